"""`s3le robot new`: what it says of robots that cannot be used."""

import numpy as np
import pytest
from figures import BOX, figure, joint, link, stl, stripped, write
from onboarded import proposed
from worlds import MARGIN

from s3le.errors import RobotError
from s3le.onboard import propose, source
from s3le.robot.robot import Robot

MIMIC = '<mimic joint="{0}" multiplier="-1"/>'
GRIP = link("finger") + joint("grip", "left_palm", "finger", more=MIMIC.format("left_elbow"))
REVERSED = {"elbow": (2.3, -0.1)}
REFUSALS = {
    "no such file": (None, {}, "does not exist; give the URDF"),
    "urdfdom refuses": (figure().replace('velocity="4"', 'velocity="fast"'), {},
                        r"urdfdom or pinocchio refuse it \(.*fast.*correct that element"),
    "two roots": (figure(extra=link("alone")), {}, "urdfdom or pinocchio refuse it"),
    "missing mesh": (figure(torso='<mesh filename="no.stl"/>'), {}, "no.stl, which does not exist"),
    "missing package": (figure(torso='<mesh filename="package://p/no.stl"/>'), {},
                        "package 'p' lies with --package-path or ROS_PACKAGE_PATH"),
    "no geometry at all": (
        stripped(figure()), {},
        "no collision geometry at all and nothing is drawn"),
    "reversed limits": (figure(**REVERSED), {}, "has its limits reversed, lower 2.3 and upper"),
    "stiff elbow": (figure(elbow=(-0.01, 0.01)), {}, "no joint of the arm .* bends it"),
    "mimic in the arm": (figure(elbow_more=MIMIC.format("waist_yaw")), {},
                         "figure.urdf: joint '.*_elbow' mimics 'waist_yaw' and cannot"),
    "mimic of the arm": (figure(extra=GRIP), {}, "would move with it, which is not modelled"),
    "no arms": (figure(arms=""), {}, "no arm is found"),
    "name": (figure(), {"name": "a b"}, "letters, digits"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "options", "want"), REFUSALS.values(), ids=REFUSALS)
def test_what_cannot_be_used_is_refused_in_a_line_that_says_what_to_do(
    tmp_path, text, options, want
):
    with pytest.raises(RobotError, match=want) as refusal:
        if text is None:
            propose.propose(tmp_path / "none.urdf", "a", MARGIN, "midpoint")
        proposed(tmp_path, text, **options)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "want"),
    [(b"", "not readable as a mesh|without triangles"),
     (b"solid a\nendsolid a\n", "triangles|mesh"),
     (stl(BOX * 200.0), "beyond 10 m.*millimetres"), (stl(BOX * np.nan), "millimetres|mesh|trian")],
    ids=["empty", "no facet", "millimetres", "nan"],
)  # fmt: skip
def test_a_mesh_that_is_none_is_refused(tmp_path, content, want):
    (tmp_path / "torso.stl").write_bytes(content)
    with pytest.raises(RobotError, match=want):
        source.read(write(tmp_path, figure(torso='<mesh filename="torso.stl"/>')))


POINT_CHANGES = {
    "left and right swapped": (
        lambda t: t.replace("  r_", "  @_").replace("  l_", "  r_").replace("  @_", "  l_"),
        "r_shoulder lies to the left of l_shoulder; swap"),
    "facing backwards": (lambda t: t.replace("base_rpy: [0.0, 0.0, 0.0]",
                                             "base_rpy: [0.0, 0.0, 3.14159]"), "turn base_rpy"),
    "upside down": (lambda t: t.replace("hip: pelvis", "hip: head"), "shoulders lie below the hip"),
    "stiff elbow": (lambda t: t.replace(", left_elbow,", ",", 1), "l_elbow cannot bend"),
    "half an arm": (lambda t: t.replace("  l_hand: left_wrist_pitch\n", ""), "points lacks l_hand"),
    "an offset of two": (lambda t: t.replace("hip: pelvis",
                                             "hip: {frame: pelvis, offset: [0, 0]}"), "points.hip"),
    "speed of a still joint": (lambda t: t.replace("velocity: {}", "velocity: {head: 1}"),
                               "velocity names 'head'"),
    "no speed": (lambda t: t.replace("velocity: {}", "velocity: {left_elbow: 0}"),
                 "velocity.left_elbow"),
    "no srdf": (lambda t: t.replace("velocity: {}", "velocity: {}\nsrdf: urdf/no.srdf"),
                "srdf 'urdf/no.srdf' does not exist"),
}  # fmt: skip


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    propose.write(proposed(folder, figure()), folder / "robots", force=False)
    return folder / "robots"


@pytest.mark.parametrize(("change", "want"), POINT_CHANGES.values(), ids=POINT_CHANGES)
def test_a_robot_file_that_makes_no_sense_is_refused_in_a_line(plain, change, want):
    text = (plain / "figure.yaml").read_text()
    body = text[text.index("points:") : text.index("\n\n# Joints")]
    changed = text.replace(body, change(body)) if change(body) != body else change(text)
    assert changed != text
    (plain / "changed.yaml").write_text(changed)
    with pytest.raises(RobotError, match=want) as refusal:
        Robot.adopt(plain / "changed.yaml", MARGIN, "midpoint")
    assert "\n" not in str(refusal.value)
