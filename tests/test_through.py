"""Speeds for rows that tell none: found where there are any, and never beyond the limits."""

import numpy as np
import pytest
from scipy.optimize import linprog
from worlds import coman

from s3le.plan import flow, through
from s3le.plan.flow import planner
from s3le.plan.limits import Limits, limits
from s3le.plan.settings import Settings
from s3le.safety import checks


def speeds(time, q, most, known=None, v=None):
    """What each share gives, and whether it is within."""
    way = through.Through(time, q, most)
    for share in through.SHARES:
        guess = way.guess(share)
        if known is not None:
            guess = np.where(known[:, None], v, guess)
        yield way.near(guess), way.within


def one(speed=4.0, hardest=60.0, far=3.0):
    return Limits(*(np.array([x]) for x in (-far, far, speed, hardest)))


def kept(time, q, v, most):
    """Shares of the limits that the cubics through rows use at most, and whether they stay in."""
    fast, bent, low, high = checks.between(time, q, v)
    inside = (low >= most.lower - 1e-9).all() and (high <= most.upper + 1e-9).all()
    return (fast / most.speed).max(), (bent / most.acceleration).max(), inside


@pytest.mark.parametrize("rate", [30.0, 120.0])
def test_a_smooth_motion_has_speeds_within_its_limits(rate):
    robot, most = coman(), limits(coman())
    time = np.arange(90) / rate
    far = 0.9 * np.minimum(robot.upper - robot.anchor, robot.anchor - robot.lower)
    far, phase = np.minimum(0.3, far), np.arange(robot.n_dof)
    q = robot.anchor + far * np.sin(3.0 * time[:, None] + phase)
    for v, within in speeds(time, q, most):
        assert within
        fast, bent, inside = kept(time, q, v, most)
        assert fast <= 1.0 + 1e-6 and bent <= 1.0 + 1e-6 and inside
        exact = 3.0 * far * np.cos(3.0 * time[:, None] + phase)
        assert np.abs(v - exact)[30:-30].max() < 0.02


def test_a_joint_that_stands_at_its_limit_is_not_led_beyond_it():
    time, most = np.arange(40) / 30.0, one(far=1.0)
    q = np.ones((40, 1))
    q[20:, 0] -= 0.01 * np.arange(20)  # leaves at once, as straight rows may
    for v, within in speeds(time, q, most):
        assert within and kept(time, q, v, most)[2]
        assert np.abs(v[1:20]).max() < 1e-9


def feasible(time, q, most):
    """The same question as a linear program: are there speeds that keep all lines?"""
    m, dt = len(q), np.diff(time)
    rows, room = [], []
    for t in range(m - 1):
        s = (q[t + 1, 0] - q[t, 0]) / dt[t]
        for a, b, most_of in (
            (4.0, 2.0, most.acceleration[0] * dt[t]),
            (2.0, 4.0, most.acceleration[0] * dt[t]),
            (1.0, 1.0, 4.0 * most.speed[0]),
        ):
            line = np.zeros(m)
            line[t], line[t + 1] = a, b
            rows += [line, -line]
            room += [6.0 * s + most_of, most_of - 6.0 * s]
    ends = [(-most.speed[0], most.speed[0])] * m
    return linprog(np.zeros(m), np.array(rows), np.array(room), bounds=ends).status == 0


def test_speeds_are_found_exactly_where_a_linear_program_finds_some():
    rng, most = np.random.default_rng(3), one(far=1e6)
    seen = []
    for _ in range(150):
        dt = rng.uniform(0.02, 0.05, 11)
        time = np.concatenate([[0.0], np.cumsum(dt)])
        pace = np.cumsum(rng.normal(0.0, rng.choice([0.4, 1.0, 1.6]), 11))
        q = np.concatenate([[0.0], np.cumsum(pace * dt)])[:, None]
        found = list(speeds(time, q, most))
        assert {within for _, within in found} == {feasible(time, q, most)}
        seen.append(found[0][1])
        for v, within in found:
            fast, bent, _ = kept(time, q, v, most)
            assert not within or bent <= 1.0 + 1e-6
    assert 30 < sum(seen) < 120  # both kinds are among them


def test_speeds_that_were_lost_with_a_file_are_found_again():
    robot, most, rng = coman(), limits(coman()), np.random.default_rng(0)
    time = np.arange(60) / 30.0
    share = rng.uniform(0.3, 0.6, (4, robot.n_dof))
    wanted = robot.lower + (robot.upper - robot.lower) * share[np.arange(60) // 15]
    plan = planner(robot, most, Settings(curved=True)).plan(time, wanted)
    *_, (v, within) = speeds(time, plan.q, most)  # as parabolas
    assert within and np.abs(v - plan.v).max() < 0.05 * np.abs(plan.v).max()


def test_rows_whose_speeds_are_known_keep_them():
    time, most = np.arange(30) / 30.0, one()
    q = 0.2 * np.sin(3.0 * time)[:, None]
    known = np.arange(30) < 10
    told = 0.6 * np.cos(3.0 * time)[:, None] + 0.05
    for v, within in speeds(time, q, most, known, told):
        assert within and (v[2:10] == told[2:10]).all() and (v[12:] != told[12:]).all()


def test_one_row_stands():
    for v, within in speeds(np.zeros(1), coman().anchor[None], limits(coman())):
        assert within and not v.any()


def test_a_smooth_motion_planned_in_the_joints_goes_through_its_own_rows():
    robot, most = coman(), limits(coman())
    time = np.arange(90) / 30.0
    wanted = np.tile(robot.anchor, (90, 1))
    joint = robot.joint_names.index("LShSag")
    wanted[:, joint] += 0.5 * np.sin(4.0 * time)
    plan = planner(robot, most, Settings(curved=True)).plan(time, wanted)
    assert np.abs(plan.q - wanted)[6:-6].max() < 1e-5 and np.abs(plan.q - wanted).max() < 1e-4
    calm = flow.calmed(time, wanted)
    assert np.abs(calm - wanted)[3:-3].max() > 1e-3  # what control points on the motion would give
