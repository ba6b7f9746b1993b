"""Curves: their extremes are computed, their proof bounds what coal sees, stops end where said."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import MARGIN, coman, relaxed

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.safety import curve, paths, rest, segment
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, certify
from s3le.safety.swept import swept

BETWEEN, AGREEMENT, N = 0.0005, 2e-6, 6
KINDS = ["straight", "parabola", "cubic", "stop"]


def path_of(kind, seed, n=N, size=1.0):
    rng = np.random.default_rng(seed)
    path = np.empty((curve.ROWS, n))
    q, v, w, q1 = rng.normal(size=(4, n)) * size
    if kind == "straight":
        curve.straight(q, q1, path)
    elif kind == "parabola":
        curve.parabola(q, v, w, 0.1, path)
    elif kind == "cubic":
        curve.cubic(q, v, q1, w, 0.7, path)
    else:
        v[rng.random(n) < 0.3] = 0.0
        curve.stop(q, 3.0 * v, np.full(n, 20.0), 1 / 30, path)
    return path


def traced(path, t):
    q, w = np.empty((2, len(t), path.shape[1]))
    for row, moment in enumerate(t):
        curve.position(path, moment, q[row])
        curve.speed(path, moment, w[row])
    return q, w


@settings(max_examples=120, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**31))
def test_extremes_are_those_that_samples_come_near_to_and_never_exceed(kind, seed):
    path = path_of(kind, seed)
    t = np.linspace(0.0, 1.0, 2001)
    q, w = traced(path, t)
    fastest, bent, low, high = np.empty((4, N))
    curve.extremes(path, fastest, bent)
    curve.span(path, low, high)
    assert (np.abs(w) <= fastest + 1e-12).all()
    assert np.abs(w).max(axis=0) == pytest.approx(fastest, abs=1e-4)
    assert (q >= low - 1e-12).all() and (q <= high + 1e-12).all()
    assert q.min(axis=0) == pytest.approx(low, abs=1e-5)
    assert q.max(axis=0) == pytest.approx(high, abs=1e-5)
    turned = np.abs(np.diff(w, axis=0)) / np.diff(t)[:, None]
    assert (turned <= bent * (1.0 + 1e-9) + 1e-9).all()
    # The speed is that of the positions.
    assert np.diff(q, axis=0) == pytest.approx(
        0.5 * (w[1:] + w[:-1]) * np.diff(t)[:, None], abs=1e-6
    )


def test_steps_end_where_they_are_to_and_a_parabola_is_a_cubic():
    rng = np.random.default_rng(1)
    q, v, w, q1 = rng.normal(size=(4, N))
    for kind, end in (("cubic", q1), ("parabola", q + 0.5 * 0.2 * (v + w))):
        path = np.empty((curve.ROWS, N))
        curve.cubic(q, v, end, w, 0.2, path)
        at, speed = traced(path, [0.0, 1.0])
        assert at == pytest.approx(np.array([q, end])), kind
        assert speed / 0.2 == pytest.approx(np.array([v, w]))
    other = np.empty((curve.ROWS, N))
    curve.parabola(q, v, w, 0.2, other)
    assert path == pytest.approx(other, abs=1e-12)


def test_a_stop_brakes_as_hard_as_it_may_and_rests_on_the_grid():
    q, v, most = np.zeros(4), np.array([0.0, 1.0, -2.5, 0.3]), np.full(4, 20.0)
    path = np.empty((curve.ROWS, 4))
    dt = 1 / 30
    lasts = curve.stop(q, v, most, dt, path)
    assert lasts == pytest.approx(4 * dt)  # 2.5 rad/s take 3.75 steps
    fastest, bent = np.empty((2, 4))
    curve.extremes(path, fastest, bent)
    assert fastest / lasts == pytest.approx(np.abs(v))
    assert (bent / lasts**2 <= most * (1 + 1e-12)).all()
    end, speed = traced(path, [1.0])
    assert np.abs(speed).max() < 1e-12
    hardest = v * np.abs(v) / (2.0 * most)
    assert (np.abs(end[0]) >= np.abs(hardest) - 1e-12).all()
    assert (np.abs(end[0]) <= np.abs(hardest) + np.abs(v) * dt / 2).all()
    # Rows dt apart have one parabola between two.
    rows, speeds = traced(path, np.arange(5) / 4)
    assert np.diff(rows, axis=0) == pytest.approx(
        0.5 * dt * (speeds[1:] + speeds[:-1]) / lasts, abs=1e-12
    )


def near_contact(n, seed):
    robot = coman()
    q = batch.project(robot.chain, robot.anchor, relaxed(robot, n, seed), MARGIN).q
    v = np.random.default_rng(seed).uniform(-4.0, 4.0, q.shape)
    return q, v


@pytest.mark.parametrize("dt", [1 / 30, 0.15], ids="{:.3f} s".format)
def test_coal_sees_no_less_on_a_curve_than_what_is_proven(dt):
    robot, rng = coman(), np.random.default_rng(5)
    q, v = near_contact(300, 5)
    w = np.clip(v + rng.uniform(-60.0, 60.0, v.shape) * dt, -4.0, 4.0)
    checker, certified, collided = robot.certifier(), 0, 0
    for k in range(len(q)):
        rows, speeds = np.array([q[k], q[k] + 0.5 * dt * (v[k] + w[k])]), np.array([v[k], w[k]])
        found = certify(robot, rows, BETWEEN, time=np.array([0.0, dt]), v=speeds)
        at = np.linspace(0.0, dt, 60)
        there = paths.sampled(np.array([0.0, dt]), rows, speeds, np.zeros(60, int), at)[0]
        if found.status[0] == CERTIFIED:
            seen = checker.check(there).clearance.min()
            assert seen >= found.bound[0] - AGREEMENT and found.bound[0] >= BETWEEN
            certified += 1
        elif found.status[0] == COLLIDES:
            when = found.t * dt
            hit = paths.sampled(np.array([0.0, dt]), rows, speeds, np.zeros(1, int), when)[0]
            report = checker.check(hit)
            assert report.clearance[0] == pytest.approx(found.clearance[0], abs=AGREEMENT)
            assert report.clearance[0] < BETWEEN
            collided += 1
    assert certified > 20 and collided > 10


def test_without_the_change_of_rates_in_the_bound_what_collides_is_certified():
    """The second-order bound of a curve has a term of its own; taken out, paths pass through."""
    robot = coman()
    bounds, scratch = swept(robot.chain), segment.scratch(robot.chain)
    rng, wrong = np.random.default_rng(2), 0
    path, blind = np.empty((2, curve.ROWS, robot.n_dof))
    for k, q in enumerate(near_contact(600, 2)[0]):
        # Out and back: the ends are one pose, all of the way lies between.
        v = rng.uniform(-1.0, 1.0, q.shape) * 6.0
        curve.parabola(q, v, -v, 0.2, path)
        honest = segment.prove_curve(robot.chain, bounds, scratch, path, BETWEEN, 200)[0]
        curve.straight(q, q, blind)
        if honest == COLLIDES:
            status = segment.prove_curve(robot.chain, bounds, scratch, blind, BETWEEN, 200)[0]
            wrong += status == CERTIFIED
        assert k < 599 or wrong > 20


@pytest.mark.parametrize("broken", [np.nan, np.inf, 1e4])
def test_a_curve_that_is_no_curve_is_undecided(broken):
    robot = coman()
    q, v = near_contact(2, 1)
    time = np.array([0.0, 1 / 30])
    for rows, speeds in ((q.copy(), v.copy()), (q.copy(), v.copy())):
        (rows if rows is q else speeds)[1, 3] = broken * 100
        assert certify(robot, rows, BETWEEN, time=time, v=speeds).status[0] == UNDECIDED


def test_speeds_of_another_shape_are_refused():
    q, v = near_contact(3, 1)
    with pytest.raises(ParameterError, match="do not fit poses"):
        certify(coman(), q, BETWEEN, time=np.arange(3.0), v=v[:2])


def test_a_way_to_rest_that_collides_or_leaves_the_limits_is_none():
    robot = coman()
    q, v = near_contact(400, 9)
    v *= 0.2
    most = np.full(robot.n_dof, 60.0)
    time = np.arange(len(q)) / 30.0
    good = paths.rests(robot, time, q, v, most, BETWEEN)
    assert 0.05 < good.mean() < 0.95
    path, ends = np.empty((curve.ROWS, robot.n_dof)), []
    checker = robot.certifier()
    for k in range(len(q)):
        lasts = curve.stop(q[k], v[k], most * (1 - curve.EPS), 1 / 30, path)
        there = traced(path, np.linspace(0.0, 1.0, 40))[0]
        report = checker.check(there)
        inside = (there >= robot.lower - 1e-9).all() and (there <= robot.upper + 1e-9).all()
        assert lasts > 0.0
        if good[k]:
            assert inside and report.clearance.min() >= BETWEEN - AGREEMENT
            assert report.clearance[-1] >= MARGIN - AGREEMENT
        else:
            ends.append(inside and report.clearance.min() >= MARGIN + 1e-4)
    assert np.mean(ends) < 0.05  # hardly one is refused that keeps the margin all along


def test_at_rest_it_rests():
    robot = coman()
    path = np.empty((curve.ROWS, robot.n_dof))
    its = robot.chain, swept(robot.chain), segment.scratch(robot.chain)
    still, most = np.zeros(robot.n_dof), np.full(robot.n_dof, 60.0)
    args = most, 1 / 30, MARGIN, BETWEEN, 200, path
    assert rest.rests(*its, robot.anchor, still, *args)[0]
    assert not rest.rests(*its, robot.anchor, still + np.nan, *args)[0]
