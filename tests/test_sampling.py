"""Sampling: the law of relaxed limits, mixup, determinism, and poses that are certified."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import MARGIN, coman

from s3le import rng, sampling
from s3le.errors import ParameterError, RobotError
from s3le.kernels import batch
from s3le.sampling import draw_feasible, draw_tuples, mixup, relaxed_limits
from s3le.skeleton import cosine_distance
from s3le.tables.kinematic_pairs import kinematic_pairs
from s3le.tables.robot_poses import robot_poses

ALGEBRA = 1e-12  # [rad] or [-], float64


def stream(seed):
    return np.random.default_rng(seed)


# --- relaxed limits


@given(alpha=st.floats(0, 4), low=st.floats(-3, 3), width=st.floats(1e-3, 6))
def test_width_grows_by_the_factor_one_plus_alpha(alpha, low, width):
    lower, upper = relaxed_limits(np.array([low]), np.array([low + width]), alpha)
    assert upper[0] - lower[0] == pytest.approx((1 + alpha) * width, abs=ALGEBRA)


@given(alpha=st.floats(0, 4), low=st.floats(-3, 3), width=st.floats(1e-3, 6))
def test_the_middle_of_a_range_stays(alpha, low, width):
    lower, upper = relaxed_limits(np.array([low]), np.array([low + width]), alpha)
    assert lower[0] + upper[0] == pytest.approx(2 * low + width, abs=ALGEBRA)


def test_no_relaxation_is_the_robot_s_own_limits_to_the_bit():
    robot = coman().robot
    lower, upper = relaxed_limits(robot.lower, robot.upper, 0.0)
    assert np.array_equal(lower, robot.lower) and np.array_equal(upper, robot.upper)


@pytest.mark.parametrize("alpha", [-1e-9, -1.0, np.nan, np.inf, -np.inf], ids=str)
def test_a_relaxation_that_is_none_is_refused(alpha):
    with pytest.raises(ParameterError) as refusal:
        relaxed_limits(np.zeros(2), np.ones(2), alpha)
    assert str(refusal.value) == f"alpha must be finite and >= 0, got {alpha!r}"


def test_relaxed_poses_fill_the_relaxed_box_and_no_more():
    made = coman()
    drawn = draw_tuples(made, 3000, 0.2, False, stream(1))
    lower, upper = relaxed_limits(made.robot.lower, made.robot.upper, 0.2)
    assert (drawn.q_relaxed >= lower).all() and (drawn.q_relaxed <= upper).all()
    share = (drawn.q_relaxed - lower) / (upper - lower)
    assert np.allclose(share.mean(axis=0), 0.5, atol=5 / np.sqrt(12 * 3000))  # five sigma
    outside = (drawn.q_relaxed < made.robot.lower) | (drawn.q_relaxed > made.robot.upper)
    assert outside.mean() == pytest.approx(0.2 / 1.2, abs=0.01)


# --- mixup


def skeletons(seed, n=50):
    made = coman()
    low, high = made.robot.lower, made.robot.upper
    return batch.skeletons(made.chain, stream(seed).uniform(low, high, (n, 11)))


@pytest.mark.parametrize("renormalise", [False, True])
def test_mixup_ends_at_its_two_skeletons(renormalise):
    a, b = skeletons(2), skeletons(3)
    ends = ((np.ones(50), a), (np.zeros(50), b))
    for mix, want in ends:
        assert np.allclose(mixup(a, b, mix, renormalise), want, rtol=0, atol=ALGEBRA)


def test_mixup_is_a_straight_line_where_it_is_not_renormalised():
    a, b, mix = skeletons(4), skeletons(5), stream(6).uniform(size=50)
    want = b + mix[:, None] * (a - b)
    assert np.allclose(mixup(a, b, mix, False), want, rtol=0, atol=ALGEBRA)
    short = np.linalg.norm(mixup(a, b, mix, False).reshape(50, 7, 3), axis=2)
    assert (short <= 1 + ALGEBRA).all() and (short < 0.99).any()


def test_renormalising_gives_every_bone_unit_length_and_keeps_its_direction():
    a, b, mix = skeletons(7), skeletons(8), stream(9).uniform(size=50)
    plain, unit = mixup(a, b, mix, False), mixup(a, b, mix, True)
    assert np.allclose(np.linalg.norm(unit.reshape(50, 7, 3), axis=2), 1, rtol=0, atol=ALGEBRA)
    assert np.allclose(cosine_distance(plain, unit), 0, rtol=0, atol=ALGEBRA)


def test_bones_that_cancel_do_not_become_nan():
    a = skeletons(10, 1)
    assert np.isfinite(mixup(a, -a, np.array([0.5]), True)).all()


# --- tuples


@pytest.mark.parametrize("renormalise", [False, True])
def test_a_tuple_is_what_its_columns_say(renormalise):
    made = coman()
    drawn = draw_tuples(made, 400, 0.5, renormalise, stream(11))
    assert np.array_equal(drawn.x_relaxed, batch.skeletons(made.chain, drawn.q_relaxed))
    assert np.array_equal(drawn.x_feasible, batch.skeletons(made.chain, drawn.q_feasible))
    projected = batch.project(made.chain, made.robot.anchor, drawn.q_relaxed, made.margin)
    assert np.array_equal(drawn.q_feasible, projected.q)
    assert ((drawn.mix >= 0) & (drawn.mix <= 1)).all()
    again = mixup(drawn.x_relaxed, drawn.x_feasible, drawn.mix, renormalise)
    assert np.array_equal(drawn.x_mixed, again)


def test_the_same_seed_draws_the_same_rows_and_another_seed_others():
    made = coman()
    one, two, other = (draw_tuples(made, 200, 0.2, False, stream(s)) for s in (12, 12, 13))
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert not np.array_equal(one.q_relaxed, other.q_relaxed)


@pytest.mark.parametrize("threads", [1, 3])
def test_rows_do_not_depend_on_the_number_of_threads(monkeypatch, threads):
    made = coman()
    want = draw_tuples(made, 700, 0.2, False, stream(14))
    monkeypatch.setattr(batch, "workers", lambda: threads)
    monkeypatch.setattr(batch, "CHUNK", 64)
    found = draw_tuples(made, 700, 0.2, False, stream(14))
    assert all(np.array_equal(a, b) for a, b in zip(want, found, strict=True))


def test_streams_of_two_purposes_are_independent_and_each_is_repeatable():
    a, b, again = (rng.stream(7, purpose).uniform(size=4) for purpose in ("a", "b", "a"))
    assert np.array_equal(a, again)
    assert not np.array_equal(a, b)
    assert not np.array_equal(a, rng.stream(8, "a").uniform(size=4))


def test_the_table_of_tuples_keeps_its_contract_and_counts_its_rows():
    made, done = coman(), []
    columns, counts = sampling.kinematic_pairs(made, 300, 0.2, False, stream(15), done.append)
    assert list(columns) == list(kinematic_pairs(11, MARGIN).columns)
    assert counts["feasible"] + counts["solved"] + counts["fallback"] == counts["rows"] == 300
    assert (columns["clearance"] >= MARGIN).all() and (columns["limit_margin"] >= 0).all()
    assert sum(done) == 600  # twice a row: projected, certified
    made.certifier().require(columns["q_feasible"], MARGIN)


def test_more_relaxation_is_farther_from_feasible():
    made = coman()
    moved = []
    for alpha in (0.0, 0.5, 2.0):
        drawn = draw_tuples(made, 600, alpha, False, stream(16))
        moved.append(np.linalg.norm(drawn.q_relaxed - drawn.q_feasible, axis=1).mean())
    assert moved[0] < moved[1] < moved[2]


# --- feasible poses


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_feasible_poses_are_certified(name):
    made = coman(name=name)
    columns, counts = sampling.robot_poses(made, 700, stream(17))
    assert list(columns) == list(robot_poses(11, MARGIN).columns)
    made.certifier().require(columns["q"], MARGIN)
    assert np.array_equal(columns["x"], batch.skeletons(made.chain, columns["q"]))
    assert counts["rows"] == 700 and 0.3 < counts["accepted_share"] < 0.8


def test_the_accepted_share_of_coman_is_the_measured_one():
    _, share = draw_feasible(coman(margin=0.0), 20_000, stream(18))
    assert share == pytest.approx(1 - 0.411, abs=0.03)  # 41 % of random poses collide


@pytest.mark.parametrize("count", [1, 999, 1001], ids=str)
def test_as_many_feasible_poses_come_as_were_asked_for_and_progress_says_so(count):
    done = []
    q, share = draw_feasible(coman(), count, stream(19), done.append)
    assert q.shape == (count, 11) and sum(done) == count
    assert 0.0 < share <= 1.0


def test_feasible_poses_of_one_seed_are_the_same():
    a, b = (draw_feasible(coman(), 300, stream(20))[0] for _ in range(2))
    assert np.array_equal(a, b)


def test_a_robot_that_is_hardly_ever_feasible_is_refused_instead_of_searched_for_ever():
    strict = dataclasses.replace(coman(), margin=1.0)  # [m], farther than its bodies can be
    with pytest.raises(RobotError) as refusal:
        draw_feasible(strict, 30_000, stream(21))
    assert str(refusal.value) == (
        "robot coman: only 0 of 120000 random poses feasible; "
        "look at its watched pairs (data/robot/pairs.parquet)"
    )
