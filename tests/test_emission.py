"""A motion in other rows: samples of the same curve, on one piece each, at a rate that fits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import coman

from s3le.errors import ParameterError
from s3le.motion.rates import as_given, at_rate, check_rate, on_grid, planned
from s3le.plan.flow import planner
from s3le.plan.limits import limits
from s3le.plan.settings import Settings
from s3le.safety.paths import CERTIFIED, certify


def motion(seed, rows=40, rate=30.0):
    """A planned motion: times, positions, speeds."""
    robot, rng = coman(), np.random.default_rng(seed)
    a, b = rng.uniform(robot.lower, robot.upper, (2, robot.n_dof))
    time = np.arange(rows) / rate
    share = 0.5 - 0.5 * np.cos(rng.uniform(2.0, 8.0) * time)[:, None]
    plan = planner(robot, limits(robot), Settings(curved=True)).plan(time, a + share * (b - a))
    return time, plan.q, plan.v


@pytest.mark.parametrize("times", [1, 2, 4, 9])
def test_a_whole_multiple_keeps_every_row_and_every_step_is_what_was_proven(times):
    time, q, v = motion(3)
    made = at_rate(time, q, v, 30.0 * times)
    assert len(made.time) == (len(time) - 1) * times + 1
    assert (made.q[::times] == q).all() and (made.v[::times] == v).all()
    assert (made.own[::times] == np.arange(len(time))).all()
    assert (np.delete(made.own, slice(None, None, times)) == -1).all()
    # Rows of one piece: even acceleration, the same as that of the piece.
    step = np.diff(made.time)[:, None]
    bent = np.diff(made.v, axis=0) / step
    own = np.repeat(np.diff(v, axis=0) * 30.0, times, axis=0)
    assert bent == pytest.approx(own, abs=1e-6)
    assert np.diff(made.q, axis=0) == pytest.approx(
        step * 0.5 * (made.v[1:] + made.v[:-1]), abs=1e-12
    )
    found = certify(coman(), made.q, 0.0005, time=made.time, v=made.v)
    assert (found.status == CERTIFIED).all()


def test_rows_that_are_missing_are_put_on_the_piece_that_leads_over_them():
    time, q, v = motion(5)
    keep = np.r_[0:10, 14:40]
    gap = time[keep], q[keep], v[keep]
    made = at_rate(*gap, 60.0)
    assert len(made.time) == 79 and np.diff(made.time) == pytest.approx(1 / 60)
    between = (made.time > time[9]) & (made.time < time[14])
    assert (made.own[between] == -1).all() and (made.next[between] == 10).all()


def test_a_row_off_the_grid_is_refused():
    time, q, v = motion(3)
    with pytest.raises(ParameterError, match="not every row of the motion is one at 45 Hz"):
        at_rate(time, q, v, 45.0)


@settings(max_examples=200, deadline=None)
@given(rate=st.floats(30.0, 1000.0), own=st.floats(5.0, 1000.0))
def test_the_rate_that_is_planned_at_divides_the_one_wanted_and_is_near_the_clip_s(rate, own):
    found = planned(rate, own)
    assert rate / found == pytest.approx(round(rate / found), rel=1e-8)
    assert found == own or abs(np.log(found / own)) <= np.log(1.5) + 1e-9 or rate < own


@pytest.mark.parametrize(
    ("rate", "own", "at"), [(30, 30, 30), (120, 30, 30), (50, 120, 50), (100, 30, 100 / 3)]
)
def test_rates_that_people_ask_for(rate, own, at):
    assert planned(float(rate), float(own)) == pytest.approx(at)


@pytest.mark.parametrize("rows", [1, 2])
def test_short_motions(rows):
    time, q, v = motion(1, rows)
    made = at_rate(time, q, v, 120.0)
    assert len(made.q) == 4 * (rows - 1) + 1 and (made.q[0] == q[0]).all()


@pytest.mark.parametrize("rate", [0.0, 29.9, 1000.1, -30.0, float("nan"), float("inf")])
def test_rates_out_of_range_are_refused(rate):
    with pytest.raises(ParameterError, match=r"rate must be in \[30, 1000\] Hz"):
        check_rate(rate)


def test_a_motion_of_days_is_refused_before_memory_is_asked_for():
    _, q, v = motion(1, 2)
    with pytest.raises(ParameterError, match="at most 10000000"):
        at_rate(np.array([0.0, 1e9]), q, v, 1000.0)


def test_a_motion_as_it_is():
    time, q, v = motion(2, 4)
    made = as_given(time, q, v)
    assert (made.q == q).all() and (made.v == v).all()
    assert made.own.tolist() == made.next.tolist() == [0, 1, 2, 3]


def test_what_lies_on_a_grid():
    time = np.arange(20) / 30.0
    assert on_grid(time, 30.0) and on_grid(time, 90.0) and on_grid(time[[0, 3, 9]], 30.0)
    assert not on_grid(time, 45.0) and not on_grid(time + 1e-3 * (time > 0.3), 30.0)
