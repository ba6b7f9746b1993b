"""Sampling: the law of relaxed limits, mixup, determinism, and poses that are certified."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import coman

from s3le import rng
from s3le.errors import ParameterError, RobotError
from s3le.kernels import batch
from s3le.skeleton import cosine_distance
from s3le.tuples import sampling
from s3le.tuples.sampling import draw_feasible, mixup, relaxed_limits

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
    robot = coman()
    lower, upper = relaxed_limits(robot.lower, robot.upper, 0.0)
    assert np.array_equal(lower, robot.lower) and np.array_equal(upper, robot.upper)


@pytest.mark.parametrize("alpha", [-1e-9, -1.0, np.nan, np.inf, -np.inf], ids=str)
def test_a_relaxation_that_is_none_is_refused(alpha):
    with pytest.raises(ParameterError) as refusal:
        relaxed_limits(np.zeros(2), np.ones(2), alpha)
    assert str(refusal.value) == f"alpha must be finite and >= 0, got {alpha!r}"


# --- mixup


def skeletons(seed, n=50):
    made = coman()
    low, high = made.lower, made.upper
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


def tuples(made, n, seed, alpha=0.2, renormalise=False):
    low, high = relaxed_limits(made.lower, made.upper, alpha)
    q = stream(seed).uniform(low, high, (n, made.n_dof))
    mix = stream(seed + 100).uniform(size=n)
    return sampling.tuples(made, q, mix, renormalise, sampling.projector(made))


@pytest.mark.parametrize("renormalise", [False, True])
def test_a_tuple_is_what_its_columns_say(renormalise):
    made = coman()
    drawn = tuples(made, 400, 11, 0.5, renormalise)
    assert np.array_equal(drawn.x_relaxed, batch.skeletons(made.chain, drawn.q_relaxed))
    assert np.array_equal(drawn.x_feasible, batch.skeletons(made.chain, drawn.q_feasible))
    projected = batch.project(made.chain, made.anchor, drawn.q_relaxed, made.margin)
    assert np.array_equal(drawn.q_feasible, projected.q)
    assert np.array_equal(drawn.how, projected.how)
    again = mixup(drawn.x_relaxed, drawn.x_feasible, drawn.mix, renormalise)
    assert np.array_equal(drawn.x_mixed, again)


@pytest.mark.parametrize("threads", [1, 3])
def test_rows_do_not_depend_on_the_number_of_threads(monkeypatch, threads):
    want = tuples(coman(), 700, 14)
    monkeypatch.setattr(batch, "workers", lambda: threads)
    monkeypatch.setattr(batch, "CHUNK", 64)
    found = tuples(coman(), 700, 14)
    assert all(np.array_equal(a, b) for a, b in zip(want, found, strict=True))


def test_streams_of_two_purposes_and_parts_are_independent_and_each_is_repeatable():
    one, two, part, again = (
        rng.stream(7, *words).uniform(size=4) for words in (["a"], ["b"], ["a", 1], ["a"])
    )
    assert np.array_equal(one, again)
    assert not np.array_equal(one, two) and not np.array_equal(one, part)
    assert not np.array_equal(one, rng.stream(8, "a").uniform(size=4))
    assert not np.array_equal(part, rng.stream(7, "a", 2).uniform(size=4))


def test_more_relaxation_is_farther_from_feasible():
    moved = []
    for alpha in (0.0, 0.5, 2.0):
        drawn = tuples(coman(), 600, 16, alpha)
        moved.append(np.linalg.norm(drawn.q_relaxed - drawn.q_feasible, axis=1).mean())
    assert moved[0] < moved[1] < moved[2]


# --- feasible poses


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_feasible_poses_are_certified(name):
    made = coman(name=name)
    q, accepted, drawn = draw_feasible(made, 700, stream(17))
    made.certifier().require(q, made.margin)
    assert q.shape == (700, 11) and 0.3 < accepted / drawn < 0.8


def test_the_accepted_share_of_coman_is_the_measured_one():
    _, accepted, drawn = draw_feasible(coman(margin=0.0), 20_000, stream(18))
    assert accepted / drawn == pytest.approx(1 - 0.411, abs=0.03)  # 41 % of random poses collide


@pytest.mark.parametrize("count", [1, 999, 5001], ids=str)
def test_fewer_feasible_poses_are_the_first_of_more(count):
    many, fewer = (draw_feasible(coman(), n, stream(19))[0] for n in (6000, count))
    assert np.array_equal(many[:count], fewer)


def test_a_robot_that_is_hardly_ever_feasible_is_refused_instead_of_searched_for_ever():
    strict = dataclasses.replace(coman(), margin=1.0)  # [m], farther than its bodies can be
    with pytest.raises(RobotError) as refusal:
        draw_feasible(strict, 30_000, stream(21))
    assert str(refusal.value) == (
        "robot coman: only 0 of 102400 random poses feasible; "
        "look at its watched pairs (data/robot/pairs.parquet)"
    )
