"""Joints that others move in ranges, any way: bodies contain all that theirs sweep."""

import json
import shutil
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
import yaml
from test_guard_command import run
from test_wholebody import FILE, MARGIN, g1, hanging

from s3le.errors import RobotError
from s3le.guard.guard import Guard
from s3le.kernels import batch
from s3le.robot import ranges
from s3le.robot.ranges import PART, Turning, cover
from s3le.robot.robot import Robot
from s3le.robot.wholebody import whole_body

STANDING = {  # what a controller that keeps balance may do, knees bent or not
    "hip_pitch": (-0.6, 0.4), "hip_roll": (-0.1, 0.25), "hip_yaw": (-0.2, 0.2),
    "knee": (0.0, 0.8), "ankle_pitch": (-0.6, 0.3), "ankle_roll": (-0.2, 0.2),
}  # fmt: skip


def standing(factor=1.0):
    """Ranges of both legs, mirrored, as a robot file has them."""
    given = {}
    for side in ("left", "right"):
        for part, (low, high) in STANDING.items():
            if side == "right" and ("roll" in part or "yaw" in part):
                low, high = -high, -low
            given[f"{side}_{part}_joint"] = [low * factor, high * factor]
    return given


def written(folder, given, **changed):
    """A robot file of G1 with ranges."""
    tree = yaml.safe_load(FILE.read_text("utf-8")) | {"given": given} | changed
    shutil.copytree(FILE.parent / "urdf", folder / "urdf", dirs_exist_ok=True)
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump(tree), "utf-8")
    return file


@cache
def ranged(folder):
    return Robot.load(written(folder, standing()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("ranges")


def test_capsules_contain_a_core_at_every_angle_of_random_chains():
    rng = np.random.default_rng(0)
    for case in range(40):
        m = int(rng.integers(1, 5))
        placements = [
            pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.2, size=3))
            for _ in range(m + 1)
        ]  # fmt: skip
        axes = [axis / np.linalg.norm(axis) for axis in rng.normal(size=(m, 3))]
        core = Turning(placements, axes, np.zeros(3), rng.normal(scale=0.2, size=3))
        low = rng.uniform(-1.0, 0.0, m)
        high = low + rng.choice([0.0, 0.1, 1.0, 2.0], m)
        made = cover(core, low, high, most=int(rng.integers(1, 20)))
        for _ in range(100):
            angles = np.where(rng.random(m) < 0.5, rng.choice([0.0, 1.0], m), rng.random(m))
            point = core.at(low + angles * (high - low), rng.random())
            assert min(_apart(point, one) - one.radius for one in made) <= 1e-12, case


def _apart(point, capsule):
    along = capsule.b - capsule.a
    share = np.clip((point - capsule.a) @ along / max(along @ along, 1e-30), 0.0, 1.0)
    return np.linalg.norm(capsule.a + share * along - point)


def test_what_legs_sweep_is_contained_wherever_they_are(folder):
    robot, names = ranged(folder), tuple(standing())
    body, rng = whole_body(g1(), names), np.random.default_rng(1)
    low, high = np.array(list(standing().values())).T
    q = rng.uniform(robot.lower, robot.upper, (500, robot.n_dof))
    bound = batch.clearances(robot.chain, q)
    for _ in range(60):
        corner = rng.random((len(q), len(low))) < 0.5
        given = np.where(corner, np.where(rng.random(corner.shape) < 0.5, low, high),
                         rng.uniform(low, high, corner.shape))  # fmt: skip
        there = batch.clearances(body.robot.chain, body.poses(q, given))
        assert (there - bound).min() >= -1e-12


def test_a_standing_range_leaves_the_arms_nearly_all_their_space(folder):
    robot = ranged(folder)
    q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (4000, robot.n_dof))
    still = batch.clearances(g1().chain, q) >= MARGIN
    moving = batch.clearances(robot.chain, q) >= MARGIN
    assert not (moving & ~still).any()
    assert moving.sum() > 0.9 * still.sum()


def test_the_same_pairs_are_watched_as_while_the_legs_stand(folder):
    def links(robot):
        return {
            frozenset(ranges.origin(robot.bodies[body].name) for body in pair)
            for pair in robot.watched.tolist()
        }

    assert links(ranged(folder)) == links(g1())
    assert ranged(folder).unwatched() == g1().unwatched()
    assert ranged(folder).digest != g1().digest


def test_the_guard_keeps_arms_out_of_all_that_the_legs_may_do(folder):
    robot, rng = ranged(folder), np.random.default_rng(3)
    its, plain = Guard(robot), Guard(g1())
    wanted = hanging(1, elbow=1.2, yaw=-0.9)[0]
    body = whole_body(g1(), tuple(standing()))
    low, high = np.array(list(standing().values())).T
    found = {}
    for name, one in (("ranges", its), ("held", plain)):
        one.start()
        for _ in range(300):
            step = one.step(wanted, 0.02)
            assert step.certified
        given = np.where(rng.random((3000, len(low))) < 0.5, low, high)
        poses = body.poses(np.tile(step.q, (len(given), 1)), given)
        found[name] = body.robot.certifier().check(poses).clearance.min()
    assert found["ranges"] >= MARGIN and found["held"] < 0.0
    assert PART not in step.reason


@pytest.mark.parametrize(
    ("given", "changed", "words"),
    [
        ({"left_knee_joint": [0.5]}, {}, "must be two angles"),
        ({"left_knee_joint": [0.5, 0.1]}, {}, "must be [low, high]"),
        ({"left_knee_joint": ["a", 0.1]}, {}, "must be a number"),
        ({"left_knee_joint": [-2.0, 0.1]}, {}, "not within its limits"),
        ({"left_knee_joint": [0.2, 0.4]}, {}, "outside its range"),
        ({"left_knie_joint": [0.2, 0.4]}, {}, "given names 'left_knie_joint'"),
        ({"left_elbow_joint": [0.2, 0.4]}, {}, "both decided here"),
        ({"left_hip_pitch_joint": [-2.5, 0.4], "left_hip_roll_joint": [-0.5, 2.9]}, {},
         "somewhere in the ranges"),
    ],
)  # fmt: skip
def test_a_range_that_cannot_be_is_refused(tmp_path, given, changed, words):
    with pytest.raises(RobotError) as refused:
        Robot.load(written(tmp_path, given, **changed))
    assert words in str(refused.value)


def test_a_range_of_a_joint_that_carries_ours_is_refused(tmp_path):
    tree = yaml.safe_load(FILE.read_text("utf-8"))
    own = [name for name in tree["joints"] if name != "waist_yaw_joint"]
    file = written(tmp_path, {"waist_yaw_joint": [-0.2, 0.2]}, joints=own)
    with pytest.raises(RobotError, match="carries joints that are decided here"):
        Robot.load(file)


@pytest.mark.parametrize("ranged", ["left_knee_joint", "right_knee_joint"])
def test_a_range_of_a_joint_that_mimics_or_is_mimicked_is_refused(tmp_path, ranged):
    """The other one would move too, where nobody looks."""
    file = written(tmp_path, {ranged: [0.0, 0.5]})
    text = (tmp_path / "urdf/g1.urdf").read_text("utf-8")
    head, tail = text.split('<joint name="right_knee_joint"', 1)
    tail = tail.replace("</joint>", '<mimic joint="left_knee_joint"/></joint>', 1)
    (tmp_path / "urdf/g1.urdf").write_text(f'{head}<joint name="right_knee_joint"{tail}', "utf-8")
    with pytest.raises(RobotError, match="mimics 'left_knee_joint'"):
        Robot.load(file)


def test_names_of_a_urdf_may_hold_the_sign_of_parts():
    assert ranges.origin("left~2_0") == "left~2_0" and ranges.origin("left~2_0~7") == "left~2_0"


def test_a_motion_that_says_what_the_legs_do_is_held_to_that_instead(folder):
    body = whole_body(ranged(folder), tuple(standing()))
    assert not body.base.description.ranges
    assert body.base.digest == g1().digest


def test_the_file_goes_where_the_robot_goes(folder, tmp_path):
    robot = ranged(folder)
    robot.write(tmp_path)
    again = Robot.read(tmp_path)
    assert again.digest == robot.digest and again.description.ranges == robot.description.ranges


def test_check_and_certificate_say_what_the_ranges_are(folder, tmp_path):
    file = written(folder, standing())
    said = run("robot", "check", file).output
    assert "given, anywhere in [deg]:" in said and "left_hip_yaw_link_0" in said
    np.savez(tmp_path / "a.npz", q=np.repeat(g1().anchor[None], 5, axis=0), time=np.arange(5) / 30,
             joint_names=np.array(g1().joint_names))  # fmt: skip
    found = run("guard", tmp_path / "a.npz", "--robot", file, "--out", tmp_path / "out")
    assert found.exit_code == 0, found.output
    summary = json.loads((tmp_path / "out/a.npz.guard.json").read_text("utf-8"))
    said = summary["certificate"]["given_ranges_rad"]
    assert said == standing() and said["left_knee_joint"] == [0.0, 0.8]
