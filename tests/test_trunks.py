"""Which joints are a waist, on robots whose root, legs or base are not where most have them."""

import re

import numpy as np
from figures import figure, joint, link, write

from s3le.onboard import limbs, source

BASE = joint("base_joint", "base", "pelvis", kind="fixed")


def found(folder, text) -> limbs.Limbs:
    return limbs.find(source.read(write(folder, text)))


def names(it: limbs.Limbs, folder) -> list[str]:
    model = source.read(folder / "figure.urdf").model
    return [model.names[j] for j in it.waist]


def test_joints_of_a_floating_base_are_no_waist(tmp_path):
    """As some models have it: slides and hinges between the world and a pelvis with legs."""
    chain = "".join(
        joint(f"pelvis_{k}", "base" if k == 0 else f"f{k}", f"f{k + 1}" if k < 2 else "pelvis",
              axis=axis) for k, axis in enumerate(("0 1 0", "1 0 0", "0 0 1"))
    )  # fmt: skip
    text = figure(waist=("yaw",))
    assert BASE in text
    it = found(tmp_path, text.replace(BASE, link("f1") + link("f2") + chain))
    assert names(it, tmp_path) == ["waist_yaw"] and "waist: waist_yaw" in it.sure
    assert "held, for legs and arms hang on them alike: pelvis_0, pelvis_1, pelvis_2" in it.look


def test_a_waist_below_a_trunk_that_is_the_root_is_told_and_not_denied(tmp_path):
    text = figure(waist=())
    stiff = joint("torso_joint", "pelvis", "torso", "0 0 0.1", kind="fixed")
    assert BASE in text and stiff in text
    text = text.replace(BASE, joint("base_joint", "base", "torso", kind="fixed"))
    text = text.replace(stiff, joint("waist_yaw", "torso", "pelvis", "0 0 -0.1", axis="0 0 1"))
    it = found(tmp_path, text)
    assert names(it, tmp_path) == []
    assert not any(line.startswith("waist") for line in it.sure)
    assert sum("waist_yaw turns the legs against the trunk" in line for line in it.look) == 1


def test_a_stiff_trunk_is_still_sure(tmp_path):
    assert "waist: none, the trunk is stiff" in found(tmp_path, figure(waist=())).sure


def test_a_leg_of_pitch_joints_under_the_trunk_is_held_and_the_hip_is_where_the_waist_is(tmp_path):
    """As on wheeled robots that crouch: two long links from the base up, then a waist."""
    text = figure(waist=("pitch",), legs=False)
    lower = joint("j1", "base", "l1") + joint("j2", "l1", "l2", "0 0 0.45")
    lower += joint("top", "l2", "pelvis", "0 0 0.45", kind="fixed") + link("l1") + link("l2")
    assert BASE in text
    it = found(tmp_path, text.replace(BASE, lower))
    assert names(it, tmp_path) == ["waist_pitch"]
    assert any("as legs do: j1, j2" in line for line in it.look)
    assert not any(line.startswith("waist") for line in it.sure)
    hip, neck = it.points["hip"], it.points["neck"]
    assert hip["frame"] == "pelvis" and np.allclose(hip["offset"], [0, 0, 0.1], atol=1e-5)
    assert np.allclose(neck["offset"], [0, 0, 0.22], atol=1e-5)
    assert np.allclose(it.base, np.eye(3))


def test_a_forearm_of_which_only_the_solid_tells_the_length_has_an_elbow(tmp_path):
    text = figure(wrist=False, hand_frame=False)
    it = found(tmp_path, text)
    assert it.points["l_elbow"] == "left_elbow"
    assert it.points["l_hand"]["frame"] == "left_fore"
    bare = re.sub(r'(<link name="\w+_fore">)<collision.*?</collision>', r"\1", text)
    try:
        found(tmp_path, bare)
    except limbs.RobotError as refusal:
        assert "bends it" in str(refusal)
    else:
        raise AssertionError("an elbow of which nothing tells that it bends was taken")
