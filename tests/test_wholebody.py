"""Whole-body motions: legs and hands that others move, arms that give way, steps that are forced.

The judge is coal on pinocchio's model of the URDF, all of its joints moving: it knows nothing of
which pairs are watched, and leaves out neighbours and what touches at the anchor alone.
"""

import json
import pickle
import shutil
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import yaml
from test_guard_command import run

from s3le.cli import shell
from s3le.errors import ParameterError, RobotError, TrajectoryError
from s3le.guard import folder
from s3le.guard.claim import claim
from s3le.guard.clean import Guard
from s3le.guard.layouts.door import open_layout
from s3le.guard.table import guard as contract
from s3le.guard.task import Reading
from s3le.kernels import batch
from s3le.motion.whole import joints
from s3le.plan import rounds
from s3le.plan.examine import DRIVEN
from s3le.plan.interior import program
from s3le.plan.wholebody import BodyPlanner
from s3le.robot import pairs
from s3le.robot.description import read_description
from s3le.robot.robot import Robot
from s3le.robot.wholebody import DESIGNED, NEIGHBOURS, whole_body, with_joints
from s3le.safety import audit, wholebody
from s3le.safety.paths import CERTIFIED, certify
from s3le.safety.swept import swept
from s3le.store import tables

FILE = Path(__file__).parents[1] / "s3le/robots/g1.yaml"
URDF = FILE.parent / "urdf/g1.urdf"
G1 = ["--robot", FILE]
ONE = [*G1, "--jobs", "1"]
LEGS = (
    "left_hip_pitch_joint", "left_knee_joint", "left_hip_roll_joint", "right_hip_pitch_joint",
    "right_knee_joint", "right_hip_roll_joint",
)  # fmt: skip
WRISTS = ("left_wrist_roll_joint", "left_wrist_pitch_joint")
BETWEEN, MARGIN = 0.0005, 0.002  # [m]
ROWS, RATE = 60, 30.0
FINE = 2.0**20  # per metre: in metres coal takes segments for parallel that are not
ROOT = np.arange(7.0)  # a root's numbers


@cache
def g1() -> Robot:
    return Robot.load(FILE)


def copied(folder, line):
    """G1's files, and a line more in the robot file."""
    shutil.copytree(URDF.parent, folder / "urdf")
    (folder / FILE.name).write_text(f"{FILE.read_text()}\n{line}\n")


@cache
def legged():
    return whole_body(g1(), LEGS)


@cache
def guard() -> Guard:
    return Guard(*claim(g1()))


def hanging(rows=ROWS, elbow=0.5, yaw=-0.3):
    """Arms that hang beside the thighs, elbows a little bent, (rows, n) [rad]."""
    q, names = g1().anchor.copy(), g1().joint_names
    q[names.index("waist_pitch_joint")] = 0.0
    for side, sign in (("left", 1.0), ("right", -1.0)):
        at = {"shoulder_pitch": 0.0, "shoulder_roll": 0.15 * sign, "shoulder_yaw": yaw * sign,
              "elbow": elbow}  # fmt: skip
        for part, angle in at.items():
            q[names.index(f"{side}_{part}_joint")] = angle
    return np.repeat(q[None], rows, axis=0)


def pulse(rows=ROWS):
    return np.sin(np.pi * np.arange(rows) / (rows - 1)) ** 2


def raised(rows=ROWS, far=1.5):
    """The left thigh comes up under the forearm and goes down again, (rows, 6) [rad]."""
    legs = np.zeros((rows, len(LEGS)))
    legs[:, 0], legs[:, 1] = -far * pulse(rows), 0.9 * far * pulse(rows)
    return legs


def crossed(rows=ROWS):
    """A leg comes against the other one."""
    legs = np.zeros((rows, len(LEGS)))
    legs[:, 2], legs[:, 5] = -0.4 * pulse(rows), 0.4 * pulse(rows)
    return legs


def saved(path, q, legs, names=LEGS, kind="f8"):
    """As an NPZ behind a free base, with an array that is nobody's joint."""
    path.parent.mkdir(parents=True, exist_ok=True)
    root = np.repeat(ROOT[None], len(q), axis=0)
    np.savez(
        path, qpos=np.hstack([root, q, legs]).astype(kind), fps=RATE,
        joint_names=np.array([*g1().joint_names, *names]), contacts=np.arange(len(q)) % 2,
    )  # fmt: skip
    return path


def side(target):
    return json.loads(Path(f"{target}.guard.json").read_text())


def finer(shape):
    """The shape in a finer unit; of a cylinder the capsule that lies in it."""
    if isinstance(shape, coal.Sphere):
        return coal.Sphere(shape.radius * FINE)
    half = shape.halfLength
    if isinstance(shape, coal.Cylinder):
        half = max(half - shape.radius, 0.0)
    return coal.Capsule(shape.radius * FINE, 2.0 * half * FINE)


@cache
def told():
    """What G1's files say: pairs of links that are off, that finer bodies watch; names of these."""
    off = ElementTree.parse(FILE.parent / "urdf/g1.srdf").iter("disable_collisions")
    finer = {frozenset(pair) for pair in yaml.safe_load(FILE.read_text())["finer"]}
    fine = {
        f"{link.get('name')}_{k}"
        for link in ElementTree.parse(URDF).iter("link")
        for k, item in enumerate(link.findall("collision")) if item.get("name") == "fine"
    }  # fmt: skip
    return {frozenset((one.get("link1"), one.get("link2"))) for one in off}, finer, fine


def meant(a, b):
    """Is it a pair of bodies, LINK_K each, that is to be watched?"""
    off, finer, fine = told()
    links = frozenset(name.rpartition("_")[0] for name in (a, b))
    cut = {name.rpartition("_")[0] for name in fine}
    kinds = [(name in fine) == (links in finer and name.rpartition("_")[0] in cut)
             for name in (a, b)]  # fmt: skip
    return links not in off and all(kinds)


class Judge:
    """Coal on pinocchio's model, every joint of the URDF moving."""

    def __init__(self):
        self.model = pin.buildModelFromUrdf(str(URDF))
        self.bodies = pin.buildGeomFromUrdf(self.model, str(URDF), pin.GeometryType.COLLISION)
        for at in self.model.jointPlacements:
            at.translation = at.translation * FINE
        for item in self.bodies.geometryObjects:
            item.geometry = finer(item.geometry)
            item.placement = pin.SE3(item.placement.rotation, item.placement.translation * FINE)
        self.data = self.model.createData()
        joint = [item.parentJoint for item in self.bodies.geometryObjects]
        parent = self.model.parents
        names = [item.name for item in self.bodies.geometryObjects]
        found = [
            pin.CollisionPair(a, b)
            for a in range(len(joint))
            for b in range(a + 1, len(joint))
            if joint[a] != joint[b]
            and parent[joint[a]] != joint[b]
            and parent[joint[b]] != joint[a]
            and meant(names[a], names[b])
        ]
        self._watch(found)
        anchor = yaml.safe_load(FILE.read_text())["anchor"]
        seen = self.distances(anchor)
        self._watch([pair for pair, d in zip(found, seen, strict=True) if d > 0.01])
        assert len(self.bodies.collisionPairs) > 1000

    def _watch(self, wanted):
        self.bodies.removeAllCollisionPairs()
        for pair in wanted:
            self.bodies.addCollisionPair(pair)
        self.scratch = pin.GeometryData(self.bodies)

    def distances(self, at):
        q = pin.neutral(self.model)
        for name, angle in at.items():
            q[self.model.joints[self.model.getJointId(name)].idx_q] = angle
        pin.computeDistances(self.model, self.data, self.bodies, self.scratch, q)
        return np.array([one.min_distance for one in self.scratch.distanceResults]) / FINE

    def steps(self, names, q, parts=5):
        """Least clearance less what is asked of each row, and of the path to it [m], (rows,)."""
        spare = np.empty(len(q))
        for t in range(len(q)):
            spare[t] = self.distances(dict(zip(names, q[t], strict=True))).min() - MARGIN
            for share in np.arange(1, parts) / parts if t else ():
                pose = (1.0 - share) * q[t - 1] + share * q[t]
                on = self.distances(dict(zip(names, pose, strict=True))).min() - BETWEEN
                spare[t] = min(spare[t], on)
        return spare


@cache
def judge() -> Judge:
    return Judge()


def judged(path, rows=slice(None)):
    data = np.load(path)
    return judge().steps(data["joint_names"], data["qpos"][rows, 7:])


# --- the robot


def test_a_robot_with_legs_that_move_watches_what_it_did_and_legs_against_all():
    wide = with_joints(g1(), LEGS)
    assert set(map(tuple, g1().watched)) < set(map(tuple, wide.watched))
    names = [body.name for body in wide.bodies]
    watched = {frozenset((names[a], names[b])) for a, b in wide.watched}
    for one, other in (
        ("left_hip_yaw_link_0", "left_rubber_hand_0"), ("left_knee_link_0", "right_knee_link_0"),
        ("left_knee_link_1", "torso_link_0"), ("right_hip_yaw_link_0", "left_wrist_yaw_link_0"),
    ):  # fmt: skip
        assert frozenset((one, other)) in watched
    apart = {pair.reason for pair in wide.pairs if not pair.reason.startswith(pairs.DISABLED)}
    assert apart - {*pairs.SURE, NEIGHBOURS} == {DESIGNED}
    assert frozenset(("pelvis_1", "right_hip_pitch_link_0")) not in watched  # neighbours
    report = wide.certifier().check(wide.anchor[None])
    assert report.clearance[0] >= g1().margin


def test_a_thigh_that_moves_alone_is_watched_against_the_leg_that_stands():
    # In the reduced model the other leg, the pelvis and all that is held are one body.
    body = whole_body(g1(), ["left_hip_pitch_joint"])
    names = [one.name for one in body.rest.bodies]
    watched = {frozenset((names[a], names[b])) for a, b in body.rest.watched}
    for other in ("right_hip_yaw_link_0", "right_knee_link_0", "pelvis_contour_link_0"):
        assert frozenset(("left_hip_yaw_link_0", other)) in watched
    assert frozenset(("pelvis_0", "left_hip_pitch_link_0")) not in watched


def test_ours_part_the_pairs_that_are_ours_and_never_the_others():
    body, rng = legged(), np.random.default_rng(3)
    legs = rng.uniform(-0.5, 0.5, (1, len(LEGS)))
    arms = rng.uniform(g1().lower, g1().upper, (8, g1().n_dof))
    q = body.poses(arms, np.repeat(legs, 8, axis=0))
    apart = batch.pair_distances(body.rest.chain, q)
    assert np.ptp(apart, axis=0).max() < 1e-12  # [m]
    ours = batch.pair_distances(body.robot.chain, q)
    assert (np.ptp(ours, axis=0) > 1e-9).all()
    assert len(body.rest.watched) + len(body.robot.watched) == len(with_joints(g1(), LEGS).watched)


@pytest.mark.parametrize(
    ("names", "says"),
    [(["left_hip_pitch"], "not in g1.urdf"), (["left_elbow_joint"], "moves? already")],
)
def test_what_is_no_further_joint_cannot_be_given(names, says):
    with pytest.raises(RobotError, match=says):
        with_joints(g1(), names)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("given: [left_elbow_joint]", "both decided here"),
        ("given: 3", "must be a list"),
        ("given: [left_knee_joint, left_knee_joint]", "must be a list of different"),
        ("given: [left_knee]", "given names 'left_knee', not in"),
    ],
)
def test_a_robot_file_with_nonsense_in_given_is_refused(line, says, tmp_path):
    copied(tmp_path, line)
    with pytest.raises(RobotError, match=says):
        Robot.load(tmp_path / "g1.yaml")


def test_a_robot_file_says_which_joints_are_given(tmp_path):
    copied(tmp_path, "given: [left_hip_pitch_joint]")
    assert read_description(tmp_path / "g1.yaml").given == ("left_hip_pitch_joint",)
    assert Robot.load(tmp_path / "g1.yaml").digest == g1().digest  # it moves nothing by itself
    path = saved(tmp_path / "a.npz", hanging(), raised())
    said = run("audit", path, "--robot", tmp_path / "g1.yaml")  # its knee moves too
    assert said.exit_code == shell.UNREADABLE and "left_knee_joint" in said.output


# --- the kernel


def test_rows_of_ours_are_the_columns_of_ours_among_the_rows_of_all():
    body, m = legged(), 6
    every = body.robot.n_dof
    q = body.poses(hanging(m), raised(m))
    chain, balls = body.robot.chain, swept(body.robot.chain).balls
    custom = rounds.Custom(0.03, 50.0, 5000.0, 0.0, 1e-7, 8, 4, 2e-3)
    found = []
    for own in (np.arange(every), body.own):
        n = len(own)
        p = program(m, n, 4000)
        p.q[:] = q[:, own]
        aim = rounds.Aim(
            p.q.copy(), np.zeros((0, 21)), np.ones(21), np.eye(n)[None], q.copy(), own
        )  # fmt: skip
        rounds.linearise(
            chain, balls, p, m, aim, np.full(m, 0.004), np.full(m, 0.5), np.zeros(m), np.ones(n),
            custom,
        )  # fmt: skip
        found.append(p)
    wide, ours = found
    count = int(wide.count[0])
    assert count == ours.count[0] > 20
    assert (wide.row[:count][:, :, body.own] == ours.row[:count]).all()
    assert (wide.need[:count] == ours.need[:count]).all()


# --- audit


def test_a_file_in_which_legs_stand_still_is_audited_as_ever(tmp_path):
    path = saved(tmp_path / "still.npz", hanging(), np.zeros((ROWS, len(LEGS))))
    said = run("audit", path, *G1)
    assert said.exit_code == shell.OK and "moved by others" not in said.output, said.output


def test_a_thigh_that_comes_up_under_a_forearm_is_found(tmp_path):
    path = saved(tmp_path / "up.npz", hanging(), raised())
    said = run("audit", path, *G1, "--json")
    assert said.exit_code == shell.BROKEN
    one = json.loads(said.stdout)["files"][0]
    assert one["given_joints"] == ["left_hip_pitch_joint", "left_knee_joint"]
    assert not one["holds"] and "left_hip_yaw_link_0" in one["first"]["what"]
    spare = judged(path)
    broken = np.flatnonzero(spare < 0.0)
    assert one["checks"]["poses"]["first"]["row"] in (broken[0], broken[0] + 1)
    assert one["checks"]["poses"]["broken"] <= len(broken) <= one["checks"]["poses"]["broken"] + 1
    assert not one["moved_by_given_joints_alone"]["poses"]["broken"]


def test_what_given_joints_break_is_told_and_not_counted(tmp_path):
    legs = np.zeros((ROWS, len(LEGS)))
    legs[20:22, 1] = -0.2  # a knee beyond its range,
    legs[30, 4] = 1.0  # and one that jumps
    said = run("audit", saved(tmp_path / "a.npz", hanging(yaw=0.3), legs), *G1)
    assert said.exit_code == shell.OK and "CERTIFIED" in said.output, said.output
    assert "their joint ranges do not hold in 2 of 60" in said.output
    assert "their joint speeds do not hold in 2 of 59" in said.output


def test_a_leg_against_the_other_is_broken_and_told_apart(tmp_path):
    path = saved(tmp_path / "x.npz", g1().anchor + np.zeros((ROWS, 1)), crossed())
    said = run("audit", path, *G1)
    assert said.exit_code == shell.BROKEN and "NOT CERTIFIED" in said.output
    assert "others alone move, not ours to change" in said.output


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--given", "none"], "but the robot file holds it"),
        (["--given", "left_hip_pitch_joint"], "left_knee_joint is .* holds it"),
        (["--given", "left_hip_pitch"], "has no column of the given joint"),
        (["--given", "left_elbow_joint"], "own and is not given"),
    ],
)
@pytest.mark.parametrize("command", ["audit", "guard"])
def test_joints_that_nobody_gives_are_refused(command, words, says, tmp_path):
    path = saved(tmp_path / "up.npz", hanging(), raised())
    more = ["--check"] if command == "guard" else []
    said = run(command, path, *G1, *words, *more)
    assert said.exit_code == shell.UNREADABLE
    assert pytest.importorskip("re").search(says, said.output), said.output


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda q, legs: (np.rad2deg(q), np.rad2deg(legs)), "look like degrees|degrees"),
        (lambda q, legs: (q, np.where(legs == legs.min(), np.nan, legs)), "is nan"),
        (lambda q, legs: (q, np.where(legs == legs.min(), 99.0, legs)), "times as far from zero"),
    ],
)
def test_no_angles_are_refused_whoever_moves(spoil, says, tmp_path):
    q, legs = spoil(hanging(), raised())
    said = run("guard", saved(tmp_path / "a.npz", q, legs), *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE
    assert pytest.importorskip("re").search(says, said.output), said.output
    assert not (tmp_path / "out/a.npz").exists()


def test_a_csv_of_unitree_is_audited_without_names_and_taken_by_the_guard(tmp_path):
    names = with_joints(g1(), [*LEGS, *WRISTS]).joint_names  # depth first, as MuJoCo has them
    every = [one.get("name") for one in g1().tree.findall("joint") if one.get("type") != "fixed"]
    whole = dict.fromkeys(every, np.zeros(ROWS)) | dict(
        zip(g1().joint_names, hanging().T, strict=True)
    )
    whole |= dict(zip(LEGS, raised().T, strict=True))
    order = joints(g1()).depth_first
    assert [name for name in order if name in names] == names
    root = np.repeat(ROOT[None], ROWS, axis=0)
    path = tmp_path / "in/up.csv"
    path.parent.mkdir()
    rows = np.hstack([root, np.stack([whole[name] for name in order], axis=1)])
    np.savetxt(path, rows, delimiter=",", fmt="%.6f")
    said = run("audit", path, *G1, "--fps", RATE)
    assert said.exit_code == shell.BROKEN and "as MuJoCo numbers them" in said.output
    assert "left_hip_yaw_link_0 and left_rubber_hand_1 overlap" in said.output
    done = run("guard", path, *ONE, "--fps", RATE, "--out", tmp_path / "out")
    assert done.exit_code == shell.OK, done.output
    assert run("audit", tmp_path / "out/up.csv", *G1, "--fps", RATE).exit_code == shell.OK
    old, new = (each.read_text().splitlines() for each in (path, tmp_path / "out/up.csv"))
    ours = {7 + order.index(name) for name in g1().joint_names}
    for before, after in zip(old, new, strict=True):
        fields = zip(before.split(","), after.split(","), strict=True)
        assert all(one == two for i, (one, two) in enumerate(fields) if i not in ours)
    cut = tmp_path / "cut.csv"
    np.savetxt(cut, rows[:, :-1], delimiter=",", fmt="%.6f")
    wrong = run("audit", cut, *G1, "--fps", RATE)
    assert wrong.exit_code == shell.UNREADABLE and "--joints" in wrong.output


# --- guard


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    """A thigh that comes up, guarded: the file as it was and as it came out."""
    place = tmp_path_factory.mktemp("lifted")
    path = saved(place / "in/up.npz", hanging(), raised())
    said = run("guard", path, *ONE, "--out", place / "out")
    assert said.exit_code == shell.OK, said.output
    return path, place / "out/up.npz"


def test_arms_give_way_to_a_thigh_and_all_is_certified(lifted):
    was, now = lifted
    assert (judged(was) < -0.01).any()
    assert judged(now).min() >= -1e-7  # [m], of two engines
    held = side(now)
    assert held["holds"] and held["certificate"]["holds"] and "forced" not in held
    assert held["certificate"]["given"] == ["left_hip_pitch_joint", "left_knee_joint"]
    assert held["given"]["joints"] == held["certificate"]["given"]
    assert held["certificate"]["robot_hash"] == g1().digest
    assert held["moved"]["most_deg"] < 20.0
    assert run("audit", now, *G1, "--acceleration", 60).exit_code == shell.OK


def test_legs_root_and_all_else_stay_to_the_bit(lifted):
    was, now = (np.load(path) for path in lifted)
    assert set(was.files) == set(now.files)
    ours = slice(7, 7 + g1().n_dof)
    assert (was["qpos"][:, :7] == now["qpos"][:, :7]).all()
    assert (was["qpos"][:, ours.stop :] == now["qpos"][:, ours.stop :]).all()
    assert (was["contacts"] == now["contacts"]).all()
    assert (was["qpos"][:, ours] != now["qpos"][:, ours]).any()


def test_guarding_twice_is_guarding_once(lifted, tmp_path):
    assert run("guard", lifted[1], *ONE, "--out", tmp_path).exit_code == shell.OK
    assert (tmp_path / "up.npz").read_bytes() == lifted[1].read_bytes()


def test_with_the_legs_ignored_the_certificate_does_not_hold(tmp_path):
    # Arms alone are certified and come back to the bit, although the thigh goes through the hand.
    body, q = legged(), hanging()
    time = np.arange(ROWS) / RATE
    assert audit.audit(g1(), time, q, audit.demands(g1())).holds
    whole = wholebody.look(body, time, q, raised(), audit.demands(g1()))
    assert not whole.report.holds and whole.ours.close.sum() > 10
    assert whole.report.deep > 10 and whole.report.least < -0.05


def test_legs_that_stand_change_nothing_to_the_bit(tmp_path):
    q = hanging()
    q[:, g1().joint_names.index("left_shoulder_roll_joint")] -= 0.3 * pulse()  # into the trunk
    alone = saved(tmp_path / "alone.npz", q, np.zeros((ROWS, 0)), ())
    stand = saved(tmp_path / "stand.npz", q, np.zeros((ROWS, len(LEGS))))
    said = run("guard", alone, stand, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    one, two = (np.load(tmp_path / f"out/{name}.npz")["qpos"] for name in ("alone", "stand"))
    assert (one != np.load(alone)["qpos"]).any()
    assert (one == two[:, : one.shape[1]]).all()
    assert side(tmp_path / "out/alone.npz")["moved"] == side(tmp_path / "out/stand.npz")["moved"]
    assert "given" not in side(tmp_path / "out/stand.npz")["certificate"]


def test_a_leg_against_the_other_is_forced_and_arms_hold_all_the_same(tmp_path):
    legs = crossed()
    both = np.concatenate([raised(), legs])  # first the thigh, then leg against leg
    path = saved(tmp_path / "in/both.npz", hanging(len(both)), both)
    out = tmp_path / "out"
    said = run("guard", path, *ONE, "--out", out)
    assert said.exit_code == shell.BROKEN
    assert "forced" in said.output and "not ours to change" in said.output
    held = side(out / "both.npz")
    assert not held["holds"] and not held["certificate"]["holds"]
    assert held["forced"]["steps"] == 0 < held["forced"]["steps_not_ours_to_change"]
    (run_,) = held["forced"]["runs"]
    assert run_["whose"] == "not ours to change" and run_["first_row"] > ROWS
    assert "left" in run_["pair"] and "right" in run_["pair"]
    spare = judged(out / "both.npz")
    free = np.ones(len(spare), bool)
    free[run_["first_row"] : run_["last_row"] + 1] = False
    assert spare[free].min() >= -1e-7
    least = spare[~free].min() + MARGIN
    assert run_["clearance_m"] == pytest.approx(least, abs=1e-6)
    row = tables.read_frame(contract(MARGIN), out / "guard.parquet", g1().tag).row(0, named=True)
    assert row["status"] == folder.FORCED and "not ours to change" in row["why"]
    assert row["left_broken"] > 0 and row["clearance"] < 0.0
    again = run("guard", path, *ONE, "--out", out)
    assert again.exit_code == shell.BROKEN and "(kept)" in again.output


def test_arms_that_hold_come_back_to_the_bit_beside_legs_that_do_not(tmp_path):
    path = saved(tmp_path / "in/x.npz", g1().anchor + np.zeros((ROWS, 1)), crossed())
    assert run("guard", path, *ONE, "--out", tmp_path / "out").exit_code == shell.BROKEN
    was, now = np.load(path), np.load(tmp_path / "out/x.npz")
    assert was.files == now.files and all((was[key] == now[key]).all() for key in was.files)
    assert run("guard", path, *ONE, "--check").exit_code == shell.BROKEN


def test_joints_that_may_be_changed_too_are(tmp_path):
    path = saved(tmp_path / "in/x.npz", g1().anchor + np.zeros((ROWS, 1)), crossed())
    legs = "left_hip_roll_joint,right_hip_roll_joint"
    said = run("guard", path, *ONE, "--change", legs, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    assert judged(tmp_path / "out/x.npz").min() >= -1e-7
    was, now = np.load(path)["qpos"], np.load(tmp_path / "out/x.npz")["qpos"]
    moved = np.flatnonzero((was != now).any(axis=0)) - 7
    names = [*g1().joint_names, *LEGS]
    assert {"left_hip_roll_joint", "right_hip_roll_joint"} <= {names[j] for j in moved}
    wrong = run("guard", path, *ONE, "--change", "left_hip", "--out", tmp_path / "out")
    assert wrong.exit_code == shell.UNREADABLE and "left_hip" in wrong.output


def test_float32_of_a_pickle_is_proven_as_it_lies_there(tmp_path):
    names = [joint.name for joint in with_joints(g1(), [*LEGS, *WRISTS]).joints]
    whole = dict(zip(g1().joint_names, hanging().T, strict=True))
    whole |= dict(zip(LEGS, raised().T, strict=True))
    whole |= {WRISTS[0]: 0.4 * pulse(), WRISTS[1]: -0.3 * pulse()}
    q = np.stack([whole[name] for name in names], axis=1).astype("f4")
    motion = {
        "fps": 30, "root_pos": np.ones((ROWS, 3)), "root_rot": np.ones((ROWS, 4)), "dof_pos": q,
        "dof_names": names, "local_body_pos": None, "link_body_list": None,
    }  # fmt: skip
    (tmp_path / "in").mkdir()
    (tmp_path / "in/a.pkl").write_bytes(pickle.dumps(motion, protocol=4))
    said = run("guard", tmp_path / "in/a.pkl", *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    came = pickle.loads((tmp_path / "out/a.pkl").read_bytes())["dof_pos"]
    given = [names.index(name) for name in (*LEGS, *WRISTS)]
    assert came.dtype == np.float32 and (came[:, given] == q[:, given]).all()
    assert judge().steps(names, came.astype(float)).min() >= -1e-7


def test_a_data_set_takes_no_motion_whose_legs_move(tmp_path):
    path = saved(tmp_path / "up.npz", hanging(), raised())
    with pytest.raises(TrajectoryError, match="holds it at 0"):
        Reading().open(path, g1())
    with pytest.raises(TrajectoryError, match="holds it at 0"):
        open_layout(path, g1())


# --- where there is no way


@cache
def held_up():
    """A thigh that jumps into a hand which may hardly move, planned."""
    rows = 40
    legs = raised(rows)
    legs[:, :2] = np.where(np.arange(rows)[:, None] < 20, 0.0, [-1.6, 1.35])
    its, asked = claim(g1(), speed_factor=0.0015, acceleration=0.5)
    one = Guard(its, asked)
    body = whole_body(its, LEGS)
    _, most, settings = (
        one.planned(0.0, 1.0).robot,
        one.planned(0.0, 1.0).most,
        (one.planned(0.0, 1.0).settings),
    )
    planner = BodyPlanner(body, most, settings)
    time = np.arange(rows) / RATE
    return planner, time, legs, planner.among(time, hanging(rows), legs)


def test_a_hand_that_cannot_get_away_is_forced_and_listed_as_ours(tmp_path):
    _, time, legs, made = held_up()
    assert made.forced.any() and not made.forced[:15].any()
    path = saved(tmp_path / "in/a.npz", hanging(len(time)), legs)
    words = ["--speed-factor", 0.0015, "--acceleration", 0.5]
    said = run("guard", path, *ONE, *words, "--out", tmp_path / "out")
    assert said.exit_code == shell.BROKEN, said.output
    held = side(tmp_path / "out/a.npz")
    assert held["forced"]["steps"] > 0 == held["forced"]["steps_not_ours_to_change"]
    first = held["forced"]["runs"][0]
    assert first["whose"] == "ours" and "rubber_hand" in first["pair"]
    assert first["clearance_m"] < first["wanted_m"] == MARGIN
    spare = judged(tmp_path / "out/a.npz")
    free = np.ones(len(spare), bool)
    for one in held["forced"]["runs"]:
        free[one["first_row"] : one["last_row"] + 1] = False
    assert spare[free].min() >= -1e-7 and spare[~free].min() < 0.0
    checks = {name: one["broken"] for name, one in held["after"].items()}
    assert checks["limits"] == checks["velocities"] == checks["accelerations"] == 0


def test_of_forced_steps_hardly_one_had_a_way_among_a_thousand_poses():
    planner, time, legs, made = held_up()
    body, most, rng = planner.body, planner.most, np.random.default_rng(7)
    whole = body.poses(made.q, legs)
    missed = 0
    rows = np.flatnonzero(made.forced)
    for t in rows:
        dt = time[t] - time[t - 1]
        v = (made.q[t - 1] - made.q[t - 2]) / dt
        low = np.maximum(v - most.acceleration * dt, -most.speed) * dt + made.q[t - 1]
        high = np.minimum(v + most.acceleration * dt, most.speed) * dt + made.q[t - 1]
        drawn = rng.uniform(
            np.maximum(low, most.lower), np.minimum(high, most.upper), (1000, len(v))
        )
        poses = body.poses(drawn, np.repeat(legs[t][None], 1000, axis=0))
        good = batch.clearances(body.robot.chain, poses) >= MARGIN
        missed += any(
            certify(body.robot, np.stack([whole[t - 1], pose]), BETWEEN).status[0] == CERTIFIED
            for pose in poses[good]
        )
    assert len(rows) and missed < 0.05 * len(rows)


@pytest.mark.parametrize("seed", [8, 9])
def test_where_the_given_joints_are_in_nobodys_way_no_step_is_forced(seed):
    # Arms that swing through everything: giving way has to begin where they can still brake.
    rows, rng, its = 150, np.random.default_rng(seed), g1()
    time = np.arange(rows) / RATE
    rate, phase = rng.uniform(0.1, 0.8, its.n_dof), rng.uniform(0.0, 6.28, its.n_dof)
    waves = np.sin(2.0 * np.pi * rate * time[:, None] + phase)
    wanted = 0.5 * (its.lower + its.upper) + 0.4 * (its.upper - its.lower) * waves
    planner = guard()._planned_among(whole_body(its, ["left_knee_joint"]), 0.0, 1.0)
    made = planner.among(time, wanted, 0.2 * pulse(rows)[:, None])
    assert (made.how == DRIVEN).any() and not made.forced.any()


def test_given_angles_of_another_shape_or_not_finite_are_refused():
    planner, time, legs, _ = held_up()
    with pytest.raises(ParameterError, match="given joints need finite angles"):
        planner.among(time, hanging(len(time)), legs[:, :3])
    with pytest.raises(ParameterError, match="given joints need finite angles"):
        planner.among(time, hanging(len(time)), np.full_like(legs, np.nan))
