"""A robot file or URDF that cannot be used is refused in one line that says what to do."""

import os
import re
from pathlib import Path

import pytest
from worlds import (
    ARMS_URDF,
    ARMS_YAML,
    MARGIN,
    ROBOTS,
    coman,
    edited,
    write_arms,
)

from s3le.errors import RobotError, TableError
from s3le.robot import model, urdf
from s3le.robot.description import read_description
from s3le.robot.robot import Robot

MOVES = "l_shoulder, l_elbow, r_shoulder, r_elbow"
YAML_REFUSALS = {
    "missing key": ([("name: arms\n", "")], "arms.yaml: key 'name' is missing"),
    "unknown key": (
        [("hold: {}", "hold: {}\nanchr: {}")],
        "arms.yaml: unknown key 'anchr'; did you mean anchor?",
    ),
    "unlike any key": ([("hold: {}", "hold: {}\nxyzzy: 1")], "arms.yaml: unknown key 'xyzzy'"),
    "no such urdf": (
        [("arms.urdf", "nowhere.urdf")],
        "arms.yaml: urdf 'nowhere.urdf' does not exist below FOLDER",
    ),
    "base of two": (
        [("[0.0, 0.0, 0.0]", "[0.0, 0.0]")],
        "arms.yaml: base_rpy must be three angles [rad], got [0.0, 0.0]",
    ),
    "base is a word": (
        [("[0.0, 0.0, 0.0]", "[0.0, 0.0, up]")],
        "arms.yaml: base_rpy must be a number in [-100, 100], got 'up'",
    ),
    "base beyond turns": (
        [("[0.0, 0.0, 0.0]", "[0.0, 0.0, 1e300]")],
        "arms.yaml: base_rpy must be a number in [-100, 100], got 1e+300",
    ),
    "name of two lines": (
        [("name: arms", 'name: "a\\nb"')],
        "arms.yaml: name must be of letters, digits and _.+-, got 'a\\nb'",
    ),
    "a point lacks": ([("  r_hand: r_hand\n", "")], "arms.yaml: points lacks r_hand"),
    "unknown role": (
        [("  hip: body", "  hip: body\n  head: chest")],
        "arms.yaml: points has the unknown role 'head'; roles: hip, neck, r_shoulder, r_elbow, "
        "r_hand, l_shoulder, l_elbow, l_hand",
    ),
    "joints is a word": (
        [("[r_shoulder, r_elbow, l_shoulder, l_elbow]", "all")],
        "arms.yaml: joints must be a list of different joint names, got 'all'",
    ),
    "a joint twice": (
        [("[r_shoulder, r_elbow, l_shoulder, l_elbow]", "[r_elbow, r_elbow]")],
        "arms.yaml: joints must be a list of different joint names, got ['r_elbow', 'r_elbow']",
    ),
    "hold is a list": ([("hold: {}", "hold: [1]")], "arms.yaml: hold must be a mapping, got [1]"),
    "anchor is NaN": (
        [("l_shoulder: 1.5", "l_shoulder: .nan")],
        "arms.yaml: anchor.l_shoulder must be a number in [-100, 100], got nan",
    ),
    "inflation below one": (
        [("1.1", "0.9")],
        "arms.yaml: pair_inflation must be a number in [1, 10], got 0.9",
    ),
    "aliases": (
        [("hold: {}", "hold: &a {}"), ("{r_shoulder: -1.5, l_shoulder: 1.5}", "*a")],
        "arms.yaml: YAML aliases (*name) are not read; write the value out",
    ),
    "joint not in the urdf": (
        [("[r_shoulder,", "[r_shouldr,")],
        "arms.yaml: joints names 'r_shouldr', not in arms.urdf; its movable joints: " + MOVES,
    ),
    "fixed joint held": (
        [("hold: {}", "hold: {r_tip: 1}")],
        "arms.yaml: hold names 'r_tip', not in arms.urdf; its movable joints: " + MOVES,
    ),
    "held and moving": (
        [("hold: {}", "hold: {r_elbow: 1}")],
        "arms.yaml: 'r_elbow' both moves (joints) and is held (hold)",
    ),
    "held beyond its range": (
        [("hold: {}", "hold: {r_elbow: 9}"), ("r_elbow, l", "l")],
        "arms.yaml: hold of r_elbow is 9.0000, outside its range [-2.5000, 2.5000]",
    ),
    "anchor of a still joint": (
        [("{r_shoulder: -1.5", "{r_tip: -1.5")],
        "arms.yaml: anchor names 'r_tip', which does not move",
    ),
    "anchor outside limits": (
        [("r_shoulder: -1.5", "r_shoulder: -3.5")],
        "arms.yaml: anchor of r_shoulder is -3.5000 rad, outside its range [-3.0000, 3.0000]",
    ),
    "point nowhere": (
        [("r_hand: r_hand", "r_hand: hand")],
        "arms.urdf: point r_hand names 'hand', which is no joint, link or frame of it; "
        "like it: l_hand, r_hand",
    ),
    "two points in one place": (
        [("r_hand: r_hand", "r_hand: r_elbow")],
        "arms.yaml: its points leave no length for r_elbow_to_hand",
    ),
}  # fmt: skip
UPPER_BODY = '<capsule radius="0.04" length="0.2"/>'
LOST = (
    "arms.urdf: link 'r_upper' has 1 collision elements, only 0 could be read; write finite "
    'sizes, and <robot version="1.1"> where there is a <capsule>'
)
SHOULDER = 'r_shoulder" type="'
URDF_REFUSALS = {
    "continuous joint": (
        [(SHOULDER + "revolute", SHOULDER + "continuous")],
        "arms.urdf: joint 'r_shoulder' is continuous; only joints with limits move: make it "
        'revolute with lower and upper, as "s3le robot new" does',
    ),
    "prismatic joint": (
        [(SHOULDER + "revolute", SHOULDER + "prismatic")],
        "arms.urdf: joint 'r_shoulder' is JointModelPX; only revolute joints move",
    ),
    "floating joint": (
        [(SHOULDER + "revolute", SHOULDER + "floating")],
        "arms.urdf: joint 'r_shoulder' is JointModelFreeFlyer; only revolute joints move",
    ),
    "reversed limits": (
        [('lower="-3" upper="3"', 'lower="3" upper="-3"')],
        "arms.urdf: joint 'r_shoulder' needs lower < upper in [-100, 100] rad, got 3.0 and -3.0; "
        "they are reversed",
    ),
    "axis without direction": (
        [('axis xyz="1 0 0"', 'axis xyz="0 0 0"')],
        "arms.urdf: the axis of joint 'r_shoulder' has no direction",
    ),
    "capsule in an old file": (
        [(' version="1.1"', "")], LOST.replace("r_upper", "body"),
    ),
    "radius is not a number": ([('radius="0.04"', 'radius="nan"')], LOST),
    "misspelt shape": (
        [("<capsule radius=\"0.04\"", "<capsul radius=\"0.04\"")],
        "arms.urdf: <capsul> in a <geometry> is not read; did you mean capsule?",
    ),
    "misspelt collision": (
        [("<collision><origin xyz=\"0 0 -0.15\"/>", "<colision><origin xyz=\"0 0 -0.15\"/>"),
         (UPPER_BODY + "</geometry></collision>", UPPER_BODY + "</geometry></colision>")],
        "arms.urdf: <colision> in <link> 'r_upper' is not read; did you mean collision?",
    ),
    "misspelt origin of a body": (
        [("<origin xyz=\"0 0 -0.15\"/>", "<orgin xyz=\"0 0 -0.15\"/>")],
        "arms.urdf: <orgin> in a <collision> is not read; did you mean origin?",
    ),
    "misspelt attribute": (
        [('lower="-3" upper="3"', 'lowr="-3" upper="3"')],
        "arms.urdf: lowr of <limit> in <joint> 'r_shoulder' is not read; did you mean lower?",
    ),
    "an origin twice": (
        [('<axis xyz="1 0 0"/>', '<origin xyz="0 0 0.1"/><axis xyz="1 0 0"/>')],
        "arms.urdf: 2 <origin> in <joint> 'r_shoulder', one is read",
    ),
    "a link of a kilometre": (
        [('<origin xyz="0 0 -0.3"/>', '<origin xyz="0 0 -1000"/>')],
        "arms.urdf: joint 'r_elbow' lies or reaches beyond 10 m, or nowhere",
    ),
    "a huge body": (
        [('radius="0.04"', 'radius="1e308"')],
        "arms.urdf: a body of link 'r_upper' lies or reaches beyond 10 m, or nowhere",
    ),
    "limits of no joint": (
        [('lower="-3" upper="3"', 'lower="-3" upper="1e308"')],
        "arms.urdf: joint 'r_shoulder' needs lower < upper in [-100, 100] rad, got -3.0 and 1e+308",
    ),
    "negative velocity": (
        [('velocity="4"', 'velocity="-4"')],
        "arms.urdf: pinocchio cannot read it (Some components of min_velocity are greater than "
        "max_velocity)",
    ),
    "entities": (
        [("<robot", "<!DOCTYPE robot [<!ENTITY a 'a'>]><robot")],
        "arms.urdf: a DOCTYPE is not read; write its entities out",
    ),
    "another kind of file": (
        [('<robot name="arms"', '<sdf name="arms"'), ("</robot>", "</sdf>")],
        "arms.urdf: its root is <sdf>, wanted the <robot> of a URDF (and no xmlns)",
    ),
    "shape nowhere": ([('xyz="0 0 -0.15"', 'xyz="0 nan -0.15"')], LOST),
    "negative radius": (
        [('radius="0.04"', 'radius="-0.04"')],
        "arms.urdf: link 'r_upper' has a capsule whose size is not positive",
    ),
    "negative length": (
        [('length="0.2"', 'length="-0.2"')],
        "arms.urdf: link 'r_upper' has a capsule whose size is not positive",
    ),
    "flat box": (
        [(UPPER_BODY, '<box size="0.1 0 0.1"/>')],
        "arms.urdf: link 'r_upper' has a box whose size is not positive",
    ),
}  # fmt: skip


def words(refusal: Exception, folder: Path) -> str:
    """The message without the folder before the file's name."""
    text = str(refusal)
    assert "\n" not in text
    return text.removeprefix(f"{folder}{os.sep}").replace(str(folder), "FOLDER")


@pytest.mark.parametrize(("changes", "want"), YAML_REFUSALS.values(), ids=YAML_REFUSALS)
def test_a_robot_file_that_cannot_be_used_is_refused_in_one_line(tmp_path, changes, want):
    file = write_arms(tmp_path, edited(ARMS_YAML, *changes))
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(file, MARGIN, "midpoint")
    assert words(refusal.value, tmp_path) == want


@pytest.mark.parametrize(("changes", "want"), URDF_REFUSALS.values(), ids=URDF_REFUSALS)
def test_a_urdf_that_cannot_be_used_is_refused_in_one_line(tmp_path, changes, want):
    file = write_arms(tmp_path, urdf=edited(ARMS_URDF, *changes))
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(file, MARGIN, "midpoint")
    assert words(refusal.value, tmp_path) == want


BOMB = "a: &a [x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 10)}]\n" for i in range(20)
)


@pytest.mark.parametrize(
    ("content", "want"),
    [
        (b"", "expected a mapping with the keys name, urdf, base_rpy"),
        (b"- coman\n", "expected a mapping with the keys name, urdf, base_rpy"),
        (bytes(range(256)) * 9, "not readable as YAML ('utf-8' codec can't decode byte 0x80"),
        (b"\0" * 64, "not readable as YAML (unacceptable character #x0000"),
        (ARMS_YAML.encode("utf-16"), "not readable as YAML ('utf-8' codec"),
        (ARMS_YAML.encode() + b"name: again\n", "not readable as YAML (while constructing"),
        (ARMS_YAML.encode() + b"---\nname: b\n", "not readable as YAML (expected a single doc"),
        (BOMB.encode(), "YAML aliases (*name) are not read"),
        (b"[" * 10_000 + b"]" * 10_000, "nested deeper than 32 levels in line 1"),
        (b"name: " + b"9" * 5000, "not readable as YAML (Exceeds the limit"),
        (b"#" * 40_000, "longer than the 32 KiB that are read"),
        (b"name: !!python/name:os.system ''", "not readable as YAML (could not determine a con"),
    ],
    ids=["empty", "list", "binary", "zeros", "utf-16", "key twice", "two documents", "bomb",
         "deep", "endless number", "long", "python tag"],
)  # fmt: skip
def test_what_is_no_robot_file_is_refused_in_one_short_line(tmp_path, content, want):
    file = tmp_path / "robot.yaml"
    file.write_bytes(content)
    with pytest.raises(RobotError, match=re.escape(want)) as refusal:
        read_description(file)
    assert str(refusal.value).startswith(f"{file}: ")
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < len(str(file)) + 200


def test_a_missing_robot_is_answered_with_the_ones_there_are():
    with pytest.raises(RobotError) as refusal:
        model.load(ROBOTS / "coma.yaml")
    assert str(refusal.value) == (
        f"{ROBOTS / 'coma.yaml'} does not exist; robots here: "
        + ", ".join(sorted(file.stem for file in ROBOTS.glob("*.yaml")))
    )


def test_a_folder_is_no_robot_file(tmp_path):
    with pytest.raises(RobotError, match="not readable as YAML"):
        model.load(tmp_path)


@pytest.mark.parametrize(
    "content",
    [b"", bytes(range(256)) * 9, ARMS_URDF.encode()[:700],
     edited(ARMS_URDF, ('<link name="chest"/>', '<link name="chest"/><link name="two"/>')).encode(),
     edited(ARMS_URDF, (UPPER_BODY, '<mesh filename="package://none/arm.stl"/>')).encode()],
    ids=["empty", "binary", "truncated", "two roots", "mesh that is not there"],
)  # fmt: skip
def test_a_malformed_urdf_is_refused_in_one_line(tmp_path, content):
    file = write_arms(tmp_path)
    (tmp_path / "arms.urdf").write_bytes(content)
    with pytest.raises(RobotError, match="pinocchio cannot read it|not well-formed XML") as refusal:
        model.load(file)
    assert str(refusal.value).startswith(str(tmp_path / "arms.urdf"))
    assert "\n" not in str(refusal.value)


def test_a_mesh_is_refused_with_the_shapes_that_can_be_used(tmp_path):
    corners = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
    facets = ""
    for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        facets += "facet normal 0 0 1\nouter loop\n"
        facets += "".join(f"vertex {x} {y} {z}\n" for x, y, z in (corners[i] for i in face))
        facets += "endloop\nendfacet\n"
    (tmp_path / "arm.stl").write_text(f"solid arm\n{facets}endsolid arm\n")
    mesh = f'<mesh filename="{tmp_path / "arm.stl"}"/>'
    file = write_arms(tmp_path, urdf=edited(ARMS_URDF, (UPPER_BODY, mesh)))
    with pytest.raises(RobotError) as refusal:
        model.load(file)
    assert str(refusal.value) == (
        f"{file.with_suffix('.urdf')}: link 'r_upper' has a BVHModelOBBRSS for collision; "
        "use capsules, spheres, cylinders or boxes"
    )


def test_a_robot_without_collision_geometry_is_refused(tmp_path):
    bare = re.sub(r"<collision>.*?</collision>", "", ARMS_URDF, flags=re.DOTALL)
    with pytest.raises(RobotError) as refusal:
        model.load(write_arms(tmp_path, urdf=bare))
    assert words(refusal.value, tmp_path) == (
        "arms.urdf: no collision geometry, so nothing could be checked; s3le robot new puts "
        "capsules around meshes"
    )


def test_a_urdf_name_that_no_file_can_have_is_a_file_that_is_not_there(tmp_path):
    file = write_arms(tmp_path, edited(ARMS_YAML, ("arms.urdf", "a" * 5000)))
    with pytest.raises(RobotError, match="does not exist below"):
        model.load(file)


def test_an_element_of_an_extension_is_no_slip(tmp_path):
    more = '<gazebo reference="chest"/><drake:declare xmlns:drake="d"/><ros2_control/>'
    urdf = edited(ARMS_URDF, ('<link name="chest"/>', f'<link name="chest"/>{more}'))
    assert model.load(write_arms(tmp_path, urdf=urdf)).n_dof == 4


def test_what_the_urdf_reader_prints_is_part_of_the_refusal_and_printed_nowhere(tmp_path, capfd):
    file = write_arms(tmp_path, urdf=edited(ARMS_URDF, ('velocity="4"', 'velocity="fast"')))
    with pytest.raises(RobotError, match=r"pinocchio cannot read it \(.*velocity.*fast"):
        model.load(file)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("closed", [False, True], ids=["open", "closed"])
def test_standard_error_is_as_before_after_a_quiet_block(closed, capfd):
    printed = []
    kept = os.dup(2)
    try:
        if closed:
            os.close(2)
        with pytest.raises(ZeroDivisionError), urdf.quiet(printed):
            if not closed:
                os.write(2, b"Error:   one\n  at line 7 in x\n")
            1 / 0  # noqa: B018
    finally:
        os.dup2(kept, 2)
        os.close(kept)
    os.write(2, b"two\n")
    assert printed == ([] if closed else ["Error: one"])
    assert capfd.readouterr().err == "two\n"


@pytest.mark.parametrize(
    "text",
    ['{"neck": "joint"}', '{"margin": "0.1", "neck": "joint"}', '{"margin": -1, "neck": "joint"}',
     '{"margin": 0.002, "neck": "thorax"}', '{"margin": 0.002, "margin": 0.001, "neck": "joint"}',
     "[" * 100_000],
    ids=["no margin", "a word", "negative", "another neck", "twice", "deep"],
)  # fmt: skip
def test_damaged_settings_of_a_machine_are_refused(tmp_path, text):
    coman().write(tmp_path)
    (tmp_path / "settings.json").write_text(text)
    with pytest.raises((RobotError, TableError), match="settings.json.*dvc repro robot"):
        Robot.read(tmp_path)


def test_an_unknown_neck_is_refused(tmp_path):
    with pytest.raises(RobotError) as refusal:
        Robot.from_file(write_arms(tmp_path), MARGIN, "thorax")
    assert str(refusal.value) == "neck must be one of midpoint, joint, got 'thorax'"
