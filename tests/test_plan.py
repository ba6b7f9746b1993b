"""Plans: what comes out holds in every way, is near what was wanted, and comes back to the bit."""

from functools import cache

import daqp
import numpy as np
import pytest
from worlds import MARGIN, coman, inside_limits

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.plan import chase, interior, limits, rounds, weights, whole
from s3le.plan.banded import factor, solve_with
from s3le.plan.examine import DRIVEN, WANTED
from s3le.plan.settings import Settings
from s3le.plan.steps import Walker
from s3le.plan.whole import Planner
from s3le.robot.robot import Robot
from s3le.safety.judge import Judge
from s3le.safety.paths import CERTIFIED, certify
from s3le.skeleton import cosine_distance

BETWEEN = 0.0005  # [m]
AGREEMENT = 1e-7  # [m], of kernels and coal (test_distance.py)
SPEED, ACCELERATION = 4.0, 60.0  # [rad/s] COMAN's, [rad/s^2] the default
ROUNDED = 1.0 + 1e-9


@cache
def planner() -> Planner:
    return Planner(coman())


def walk(walker, times, wanted):
    """Follow wanted poses from where a walker is, which is row 0: rows, how each came about."""
    q, how = [walker.q], ["start"]
    for row in range(1, len(times)):
        step = walker.step(wanted[row], times[row] - times[row - 1])
        assert step.certified, row
        q.append(step.q)
        how.append(step.how)
    return np.array(q), how


def clear_poses(n: int, seed: int, made: Robot | None = None) -> np.ndarray:
    made = made or coman()
    return batch.project(made.chain, made.anchor, inside_limits(made, n, seed), 0.004).q


def visits(m: int, every: int, seed: int) -> np.ndarray:
    """Poses that jump to another clear pose now and then, (m, n_dof)."""
    return np.repeat(clear_poses(-(-m // every), seed), every, axis=0)[:m]


def swings(m: int, seed: int, far: float = 1.0, rate: float = 30.0) -> np.ndarray:
    """Every joint swings through its range, in collision or not, (m, n_dof)."""
    made, rng = coman(), np.random.default_rng(seed)
    n = made.n_dof
    middle, half = 0.5 * (made.lower + made.upper), far * 0.5
    half = half * (made.upper - made.lower)
    t = np.arange(m)[:, None] / rate
    waves = np.sin(2.0 * np.pi * rng.uniform(0.1, 0.6, n) * t + rng.uniform(0.0, 6.28, n))
    return middle + half * waves


def even(m: int, rate: float = 30.0) -> np.ndarray:
    return np.arange(m) / rate


def assert_holds(
    times: np.ndarray, q: np.ndarray, from_rest: bool = False, made: Robot | None = None
) -> None:
    """By numpy's differences, coal and the proof: independent of what planned it."""
    most = SPEED if made is None else limits.limits(made).speed
    made = made or coman()
    assert (q >= made.lower).all() and (q <= made.upper).all()
    dt = np.diff(times)[:, None]
    speed = np.diff(q, axis=0) / dt
    assert (np.abs(speed) <= most * ROUNDED).all()
    mean = 0.5 * (dt[1:] + dt[:-1])
    assert np.abs(np.diff(speed, axis=0) / mean).max(initial=0.0) <= ACCELERATION * ROUNDED
    if from_rest and len(speed):
        assert np.abs(speed[0] / dt[0]).max() <= ACCELERATION * ROUNDED
    made.certifier().require(q, MARGIN)
    assert (certify(made, q, BETWEEN).status == CERTIFIED).all()


@pytest.mark.parametrize("skeleton", [False, True])
@pytest.mark.parametrize(("kind", "seed"), [("visits", 0), ("swings", 1), ("swings", 2)])
def test_whatever_is_wanted_what_comes_out_holds(kind, seed, skeleton):
    times = even(150)
    wanted = visits(150, 40, seed) if kind == "visits" else swings(150, seed)
    made = planner().plan(times, wanted, skeleton=skeleton)
    assert_holds(times, made.q)
    assert (made.clearance >= MARGIN).all() and (made.bound >= BETWEEN).all()


@pytest.mark.parametrize("skeleton", [False, True])
def test_a_motion_that_holds_comes_back_to_the_bit(skeleton):
    times = even(120)
    first = planner().plan(times, swings(120, 3, 0.8), skeleton=skeleton)
    again = planner().plan(times, first.q, skeleton=skeleton)
    assert again.q.tobytes() == first.q.tobytes()
    assert (again.how == WANTED).all()


def test_rows_far_from_what_is_broken_stay_as_they_are():
    times = even(400)
    calm = planner().plan(times, swings(400, 4, 0.3)).q
    wanted = calm.copy()
    wanted[200] += 0.3  # a row that no joint can reach and leave in time
    made = planner().plan(times, wanted)
    assert_holds(times, made.q)
    moved = np.flatnonzero((made.q != wanted).any(axis=1))
    assert len(moved) and moved.min() >= 198 - 15 and moved.max() <= 202 + 15


def test_uneven_steps_keep_speed_and_acceleration():
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.uniform(0.004, 0.06, 150))
    wanted = visits(150, 50, 6)
    for skeleton in (False, True):
        assert_holds(times, planner().plan(times, wanted, skeleton=skeleton).q)


def test_poses_outside_every_limit_and_in_collision_throughout():
    made = coman()
    wanted = np.tile(made.upper + 1.0, (40, 1))
    wanted[20:] = made.lower - 1.0
    times = even(40)
    assert_holds(times, planner().plan(times, wanted).q)
    assert_holds(times, planner().plan(times, wanted, skeleton=True).q)


def crossed() -> tuple[np.ndarray, np.ndarray]:
    """Two clear poses between which the straight path collides."""
    poses = clear_poses(60, 7)
    for a, b in zip(poses[:-1], poses[1:], strict=True):
        if certify(coman(), np.stack([a, b]), BETWEEN).status[0] != CERTIFIED:
            return a, b
    raise AssertionError("no such pair")


def test_a_collision_on_the_way_is_planned_around_or_stopped_before():
    a, b = crossed()
    share = np.clip((np.arange(90) - 20) / 50.0, 0.0, 1.0)[:, None]
    wanted = (1.0 - share) * a + share * b
    assert (certify(coman(), wanted, BETWEEN).status != CERTIFIED).any()
    made = planner().plan(even(90), wanted)
    assert_holds(even(90), made.q)


def test_what_cannot_be_proven_is_refused_not_returned(monkeypatch):
    a, b = crossed()
    wanted = np.repeat(np.stack([a, b]), 30, axis=0)
    short = Planner(coman(), settings=Settings(repairs=0, rounds=1, inner=1, band=0.0))
    monkeypatch.setattr(whole._Job, "repair", lambda self: None)
    with pytest.raises(CertificateError, match="no motion was found that holds at row"):
        short.plan(even(60), wanted)


def test_where_planning_fails_the_robot_is_driven_past_step_by_step():
    a, b = crossed()
    wanted = np.repeat(np.stack([a, b]), 30, axis=0)
    short = Planner(coman(), settings=Settings(repairs=0, rounds=1, inner=1, band=0.0))
    made = short.plan(even(60), wanted)
    assert (made.how == DRIVEN).any()
    assert_holds(even(60), made.q)


@cache
def g1() -> Robot:
    return Robot.load("g1")


def blocked(seed):
    """Times and wanted poses of G1: two clear poses, limbs on each other's other sides.

    A tenth of a second lies between them; the wanted pose never stands still, so that a robot which
    only chases it never catches up.
    """
    made, rng, rate = g1(), np.random.default_rng(seed), 120.0
    a, b = clear_poses(2, seed, made)
    times = even(360, rate)
    share = np.clip((times - 1.0) / 0.1, 0.0, 1.0)[:, None]
    waves = np.sin(2.0 * np.pi * rng.uniform(0.8, 1.6, made.n_dof) * times[:, None])
    return times, (1.0 - share) * a + share * b + 0.05 * waves


@pytest.mark.parametrize("seed", [1, 13, 20])
def test_after_a_place_where_planning_fails_the_robot_is_where_it_is_wanted_again(seed):
    made, (times, wanted) = g1(), blocked(seed)
    found = Planner(made).plan(times, wanted, skeleton=True)
    assert_holds(times, found.q, made=made)
    far = cosine_distance(*(batch.skeletons(made.chain, q) for q in (found.q, wanted)))
    assert far[-60:].mean() < 0.01
    assert far.mean() < 0.04  # 0.056 to 0.071 if only driven


def test_a_plan_after_driving_is_not_taken_where_it_exceeds_a_limit(monkeypatch):
    made, (times, wanted) = g1(), blocked(20)
    around, past, seen = whole._Job.around, whole._Job.past, []
    elbow = made.joint_names.index("left_elbow_joint")

    def rough(self, start, stop):
        around(self, start, stop)
        if seen:
            self.q[start + 3, elbow] += 0.008  # 230 rad/s^2, and clear
            self.measure(start, start + 5)
            seen.append(limits.broken(self.times, self.q, self.its.most).any())

    def driving(self, row):
        seen.append(False)
        return past(self, row)

    monkeypatch.setattr(whole._Job, "around", rough)
    monkeypatch.setattr(whole._Job, "past", driving)
    found = Planner(made).plan(times, wanted, skeleton=True)
    assert any(seen)
    assert_holds(times, found.q, made=made)


@pytest.mark.parametrize(("room", "stops"), [(0.05, False), (0.3, True)])
def test_driving_does_not_begin_where_a_joint_cannot_stop_before_its_limit(room, stops):
    # 3.9 rad/s take 0.067 rad to stop at 60 rad/s^2 in steps of 1/30 s.
    made, its = coman(), planner()
    elbow = made.joint_names.index("LElbj")
    q = np.repeat(made.anchor[None], 2, axis=0)
    q[1, elbow] = made.upper[elbow] - room
    q[0, elbow] = q[1, elbow] - 3.9 / 30.0
    job = whole._Job(its, even(2), q, its._aim(even(2), q, False, None, None))
    assert job._stops(1) == stops


def test_where_driving_ends_with_the_motion_it_still_holds():
    a, b = crossed()
    short = Planner(coman(), settings=Settings(repairs=0, rounds=1, inner=1, band=0.0))
    for m in (2, 3, 5):  # the last rows are those that no plan holds at
        wanted = np.concatenate([np.repeat(a[None], m - 1, axis=0), b[None]])
        assert_holds(even(m), short.plan(even(m), wanted).q)


def test_the_plan_is_nearer_than_each_joint_clipped_by_itself():
    times = even(150)
    wanted = visits(150, 30, 8)
    x = batch.skeletons(coman().chain, wanted)
    made = planner().plan(times, wanted, skeleton=True)
    most = planner().most
    alone = np.empty_like(wanted)
    chase.chase(
        times, wanted, most.lower, most.upper, most.speed, most.acceleration, 0.0, 0, alone
    )  # fmt: skip
    far = cosine_distance(batch.skeletons(coman().chain, made.q), x).mean()
    assert far < 0.6 * cosine_distance(batch.skeletons(coman().chain, alone), x).mean()


def test_a_long_motion_takes_the_room_of_a_window():
    one = Planner(coman(), settings=Settings(window=64))
    times = even(700)
    made = one.plan(times, swings(700, 9, 0.9), skeleton=True)
    assert_holds(times, made.q)
    assert len(one._program.q) <= 4 * 15 + 2 * 15 + 68  # a window, not the motion


def test_one_row_and_two_rows():
    wanted = clear_poses(2, 10)
    assert_holds(even(1), planner().plan(even(1), wanted[:1]).q)
    assert_holds(even(2), planner().plan(even(2), wanted).q)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda t, q: (t, np.where(np.arange(len(q))[:, None] == 5, np.nan, q)), "row 5"),
        (lambda t, q: (t, np.where(np.arange(len(q))[:, None] == 2, np.inf, q)), "row 2"),
        (lambda t, q: (t[::-1], q), "rise"),
        (lambda t, q: (t, q[:, :-1]), "poses"),
        (lambda t, q: (t[:-1], q), "times"),
        (lambda t, q: (t[:0], q[:0]), "motion"),
    ],
)
def test_what_is_no_motion_is_refused_with_the_place(spoil, says):
    with pytest.raises(ParameterError, match=says):
        planner().plan(*spoil(even(20), swings(20, 0)))


def test_accelerations_must_be_above_zero():
    with pytest.raises(ParameterError, match="WaistLat"):
        limits.limits(coman(), np.nan)
    with pytest.raises(ParameterError, match="number"):
        limits.limits(coman(), np.ones(3))


def test_clearances_out_of_order_are_refused():
    with pytest.raises(ParameterError, match="ordered"):
        Planner(coman(), settings=Settings(target=0.001))


def test_the_weights_make_trunks_dear_and_elbows_cheap():
    weight = np.diag(weights.of_joints(coman()))
    named = dict(zip(coman().joint_names, weight, strict=True))
    assert named["WaistLat"] > 2.0 * named["LElbj"]
    assert weight.mean() == pytest.approx(1.0, rel=0.05)


# --- the parts


def test_a_banded_system_is_solved_as_a_dense_one():
    rng = np.random.default_rng(0)
    m, b = 40, 6
    dense = np.zeros((m, m))
    for j in range(m):
        for k in range(min(b + 1, m - j)):
            dense[j + k, j] = dense[j, j + k] = rng.normal() + (20.0 if k == 0 else 0.0)
    banded = np.zeros((m, b + 1))
    for j in range(m):
        banded[j, : min(b + 1, m - j)] = dense[j : j + b + 1, j]
    right = rng.normal(size=m)
    found = right.copy()
    assert factor(banded, 1e-12)
    solve_with(banded, found)
    np.testing.assert_allclose(found, np.linalg.solve(dense, right), rtol=1e-10)


def test_a_matrix_that_is_not_finite_has_no_factor():
    assert not factor(np.full((3, 2), np.nan), 1e-12)


def test_the_interior_point_method_finds_what_an_active_set_method_finds():
    rng = np.random.default_rng(1)
    m, n = 9, 2
    p = interior.program(m, n, 4)
    p.q[:] = 0.1
    times = np.cumsum(rng.uniform(0.02, 0.05, m))
    lower, upper = np.full(n, -0.4), np.full(n, 0.5)
    rounds.bound(
        p,
        m,
        times,
        limits.changing(times),
        lower,
        upper,
        np.full(n, SPEED),
        np.full(n, ACCELERATION),
    )
    for t in range(m):
        root = rng.normal(size=(n, n))
        p.H[t] = root @ root.T + 0.1 * np.eye(n)
    p.g[:] = rng.normal(0.0, 2.0, (m, n))
    q0, g0, H0 = p.q.copy(), p.g.copy(), p.H.copy()
    interior.warm(p, m, 1e-2, 0.05, True)
    interior.warm_rows(p, 1e-2, 1e3)
    interior.improve(p, m, 1e3, 0.0, 1e-11, 80)
    H = np.zeros((m * n, m * n))
    for t in range(m):
        H[t * n : t * n + n, t * n : t * n + n] = H0[t]
    rows, low, high = [], [], []
    for t in range(m):
        for kind in range(3):
            if not p.on[t, kind]:
                continue
            for i in range(n):
                row, at = np.zeros(m * n), 0.0
                for k, c in enumerate(p.coef[t, kind]):
                    if c and 0 <= t - 1 + k < m:
                        row[(t - 1 + k) * n + i] = c
                        at += c * q0[t - 1 + k, i]
                rows.append(row)
                low.append(p.low[t, kind, i] - at)
                high.append(p.high[t, kind, i] - at)
    best, _, flag, _ = daqp.solve(
        H, g0.ravel(), np.array(rows), np.array(high), np.array(low),
        np.zeros(len(rows), np.int32),
    )  # fmt: skip
    assert flag == 1
    np.testing.assert_allclose((p.q - q0).ravel(), best, atol=2e-5)


def test_a_joint_stops_exactly_where_it_must():
    for far in (1e-6, 0.01, 0.0667, 0.1, 0.5, 3.0):
        v = chase.fastest(far, ACCELERATION, 1.0 / 30.0)
        assert v / 30.0 + chase.stopping(v, ACCELERATION, 1.0 / 30.0) == pytest.approx(far)


def test_the_first_guess_is_within_the_limits():
    times, wanted = even(200), visits(200, 25, 11)
    most = planner().most
    q = np.empty_like(wanted)
    chase.chase(times, wanted, most.lower, most.upper, most.speed, most.acceleration, 0.1, 0, q)
    assert not limits.broken(times, q, most).any()
    np.testing.assert_allclose(q[24], wanted[24])  # and gets where it is wanted
    assert limits.broken(times, wanted, most).any()


# --- streams


@pytest.mark.parametrize("skeleton", [False, True])
@pytest.mark.parametrize("rate", [30.0, 100.0])
def test_every_step_holds_and_none_has_to_stand_still_at_once(rate, skeleton):
    m = int(5.0 * rate)
    wanted = np.concatenate([swings(m, 12, 1.0, rate), visits(m, m // 4, 13)])
    times = even(len(wanted), rate)
    walker = Walker(coman(), q=coman().anchor, skeleton=skeleton)
    q, how = walk(walker, times, wanted)
    assert_holds(times, q, from_rest=True)
    assert "held" not in how and {"wanted", "limited"} <= set(how)


def test_a_stream_that_holds_comes_back_to_the_bit():
    times, wanted = even(200), swings(200, 14)
    first, _ = walk(Walker(coman(), q=coman().anchor), times, wanted)
    again, how = walk(Walker(coman(), q=coman().anchor), times, first)
    assert again.tobytes() == first.tobytes()
    assert set(how) == {"start", "wanted"}


def test_the_robot_can_brake_within_its_limits_from_every_step():
    made, wanted = coman(), swings(240, 15)
    walker = Walker(made, q=made.anchor, skeleton=True)
    judge = Judge(made.certifier(), 0.002)
    for cut in (31, 64, 97, 130, 163, 196, 229):
        q = [walker.q]
        for row in range(cut - 30, cut):
            q.append(walker.step(wanted[row], 1.0 / 30.0).q)
        while walker.v.any():
            step = walker.step(None, 1.0 / 30.0)
            assert step.certified
            q.append(step.q)
            seen = judge.path(q[-2], q[-1])
            assert seen.clearance >= BETWEEN - AGREEMENT
        assert_holds(even(len(q)), np.array(q))


def test_a_wanted_pose_that_is_not_finite_is_refused_and_changes_nothing():
    walker = Walker(coman(), q=coman().anchor)
    walker.step(clear_poses(1, 16)[0], 0.03)
    q, v = walker.q, walker.v
    bad = q.copy()
    bad[3] = np.nan
    with pytest.raises(ParameterError, match="joint 3"):
        walker.step(bad, 0.03)
    with pytest.raises(ParameterError, match="shape"):
        walker.step(q[:-1], 0.03)
    assert (walker.q == q).all() and (walker.v == v).all()


@pytest.mark.parametrize("dt", [np.nan, 0.0, -1.0, 1e-9, np.inf])
def test_no_time_no_motion(dt):
    walker = Walker(coman(), q=coman().anchor)
    before = walker.q
    step = walker.step(clear_poses(1, 17)[0], dt)
    if dt == np.inf:  # counts as a second
        assert_holds(np.array([0.0, 1.0]), np.stack([before, step.q]))
    else:
        assert (step.q == before).all() and step.how == "held"


def test_a_robot_does_not_start_in_collision():
    made = coman()
    q = inside_limits(made, 400, 18)
    bad = q[np.argmin(batch.clearances(made.chain, q))]
    with pytest.raises(CertificateError):
        Walker(made, q=bad)
