"""How a robot stands, and bodies that let it: more capsules where limbs pass, fewer elsewhere."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from figures import BOX, drawn, figure
from onboarded import new
from PIL import Image
from typer.testing import CliRunner
from worlds import MARGIN

from s3le.cli import shell
from s3le.cli.main import app
from s3le.errors import RobotError
from s3le.kernels import batch
from s3le.onboard import motion, propose, splitting, stand, survey, tight, watched
from s3le.report import robot as picture
from s3le.robot.robot import Robot

TORSO, SIDES = "waist_pitch_link", np.array([0.3, 0.24, 0.3])
DEEP = figure(torso='<box size="0.3 0.24 0.3"/>')  # arms hang 10 mm beside it
CORNERS = BOX * SIDES / 2 + [0, 0, 0.15]


def beyond(points, robot, link, fine) -> np.ndarray:
    """How far points of a link lie outside its bodies of a kind [m]; written anew, it judges."""
    far = []
    for body in (b for b in robot.bodies if b.link == link and b.fine == fine):
        d = body.b - body.a
        t = np.clip((points - body.a) @ d / max(d @ d, 1e-300), 0, 1)
        far.append(np.linalg.norm(points - body.a - t[:, None] * d, axis=1) - body.radius)
    return np.min(far, axis=0)


@pytest.fixture(scope="module")
def deep(tmp_path_factory) -> Robot:
    return new(tmp_path_factory.mktemp("deep"), DEEP, with_hulls=True, finer=True).robot


@pytest.fixture(scope="module")
def fat(tmp_path_factory) -> Robot:
    """The same with one capsule for each piece, and where it stands although they forbid it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tight.Work, "tighten", lambda *_: (set(), []))
        patch.setattr(watched.Settling, "_farther", lambda *_: None)
        return new(tmp_path_factory.mktemp("fat"), DEEP, with_hulls=True, most=1).robot


# --- how it stands


def test_arms_hang_as_straight_as_the_legs_beside_them_allow(deep):
    assert deep.stand is not None
    assert ((deep.stand >= deep.lower) & (deep.stand <= deep.upper)).all()
    assert (deep.stand[[k for k, n in enumerate(deep.joint_names) if "waist" in n]] == 0.0).all()
    bones = batch.skeletons(deep.chain, deep.stand[None]).reshape(7, 3)[[2, 3, 5, 6]]
    down = np.degrees(np.arccos(-bones[:, 2]))
    assert 1.0 < down.max() < 20.0  # the palms would be in the thighs at zero


def test_a_pose_of_the_srdf_is_taken(tmp_path):
    file = tmp_path / "a.srdf"
    file.write_text(
        '<robot name="f"><group_state name="half_sitting" group="all">'
        '<joint name="right_shoulder_roll" value="-0.3"/>'
        '<joint name="left_shoulder_roll" value="0.3"/>'
        '<joint name="root" value="0 0 1 0 0 0 1"/></group_state></robot>'
    )
    made = new(tmp_path, figure(), srdf_file=file)
    at = dict(zip(made.robot.joint_names, made.robot.stand, strict=True))
    assert at["left_shoulder_roll"] == 0.3 and at["right_shoulder_roll"] == -0.3
    assert "stand: 'half_sitting' of its file" in made.proposal.sure


@pytest.mark.parametrize(
    ("name", "roll", "room", "taken"),
    [("home", 0.25, 1.0, True), ("home", 1.5, 1.0, False), ("raised", 0.25, 1.0, False),
     ("home", 0.25, 0.0, False), ("home", 9.0, 1.0, False)],
)  # fmt: skip
def test_a_known_pose_is_taken_if_its_name_says_stand_and_its_arms_hang_clear(
    deep, name, roll, room, taken
):
    known = {name: {"left_shoulder_roll": roll, "right_shoulder_roll": -roll, "knee": 0.3}}
    found = stand.propose(deep, known, lambda q: room, MARGIN)
    assert (found.how == f"'{name}' of its file") == taken
    assert stand.hanging(deep, found.q) > 0.9


def test_keyframes_give_angles_by_joint_and_those_of_another_length_nothing():
    width = {"<freejoint>": 7, "a": 1, "ball": 4, "b": 1}
    text = (
        '<mujoco><keyframe><key name="home" qpos="0 0 1 1 0 0 0  0.5  1 0 0 0  -0.25"/>'
        '<key name="short" qpos="0 0 1"/><key name="odd" qpos="x"/></keyframe></mujoco>'
    )
    found = stand.keys(ElementTree.fromstring(text), width)
    assert found == {"home": {"a": 0.5, "b": -0.25}}


def test_the_file_says_it_and_reading_keeps_it(deep, tmp_path):
    deep.write(tmp_path / "robot")
    assert Robot.read(tmp_path / "robot").stand == pytest.approx(deep.stand, abs=0.0)


# --- bodies that let it


def test_a_deep_torso_forbids_hanging_arms_in_one_capsule_and_not_in_several(deep, fat):
    fat_says, deep_says = (survey.standing(robot) for robot in (fat, deep))
    assert fat_says is not None and deep_says is not None
    arm = [far for row, far, _ in fat_says.forbid
           if "left_" in fat.pair_name(row)]  # fmt: skip
    assert arm and min(arm) < 0.0
    assert deep_says.forbid == [] and deep_says.clearance >= MARGIN
    assert sum(b.link == TORSO and b.fine for b in deep.bodies) > 1
    assert any(TORSO in pair for pair in deep.description.finer) and deep.description.baselines


def test_several_capsules_hold_all_of_the_torso(deep):
    rng = np.random.default_rng(1)
    inside = rng.uniform(-0.5, 0.5, (20_000, 3)) * SIDES + [0, 0, 0.15]
    points = np.concatenate([CORNERS, inside])
    for fine in (True, False):  # each kind alone
        assert beyond(points, deep, TORSO, fine).max() <= 1e-9


def test_what_nothing_comes_near_has_no_finer_bodies(deep):
    assert not any(b.fine for b in deep.bodies if b.link == "head")


def test_finer_bodies_hold_what_is_drawn_too(tmp_path):
    text = drawn(DEEP, TORSO, '<box size="0.36 0.24 0.3"/>', "0 0 0.15")  # 30 mm before and behind
    robot = new(tmp_path, text, finer=True).robot
    seen = BOX * [0.18, 0.12, 0.15] + [0, 0, 0.15]
    assert any(b.fine for b in robot.bodies if b.link == TORSO)
    for fine in (True, False):
        assert beyond(seen, robot, TORSO, fine).max() <= 0.02


# --- geometry


def test_cells_of_a_convex_piece_hold_all_of_it_between_them():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(80, 3)) * [0.1, 0.2, 0.05]
    splitter = splitting.Splitter(points)
    weights = rng.dirichlet(np.full(len(splitter.corners), 0.3), 4000)
    inside = np.concatenate([weights @ splitter.corners, splitter.corners])
    found = list(splitter.cuts(splitter.whole()))
    assert {len(cells) for cells in found} == {2}
    for cells in found:
        far = np.full(len(inside), np.inf)
        for cell in cells:
            a, b, radius = cell.capsule
            t = np.clip((inside - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
            near = np.linalg.norm(inside - a - t[:, None] * (b - a), axis=1)
            far = np.minimum(far, near - radius)
        assert far.max() <= 1e-9


def test_poses_hang_their_arms_more_than_they_raise_them(deep):
    shown = motion.poses(deep, [deep.stand], 0.2)
    assert shown.named == 1 and shown.weight[1:].sum() == pytest.approx(1.0)
    up = batch.skeletons(deep.chain, shown.q[1:]).reshape(-1, 7, 3)[:, [2, 5], 2]
    assert (up < 0.0).mean() > 0.7
    assert ((shown.q >= deep.lower) & (shown.q <= deep.upper)).all()


# --- what a person sees


def test_check_says_which_pairs_forbid_the_stand_and_by_how_much(fat, deep):
    said = "\n".join(survey.stands(fat, survey.standing(fat)))
    assert "left_fore_0" in said and "mm by bodies" in said
    assert "let it stand" in survey.stands(deep, survey.standing(deep))[0]
    assert "does not say" in survey.stands(deep, None)[0]


def test_the_picture_shows_it_standing(fat, deep, tmp_path):
    file = tmp_path / "a.png"
    for robot in (fat, deep):
        where = robot.description.source
        said = CliRunner().invoke(
            app, ["robot", "check", str(where), "--poses", "20", "--picture", str(file)]
        )
        assert said.exit_code == shell.OK, said.output
        assert ("forbid it" in said.output) == (robot is fat)
        wide = Image.open(file)
        red = np.array(wide.convert("RGB")).astype(int)
        third = red[:, 2 * red.shape[1] // 3 :]
        hot = (third[..., 0] > third[..., 1] + 80) & (third[..., 0] > third[..., 2] + 80)
        assert (hot.sum() > 500) == (robot is fat)


def test_an_outline_goes_around_all_points():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(200, 2))
    ring = picture.outline(points)
    edge = np.roll(ring, -1, axis=0) - ring
    rel = points[:, None] - ring[None]
    assert (edge[None, :, 0] * rel[..., 1] - edge[None, :, 1] * rel[..., 0] >= -1e-12).all()


@pytest.mark.wide
def test_jvrc_can_lower_its_arms(tmp_path):
    package = pytest.importorskip("jvrc_description")
    file = f"{next(iter(package.__path__))}/urdf/jvrc1.urdf"
    made = propose.propose(file, "jvrc", MARGIN, "midpoint", with_hulls=True, finer=True)
    propose.write(made, tmp_path, force=False)
    robot = Robot.from_file(tmp_path / "jvrc.yaml", MARGIN, "midpoint")
    found = survey.standing(robot)
    assert found is not None and found.forbid == []


def test_damaged_group_states_are_left_out(tmp_path):
    file = tmp_path / "a.srdf"
    file.write_text(
        '<robot><group_state name="home"><joint name="a" value="x"/></group_state></robot>'
    )
    assert stand.named(file) == {"home": {}}
    file.write_text("<robot>")
    with pytest.raises(RobotError, match="a.srdf"):
        stand.named(file)
