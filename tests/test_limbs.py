"""What `robot new` is sure of, and where it must ask: hips, bases and hands that are not plain."""

import numpy as np
import pytest
from figures import figure, joint, write

from s3le.onboard import limbs, reading

TILTED = '<axis xyz="0.70710678 0 0.70710678"/>'


def found(folder, text) -> limbs.Limbs:
    return limbs.find(reading.read(write(folder, text)))


def asked(it: limbs.Limbs, about: str) -> str:
    return " ".join(line for line in it.look if line.startswith(f"{about}:"))


def test_a_plain_figure_is_not_asked_about(tmp_path):
    it = found(tmp_path, figure())
    assert it.points["hip"] == "pelvis" and not asked(it, "hip") and not asked(it, "base")


def on_wheels(lift: float) -> str:
    text = figure(waist=("yaw",), legs=False)
    there = joint("waist_yaw", "pelvis", "waist_yaw_link", "0 0 0.1", "0 0 1", -0.7, 0.7)
    assert there in text
    return text.replace(there, there.replace('"pelvis"', '"base"').replace("0.1", f"{lift}"))


def test_a_base_far_below_the_shoulders_is_no_hip_and_is_asked_about(tmp_path):
    it = found(tmp_path, on_wheels(1.0))
    assert it.waist and asked(it, "hip").startswith("hip: 300 mm below the shoulders, for 'base'")
    assert it.points["hip"] == {"frame": "base", "offset": pytest.approx([0, 0, 0.92], abs=1e-4)}
    near = found(tmp_path / "near", on_wheels(0.3))
    assert near.points["hip"] == "base" and not asked(near, "hip")


def on_the_ground(height: float) -> str:
    """Base on the ground, pelvis and hips above it; both hang on the base."""
    text = figure(waist=())
    there = joint("base_joint", "base", "pelvis", kind="fixed")
    assert there in text
    text = text.replace(there, there.replace("0 0 0", f"0 0 {height}", 1))
    for side, y in (("left", 0.08), ("right", -0.08)):
        name = f"{side}_hip_pitch"
        there = joint(name, "pelvis", f"{name}_link", f"0 {y} -0.05")
        assert there in text
        here = joint(name, "base", f"{name}_link", f"0 {y} {height - 0.05}")
        text = text.replace(there, here)
    return text


def test_a_base_on_the_ground_is_no_hip_where_the_legs_are_is_and_is_asked_about(tmp_path):
    it = found(tmp_path, on_the_ground(0.8))
    assert it.points["hip"] == {"frame": "base", "offset": pytest.approx([0, 0, 0.75])}
    assert "midway between the legs, for 'base' is 1120 mm below" in asked(it, "hip")
    near = found(tmp_path / "near", on_the_ground(0.1))
    assert near.points["hip"] == "base" and not asked(near, "hip")


def leaning(ahead: float) -> str:
    text = figure(waist=())
    there = joint("torso_joint", "pelvis", "torso", "0 0 0.1", kind="fixed")
    assert there in text
    return text.replace(there, there.replace("0 0 0.1", f"{ahead} 0 0.1"))


@pytest.mark.parametrize("ahead", [0.08, -0.08])
def test_a_trunk_is_upright_at_zero_or_its_hip_is_asked_about(tmp_path, ahead):
    it = found(tmp_path, leaning(ahead))
    way = "before" if ahead > 0 else "behind"
    assert asked(it, "hip") == f"hip: 80 mm {way} 'pelvis', for a trunk is upright at zero"
    assert it.points["hip"] == {"frame": "pelvis", "offset": pytest.approx([ahead, 0, 0])}
    assert found(tmp_path / "a", leaning(ahead / 4)).points["hip"] == "pelvis"


def test_hips_that_are_tilted_do_not_tilt_the_base(tmp_path):
    text = leaning(0.1).replace('<axis xyz="0 0 1"/>', '<axis xyz="1 0 0"/>')
    for side in ("left", "right"):
        for name in (f"{side}_hip_pitch", f"{side}_hip_pitch_knee"):
            head, _, tail = text.partition(f'<joint name="{name}"')
            assert tail
            text = f'{head}<joint name="{name}"' + tail.replace('<axis xyz="0 1 0"/>', TILTED, 1)
    it = found(tmp_path, text)
    assert it.base == pytest.approx(np.eye(3)) and not asked(it, "base")


def test_a_hand_that_nothing_names_lies_on_the_middle_of_the_forearm(tmp_path):
    text = figure(wrist=False, hand_frame=False, body=lambda r, n: f'<box size="{r} {2 * r} {n}"/>')
    it = found(tmp_path, text)
    hand = it.points["l_hand"]
    assert isinstance(hand, dict) and hand["offset"][:2] == pytest.approx([0, 0], abs=1e-4)
    assert -0.21 < hand["offset"][2] < -0.18 and "far end" in asked(it, "l_hand")
