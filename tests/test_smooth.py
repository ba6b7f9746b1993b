"""Motions whose speed is continuous: streams and files keep all they promise at every moment."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import MARGIN, coman

from s3le.errors import CertificateError, ParameterError, TrajectoryError
from s3le.guard import clean
from s3le.guard.claim import claim
from s3le.guard.guard import Guard
from s3le.guard.task import Reading
from s3le.motion import files, trajectory
from s3le.plan import curved
from s3le.plan.flow import control_points, control_times, planner
from s3le.plan.limits import limits
from s3le.plan.settings import Settings
from s3le.plan.smooth import Smooth, walker
from s3le.plan.steps import Walker
from s3le.safety import paths
from s3le.safety.audit import CUBIC, STRAIGHT, audit, demands, say

DT, BETWEEN = 1 / 30, 0.0005
SETTINGS = Settings(curved=True)
EXACT = 1e-9  # [rad], of floats


def swings(seed, rows, pace=4.0, wild=False):
    """Wanted poses from pose to pose, through bodies and beyond limits."""
    robot, rng = coman(), np.random.default_rng(seed)
    ends = rng.uniform(robot.lower - 0.3, robot.upper + 0.3, (rows // 20 + 2, robot.n_dof))
    t = np.arange(rows) * DT * pace / np.pi
    k, share = (t % (len(ends) - 1)).astype(int), 0.5 - 0.5 * np.cos(np.pi * (t % 1.0))
    wanted = ends[k] + share[:, None] * (ends[k + 1] - ends[k])
    if wild:
        jumps = rng.random(rows) < 0.1
        wanted[jumps] = rng.uniform(robot.lower - 1, robot.upper + 1, (jumps.sum(), robot.n_dof))
    return wanted


def dense(rows, count=25):
    """Moments of a motion of rows (t, q, v), each piece a parabola; they must meet."""
    found = []
    for (t0, q0, v0), (t1, q1, v1) in zip(rows, rows[1:], strict=False):
        dt = t1 - t0
        assert np.abs(q0 + 0.5 * dt * (v0 + v1) - q1).max() < EXACT
        s = np.linspace(0.0, dt, count)[:, None]
        found.append(q0 + s * v0 + 0.5 * s**2 * (v1 - v0) / dt)
    return np.concatenate(found)


def held(robot, rows, most):
    """Is all of a motion of rows (t, q, v) within limits, speeds, accelerations and clear?"""
    q, dt = dense(rows), np.diff([t for t, *_ in rows])[:, None]
    v = np.array([v for *_, v in rows])
    assert (np.abs(v) <= most.speed * (1 + 1e-9)).all()
    assert (np.abs(np.diff(v, axis=0)) / dt <= most.acceleration * (1 + 1e-6)).all()
    assert (q >= robot.lower - 1e-9).all() and (q <= robot.upper + 1e-9).all()
    return robot.certifier().check(q).clearance.min()


def rested(robot, it):
    """The least clearance on the motion on which a walker would brake; it must end in rest."""
    rows = it.rest()
    assert rows[0].after == 0.0 and (rows[0].q == it.q).all() and (rows[0].v == it.v).all()
    assert not rows[-1].v.any() and robot.certifier().one(rows[-1].q)[0] >= MARGIN - 1e-6
    return held(robot, rows, it.most) if len(rows) > 1 else np.inf


@pytest.mark.parametrize("skeleton", [False, True], ids=["joints", "skeleton"])
@pytest.mark.parametrize("uneven", [False, True], ids=["even", "uneven"])
def test_a_stream_holds_at_every_moment_and_always_has_a_way_to_rest(skeleton, uneven):
    robot, rng = coman(), np.random.default_rng(4)
    it = Smooth(robot, limits(robot), SETTINGS, q=robot.anchor, skeleton=skeleton)
    rows, least, kept = [(0.0, it.q, it.v)], np.inf, 0
    for number, wanted in enumerate(swings(4, 240, wild=True)):
        dt = rng.choice([DT, DT / 2, 0.05, 0.01, 0.2]) if uneven else DT
        step = it.step(None if rng.random() < 0.05 else wanted, dt)
        assert step.certified and (step.q == it.q).all()
        t = rows[-1][0]
        rows += [(t + via.after, via.q, via.v) for via in step.via]
        rows.append((t + dt, it.q, it.v))
        kept += bool(step.via)
        assert step.clearance >= MARGIN
        if number % 4 == 0:
            least = min(least, rested(robot, it))
    assert min(least, held(robot, rows, it.most)) >= BETWEEN - 1e-6
    assert kept > 0 if uneven else kept == 0


def test_the_way_to_rest_is_driven_to_its_end_whatever_the_steps():
    robot, rng = coman(), np.random.default_rng(0)
    it = Smooth(robot, limits(robot), SETTINGS, q=robot.anchor)
    for wanted in swings(1, 40):
        it.step(wanted, DT)
    assert it.v.any()
    rows, steps = [(0.0, it.q, it.v)], 0
    while it.v.any():
        dt = rng.uniform(0.004, 0.03)
        step = it.step(None, dt)
        t = rows[-1][0]
        rows += [(t + via.after, via.q, via.v) for via in step.via] + [(t + dt, it.q, it.v)]
        steps += 1
        assert steps < 60
    assert held(robot, rows, it.most) >= BETWEEN - 1e-6
    at = it.q
    assert it.step(None, DT).q == pytest.approx(at, abs=0) and not it.v.any()


def test_without_the_proof_of_the_way_to_rest_robots_come_to_where_there_is_none(monkeypatch):
    """The same input as above breaks what is promised once that proof is taken out."""
    robot = coman()

    def blind(chain, swept, s, c, v, to, lasts, dt, bounds, care, out):
        end = 0.5 * (c + to)
        return bool(robot.certifier().one(end)[0] >= MARGIN)

    it = Smooth(robot, limits(robot), SETTINGS, q=robot.anchor)
    q, v = [it.q], [it.v]
    monkeypatch.setattr(
        Smooth, "_as_wanted", lambda self, wanted, before, dt, near, to, out: _clipped(
            self, wanted, dt, to, blind
        )
    )  # fmt: skip
    for wanted in swings(1, 400, wild=True):
        it.step(wanted, DT)
        q.append(it.q)
        v.append(it.v)
    good = paths.rests(
        robot, np.arange(len(q)) * DT, np.array(q), np.array(v), it.most.acceleration, BETWEEN
    )
    assert (~good).sum() > 5


def _clipped(it, wanted, dt, to, good):
    most = it.most
    w = np.clip((wanted - it._at) / dt, -most.speed, most.speed)
    w = np.clip(w, it._v - most.acceleration * dt, it._v + most.acceleration * dt)
    to[:] = np.clip(it._at + w * dt, most.lower, most.upper)
    return good(None, None, None, it._at, None, to, dt, dt, None, None, None)


def test_a_state_goes_on_to_the_bit_and_one_without_a_way_to_rest_is_refused():
    robot = coman()
    it = Smooth(robot, limits(robot), SETTINGS, q=robot.anchor)
    wanted = swings(2, 60)
    for row in wanted[:30]:
        it.step(row, DT)
    kept = it.state()
    first = [it.step(row, DT).q for row in wanted[30:]]
    it.put(kept)
    assert (np.array([it.step(row, DT).q for row in wanted[30:]]) == first).all()
    other = Smooth(robot, limits(robot), SETTINGS, q=robot.anchor)
    other.restore(kept)
    assert (np.array([other.step(row, DT).q for row in wanted[30:]]) == first).all()
    outwards = np.zeros(robot.n_dof)
    outwards[int((robot.upper - robot.anchor).argmin())] = 4.0  # it stands at its end already
    with pytest.raises(CertificateError, match="not proven that the robot can brake"):
        other.restore(kept._replace(q=robot.anchor, v=outwards, stop=None))


def test_what_is_wanted_smoothly_is_followed_closely():
    robot = coman()
    t = np.arange(150) * DT
    wanted = robot.anchor + 0.1 * np.sin(2.0 * t)[:, None] * (np.arange(robot.n_dof) % 2)
    for kind in (Walker, Smooth):
        it = kind(robot, limits(robot), Settings(curved=kind is Smooth), q=robot.anchor)
        off = [np.abs(it.step(row, DT).q - row).max() for row in wanted]
        assert max(off[60:]) < 0.01, kind


@pytest.mark.parametrize("skeleton", [False, True], ids=["joints", "skeleton"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_file_holds_at_every_moment_and_every_row_has_a_way_to_rest(seed, skeleton):
    robot = coman()
    most, wanted = limits(robot), swings(seed, 150)
    time = np.arange(150) * DT
    if seed:  # rows are missing
        keep = np.delete(np.arange(150), [40, 41, 42, 90])
        time, wanted = time[keep], wanted[keep]
    plan = planner(robot, most, SETTINGS).plan(time, wanted, skeleton=skeleton)
    rows = list(zip(time, plan.q, plan.v, strict=True))
    assert held(robot, rows, most) >= BETWEEN - 1e-6
    assert (robot.certifier().check(plan.q).clearance >= MARGIN).all()
    assert paths.rests(robot, time, plan.q, plan.v, most.acceleration, BETWEEN).all()
    assert (plan.clearance >= MARGIN).all() and (plan.bound[1:] >= BETWEEN).all()


def test_a_file_that_begins_where_the_robot_stands_begins_at_rest():
    robot = coman()
    wanted = np.concatenate([[robot.anchor] * 2, swings(3, 60)])
    plan = planner(robot, limits(robot), SETTINGS).plan(np.arange(62) * DT, wanted, stands=True)
    assert (plan.q[:2] == robot.anchor).all() and not plan.v[:2].any()


def test_a_motion_that_is_smooth_is_planned_as_it_is():
    robot = coman()
    t = np.arange(90) * DT
    free = np.minimum(robot.anchor - robot.lower, robot.upper - robot.anchor) > 0.1
    wanted = robot.anchor + 0.05 * np.sin(3.0 * t)[:, None] * free
    plan = planner(robot, limits(robot), SETTINGS).plan(t, wanted)
    assert np.abs(plan.q - wanted)[2:-2].max() < 2e-4
    assert plan.v == pytest.approx(np.gradient(wanted, t, axis=0), abs=0.02)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**31), rows=st.integers(2, 12))
def test_control_points_give_back_positions_and_speeds(seed, rows):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.01, 0.1, rows))
    moments, lasts = control_times(time)
    c = rng.normal(size=(rows + 1, 3))
    v = np.diff(c, axis=0) / np.diff(moments)[:, None]
    q = c[1:] - 0.5 * lasts[1:, None] * v
    assert q == pytest.approx(c[:-1] + 0.5 * lasts[:-1, None] * v)
    assert np.diff(q, axis=0) == pytest.approx(
        0.5 * np.diff(time)[:, None] * (v[1:] + v[:-1]), abs=1e-9
    )


def test_control_points_of_a_cubic_lie_on_it():
    t = np.arange(9.0)[:, None]
    wanted = 0.01 * t**3 - 0.2 * t**2 + t
    inner = control_points(wanted)[2:-2]
    half = t[1:-2] + 0.5
    assert inner == pytest.approx(0.01 * half**3 - 0.2 * half**2 + half)
    assert (control_points(wanted[:1]) == wanted[0]).all()


def test_weights_row_by_row_are_refused():
    robot = coman()
    weight = np.tile(np.eye(robot.n_dof), (5, 1, 1))
    with pytest.raises(ParameterError, match="one matrix for all rows"):
        planner(robot, limits(robot), SETTINGS).plan(
            np.arange(5.0), np.tile(robot.anchor, (5, 1)), weight=weight
        )


def test_settings_decide_which_walker_and_planner_there_is():
    robot = coman()
    assert type(walker(robot, limits(robot), Settings(), q=robot.anchor)) is Walker
    assert type(walker(robot, limits(robot), SETTINGS, q=robot.anchor)) is Smooth
    assert planner(robot, None, SETTINGS).plan(np.zeros(1), robot.anchor[None]).v is not None
    assert planner(robot, None, Settings()).plan(np.zeros(1), robot.anchor[None]).v is None


def test_a_guard_stops_along_what_was_proven():
    robot = coman()
    guard = Guard(robot)
    guard.start()
    for wanted in swings(5, 45):
        step = guard.step(wanted, DT)
    assert np.abs(step.v).max() > 1.0
    guard.stop()
    rows, v = [(0.0, guard.q, guard.v)], [guard.v]
    while guard.v.any():
        step = guard.step(None, DT)
        assert step.certified and step.reason in ("braked", "stopped")
        rows.append((rows[-1][0] + DT, guard.q, guard.v))
        v.append(guard.v)
        assert len(rows) < 10
    assert held(robot, rows, guard.most) >= BETWEEN - 1e-6
    speed = np.abs(np.array(v))
    assert (np.diff(speed, axis=0) <= 1e-9).all()  # no joint is accelerated


def test_examine_finds_a_row_without_a_way_to_rest():
    robot = coman()
    its = planner(robot, limits(robot), SETTINGS)
    far = (robot.upper - robot.anchor)[6]
    c = np.tile(robot.anchor, (4, 1))
    c[:, 6] = robot.upper[6] - far + np.array([0.0, 0.0, 1.0, 2.0]) * 0.12
    c[:, 6] += far - 0.24  # it comes to its limit at 3.6 rad/s
    room = [np.zeros(4), np.zeros(4, bool), np.zeros(4), np.zeros(4)]
    curved.examine(
        its._chain, its._swept, its._scratch, c, np.full(4, DT), DT, its._bounds, its._care, 0, 4,
        room[0], room[1], room[2], room[3],
    )  # fmt: skip
    assert room[1].tolist() == [True, True, True, False]
    assert room[2][3] == 1.0  # it is the way to rest that fails


# --- files that tell speeds


def motion(wanted, time):
    robot = coman()
    plan = planner(robot, limits(robot), SETTINGS).plan(time, wanted)
    about = {"robot": robot.name, "robot_hash": robot.digest}
    mode = np.full(len(time), "planned")
    return trajectory.make(
        "m", robot.joint_names, time, plan.q, plan.clearance, mode, about, v=plan.v
    )


@pytest.mark.parametrize("kind", ["parquet", "csv", "npz"])
@pytest.mark.parametrize("straight", [False, True])
def test_speeds_come_back_to_the_bit_and_the_guard_tells_those_of_what_it_moves(
    tmp_path, kind, straight
):
    robot, time = coman(), np.arange(60) * DT
    made = motion(swings(7, 60), time)
    files.write(made, tmp_path / f"m.{kind}")
    back = files.read(tmp_path / f"m.{kind}")
    assert back.joints == made.joints
    assert (back.v == made.v).all() and (back.q == made.q).all()
    spoilt = replace(made, q=np.clip(made.q + 0.4, robot.lower, robot.upper))
    for number, one in enumerate((made, spoilt)):
        source, target = (tmp_path / f"{where}{number}.{kind}" for where in ("in", "out"))
        files.write(one, source)
        layout = Reading().open(source, robot)
        its = clean.Guard(*claim(robot, straight=straight))
        assert (layout.episodes[0].v == one.v).all()
        cleaned = its.clean(layout, False)
        q = layout.episodes[0].q if cleaned.q[0] is None else cleaned.q[0]
        layout.write(target, [q], None, cleaned.v)
        left = files.read(target)
        said = cleaned.summary["certificate"]["between_rows"]
        if number == 0:  # it is a curve that holds: nothing is touched
            assert cleaned.q[0] is None and (left.v == one.v).all() and said == CUBIC
        elif straight:
            assert cleaned.q[0] is not None and said == STRAIGHT
            assert left.v is None  # what is written goes straight from row to row
        else:
            assert cleaned.q[0] is not None and said == CUBIC
            assert (left.v == cleaned.v[0]).all() and (left.v != one.v).any()
        if number:
            assert not any("vel" in note for note in layout.episodes[0].notes)


def test_a_file_that_tells_the_speed_of_some_joints_is_refused(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("time,a,b,a.vel\n0,0,0,0\n1,0,1,0\n", encoding="utf-8")
    with pytest.raises(TrajectoryError, match="speed of some joints, but not of 'b'"):
        files.read(path)
    path.write_text("time,a,a.vel\n0,0,inf\n1,0,0\n", encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"line 2: a.vel is inf"):
        files.read(path)


def test_an_audit_of_a_curve_finds_what_is_broken_between_its_rows_and_after_them():
    robot = coman()
    most, time = limits(robot), np.arange(40) * DT
    made = motion(swings(8, 40), time)
    asked = demands(
        robot, acceleration=dict(zip(robot.joint_names, most.acceleration.tolist(), strict=True))
    )
    good = audit(robot, time, made.q, asked, v=made.v)
    assert good.holds and {c.name for c in good.checks} >= {"stops", "accelerations", "paths"}
    spoilt = made.v.copy()
    spoilt[20] += 0.5  # the rows stay where they are: harder, and not on one parabola
    found = {c.name: c for c in audit(robot, time, made.q, asked, v=spoilt).checks}
    assert found["accelerations"].broken > 0 and found["accelerations"].first.row in (19, 20)
    fast = made.v.copy()
    fast[-1] = 99.0  # it comes to rest beyond its limits
    found = {c.name: c for c in audit(robot, time, made.q, asked, v=fast).checks}
    assert found["stops"].broken == 1 and found["stops"].first.row == 39
    assert "no way to rest" in say("stops", found["stops"].first)
    nan = made.v.copy()
    nan[5, 2] = np.nan
    report = audit(robot, time, made.q, asked, v=nan)
    assert not report.holds
    assert {c.name for c in report.checks if c.broken} >= {"velocities", "accelerations", "paths"}


@pytest.mark.parametrize("check", [True, False])
def test_a_row_of_a_stop_that_keeps_less_than_the_margin_is_not_called_certified(
    check, monkeypatch
):
    robot = coman()
    room = robot.certifier()
    rng = np.random.default_rng(3)
    bad = next(
        q
        for q in rng.uniform(robot.lower, robot.upper, (500, robot.n_dof))
        if room.one(q)[0] < BETWEEN
    )
    near, low, high = robot.anchor, 0.0, 1.0  # a pose between the claim of rows and of the way
    while not BETWEEN <= room.one(near)[0] < MARGIN:
        share = 0.5 * (low + high)
        near = robot.anchor + share * (bad - robot.anchor)
        low, high = (share, high) if room.one(near)[0] >= MARGIN else (low, share)
    it = Smooth(
        robot, limits(robot), Settings(curved=True, target=MARGIN, check=check), q=robot.anchor
    )
    for wanted in swings(6, 10):
        assert it.step(wanted, DT).certified
    assert it.v.any()
    monkeypatch.setattr(it, "_holds", lambda *_: False)  # only the kept stop is left
    monkeypatch.setattr(it, "_along", lambda dt: (near.copy(), np.zeros_like(near), ()))
    step = it.step(wanted, DT)
    assert (step.q == near).all() and not step.certified
    assert step.clearance == pytest.approx(room.one(near)[0], abs=1e-6)
