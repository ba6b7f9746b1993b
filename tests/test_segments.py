"""Paths between poses: what is proven holds, what collides does, and the rest is not certified."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from proofs import prove
from worlds import (
    ARMS_URDF,
    ARMS_YAML,
    HALF_WIDTH,
    HEIGHT,
    MARGIN,
    UPPER,
    arms_points,
    coman,
    edited,
    exact_distance,
    inside_limits,
    placed,
    relaxed,
    write_arms,
)

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.kernels.threads import use_threads
from s3le.robot.certificate import placements
from s3le.robot.robot import Robot
from s3le.safety import paths, segment
from s3le.safety.judge import Judge
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, certify
from s3le.safety.swept import swept, travels

BETWEEN = 0.0005  # [m], clearance to keep between poses
AGREEMENT = 1e-7  # [m], of kernels and coal on any capsules (test_distance.py)
ALGEBRA = 1e-9  # [m]
ROUNDING = 2e-9  # [m], taken off what is proven


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """The two-armed robot with its base lying on a side."""
    lying = edited(ARMS_YAML, ("base_rpy: [0.0, 0.0, 0.0]", "base_rpy: [0.4, -1.2, 2.0]"))
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("turned"), lying), MARGIN, "midpoint")


def feasible(made, n, seed):
    """Feasible poses, about half of them as close to a collision as allowed, (n, n_dof) [rad]."""
    return batch.project(made.chain, made.anchor, relaxed(made, n, seed), MARGIN).q


@cache
def steps(speed: float, n: int = 400, seed: int = 1):
    """Pairs of feasible poses of COMAN that joints at this speed [rad/s] reach in 1/30 s."""
    made, most = coman(), speed / 30.0
    q0 = feasible(made, n, seed)
    q1 = q0 + np.random.default_rng(seed).uniform(-most, most, q0.shape)
    q1 = np.clip(q1, made.lower, made.upper)
    q1 = batch.project(made.chain, made.anchor, q1, MARGIN).q
    near = np.abs(q1 - q0).max(axis=1) <= 1.001 * most
    return q0[near], q1[near]


def prove_all(made, pairs, margin=BETWEEN, budget=paths.BUDGET):
    return [prove(made, a, b, margin, budget) for a, b in zip(*pairs, strict=True)]


def at(q0, q1, t):
    """Poses of the path [rad]."""
    t = np.asarray(t, float)[..., None]
    return (1.0 - t) * q0 + t * q1


# --- never certified where it is not


@pytest.mark.parametrize("speed", [4.0, 15.0], ids="{:g} rad/s".format)
def test_the_judge_sees_no_less_than_what_is_proven(speed):
    made = coman()
    q0, q1 = steps(speed)
    found = prove_all(made, (q0, q1))
    judge = Judge(made.certifier())
    bound = np.array([one.bound for one in found])
    certified = np.array([one.status == CERTIFIED for one in found])
    assert certified.mean() > 0.9
    hard = np.flatnonzero(certified)[np.argsort(bound[certified])]
    for row in (*hard[: int(400 / speed)], *hard[:: len(hard) // 16]):
        seen = judge.path(q0[row], q1[row])
        assert seen.poses > 1.2 * speed and seen.clearance >= bound[row] - AGREEMENT
        assert bound[row] >= BETWEEN


@pytest.mark.parametrize("speed", [4.0, 15.0, 60.0], ids="{:g} rad/s".format)
def test_a_counterexample_is_one_to_coal(speed):
    made = coman()
    q0, q1 = steps(speed)
    checker, collided = made.certifier(), 0
    for a, b, one in zip(q0, q1, prove_all(made, (q0, q1)), strict=True):
        if one.status == COLLIDES:
            report = checker.check(at(a, b, one.t)[None])
            assert one.clearance == pytest.approx(report.clearance[0], abs=AGREEMENT)
            assert one.clearance < BETWEEN and one.pair == report.pair[0]
            assert 0.0 < one.t < 1.0 and 0.0 <= one.until <= one.t
            collided += 1
        else:
            assert np.isnan(one.t) and np.isnan(one.clearance) and one.pair == -1
    assert collided or speed == 4.0


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([1e-12, 1e-4, 0.02, 0.15, 0.6, 3.0]),
    margin=st.sampled_from([1e-6, 0.0005, 0.002]),
)
def test_proofs_hold_on_random_steps_of_two_arms(arms, seed, size, margin):
    rng = np.random.default_rng(seed)
    q = batch.project(arms.chain, arms.anchor, relaxed(arms, 1, seed), MARGIN).q[0]
    end = np.clip(q + rng.uniform(-size, size, 4), arms.lower, arms.upper)
    one = prove(arms, q, end, margin)
    sampled = batch.clearances(arms.chain, at(q, end, np.linspace(0, 1, 400)))
    if one.status == COLLIDES:
        there = batch.clearances(arms.chain, at(q, end, one.t)[None])[0]
        assert there == pytest.approx(one.clearance, abs=ALGEBRA) and there < margin
        assert np.isnan(one.bound)
    else:
        assert (one.status == CERTIFIED) == (one.bound >= margin)
        assert sampled.min() >= one.bound
    proven = sampled[: int(one.until * 399) + 1] if one.until > 0 else sampled[:0]
    assert (proven >= margin).all()


def test_without_the_whole_bound_the_judge_finds_collisions_among_the_certified():
    made = coman()
    pairs = steps(60.0)
    bounds, scratch = swept(made.chain), segment.scratch(made.chain)
    fifth = bounds._replace(radius=0.2 * bounds.radius)
    judge, wrong = Judge(made.certifier()), 0
    for a, b, honest in zip(*pairs, prove_all(made, pairs), strict=True):
        status = segment.prove(made.chain, fifth, scratch, a, b, BETWEEN, 200)[0]
        if status == CERTIFIED and honest.status != CERTIFIED:
            wrong += judge.path(a, b).clearance < BETWEEN
        if wrong == 2:
            return
    pytest.fail(f"the guard let through as little with a fifth of the bound: {wrong}")


# --- steps through a body


def arms_gap(names, pose, limb):
    """Clearance of the trunk and a limb of the two-armed robot, by hand [m]."""
    points = arms_points(dict(zip(names, pose, strict=True)))
    begin, end = ("shoulder", "elbow") if "upper" in limb else ("elbow", "hand")
    core, radius = ((1 / 6, 5 / 6), 0.04) if "upper" in limb else ((0.2, 0.8), 0.03)
    begin, end = points[limb[:2] + begin], points[limb[:2] + end]
    trunk = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.4]])
    limb = np.array([begin + share * (end - begin) for share in core])
    return float(exact_distance(limb, trunk)) - radius - 0.1


def test_an_arm_that_swings_through_the_trunk_collides_where_geometry_says(arms):
    names = arms.joint_names
    start, end = arms.anchor.copy(), arms.anchor.copy()
    end[names.index("r_shoulder")] = 3.0  # the straight arm swings down, through, and up
    q = np.stack([start, end, start])
    arms.certifier().require(q, MARGIN)
    found = certify(arms, q, BETWEEN)
    assert found.status.tolist() == [COLLIDES, COLLIDES]
    for a, b, t, pair, clearance in zip(
        q, q[1:], found.t, found.pair, found.clearance, strict=False
    ):
        trunk, limb = arms.pair_name(pair).split(" and ")
        assert trunk == "body_0" and limb in ("r_upper_0", "r_lower_0")
        assert clearance == pytest.approx(arms_gap(names, at(a, b, t), limb), abs=ALGEBRA)
        assert clearance < BETWEEN


@pytest.mark.parametrize("gap", [0.0, 4e-4, 4.99e-4, 5.01e-4, 6e-4, 0.002], ids="{:g} m".format)
def test_an_arm_that_swings_past_a_ball_is_certified_by_the_gap_it_leaves(tmp_path, gap):
    # Pointing at the ball, 0.3 rad from hanging, the forearm's end is nearest to it.
    far = UPPER + 0.2 + 0.03 + 0.1 + gap  # [m], shoulder to the ball's centre
    y, z = -HALF_WIDTH + far * np.sin(0.3), HEIGHT - far * np.cos(0.3)
    urdf = edited(
        ARMS_URDF,
        ('<origin xyz="0 0 0.25"/>', f'<origin xyz="0 {y:.17g} {z:.17g}"/>'),
        ('<capsule radius="0.1" length="0.3"/>', '<sphere radius="0.1"/>'),
    )
    made = Robot.from_file(write_arms(tmp_path, urdf=urdf), MARGIN, "midpoint")
    ends = np.tile(made.anchor, (2, 1))
    ends[:, made.joint_names.index("r_shoulder")] = -0.6, 1.1
    made.certifier().require(ends, 0.02)
    found = certify(made, ends, BETWEEN)
    if gap > BETWEEN:
        assert found.status[0] == CERTIFIED and BETWEEN <= found.bound[0] <= gap + ALGEBRA
    else:
        assert found.status[0] == COLLIDES and gap - ALGEBRA <= found.clearance[0] < BETWEEN
        assert found.t[0] == pytest.approx(0.9 / 1.7, abs=0.05)
        assert made.pair_name(found.pair[0]) == "body_0 and r_lower_0"


def test_between_random_feasible_poses_of_coman_some_paths_collide_and_some_do_not():
    made = coman()
    q = feasible(made, 60, 5)
    found = certify(made, q, BETWEEN)
    collided = np.flatnonzero(found.status == COLLIDES)
    assert 5 < len(collided) < 30 and (found.status == CERTIFIED).sum() > 20
    there = np.array([at(q[row], q[row + 1], found.t[row]) for row in collided])
    report = made.certifier(BETWEEN).check(there)
    assert np.allclose(report.clearance, found.clearance[collided], rtol=0, atol=AGREEMENT)
    assert (report.limit_margin >= -1e-15).all()  # [rad], limits at both ends hold between
    assert (report.clearance < BETWEEN).all()
    made.certifier().require(q, MARGIN)


# --- the bounds on travel


def courses(made, q0, q1, n):
    """Core ends in each frame that carries the body, at n + 1 poses: (n + 1, b, f, 2, 3) [m]."""
    course = []
    for pose in at(q0, q1, np.linspace(0, 1, n + 1)):
        R, p, _, ends = placed(made, pose)
        away = ends[:, None, :2] - p[None, :, None]  # (b, f, 2, 3)
        course.append(np.einsum("fji,bfej->bfei", R, away))
    return np.array(course)


@pytest.mark.parametrize("name", ["coman", "arms", "turned"])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([1e-3, 0.05, 1.0]))
def test_no_point_of_a_body_travels_or_turns_aside_more_than_its_bound(request, name, seed, share):
    made = coman() if name == "coman" else request.getfixturevalue(name)
    q0, q1 = inside_limits(made, 2, seed)
    moving = np.random.default_rng(seed).random(len(q0)) < 0.6  # few joints make the bound tight
    q1 = np.where(moving, at(q0, q1, share), q0)
    chain, n = made.chain, 40
    shape = (len(chain.body_frame), len(q0) + 1)
    travel, bend = np.full(shape, np.nan), np.full(shape, np.nan)
    travels(chain, swept(chain), np.abs(q1 - q0), np.zeros(len(q0)), travel, bend)
    carries = np.isfinite(travel)
    assert np.array_equal(carries.any(axis=1), np.full(shape[0], True))
    course = courses(made, q0, q1, n)
    went = np.linalg.norm(np.diff(course, axis=0), axis=-1).sum(axis=0).max(axis=-1)
    assert (went[carries] <= travel[carries] + ALGEBRA).all()
    # f(t + h) - 2 f(t) + f(t - h) <= A h^2
    aside = np.linalg.norm(np.diff(course, 2, axis=0), axis=-1).max(axis=(0, -1))
    assert (aside[carries] <= bend[carries] / n**2 + ALGEBRA / n**2).all()


def test_the_travel_bound_is_reached_by_a_joint_that_swings_a_straight_arm(arms):
    names = [body.name for body in arms.bodies]
    forearm, shoulder = names.index("r_lower_0"), arms.joint_names.index("r_shoulder")
    q1 = np.zeros(4)
    q1[shoulder] = 0.7
    shape = (len(names), 5)
    travel, bend = np.zeros(shape), np.zeros(shape)
    travels(arms.chain, swept(arms.chain), np.abs(q1), np.zeros(4), travel, bend)
    far = 0.3 + 0.2  # [m], upper arm and the far end of the forearm's core
    assert travel[forearm, 0] == pytest.approx(0.7 * far, abs=ALGEBRA)
    assert bend[forearm, 0] == pytest.approx(0.49 * far, abs=ALGEBRA)


def test_the_carrier_of_a_pair_is_the_last_frame_that_moves_both():
    made = coman()
    for (a, b), frame in zip(made.watched, swept(made.chain).carrier, strict=True):
        path_a, path_b = (made.path_to(made.bodies[k].joint) for k in (a, b))
        shared = [j for j in path_a if j in path_b]
        assert frame == (shared[-1] + 1 if shared else 0)


# --- the budget, and what is never certified


def hard_step():
    """A step that takes several looks, and how many."""
    q0, q1 = steps(60.0)
    for a, b, one in zip(q0, q1, prove_all(coman(), (q0, q1)), strict=True):
        if one.status == CERTIFIED and one.used >= 3:
            return a, b, one.used
    raise AssertionError("no hard step among the samples")


@pytest.mark.parametrize("budget", [0, 1])
def test_a_budget_that_is_spent_ends_undecided(budget):
    a, b, need = hard_step()
    made = coman()
    one = prove(made, a, b, BETWEEN, budget)
    assert one.status == UNDECIDED and one.used == budget
    assert one.bound < BETWEEN and one.until < 1.0
    assert np.isnan(one.t) and one.pair == -1
    assert prove(made, a, b, BETWEEN, need - 1).status == UNDECIDED
    assert prove(made, a, b, BETWEEN, need).status == CERTIFIED


def test_what_is_proven_before_the_budget_ends_is_clear():
    a, b, need = hard_step()
    made = coman()
    one = prove(made, a, b, BETWEEN, need - 1)
    assert 0.0 < one.until < 1.0
    assert Judge(made.certifier(), 0.003).path(a, at(a, b, one.until)).clearance >= BETWEEN


def test_a_path_of_no_length_is_as_clear_as_its_pose():
    made = coman()
    q = np.repeat(feasible(made, 20, 6), 2, axis=0)[:-1]
    found = certify(made, q, BETWEEN)
    stays = slice(0, None, 2)
    assert (found.status[stays] == CERTIFIED).all() and (found.used[stays] == 0).all()
    clearance = made.certifier(BETWEEN).check(q[stays]).clearance[:-1]
    assert np.allclose(found.bound[stays], clearance[: len(found.bound[stays])], atol=ROUNDING)
    assert len(certify(made, q[:1], BETWEEN).status) == 0


def test_a_pose_that_collides_is_found_at_either_end():
    made = coman()
    down, anchor = np.zeros(11), made.anchor  # arms down: the hands are in the thighs
    found = certify(made, np.stack([down, anchor, down]), BETWEEN)
    assert found.status.tolist() == [COLLIDES, COLLIDES]
    assert found.t.tolist() == [0.0, 1.0] and found.until.tolist() == [0.0, 0.0]
    want = batch.clearances(made.chain, down[None])[0]
    assert found.clearance == pytest.approx(want, abs=ALGEBRA)


def test_a_path_and_its_reverse_are_judged_alike():
    made = coman()
    for speed in (4.0, 60.0):
        q0, q1 = steps(speed)
        for there, back in zip(prove_all(made, (q0, q1)), prove_all(made, (q1, q0)), strict=True):
            assert there.status == back.status
            if there.status == CERTIFIED:
                assert there.used == back.used


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e308, 2e3], ids=str)
def test_what_is_not_finite_is_never_certified(bad):
    made = coman()
    q = np.tile(made.anchor, (5, 1))
    assert (certify(made, q, BETWEEN).status == CERTIFIED).all()
    q[2, 4] = bad
    found = certify(made, q, BETWEEN)
    assert found.status.tolist() == [CERTIFIED, UNDECIDED, UNDECIDED, CERTIFIED]
    assert np.isnan(found.bound[1:3]).all() and (found.until[1:3] == 0.0).all()
    assert not (found.bound[1:3] >= BETWEEN).any()
    assert prove(made, q[2], q[2], BETWEEN).status == UNDECIDED
    assert np.isnan(Judge(made.certifier()).path(q[1], q[2]).clearance)


# --- the doors


def test_one_step_and_the_batch_agree_whatever_the_number_of_threads():
    made = coman()
    q = feasible(made, 150, 7)
    want = prove_all(made, (q[:-1], q[1:]))
    done = []
    try:
        for threads in (1, 3):
            use_threads(threads)
            found = certify(made, q, BETWEEN, progress=done.append)
            for name, column in found._asdict().items():
                one = np.array([getattr(step, name) for step in want])
                assert np.array_equal(column, one, equal_nan=column.dtype == float), name
    finally:
        use_threads(0)
    assert sum(done) == 2 * 149


def test_a_turn_of_the_base_changes_nothing(arms, turned):
    q = feasible(arms, 80, 8)
    plain, lying = certify(arms, q, BETWEEN), certify(turned, q, BETWEEN)
    for column, other in zip(plain, lying, strict=True):
        assert np.array_equal(column, other, equal_nan=column.dtype == float)


@pytest.mark.parametrize("margin", [0.0, -0.001, 0.0021, np.nan, np.inf], ids=str)
def test_a_margin_that_means_nothing_is_refused(margin):
    made = coman()
    for door in (lambda: certify(made, np.zeros((2, 11)), margin),):
        with pytest.raises(ParameterError) as refusal:
            door()
        assert str(refusal.value) == (
            "margin_between must be above 0 and at most the margin of the poses, 0.002 m, "
            f"got {margin!r}"
        )


@pytest.mark.parametrize("shape", [(11,), (0, 11), (3, 10), (2, 2, 11)], ids=str)
def test_a_trajectory_of_another_shape_is_refused(shape):
    with pytest.raises(ParameterError) as refusal:
        certify(coman(), np.zeros(shape), BETWEEN)
    assert str(refusal.value) == (
        f"a trajectory must have shape (n, 11) with n at least 1, got {shape}"
    )


def test_a_negative_budget_is_refused():
    with pytest.raises(ParameterError) as refusal:
        certify(coman(), np.zeros((2, 11)), BETWEEN, -1)
    assert str(refusal.value) == "the budget of a proof must be at least 0 poses, got -1"


# --- the judge


@pytest.mark.parametrize("speed", [4.0, 60.0], ids="{:g} rad/s".format)
def test_no_point_of_a_body_moves_more_than_a_millimetre_between_poses_of_the_judge(speed):
    made = coman()
    q0, q1 = steps(speed)
    judge = Judge(made.certifier())
    way = np.random.default_rng(9).normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    for a, b in list(zip(q0, q1, strict=True))[:4]:
        poses = judge.poses(a, b)
        assert np.array_equal(poses[[0, -1]], [a, b])
        row = len(poses) // 2
        before, after = (placements(made, pose) for pose in poses[row : row + 2])
        for one, two, body in zip(before, after, made.bodies, strict=True):
            half = np.linalg.norm(body.b - body.a) / 2
            skin = body.radius * way + np.sign(way[:, 2:]) * [0.0, 0.0, half]
            first, then = (skin @ at.getRotation().T + at.getTranslation() for at in (one, two))
            assert np.linalg.norm(then - first, axis=1).max() <= 0.001
