"""`s3le guard` makes curves: rows of position and speed, and a proven way to rest from each."""

import json

import numpy as np
import pytest
from command import run
from guarding import put
from layouts import KINDS, TIME, gmr, joints, motion
from test_guard_clean import colliding, held, joint, near, still, swaying
from worlds import coman, inside_limits

from s3le.cli import shell
from s3le.errors import CertificateError, TrajectoryError
from s3le.guard import curves
from s3le.guard.claim import claim
from s3le.guard.clean import Guard
from s3le.guard.layouts.door import open_layout
from s3le.guard.task import decode, encode
from s3le.motion import files, trajectory
from s3le.plan.flow import planner
from s3le.plan.limits import limits
from s3le.plan.settings import Settings
from s3le.robot.robot import Robot
from s3le.safety import audit, paths

ONE = ["--robot", "coman", "--jobs", 1]


@pytest.fixture(scope="module")
def guard():
    return Guard(*claim(coman()))


@pytest.fixture(scope="module")
def straight():
    return Guard(*claim(coman(), straight=True))


def side(out, name):
    return json.loads((out / f"{name}.guard.json").read_text())


def asked(hardest=60.0):
    return audit.demands(coman(), acceleration=hardest)


def audited(path, *words):
    said = run("audit", path, "--robot", "coman", "--json", *words)
    return json.loads(said.stdout)["files"][0]


# --- what is made


def test_a_colliding_file_becomes_a_curve_with_a_way_to_rest_from_every_row(tmp_path):
    source = put(tmp_path / "bad.csv", colliding(), about={"clip": "a"})
    assert run("guard", source, *ONE, "--out", tmp_path / "out").exit_code == shell.OK
    made = files.read(tmp_path / "out" / "bad.csv")
    assert made.v is not None and np.abs(made.v).max() > 0.1
    seen = audited(tmp_path / "out" / "bad.csv")
    assert seen["holds"] and seen["checks"]["stops"]["total"] == 60
    held = side(tmp_path / "out", "bad.csv")
    assert held["certificate"]["between_rows"] == audit.CUBIC
    assert "motion to rest from each row" in held["certificate"]["covers"]
    assert held["before"]["stops"]["broken"] > 5 and held["after"]["stops"]["broken"] == 0
    assert made.about["certificate"]["holds"]


def test_asked_for_straight_rows_a_file_is_what_it_was(guard, straight, tmp_path):
    source = put(tmp_path / "bad.csv", colliding())
    said = run("guard", source, *ONE, "--straight", "--out", tmp_path / "out")
    assert said.exit_code == shell.OK
    made, told = files.read(tmp_path / "out" / "bad.csv"), side(tmp_path / "out", "bad.csv")
    assert made.v is None and told["certificate"]["between_rows"] == audit.STRAIGHT
    assert "stops" not in told["after"] and "straight joint paths" in told["certificate"]["covers"]
    settings = Settings(target=0.0025, check=False)
    plan = planner(coman(), limits(coman()), settings).plan(made.time, colliding())
    moved = (made.q != colliding()).any(axis=1)
    assert (made.q[moved] == plan.q[moved]).all() and moved.any()
    # Other claims are other results.
    assert "(kept)" not in run("guard", source, *ONE, "--out", tmp_path / "out").output


def test_straight_rows_that_hold_are_touched_unless_they_are_asked_for(guard, straight):
    jerky = straight.clean(held(zigzag()), degrees=False).q[0]
    jerky = zigzag() if jerky is None else jerky
    one = held(jerky, place=True)
    assert straight.clean(one, degrees=False).q == [None]
    made = guard.clean(one, degrees=False)
    assert made.summary["before"]["stops"]["broken"] > 0 and made.summary["holds"]
    report = audit.audit(coman(), one.episodes[0].time, made.q[0], asked(), v=made.v[0])
    assert report.holds and any(check.name == "stops" for check in report.checks)
    assert 0.0 < made.summary["moved"]["most_deg"] < 1.95  # what a smooth motion has to move


def test_rows_at_all_limits_hold_without_a_place_for_speeds_too(guard):
    """What keeps limits to the last digit has no speeds but its own; so it is planned with less."""
    q = hurried()
    made = guard.nearest(held(q).episodes[0])
    assert made.after.holds and made.reserve > 1e-3 and made.v is not None
    report = audit.audit(coman(), np.arange(len(q)) / 30.0, made.q, asked(), v=made.v)
    assert report.holds
    with_place = guard.nearest(held(q, place=True).episodes[0])
    assert with_place.after.holds and with_place.reserve == 0.0


def hurried():
    """Rows that turn as fast as joints may, and change their mind every four rows."""
    q = [coman().anchor]
    for i in range(11):
        q.append(q[-1] + np.clip(inside_limits(coman(), 12, 1)[i // 4] - q[-1], -4 / 30, 4 / 30))
    return np.array(q)


def zigzag(rows=60):
    """Straight rows whose speed turns back at every other row, as hard as it may."""
    q = still(rows)
    q[:, joint("LShSag")] += 0.5 * 60.0 / 30.0**2 * (np.arange(rows) % 2)
    return q


def test_a_curve_that_leaves_the_robot_no_way_to_rest_is_no_file_that_holds(guard):
    """Towards the body, so fast that it cannot be braked for: every pose and path is clear."""
    q, v = still(8), np.zeros((8, coman().n_dof))
    v[:, joint("RShLat")] = 3.0
    q[:, joint("RShLat")] = near(0.0025) - 3.0 * np.arange(7, -1, -1) / 30.0
    one = held(q, place=True).episodes[0]._replace(v=v)
    told = curves.see(guard, one)
    assert told.curve is None and not told.before.holds
    (stops,) = [check for check in told.before.checks if check.name == "stops"]
    assert stops.broken > 0 and not any(c.broken for c in told.before.checks if c is not stops)
    made = guard.nearest(one)
    assert made.after.holds and (made.q != q).any() and made.v is not None


def test_what_already_is_such_a_curve_stays_to_the_byte(tmp_path):
    source = put(tmp_path / "in" / "a.parquet", colliding())
    assert run("guard", source, *ONE, "--out", tmp_path / "one").exit_code == shell.OK
    one = tmp_path / "one" / "a.parquet"
    assert run("guard", one, *ONE, "--out", tmp_path / "two").exit_code == shell.OK
    assert one.read_bytes() == (tmp_path / "two" / "a.parquet").read_bytes()
    assert side(tmp_path / "two", "a.parquet")["changed"] is False


def test_a_file_with_speeds_that_is_moved_does_not_lose_them(tmp_path):
    time = np.arange(60) / 30.0
    wanted = swaying(by=0.5)
    plan = planner(coman(), limits(coman()), Settings(curved=True)).plan(time, wanted)
    one = trajectory.make("m", coman().joint_names, time, plan.q, about={"clip": "a"}, v=plan.v)
    for name in ("a.parquet", "a.csv", "a.npz"):
        files.write(one, tmp_path / "in" / name if (tmp_path / "in").mkdir(exist_ok=True) else
                    tmp_path / "in" / name)  # fmt: skip
        words = [*ONE, "--acceleration", 4, "--out", tmp_path / "out"]
        assert run("guard", tmp_path / "in" / name, *words).exit_code == shell.OK
        made = files.read(tmp_path / "out" / name)
        assert (made.q != plan.q).any() and made.v is not None and (made.v != plan.v).any()
        assert audited(tmp_path / "out" / name, "--acceleration", "4")["holds"]
        words = [*ONE, "--acceleration", 4, "--straight", "--out", tmp_path / "straight"]
        assert run("guard", tmp_path / "in" / name, *words).exit_code == shell.OK
        assert files.read(tmp_path / "straight" / name).v is None  # nothing is claimed of them


# --- where files have a place for speeds, and where they have none


PLACED = [
    "npz", "npz, behind a base", "npz, an array each", "csv, odd", "parquet, fixed lists",
    "parquet, lists", "parquet, large", "parquet, a column each", "ours, parquet", "ours, csv",
    "ours, npz",
]  # fmt: skip


@pytest.mark.parametrize("name", PLACED)
def test_speeds_lie_beside_the_angles_and_are_read_from_there(tmp_path, name):
    kind = KINDS[name]
    path, robot = kind.make(tmp_path), Robot.load(kind.robot)
    (one,) = open_layout(path, robot, **kind.options).episodes
    assert one.v is None and one.pace is not None
    v = one.paced(0.3 * np.cos(TIME[:, None] + np.arange(robot.n_dof)))
    to = tmp_path / "out" / path.name
    to.parent.mkdir()
    open_layout(path, robot, **kind.options).write(to, [one.q], None, [v])
    (two,) = open_layout(to, robot, **kind.options).episodes
    assert (two.q == one.q).all() and (two.v == v).all() and np.abs(v).max() > 0.25
    assert not any(".vel" in note or " v" in note for note in two.notes)
    again = two.paced(0.5 * v)
    open_layout(to, robot, **kind.options).write(to, [one.q], None, [again])
    (three,) = open_layout(to, robot, **kind.options).episodes
    assert (three.v == again).all() and (three.v != v).any()
    before, after = kind.cells(path), kind.cells(to)
    for key in before.keys() - {
        "entries",
        "schema",
        "fields",
        "groups",
        "side",
        "about",
        "about, type",
    }:
        assert before[key] == after[key]


def test_an_audit_reads_the_speeds_of_any_file(tmp_path):
    wanted, time = swaying(), np.arange(60) / 30.0
    plan = planner(coman(), limits(coman()), Settings(curved=True)).plan(time, wanted)
    names = [f"{name}_pos" for name in coman().joint_names]
    np.savez(tmp_path / "a.npz", fps=30.0, dof_pos=plan.q, v=plan.v, joint_names=names)
    base = np.hstack([np.zeros((60, 6)), np.ones((60, 1)), plan.q])
    np.savez(tmp_path / "b.npz", fps=30.0, qpos=base, v=plan.v, joint_names=coman().joint_names)
    head = ["time", *names, "root_x", *(f"{name}.vel" for name in names)]
    rows = np.column_stack([time, plan.q, np.sin(time), plan.v])
    np.savetxt(tmp_path / "c.csv", rows, "%.17g", ",", header=",".join(head), comments="")
    for name in ("a.npz", "b.npz", "c.csv"):
        assert audited(tmp_path / name)["checks"]["stops"] == {
            "unit": "-", "total": 60, "broken": 0, "undecided": 0, "first": None,
            "worst": audited(tmp_path / name)["checks"]["stops"]["worst"],
        }  # fmt: skip
    head.remove(names[2] + ".vel")
    rows = np.delete(rows, len(names) + 2 + 2, axis=1)
    rows[:, 3] += 1e-3 * np.arange(60)
    np.savetxt(tmp_path / "c.csv", rows, "%.17g", ",", header=",".join(head), comments="")
    assert "the speed of some joints, but not of" in audited(tmp_path / "c.csv")["unreadable"]


def test_single_precision_speeds_are_proven_as_they_are_rounded(guard, tmp_path):
    one = held(colliding(), kind="f4", place=True)
    made = guard.clean(one, degrees=False)
    q, v = made.q[0], made.v[0]
    assert (q == q.astype("f4")).all() and (v == v.astype("f4")).all()
    assert audit.audit(coman(), one.episodes[0].time, q, asked(), v=v).holds
    assert 0.0 <= made.summary["reserve_rad"] < 1e-4
    assert "straight_rows" not in made.summary["certificate"]


def test_a_file_without_a_place_for_speeds_says_what_is_proven_of_it(tmp_path):
    source = gmr(tmp_path)
    layout = open_layout(source, Robot.load("g1"))
    its = Robot.load("g1")
    wide = np.clip(3.0 * (layout.episodes[0].q - its.anchor) + its.anchor, -3, 3)
    layout.write(source, [wide])
    said = run("guard", source, "--robot", "g1", "--jobs", 1, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    told = side(tmp_path / "out", source.name)["certificate"]
    assert "the file has no place for speeds" in told["between_rows"]
    assert told["straight_rows"] == audit.straight_rows(0)
    assert "straight rows are proven too" in said.output
    (one,) = open_layout(tmp_path / "out" / source.name, its).episodes
    assert one.v is None and one.pace is None
    assert (paths.certify(its, one.q, 0.0005).status == paths.CERTIFIED).all()
    assert curves.see(Guard(*claim(its)), one).good  # speeds are found again, with ways to rest


def test_straight_rows_that_are_not_proven_are_said(guard, monkeypatch):
    monkeypatch.setattr(curves, "astray", lambda its, q: 3)
    made = guard.clean(held(colliding()), degrees=False)
    assert made.summary["holds"]
    assert made.summary["certificate"]["straight_rows"]["steps_not_proven"] == 3
    assert made.summary["certificate"]["straight_rows"]["proven"] is False


def test_a_speed_that_is_no_number_is_no_claim_and_one_that_is_infinite_is_refused(tmp_path):
    robot, time = Robot.load("coman"), np.arange(60) / 30.0
    one = trajectory.make("m", robot.joint_names, time, swaying(), v=np.zeros((60, robot.n_dof)))
    path = tmp_path / "a.csv"
    files.write(one, path)
    lines = path.read_text().splitlines()
    at = lines[0].split(",").index("LShSag.vel")
    for word in ("nan", "inf"):
        fields = lines[5].split(",")
        fields[at] = word
        path.write_text("\n".join([*lines[:5], ",".join(fields), *lines[6:]]) + "\n")
        if word == "nan":
            assert open_layout(path, robot).episodes[0].v is None
            continue
        with pytest.raises(TrajectoryError, match="line 6: the speed of LShSag is inf"):
            open_layout(path, robot)


def test_speeds_of_others_are_left_alone_where_straight_rows_are_asked_for(tmp_path):
    names = coman().joint_names
    table = {"time": np.arange(60) / 30.0}
    table |= {name: colliding()[:, i] for i, name in enumerate(names)}
    table |= {f"{name}.vel": np.full(60, 9.0) for name in names}
    rows = np.column_stack(list(table.values()))
    np.savetxt(tmp_path / "a.csv", rows, "%.17g", ",", header=",".join(table), comments="")
    words = [tmp_path / "a.csv", *ONE, "--out"]
    said = run("guard", *words, tmp_path / "out", "--straight")
    assert said.exit_code == shell.OK and "its speeds stay as they are" in said.stderr
    assert (files.read(tmp_path / "out" / "a.csv").v == 9.0).all()
    assert run("guard", *words, tmp_path / "curved").exit_code == shell.OK
    assert np.abs(files.read(tmp_path / "curved" / "a.csv").v).max() < 4.0
    assert audited(tmp_path / "curved" / "a.csv")["holds"]


# --- how


def test_what_a_worker_found_comes_back_with_its_speeds(guard):
    made = guard.clean(held(colliding(), still(3), place=True), degrees=False)
    again = decode(encode(made))
    assert isinstance(again, type(made)) and again.q[1] is None
    for one, two in zip(made.v, again.v, strict=True):
        assert (one is None) == (two is None) and (one is None or (one == two).all())


def test_rows_far_from_what_is_broken_are_put_back(guard):
    q = np.concatenate([swaying(90), swaying(90)[-1:] + colliding() - still(60), swaying(90)])
    for place in (False, True):
        made = guard.clean(held(q[:150], place=place), degrees=False)
        assert (made.q[0][:60] == q[:60]).all()
        assert made.summary["moved"]["touched"] < 90


def test_the_nearest_of_three_plans_is_taken_where_one_was_driven_or_refused(guard, monkeypatch):
    honest = Guard.planned(guard, 0.0, 1 / 30)
    wanted, time = colliding(), np.arange(60) / 30.0

    class Driven:
        def __init__(self, off):
            self.off = list(off)

        def plan(self, times, wanted, progress=None):
            off = self.off.pop(0)
            if off is None:
                raise CertificateError("no motion was found")
            made = honest.plan(times, wanted)
            return made._replace(q=made.q + off, how=np.full(60, 2, np.uint8))

    for off in ([1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 0.0], [None, None, 0.0]):
        driven = Driven(off)
        monkeypatch.setattr(
            guard, "planned",
            lambda reserve, step, straight=False, one=driven: honest if straight else one,
        )  # fmt: skip
        made = curves._plan(guard, 0.0, 1 / 30, time, wanted, None)
        assert np.abs(made.q - wanted).max() < 0.9 and not driven.off
    monkeypatch.setattr(guard, "planned", lambda *_, **__: Driven([None] * 3))
    with pytest.raises(CertificateError, match="no motion was found"):
        curves._plan(guard, 0.0, 1 / 30, time, wanted, None)


def test_among_joints_that_others_move_a_guard_says_that_rows_go_straight(tmp_path):
    q = np.zeros((30, len(joints())))
    names = list(joints())
    for i, name in enumerate(Robot.load("g1").joint_names):
        q[:, names.index(name)] = motion("g1")[0, i]
    q[:, names.index("left_knee_joint")] = np.linspace(0.0, 0.4, 30)
    np.savez(tmp_path / "a.npz", fps=30.0, dof_pos=q, joint_names=names)
    words = ["--robot", "g1", "--jobs", 1, "--out", tmp_path / "out"]
    said = run("guard", tmp_path / "a.npz", *words)
    assert said.exit_code == shell.OK and "no way to rest is proven" in said.stderr
    told = side(tmp_path / "out", "a.npz")["certificate"]
    assert told["between_rows"] == audit.STRAIGHT and "straight joint paths" in told["covers"]
    assert np.load(tmp_path / "out" / "a.npz").files == np.load(tmp_path / "a.npz").files
