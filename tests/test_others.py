"""`s3le retarget --others`: arms of a clip on the legs and the root of another tool's motion.

The judge is that of test_wholebody: coal on pinocchio's model of the URDF, all joints moving.
"""

import json
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command import run
from handmade import bvh, write
from streaming import DEFAULT
from test_wholebody import (
    G1,
    LEGS,
    RATE,
    ROWS,
    copied,
    crossed,
    g1,
    hanging,
    judge,
    pulse,
    raised,
    saved,
)

from s3le.cli import shell
from s3le.errors import ParameterError, TrajectoryError
from s3le.guard.places import fingerprint
from s3le.human.skeletons import read_frames
from s3le.kernels import batch, threads
from s3le.motion import files
from s3le.motion.whole import joints
from s3le.retarget import stored
from s3le.retarget.among import BEYOND, at_rows, convert_among, told
from s3le.retarget.clips import retarget as contract
from s3le.retarget.others import Other, read
from s3le.retarget.propose import LookUp
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter
from s3le.robot.robot import Robot
from s3le.search import neighbours
from s3le.show import motions as shown
from s3le.skeleton import DIM
from s3le.store import tables

ORDER = joints(g1()).depth_first  # as MuJoCo has them
OURS = [ORDER.index(name) for name in g1().joint_names]
REST = [i for i in range(len(ORDER)) if i not in OURS]
EXACT = 1e-7  # [m], of kernels and coal


@cache
def retargeter(**changed):
    q = batch.project(
        g1().chain, g1().anchor, np.random.default_rng(5).uniform(
            g1().lower, g1().upper, (2000, g1().n_dof)), g1().margin).q  # fmt: skip
    x, chosen = batch.skeletons(g1().chain, q), replace(DEFAULT, **changed)
    return Retargeter(g1(), LookUp(q, neighbours.build(x, exact=True), chosen.k, None), chosen)


def led(monkeypatch, **changed):
    """G1, led by a few poses, in this process."""
    made = retargeter(**changed)
    monkeypatch.setattr(stored, "retargeter_for", lambda robot, watch=None, streams=False: made)
    monkeypatch.setattr(threads, "processors", lambda: 1)


@pytest.fixture
def ready(monkeypatch):
    led(monkeypatch)


def clip(path, rows=ROWS, still=False):
    """A figure whose left arm hangs, the forearm before it, and swings a little; 30 Hz."""
    swing = np.zeros(rows) if still else 15.0 * np.sin(np.arange(rows) / 8.0)
    frames = [[0, 0, 0, 0, 0, 0, -88 if still else -80, a, 0, 0, 0, -20 - a] for a in swing]
    return write(path, bvh(frames, order="ZXY", step=f"{1 / RATE:.12f}"))


def root(rows):
    """A base that walks and turns: position, quaternion x y z w, no two numbers alike."""
    t, draws = np.arange(rows) / RATE, np.random.default_rng(2)
    position = np.stack([0.8 * t, 0.1 * np.sin(t), 0.75 + 0.02 * np.cos(9.0 * t)], axis=1)
    turn = np.array([0.1, -0.2, 0.3, 0.9]) + draws.normal(0.0, 0.02, (rows, 4))
    return position, turn / np.linalg.norm(turn, axis=1)[:, None]


def everyone(legs):
    """All 29 joints as MuJoCo numbers them; the other tool's arms hang, its wrists turn."""
    whole = dict.fromkeys(ORDER, np.zeros(len(legs)))
    whole |= dict(zip(g1().joint_names, hanging(len(legs)).T, strict=True))
    whole |= dict(zip(LEGS, legs.T, strict=True))
    whole["left_wrist_roll_joint"] = 0.3 * pulse(len(legs))
    return np.stack([whole[name] for name in ORDER], axis=1)


def gmr(path, legs, kind="f8", **changed):
    position, turn = root(len(legs))
    motion = {"fps": int(RATE), "root_pos": position, "root_rot": turn,
              "dof_pos": everyone(legs).astype(kind), "local_body_pos": None} | changed  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(motion, protocol=4))
    return path


def merged(place, path, *words, clip_=None):
    clip_ = clip_ or clip(place / "wave.bvh")
    return run("retarget", clip_, *G1, "--others", path, "--out", place / "out", *words)


def side(place):
    return json.loads((place / "out/wave.json").read_text())


def spare(data):
    """What the judge finds of an NPZ beyond what is asked of each row and its path [m]."""
    return judge().steps(list(data["joint_names"]), data["q" if "q" in data else "dof_pos"])


def asked(path, **changed):
    return Other(str(path), path.name, fingerprint(path), **changed)


# --- legs of another tool, arms of ours


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    """A thigh that comes up under the clip's forearm, in float32 of a pickle: place, its legs."""
    place = tmp_path_factory.mktemp("lifted")
    with pytest.MonkeyPatch.context() as patch:
        led(patch)
        path = gmr(place / "in/up.pkl", raised(), "f4")
        words = ["--for", "gmr", "--for", "mjlab", "--csv", "--npz"]
        said = merged(place, path, *words)
        assert said.exit_code == shell.OK, said.output
    return place, everyone(raised()).astype("f4").astype(float), said


def test_arms_of_a_clip_stay_clear_of_the_legs_of_another_tool(lifted):
    place, _, said = lifted
    assert "wave.bvh: 60 poses" in said.stdout and ", certified;" in said.stdout
    with np.load(place / "out/wave.npz") as made:
        assert spare(made).min() >= -EXACT
        here = list(made["joint_names"]).index("left_elbow_joint")
        assert np.ptp(made["q"][:, here]) > 0.05  # it is the clip's arm
    held = side(place)
    assert held["certificate"]["holds"] and "forced" not in held
    assert held["gave_way"]["moved"] > 3 and held["to_human"]["mean"] < 0.05
    assert held["given"]["joints"] == ["left_hip_pitch_joint", "left_knee_joint",
                                       "left_wrist_roll_joint"]  # fmt: skip
    assert held["certificate"]["given"] == held["given"]["joints"]
    assert held["others_file"] == "../in/up.pkl" and held["rate"] == RATE
    assert held["others_sha256"] == fingerprint(place / "in/up.pkl")
    assert held["rows"]["written"] == ROWS and held["certified"]["paths"] == ROWS - 1


def test_with_the_legs_ignored_the_same_arms_do_not_hold(lifted, tmp_path, ready):
    place, every, _ = lifted
    said = run("retarget", place / "wave.bvh", *G1, "--out", tmp_path, "--npz", "--full")
    assert said.exit_code == shell.OK, said.output
    with np.load(tmp_path / "wave.npz") as made:
        names, q = list(made["joint_names"]), np.array(made["q"])
    q[:, [names.index(ORDER[i]) for i in REST]] = every[:, REST]
    assert judge().steps(names, q).min() < -0.002


def test_the_audit_of_each_file_that_was_written_says_the_same(lifted):
    place = lifted[0]
    ends = ("parquet", "csv", "npz", "gmr.npz", "mjlab.csv")
    said = run("audit", *(place / f"out/wave.{end}" for end in ends), *G1, "--acceleration", 60)
    assert said.exit_code == shell.OK and "5 of 5 files hold" in said.output, said.output
    assert said.output.count("moved by others: left_hip_pitch_joint") == 5
    assert "is left out" not in said.output


def test_legs_root_and_rows_are_the_other_files_to_the_bit(lifted):
    place, every, _ = lifted
    position, turn = root(ROWS)
    with np.load(place / "out/wave.gmr.npz") as made:
        assert list(made["joint_names"]) == list(ORDER) and made["fps"] == RATE
        assert (made["dof_pos"][:, REST] == every[:, REST]).all()
        assert (made["root_pos"] == position).all() and (made["root_rot"] == turn).all()
        ours = made["dof_pos"][:, OURS]
        about = json.loads(str(made["about"]))
    assert not (ours == every[:, OURS]).any(axis=0).all()
    assert set(about["whole"]["moved"]) == set(ORDER) and about["whole"]["held"] == {}
    assert about["layout"]["root_quaternion"].startswith("x y z w, as the file")
    rows = np.loadtxt(place / "out/wave.mjlab.csv", delimiter=",")
    assert (rows[:, :3] == position).all() and (rows[:, 3:7] == turn).all()
    assert (rows[:, 7:][:, REST] == every[:, REST]).all() and (rows[:, 7:][:, OURS] == ours).all()
    one = files.read(place / "out/wave.parquet")
    assert one.joints[: len(OURS)] == tuple(g1().joint_names) and len(one.joints) == len(ORDER)
    assert (one.time == np.arange(ROWS) / RATE).all()
    for i in REST:
        assert (one.q[:, one.joints.index(ORDER[i])] == every[:, i]).all(), ORDER[i]


def test_legs_are_shown_as_they_move(lifted):
    place, every, _ = lifted
    one = shown.read(place / "out/wave.parquet", g1())
    assert one.trajectory.joints == tuple(one.robot.joint_names)
    for name in ("left_knee_joint", "left_wrist_roll_joint"):
        at = one.trajectory.joints.index(name)
        assert (one.trajectory.q[:, at] == every[:, ORDER.index(name)]).all()
    ends = batch.capsule_ends(one.robot.chain, one.trajectory.q)
    knee = [body.name for body in one.robot.bodies].index("left_knee_link_0")
    assert np.ptp(ends[:, knee].reshape(ROWS, -1), axis=0).max() > 0.3  # [m]


def test_what_was_finished_is_kept_unless_the_legs_are_others(lifted, tmp_path, ready):
    place = lifted[0]
    path = gmr(tmp_path / "in/up.pkl", raised())
    one = clip(tmp_path / "wave.bvh")
    assert "(kept)" not in merged(tmp_path, path, clip_=one).stdout
    first = (tmp_path / "out/wave.parquet").read_bytes()
    assert "(kept)" in merged(tmp_path, path, clip_=one).stdout
    assert (tmp_path / "out/wave.parquet").read_bytes() == first
    assert "(kept)" not in merged(tmp_path, path, "--offset", 0.5, clip_=one).stdout
    gmr(path, 0.5 * raised())
    assert "(kept)" not in merged(tmp_path, path, "--offset", 0.5, clip_=one).stdout
    assert place.exists()


def test_legs_that_stand_change_hardly_anything(tmp_path, ready):
    legs = np.zeros((ROWS, len(LEGS)))
    path = saved(tmp_path / "in/still.npz", hanging(), legs)
    assert merged(tmp_path, path).exit_code == shell.OK
    alone = run("retarget", tmp_path / "wave.bvh", *G1, "--out", tmp_path / "alone")
    assert alone.exit_code == shell.OK
    one, other = (files.read(tmp_path / place / "wave.parquet") for place in ("out", "alone"))
    assert one.v is None and other.v is not None  # straight among legs, a curve without
    assert one.q[:, : len(OURS)] == pytest.approx(other.q, abs=0.02)
    assert (one.q[:, len(OURS) :] == 0.0).all()
    assert np.abs(one.time - other.time).max() < 1e-9


# --- forced steps


def test_a_leg_against_the_other_is_forced_and_the_exit_status_says_so(tmp_path, ready):
    path = saved(tmp_path / "in/x.npz", hanging(), crossed())
    said = merged(tmp_path, path, "--npz")
    assert said.exit_code == shell.BROKEN
    assert "NOT certified, some steps are forced" in said.stdout
    assert "forced: " in said.stderr and "not ours to change" in said.stderr
    held = side(tmp_path)
    assert held["certificate"]["holds"] is False and held["certified"]["share"] < 1.0
    assert held["forced"]["steps"] == 0 < held["forced"]["steps_not_ours_to_change"]
    assert held["certificate"]["forced"] == held["forced"]
    (one,) = held["forced"]["runs"]
    made = files.read(tmp_path / "out/wave.parquet")
    rows = np.flatnonzero(made.mode == Mode.FORCED)
    assert (rows == np.arange(one["first_row"], one["last_row"] + 1)).all()
    with np.load(tmp_path / "out/wave.npz") as data:
        found = spare(data)
    assert found[made.mode != Mode.FORCED].min() >= -EXACT and found[rows].min() < 0.0
    audited = run("audit", tmp_path / "out/wave.parquet", *G1)
    assert audited.exit_code == shell.BROKEN and "not ours to change" in audited.output
    table = tables.read_frame(contract(0.0005), tmp_path / "out/retarget.parquet", g1().tag)
    assert table["status"].to_list() == ["forced"] and "not ours" in table["why"][0]
    again = merged(tmp_path, path, "--npz")
    assert again.exit_code == shell.BROKEN and "(kept)" in again.stdout


def test_a_hand_that_cannot_get_away_is_forced_and_listed_as_ours(tmp_path, monkeypatch):
    led(monkeypatch, speed_factor=0.0015, acceleration_factor=0.5 / 60.0)
    legs = raised(40)
    legs[:, :2] = np.where(np.arange(40)[:, None] < 20, 0.0, [-1.6, 1.35])
    path = saved(tmp_path / "in/jump.npz", hanging(40), legs)
    still = clip(tmp_path / "wave.bvh", 40, still=True)
    assert merged(tmp_path, path, "--npz", clip_=still).exit_code == shell.BROKEN
    held = side(tmp_path)
    assert held["forced"]["steps"] > 0 and held["forced"]["runs"][0]["whose"] == "ours"
    made = files.read(tmp_path / "out/wave.parquet")
    with np.load(tmp_path / "out/wave.npz") as data:
        found = spare(data)
    assert (
        found[made.mode != Mode.FORCED].min() >= -EXACT
        and found[made.mode == Mode.FORCED].min() < 0.0
    )
    speed = np.abs(np.diff(made.q[:, : len(OURS)], axis=0)).max() * RATE
    assert speed <= 0.0015 * 37.0 * (1.0 + 1e-6)


# --- in time


def test_rows_before_and_after_the_clip_have_its_first_and_last_pose(tmp_path, ready):
    path = saved(tmp_path / "in/long.npz", hanging(150), 0.3 * raised(150))
    said = merged(tmp_path, path, "--offset", 1)
    assert said.exit_code == shell.OK, said.output
    assert "begins 1.00 s before the clip: its first 30 rows" in said.stderr
    assert "goes on 2.00 s beyond the clip: its last 60 rows keep" in said.stderr
    made = files.read(tmp_path / "out/wave.parquet")
    assert ((made.mode == BEYOND) == np.r_[[True] * 30, [False] * 60, [True] * 60]).all()
    assert "start" not in made.mode and side(tmp_path)["clip_time_offset_s"] == 1.0
    ours = made.q[:, : len(OURS)]
    # One second to come to rest: its file lets two waist joints brake at 5 and 9 rad/s^2 only.
    still = [not np.ptp(ours[part], axis=0).any() for part in (slice(0, 15), slice(120, 150))]
    assert still == [True, True] and np.ptp(ours[30:90], axis=0).max() > 0.1
    with np.load(path) as it:
        assert (made.q[:, len(OURS) :] == it["qpos"][:, 7 + len(OURS) :]).all()


def test_what_of_the_clip_has_no_row_is_said(tmp_path, ready):
    path = saved(tmp_path / "in/short.npz", hanging(30), 0.3 * raised(30))
    said = merged(tmp_path, path, "--offset", -0.5)
    assert said.exit_code == shell.OK, said.output
    assert "0.50 s of the clip lie before it begins" in said.stderr
    assert "0.50 s of the clip lie after it ends" in said.stderr
    assert BEYOND not in files.read(tmp_path / "out/wave.parquet").mode


def test_frames_are_met_to_the_bit_and_bones_turn_evenly_between_them(tmp_path):
    frames = read_frames(clip(tmp_path / "a.bvh", 20), g1().neck)
    one = read(asked(saved(tmp_path / "b.npz", hanging(60), raised(60))), g1())
    three = one._replace(time=np.arange(58) / (3.0 * RATE) + 7.0, rate=3.0 * RATE)
    seen, inside = at_rows(frames, three, 0.0)
    assert inside == slice(0, 58) and seen.x.shape == (58, DIM)
    even = np.abs(seen.time * RATE - np.rint(seen.time * RATE)) < 1e-9
    assert even[::3].all() and np.abs(seen.x[::3] - frames.x).max() < 1e-9
    bones = seen.x.reshape(-1, 7, 3)
    assert np.abs(np.linalg.norm(bones, axis=2) - 1.0).max() < 1e-12
    angle = np.arccos(np.clip((bones[1:] * bones[:-1]).sum(axis=2), -1.0, 1.0))
    assert np.ptp(angle.reshape(19, 3, 7), axis=1).max() < 1e-6 and angle.max() > 0.005
    alike, _ = at_rows(frames, one._replace(time=frames.time), 0.0)
    assert (alike.x == frames.x).all()
    assert told(frames, three, 0.0) == []


def test_a_gap_of_the_clip_is_gone_through_evenly(tmp_path):
    frames = read_frames(clip(tmp_path / "a.bvh", 20), g1().neck)
    keep = np.r_[0:5, 15:20]
    gap = frames._replace(x=frames.x[keep], time=frames.time[keep], frame=frames.frame[keep])
    one = read(asked(saved(tmp_path / "b.npz", hanging(20), raised(20))), g1())
    seen, _ = at_rows(gap, one, 0.0)
    assert (seen.x[keep] == gap.x).all() and np.isfinite(seen.x).all() and len(seen.x) == 20
    turn = np.arccos(np.clip((seen.x[4:15] * seen.x[5:16]).reshape(-1, 7, 3).sum(axis=2), -1, 1))
    assert np.ptp(turn, axis=0).max() < 1e-6


@pytest.mark.parametrize("offset", [2.6, -3.0])
def test_a_clip_that_meets_no_row_is_refused(offset, tmp_path, ready):
    path = saved(tmp_path / "in/a.npz", hanging(), raised())
    said = merged(tmp_path, path, "--offset", offset)
    assert said.exit_code == shell.BROKEN and "has no row there (0 to 1.97 s)" in said.stderr
    assert "--offset" in said.stderr and not (tmp_path / "out/wave.parquet").exists()


# --- files of others


def arrays(legs):
    position, turn = root(len(legs))
    return {"root_pos": position, "root_rot": turn, "dof_pos": everyone(legs), "fps": RATE,
            "joint_names": np.array(ORDER)}  # fmt: skip


def as_qpos(path, legs):
    position, turn = root(len(legs))
    qpos = np.hstack([position, turn[:, [3, 0, 1, 2]], everyone(legs)])
    np.savez(path, qpos=qpos, fps=RATE, joint_names=np.array(ORDER))


def as_legs_alone(path, legs):
    position, turn = root(len(legs))
    np.savez(path, root_pos=position, root_rot=turn, dof_pos=legs, fps=RATE, joint_names=LEGS)


def as_bodies(path, legs):
    position, turn = root(len(legs))
    np.savez(
        path, fps=[RATE], joint_pos=everyone(legs), joint_names=np.array(ORDER),
        body_pos_w=np.stack([position, position + 9.0], axis=1),
        body_quat_w=np.stack([turn, -turn], axis=1)[:, :, [3, 0, 1, 2]],
    )  # fmt: skip


def named(legs):
    position, turn = root(len(legs))
    table = {"time": np.arange(len(legs)) / RATE}
    table |= dict(zip(("root_x", "root_y", "root_z"), position.T, strict=True))
    table |= dict(zip(("root_qx", "root_qy", "root_qz", "root_qw"), turn.T, strict=True))
    return pl.DataFrame(table | dict(zip(ORDER, everyone(legs).T, strict=True)))


def as_hdf5(path, legs):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for key, value in arrays(legs).items():
            if key == "joint_names":
                file.attrs[key] = list(ORDER)
            else:
                file[key] = value


def as_csv(path, legs):
    np.savetxt(path, np.hstack([*root(len(legs)), everyone(legs)]), delimiter=",", fmt="%.17g")


def as_lists(path, legs):
    table = arrays(legs)
    names = json.dumps(table.pop("joint_names").tolist())
    meta = {"joint_names": names, "fps": str(table.pop("fps"))}
    lists = {key: pa.array(value.tolist()) for key, value in table.items()}
    pq.write_table(pa.table(lists).replace_schema_metadata(meta), path)


KINDS = {
    "a.pkl": gmr,
    "a.npz": lambda path, legs: np.savez(path, **arrays(legs)),
    "qpos.npz": as_qpos,
    "bodies.npz": as_bodies,
    "legs.npz": as_legs_alone,
    "a.csv": as_csv,
    "named.csv": lambda path, legs: named(legs).write_csv(path),
    "a.parquet": lambda path, legs: named(legs).write_parquet(path),
    "lists.parquet": as_lists,
    "a.h5": as_hdf5,
}


@pytest.mark.parametrize("name", KINDS)
def test_legs_and_root_are_read_from_what_the_guard_reads(name, tmp_path):
    path, legs = tmp_path / name, raised(20)
    KINDS[name](path, legs)
    fps = RATE if name == "a.csv" else None
    one = read(asked(path, fps=fps, rooted=True), g1())
    assert one.rate == RATE and len(one.time) == 20
    position, turn = root(20)
    assert (one.root.position == position).all() and (one.root.turn == turn).all()
    assert set(one.joints) == set(LEGS if name == "legs.npz" else [ORDER[i] for i in REST])
    assert (one.q[:, [one.joints.index(joint) for joint in LEGS]] == legs).all()
    moving = {"left_hip_pitch_joint", "left_knee_joint"}
    if name != "legs.npz":
        moving.add("left_wrist_roll_joint")
    assert set(one.others.joints) == moving
    every = read(asked(path, fps=fps, given=("all",)), g1())
    assert every.others.joints == every.joints and every.root is None


def test_a_file_that_was_made_here_is_read_again(lifted):
    place, every, _ = lifted
    for end in ("gmr.npz", "mjlab.csv"):
        one = read(asked(place / f"out/wave.{end}", rooted=True), g1())
        assert (one.root.position == root(ROWS)[0]).all() and (one.root.turn == root(ROWS)[1]).all()
        assert (one.q == every[:, REST]).all()


def test_legs_alone_are_enough_and_what_nobody_moves_stands_where_it_is_held(tmp_path, ready):
    as_legs_alone(tmp_path / "legs.npz", raised())
    said = merged(tmp_path, tmp_path / "legs.npz", "--full", "--for", "gmr")
    assert said.exit_code == shell.OK, said.output
    made = files.read(tmp_path / "out/wave.parquet")
    assert made.joints == tuple(joint.name for joint in joints(g1()).joints)
    assert (made.q[:, [made.joints.index(name) for name in LEGS]] == raised()).all()
    held = side(tmp_path)["whole"]["held"]
    assert set(held) == set(ORDER) - {*LEGS, *g1().joint_names}
    assert not made.q[:, [made.joints.index(name) for name in held]].any()
    with np.load(tmp_path / "out/wave.gmr.npz") as same:
        names = list(same["joint_names"])
        assert (same["dof_pos"] == made.q[:, [made.joints.index(name) for name in names]]).all()
        assert (same["root_rot"] == root(ROWS)[1]).all() and spare(same).min() >= -EXACT
    assert run("audit", tmp_path / "out/wave.parquet", *G1).exit_code == shell.OK


def test_legs_in_degrees_are_asked_about_and_read_as_said(tmp_path, ready):
    path = gmr(tmp_path / "in/deg.pkl", raised(), dof_pos=np.rad2deg(everyone(raised())))
    said = merged(tmp_path, path)
    assert said.exit_code == shell.UNREADABLE and "--degrees" in said.stderr
    assert merged(tmp_path, path, "--degrees").exit_code == shell.OK
    made = files.read(tmp_path / "out/wave.parquet")
    knee = made.q[:, made.joints.index("left_knee_joint")]
    assert np.abs(knee - raised()[:, 1]).max() < 1e-12


def test_the_robot_file_says_which_joints_the_motion_must_have(tmp_path):
    copied(tmp_path, "given: [left_ankle_roll_joint]")
    its = Robot.load(tmp_path / "g1.yaml")
    path = tmp_path / "legs.npz"
    as_legs_alone(path, raised(20))
    with pytest.raises(TrajectoryError, match="no column of the given joint 'left_ankle_roll"):
        read(asked(path, given=its.description.given), its)
    np.savez(tmp_path / "arms.npz", dof_pos=hanging(20), fps=30, joint_names=g1().joint_names)
    with pytest.raises(TrajectoryError, match="missing are left_ankle_roll_joint$"):
        read(asked(tmp_path / "arms.npz"), its)


# --- what is refused, in a line, before anything is made


def spoiled(place, **changed):
    path = place / "in/a.npz"
    path.parent.mkdir(exist_ok=True)
    table = arrays(raised()) | changed
    np.savez(path, **{key: value for key, value in table.items() if value is not None})
    return path


def bent(rows=ROWS):
    q = everyone(raised(rows))
    q[7, ORDER.index("left_hip_roll_joint")] = np.nan
    return q


@pytest.mark.parametrize(
    ("changed", "words", "says"),
    [
        (dict(dof_pos=hanging(), joint_names=g1().joint_names), [], "missing are left_hip_pitch"),
        (dict(joint_names=[f"x{i}" for i in range(29)]), [], "has no joint of g1"),
        (dict(fps=None), [], "give the rate with --others-fps"),
        (dict(root_rot=None), ["--for", "gmr"], "does not say where its root is"),
        (dict(root_rot=np.full((ROWS, 4), np.nan)), ["--for", "mjlab"], "row 0: the root is not"),
        (dict(root_rot=np.zeros((ROWS, 4))), ["--for", "mjlab"], "quaternion is none"),
        (dict(root_pos=np.zeros((3, 3))), ["--for", "gmr"], "3 places of its root for 60 rows"),
        (dict(time=np.cumsum(np.linspace(0.01, 0.05, ROWS))), ["--for", "gmr"], "one rate"),
        (dict(dof_pos=bent()), [], "left_hip_roll_joint is nan"),
        ({}, ["--given", "left_knee_joint"], "the robot file holds it at 0"),
        ({}, ["--given", "left_knee"], "is it 'left_knee_joint'?"),
        ({}, ["--rate", 60], "--rate does not go with --others"),
        ({}, ["--lead-in", 1], "--lead-in does not go with --others"),
        ({}, ["--for", "gmr", "--root-height", 1], "--root-height does not go with --others"),
        ({}, ["--offset", "nan"], "--offset must be within"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_line(changed, words, says, tmp_path, ready):
    said = merged(tmp_path, spoiled(tmp_path, **changed), *words)
    assert said.exit_code == shell.UNREADABLE, said.output
    (line,) = [line for line in said.stderr.splitlines() if "Error" in line]
    assert says in line
    assert not list((tmp_path / "out").glob("wave*"))


def test_options_of_others_without_it_and_many_clips_with_it_are_refused(tmp_path, ready):
    one, path = clip(tmp_path / "in/a.bvh"), spoiled(tmp_path)
    for words in (["--offset", 1], ["--others-fps", 30], ["--degrees"], ["--given", "all"]):
        said = run("retarget", one, *G1, "--out", tmp_path / "out", *words)
        assert said.exit_code == shell.UNREADABLE and "give --others too" in said.stderr
    clip(tmp_path / "in/b.bvh")
    said = run("retarget", tmp_path / "in/a.bvh", tmp_path / "in/b.bvh", *G1, "--others", path,
               "--out", tmp_path / "out")  # fmt: skip
    assert said.exit_code == shell.UNREADABLE and "of one clip, and here are 2" in said.stderr
    said = run("retarget", one, *G1, "--others", tmp_path / "none.npz", "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "none.npz: No such file" in said.stderr


def test_a_result_replaces_no_motion_of_others(tmp_path, ready):
    path = spoiled(tmp_path).rename(tmp_path / "wave.npz")
    said = run("retarget", clip(tmp_path / "wave.bvh"), *G1, "--others", path, "--npz",
               "--out", tmp_path)  # fmt: skip
    assert said.exit_code == shell.UNREADABLE and "would be replaced by a result" in said.stderr


def test_several_motions_and_a_file_that_changes_are_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "two.h5"
    with h5py.File(path, "w") as file:
        for group in ("a", "b"):
            file[f"{group}/dof_pos"], file[f"{group}/fps"] = everyone(raised(9)), RATE
            file[group].attrs["joint_names"] = list(ORDER)
    with pytest.raises(TrajectoryError, match="holds 2 motions; give a file of one"):
        read(asked(path), g1())
    one = asked(spoiled(tmp_path))
    spoiled(tmp_path, fps=25.0)
    with pytest.raises(TrajectoryError, match="changed while it was read"):
        read(one, g1())


def test_one_frame_and_one_row_are_a_motion(tmp_path, ready):
    path = saved(tmp_path / "in/one.npz", hanging(1), np.zeros((1, len(LEGS))) - 0.1)
    said = merged(tmp_path, path, clip_=clip(tmp_path / "wave.bvh", 1))
    assert said.exit_code == shell.OK and "1 poses" in said.stdout, said.output
    assert files.read(tmp_path / "out/wave.parquet").q.shape == (1, len(OURS) + len(LEGS))


def test_frames_that_nobody_can_follow_are_refused(tmp_path):
    frames = read_frames(clip(tmp_path / "a.bvh", 5), g1().neck)
    one = asked(saved(tmp_path / "b.npz", hanging(5), raised(5)))
    with pytest.raises(ParameterError, match="no frame with seven finite vectors"):
        convert_among(retargeter(), frames._replace(x=frames.x * np.nan), read(one, g1()), one)
