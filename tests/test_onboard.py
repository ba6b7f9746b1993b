"""`s3le robot new`: what it proposes for robots of many kinds, and what it says of broken ones."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio
import pytest
from figures import BOX, dae, figure, joint, link, obj, stl, stripped, write
from typer.testing import CliRunner
from worlds import MARGIN, people

from s3le.cli.main import app
from s3le.errors import RobotError
from s3le.kernels import batch
from s3le.motion import whole
from s3le.onboard import propose, source, survey
from s3le.robot import hulls, pairs, sense
from s3le.robot.robot import Robot
from s3le.skeleton import BONES, cosine_distance, features
from s3le.tuples.ik import ground_truth

SIDES = {"r": "right", "l": "left"}
ALL_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")


class Added(NamedTuple):
    proposal: propose.Proposal
    robot: Robot


def proposed(folder, text, name="figure", **options) -> propose.Proposal:
    return propose.propose(write(folder, text), name, MARGIN, "midpoint", **options)


def new(folder, text, **options) -> Added:
    """Proposed, written and read again."""
    made = proposed(folder, text, **options)
    propose.write(made, folder / "robots", force=True)
    return Added(made, Robot.from_file(folder / "robots" / "figure.yaml", MARGIN, "midpoint"))


def arm_joints(arms="lr", names="{side}_{part}"):
    return {names.format(side=SIDES[s], part=p) for s in arms for p in ALL_ARM}


def through(made: Robot, n: int = 40) -> None:
    """The earliest stages and a look-up: poses, certified, and people answered with them."""
    q = np.random.default_rng(3).uniform(made.lower, made.upper,
                                         (n, made.n_dof))  # fmt: skip
    found = batch.project(made.chain, made.anchor, q, MARGIN)
    made.certifier().require(found.q, MARGIN)
    x = batch.skeletons(made.chain, found.q)
    assert np.linalg.norm(x.reshape(n, 7, 3), axis=2) == pytest.approx(1.0, abs=1e-9)
    seen, ok = features(people(3, 5))
    assert ok.all()
    seen = made.seen(seen)
    far = np.array([cosine_distance(x, human, made.followed).min() for human in seen])
    best, to_human = ground_truth(made, seen, 4, 1e-4, np.random.default_rng(0))
    made.certifier().require(best, MARGIN)
    assert (to_human <= far + 1e-6).all()


# --- what is proposed


WORLDS = {
    "plain": {},
    "base rolled": {"base": "1.5707963267948966 0 0"},
    "base on its back, turned": {"base": "0 -1.5707963267948966 0.7"},
    "facing backwards": {"base": "0 0 3.141592653589793"},
    "no waist": {"waist": ()},
    "one waist joint": {"waist": ("yaw",)},
    "two waist joints": {"waist": ("pitch", "roll")},
    "arms forward at zero": {"forward": True},
    "no legs": {"legs": False},
    "other names": {"names": "{part}_{side}_joint"},
    "no wrist, a hand's frame": {"wrist": False},
}


@pytest.mark.parametrize("options", WORLDS.values(), ids=WORLDS)
def test_parts_base_and_joints_are_found(tmp_path, options):
    made = new(tmp_path, figure(**options))
    robot = made.robot
    names = options.get("names", "{side}_{part}")
    waist = {f"waist_{part}" for part in options.get("waist", ("yaw", "roll", "pitch"))}
    assert set(robot.joint_names) == arm_joints(names=names) | waist
    at = {k: v[0] for k, v in sense.points(robot, np.zeros((1, robot.n_dof))).items()}
    way = np.array([1.0, 0, 0]) if options.get("forward") else np.array([0, 0, -1.0])
    for side, y in (("r", -0.17), ("l", 0.17)):
        shoulder = at[f"{side}_shoulder"] - at["hip"]
        assert shoulder == pytest.approx([0, y, 0.32], abs=1e-6)
        assert at[f"{side}_elbow"] - at["hip"] == pytest.approx(shoulder + 0.28 * way, abs=1e-6)
        assert at[f"{side}_hand"] - at["hip"] == pytest.approx(shoulder + 0.52 * way, abs=1e-6)
    report = made.robot.certifier().check(robot.anchor[None])
    assert report.clearance[0] >= MARGIN and report.limit_margin[0] >= 0.0


def test_what_names_do_not_tell_geometry_does(tmp_path):
    made = new(tmp_path, figure(names="{part}{side}", legs=False).replace("right", "A")
               .replace("left", "B").replace("shoulder_", "s").replace("elbow", "e"))  # fmt: skip
    description = made.robot.description
    assert description.points["l_elbow"].frame == "eB"
    assert any("names tell no sides" in line for line in made.proposal.look)
    assert any("by geometry alone" in line for line in made.proposal.look)


@pytest.mark.parametrize("side", ["r", "l"])
def test_a_robot_with_one_arm_is_followed_in_four_vectors(tmp_path, side):
    made = new(tmp_path, figure(arms=side)).robot
    other = "l" if side == "r" else "r"
    assert made.vectors == tuple(
        bone for bone in BONES if f"_{other}_" not in bone and not bone.startswith(f"{other}_")
    )
    assert len(made.vectors) == 4
    through(made)


def test_a_robot_without_waist_is_followed_in_its_arms(tmp_path):
    made = new(tmp_path, figure(waist=())).robot
    assert made.vectors == tuple(b for b in BONES if "elbow" in b)
    x, _ = features(people(5, 1))
    seen = made.seen(x).reshape(5, 7, 3)
    own = batch.skeletons(made.chain, made.anchor[None]).reshape(7, 3)
    for b, bone in enumerate(BONES):
        want = x.reshape(5, 7, 3)[:, b] if bone in made.vectors else own[b]
        assert seen[:, b] == pytest.approx(np.broadcast_to(want, (5, 3)), abs=1e-12)
    through(made)


def test_distances_are_means_over_the_vectors_that_are_followed(tmp_path):
    made = new(tmp_path, figure(arms="r")).robot
    x, _ = features(people(6, 2))
    a, b = made.seen(x[:3]), made.seen(x[3:])
    every = cosine_distance(a, b) * 7
    assert cosine_distance(a, b, made.followed) == pytest.approx(every / 4, rel=1e-9)


def test_the_same_urdf_gives_the_same_bytes(tmp_path):
    one, two = (proposed(tmp_path / name, figure()) for name in "ab")
    assert one.files == two.files


def test_a_robot_file_stands_by_itself_and_survives_being_written_and_read(tmp_path):
    made = proposed(tmp_path / "from", figure())
    propose.write(made, tmp_path / "robots", force=False)
    (tmp_path / "from" / "figure.urdf").unlink()
    read = Robot.from_file(tmp_path / "robots" / "figure.yaml", MARGIN, "midpoint")
    read.write(tmp_path / "robot")
    assert Robot.read(tmp_path / "robot").tag == read.tag


def test_what_is_there_is_not_overwritten_unless_asked(tmp_path):
    made = proposed(tmp_path, figure())
    (tmp_path / "robots").mkdir()
    mine = tmp_path / "robots" / "figure.yaml"
    mine.write_text("mine")
    with pytest.raises(RobotError, match="figure.yaml exists; give another --name, or --force"):
        propose.write(made, tmp_path / "robots", force=False)
    assert mine.read_text() == "mine"
    assert [p.name for p in (tmp_path / "robots").iterdir()] == ["figure.yaml"]
    propose.write(made, tmp_path / "robots", force=True)
    assert mine.read_bytes() == made.files["figure.yaml"]


def test_the_urdf_that_is_read_is_never_replaced(tmp_path):
    urdf = write(tmp_path / "robots" / "urdf", figure())
    before = urdf.read_bytes()
    made = propose.propose(urdf, "figure", MARGIN, "midpoint")
    with pytest.raises(RobotError, match="is the URDF that was read"):
        propose.write(made, tmp_path / "robots", force=True)
    assert urdf.read_bytes() == before


def test_where_no_named_pose_is_feasible_an_anchor_is_searched(tmp_path):
    """Arms that reach neither the T-pose nor 40 degrees below it, and hang inside the torso."""
    text = figure(torso='<box size="0.14 0.44 0.3"/>', legs=False)
    text = text.replace('lower="-3.0" upper="0.2"', 'lower="-0.25" upper="0.2"')
    text = text.replace('lower="-0.2" upper="3.0"', 'lower="-0.2" upper="0.25"')
    made = new(tmp_path, text)
    assert made.proposal.found.how == "search"
    assert any(line.startswith("anchor: search") for line in made.proposal.look)
    made.robot.certifier().require(made.robot.anchor[None], MARGIN)
    assert pairs.anchor_collision(made.robot, list(made.robot.pairs)) is None


def test_a_continuous_joint_gets_limits_and_is_told(tmp_path):
    made = new(tmp_path, figure(elbow_kind="continuous"))
    limits = {j.name: (j.lower, j.upper) for j in made.robot.joints}
    assert limits["left_elbow"] == pytest.approx((-np.pi, np.pi), abs=1e-6)
    assert any("'left_elbow' is continuous" in line for line in made.proposal.look)


def test_a_joint_that_cannot_stand_at_zero_is_held_as_near_as_it_can(tmp_path):
    knee = 'name="left_hip_pitch_knee"'
    text = figure()
    at = text.index(knee)
    text = text[:at] + text[at:].replace('lower="-2.0"', 'lower="0.3"', 1)
    made = new(tmp_path, text)
    assert made.robot.description.hold == {"left_hip_pitch_knee": 0.3}


def test_a_speed_limit_that_is_none_is_replaced_and_told(tmp_path):
    made = new(tmp_path, figure().replace('velocity="4"', 'velocity="0"'))
    assert {round(j.velocity, 4) for j in made.robot.joints} == {3.1416}
    assert any(line.startswith("velocity:") for line in made.proposal.look)


# --- bodies


@pytest.mark.parametrize("form", [stl, obj, dae], ids=["stl", "obj", "dae"])
def test_meshes_of_every_format_become_capsules_that_contain_them(tmp_path, form, monkeypatch):
    corners = BOX * [0.07, 0.11, 0.15]
    package = tmp_path / "elsewhere" / "parts"
    package.mkdir(parents=True)
    (package / f"torso.{form.__name__}").write_bytes(form(corners))
    mesh = f'<mesh filename="package://parts/torso.{form.__name__}"/>'
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
    made = new(tmp_path / "urdf", figure(torso=mesh))
    body = next(item for item in made.proposal.made if item.kind == "mesh")
    assert np.unique(np.concatenate(body.points), axis=0).shape[0] >= 8
    bodies = [b for b in made.robot.bodies if b.link == "waist_pitch_link"]
    assert len(bodies) == len(body.capsules)
    grid = np.linspace(-1, 1, 9)
    solid = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    solid = solid * [0.07, 0.11, 0.15] + [0, 0, 0.15]
    outside = np.min([_outside(solid, b) for b in bodies], axis=0)
    assert outside.max() <= 1e-7  # [m], float32 of the STL


def _outside(points, body) -> np.ndarray:
    """How far points lie outside a body [m]; written anew, for what is judged has its own."""
    d = body.b - body.a
    t = np.clip((points - body.a) @ d / max(d @ d, 1e-300), 0, 1)
    return np.linalg.norm(points - body.a - t[:, None] * d, axis=1) - body.radius


def test_primitives_and_tagged_capsules_stay_what_they_are(tmp_path):
    tagged = '<collision_checking><capsule name="head_c"/></collision_checking>'
    text = figure().replace(
        link("head", '<sphere radius="0.08"/>', "0 0 0.06"),
        link("head", '<cylinder radius="0.08" length="0.1"/>', "0 0 0.06", more=tagged),
    )
    robot = new(tmp_path, text).robot
    bodies = {b.link: b for b in robot.bodies}
    assert bodies["head"].shape == "capsule" and bodies["head"].radius == 0.08
    assert np.linalg.norm(bodies["head"].b - bodies["head"].a) == pytest.approx(0.1)
    assert bodies["left_upper"].shape == "capsule" and bodies["left_palm"].shape == "sphere"
    corners = BOX * [0.07, 0.1, 0.06]
    pelvis = [b for b in robot.bodies if b.link == "pelvis"]
    assert np.min([_outside(corners, b) for b in pelvis], axis=0).max() <= 1e-9


def test_a_list_of_spheres_takes_the_place_of_a_link_s_geometry(tmp_path):
    listed = tmp_path / "spheres.yaml"
    listed.write_text(
        "collision_spheres:\n  head:\n  - {center: [0, 0, 0.05], radius: 0.09}\n"
        "  - {center: [0.02, 0, 0.1], radius: 0.05}\n"
    )
    robot = new(tmp_path, figure(), spheres=listed).robot
    found = sorted((b.radius, *b.a) for b in robot.bodies if b.link == "head")
    offset = next(b for b in robot.bodies if b.link == "head").a[2] - 0.05
    assert [f[0] for f in found] == [0.05, 0.09] and offset >= 0.0
    for bad in ("head: [1]", "head: [{center: [0, 0], radius: 1}]", "nose: []",
                "head: [{center: [0, 0, 0], radius: 0}]", "- 1", "head: 3"):  # fmt: skip
        listed.write_text(bad)
        with pytest.raises(RobotError, match="spheres|mapping"):
            proposed(tmp_path, figure(), spheres=listed)


# --- pairs


def test_an_srdf_takes_pairs_off_beside_the_anchor_s_and_they_are_listed(tmp_path):
    file = tmp_path / "figure.srdf"
    file.write_text(
        '<robot name="f"><group name="g"/><disable_collisions link1="head" link2="left_fore" '
        'reason="Never"/><disable_collisions link1="ghost" link2="head" reason="Never"/></robot>'
    )
    plain, made = new(tmp_path, figure()), new(tmp_path, figure(), srdf_file=file)
    lost = [p for p in made.robot.pairs if p.reason == f"{pairs.DISABLED} (Never)"]
    names = [made.robot.bodies[k].link for p in lost for k in (p.a, p.b)]
    assert sorted(names) == ["head", "left_fore"]
    assert len(made.robot.watched) == len(plain.robot.watched) - 1
    assert made.robot.digest != plain.robot.digest
    told = "\n".join(survey.lines(made.robot, survey.survey(made.robot, 60), True))
    assert "head_0 and left_fore_0" in told and "disabled by the SRDF (Never): 1" in told
    made.robot.write(tmp_path / "robot")
    assert Robot.read(tmp_path / "robot").tag == made.robot.tag


@pytest.mark.parametrize(
    ("content", "want"),
    [("", "not well-formed"), ("<srdf/>", "its root is <srdf>"),
     ('<robot><disable_collisions link1="a"/></robot>', "needs link1 and link2"),
     ('<!DOCTYPE a><robot/>', "DOCTYPE")],
    ids=["empty", "root", "half a pair", "doctype"],
)  # fmt: skip
def test_a_broken_srdf_is_refused_in_a_line(tmp_path, content, want):
    (tmp_path / "a.srdf").write_text(content)
    with pytest.raises(RobotError, match=want):
        proposed(tmp_path, figure(), srdf_file=tmp_path / "a.srdf")


def test_pairs_that_are_never_near_or_nearly_always_overlap_are_listed_and_watched(tmp_path):
    ball = '<sphere radius="0.17"/>'
    text = figure().replace(
        link("left_palm", '<sphere radius="0.05"/>', "0 0 -0.05"),
        link("left_palm", ball, "0 0 -0.05"),
    ).replace(link("head", '<sphere radius="0.08"/>', "0 0 0.06"),
              link("head", '<sphere radius="0.02"/>', "0 0 0.06"))  # fmt: skip
    made = new(tmp_path, text).robot
    found = survey.survey(made, 400)
    q = sense.poses(made, 400)
    apart = batch.pair_distances(made.chain, q)
    assert {k for k, _ in found.never} == set(np.flatnonzero(apart.min(axis=0) >= survey.NEVER))
    assert found.never
    assert {k for k, _ in found.always} == set(
        np.flatnonzero((apart < 0).mean(axis=0) >= survey.ALWAYS)
    )
    assert apart.min(axis=1) == pytest.approx(batch.clearances(made.chain, q), abs=1e-12)
    assert 0.0 < found.colliding < 1.0 and found.apart < 1e-9


def test_hulls_see_what_nobody_watches(tmp_path):
    made = new(tmp_path, figure(), with_hulls=True).robot
    check = hulls.HullCheck(made)
    assert set(check.links) == {"pelvis", "waist_pitch_link"}  # the boxes; the rest is round
    assert check.pairs == []  # neighbours: nothing solid lies between them
    # Forearms hang 0.34 m apart; cubes of 0.2 m leave 0.14 m, ones 0.37 m wide overlap by 0.03.
    for half, depth in ((0.1, 0.0), (0.185, 0.03)):
        cube = BOX * [0.1, half, 0.1]
        sizes = {"left_fore/0": cube, "right_fore/0": cube, "waist_pitch_link/0": BOX * 0.01}
        np.savez(tmp_path / "cubes.npz", **sizes)
        check = hulls.HullCheck(made, tmp_path / "cubes.npz")
        assert [check.name(k) for k in range(len(check.pairs))] == ["left_fore and right_fore"]
        found = check.check(np.zeros((1, made.n_dof)))
        assert found.depth[0] == pytest.approx(depth, abs=1e-6)
    (tmp_path / "bad.npz").write_bytes(b"PK\3\4 no")
    with pytest.raises(RobotError, match="bad.npz"):
        hulls.HullCheck(made, tmp_path / "bad.npz")


# --- refusals

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


# --- robots as they are sold


PACKAGES = {
    "jvrc": ("jvrc_description", "urdf/jvrc1.urdf"),
    "g1": ("example-robot-data", "g1_description/urdf/g1_29dof_rev_1_0.urdf"),
    "talos": ("example-robot-data", "talos_data/robots/talos_reduced.urdf"),
    "romeo": ("example-robot-data", "romeo_description/urdf/romeo.urdf"),
}
POINTS = {  # hip, shoulder, elbow, hand of the left side, and the waist
    "jvrc": ("PELVIS_S", "L_SHOULDER_R", "L_ELBOW_P", "L_WRIST_R", 3),
    "g1": ("pelvis", "left_shoulder_roll_joint", "left_elbow_joint", "left_wrist_pitch_joint", 3),
    "talos": ("base_link", "arm_left_3_joint", "arm_left_4_joint", "arm_left_6_joint", 2),
    "romeo": ("body", "LShoulderYaw", "LElbowYaw", "LWristYaw", 1),
}


def urdf_of(robot: str) -> Path:
    package, file = PACKAGES[robot]
    if package == "jvrc_description":
        home = Path(pytest.importorskip("jvrc_description").__file__).parent
    else:
        roots = [Path(p) / "cmeel.prefix/share/example-robot-data/robots" for p in sys.path]
        home = next((root for root in roots if root.is_dir()), None)
        if home is None:
            pytest.skip("example-robot-data is not installed (pip install .[robots])")
    return home / file


@pytest.fixture(scope="module")
def sold(tmp_path_factory):
    """Robots of packages, proposed once."""
    made = {}

    def get(robot: str) -> tuple[propose.Proposal, Robot]:
        if robot not in made:
            folder = tmp_path_factory.mktemp(robot)
            urdf = urdf_of(robot)
            found = propose.propose(urdf, robot, MARGIN, "midpoint", with_hulls=robot == "jvrc")
            propose.write(found, folder, force=False)
            made[robot] = found, Robot.from_file(folder / f"{robot}.yaml", MARGIN, "midpoint")
        return made[robot]

    return get


@pytest.mark.parametrize("robot", PACKAGES)
def test_a_robot_of_a_package_goes_from_its_urdf_to_an_answer(sold, robot):
    found, made = sold(robot)
    hip, shoulder, elbow, hand, waist = POINTS[robot]
    places = made.description.points
    named = [places[role].frame for role in ("hip", "l_shoulder", "l_elbow", "l_hand")]
    assert named == [hip, shoulder, elbow, hand]
    assert made.n_dof == waist + 8
    assert made.base_rotation == pytest.approx(np.eye(3), abs=1e-9)
    through(made, 20)


@pytest.mark.parametrize("robot", PACKAGES)
def test_a_whole_robots_file_has_the_joints_of_the_urdf_that_was_read(sold, robot):
    _, made = sold(robot)
    tree = ElementTree.parse(urdf_of(robot)).getroot()
    items = tree.findall("joint")
    moves = [item for item in items if item.get("type") != "fixed"]
    mimics = [item.get("name") for item in moves if item.find("mimic") is not None]
    found = whole.joints(made)
    names = [item.get("name") for item in moves if item.get("name") not in mimics]
    assert [joint.name for joint in found.joints] == names
    assert list(found.mimics) == mimics
    for part in tree.findall("link"):  # MuJoCo's numbers of the joints, without any mesh
        for shape in [*part.findall("visual"), *part.findall("collision")]:
            part.remove(shape)
    extra = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(extra, "compiler", boundmass="1", boundinertia="1")
    it = mujoco.MjModel.from_xml_string(ElementTree.tostring(tree, encoding="unicode"))
    numbered = [it.joint(i).name for i in range(it.njnt)]
    assert list(found.depth_first) == [name for name in numbered if name in names]
    still = sum(joint.moved < 0 for joint in found.joints)
    assert still == len(names) - made.n_dof > 10


@pytest.mark.parametrize("robot", ["jvrc"])
def test_every_vertex_of_every_mesh_lies_in_a_capsule_of_its_link(sold, robot):
    _, made = sold(robot)
    urdf = str(urdf_of(robot))
    model = pinocchio.buildModelFromUrdf(urdf)
    geometry = pinocchio.buildGeomFromUrdf(  # pinocchio's own reading of URDF and meshes
        model,
        urdf,
        pinocchio.GeometryType.COLLISION,
        package_dirs=[str(urdf_of(robot).parents[2])],
    )
    seen = 0
    full = pinocchio.buildModelFromUrdf(str(made.description.urdf))
    mine = pinocchio.buildGeomFromUrdf(
        full, str(made.description.urdf), pinocchio.GeometryType.COLLISION
    )
    for item in geometry.geometryObjects:
        link = model.frames[item.parentFrame].name
        at = model.frames[item.parentFrame].placement.actInv(item.placement)
        vertices = np.array(item.geometry.vertices()) @ at.rotation.T + at.translation
        outside = np.full(len(vertices), np.inf)
        for body in mine.geometryObjects:
            if full.frames[body.parentFrame].name == link:
                own = full.frames[body.parentFrame].placement.actInv(body.placement)
                along = own.rotation[:, 2] * getattr(body.geometry, "halfLength", 0.0)
                rel = vertices - (own.translation - along)
                t = np.clip(rel @ along / max(2 * along @ along, 1e-300), 0, 1)
                far = np.linalg.norm(rel - 2 * t[:, None] * along, axis=1) - body.geometry.radius
                outside = np.minimum(outside, far)
        assert outside.max() <= 1e-9, link  # [m]
        seen += len(vertices)
    assert seen > 4000


def test_the_survey_of_a_real_robot_says_what_its_capsules_add_and_its_hulls_find(sold):
    found, made = sold("jvrc")
    assert all(body.grown >= 1.0 and body.adds > 0.0 for body in found.made)
    told = "\n".join(survey.lines(made, survey.survey(made, 300), False))
    for words in ("11 joints", "7 of 7 are followed", "in collision", "by kernels", "by coal",
                  "hulls of the meshes at"):  # fmt: skip
        assert words in told


def test_the_command_line_proposes_draws_checks_and_refuses(tmp_path):
    urdf = write(tmp_path, figure())
    run = CliRunner().invoke
    words = ["robot", "new", str(urdf), "--name", "fig", "--out", str(tmp_path / "robots")]
    done = run(app, words)
    assert done.exit_code == 0, done.output
    assert "sure: waist:" in done.output and "--robot" in done.output
    assert (tmp_path / "robots" / "fig.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert sorted(p.name for p in (tmp_path / "robots").rglob("*.*")) == [
        "fig.png", "fig.urdf", "fig.yaml",
    ]  # fmt: skip
    again = run(app, words)
    assert again.exit_code == 2 and "fig.urdf exists; give another --name" in again.output
    file = tmp_path / "robots" / "fig.yaml"
    checked = run(app, ["robot", "check", str(file), "--poses", "50"])
    assert checked.exit_code == 0 and "left_elbow" in checked.output
    file.write_text(file.read_text().replace("urdf/fig.urdf", "urdf/no.urdf"))
    broken = run(app, ["robot", "check", str(file)])
    assert broken.exit_code == 2 and "does not exist below" in broken.output
