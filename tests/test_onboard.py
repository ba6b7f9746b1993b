"""`s3le robot new`: what it proposes for robots of many kinds."""

import numpy as np
import pytest
from figures import BOX, dae, figure, link, obj, stl, write
from onboarded import arm_joints, new, proposed, through
from worlds import MARGIN, people

from s3le.errors import RobotError
from s3le.kernels import batch
from s3le.onboard import propose, survey
from s3le.robot import hulls, pairs, sense
from s3le.robot.robot import Robot
from s3le.skeleton import BONES, cosine_distance, features

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
    text = figure(torso='<box size="0.14 0.44 0.44"/>', legs=False)
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
    usual, finer = ([b for b in bodies if b.fine == fine] for fine in (False, True))
    assert len(usual) == len(body.capsules) < len(finer)  # in one capsule it could not stand
    grid = np.linspace(-1, 1, 9)
    solid = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    solid = solid * [0.07, 0.11, 0.15] + [0, 0, 0.15]
    for kind in (usual, finer):
        outside = np.min([_outside(solid, b) for b in kind], axis=0)
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
