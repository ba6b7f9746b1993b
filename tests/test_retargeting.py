"""Optimisation-based retargeting: recovers what it is given, and keeps what it must keep."""

import numpy as np
import pytest
from worlds import (
    ARMS_YAML,
    MARGIN,
    coman,
    edited,
    inside_limits,
    people,
    relaxed,
    skeleton_and_jacobian,
    write_arms,
)

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance, face_forward, features
from s3le.tuples import ik
from s3le.tuples.ik import TURN, ground_truth, nearest_turn, relaxed_poses

RECOVERED = 1e-4  # [-], mean cosine distance
RIDGE = 1e-4  # [-], params.yaml's truth.ridge
ALGEBRA = 1e-12  # [-]


def feasible(made, n, seed):
    q = inside_limits(made, 4 * n, seed)
    return q[batch.clearances(made.chain, q) >= made.margin][:n]


def stream(seed):
    return np.random.default_rng(seed)


def humans(n, seed):
    return features(face_forward(people(n, seed))[0])[0]


def wild(n, seed):
    """Skeletons that no robot can take: seven random directions."""
    v = stream(seed).normal(size=(n, 7, 3))
    return (v / np.linalg.norm(v, axis=2, keepdims=True)).reshape(n, 21)


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_the_ground_truth_recovers_the_skeletons_of_feasible_poses(name):
    made = coman(name=name)
    x = batch.skeletons(made.chain, feasible(made, 60, 1))
    q, distance = ground_truth(made, x, 24, RIDGE, stream(2))
    assert np.median(distance) < 1e-6
    assert (distance < RECOVERED).mean() > 0.97  # a far corner may need more starts yet
    made.certifier().require(q, made.margin)


def test_relaxed_inverse_kinematics_recovers_what_the_arms_can_reach():
    made = coman()
    x = batch.skeletons(made.chain, feasible(made, 60, 3))
    _, residual = relaxed_poses(made, x, RIDGE)
    assert np.median(residual) < RECOVERED


@pytest.mark.parametrize("draw", [humans, wild], ids=["humans", "no body's"])
def test_the_stated_distance_is_that_of_the_returned_pose(draw):
    made, x = coman(), draw(15, 4)
    q, distance = ground_truth(made, x, 4, RIDGE, stream(5))
    assert np.array_equal(distance, cosine_distance(batch.skeletons(made.chain, q), x))
    q, residual = relaxed_poses(made, x, RIDGE)
    assert np.array_equal(residual, cosine_distance(batch.skeletons(made.chain, q), x))


@pytest.mark.parametrize("draw", [humans, wild], ids=["humans", "no body's"])
def test_whatever_is_asked_for_the_ground_truth_is_feasible_by_the_independent_check(draw):
    made = coman()
    q, _ = ground_truth(made, draw(60, 6), 4, RIDGE, stream(7))
    made.certifier().require(q, made.margin)


def objective(made, q, x, ridge):
    middle = (made.lower + made.upper) / 2
    apart = batch.skeletons(made.chain, q) - x
    return 0.5 * (apart**2).sum(axis=1) + 0.5 * ridge * ((q - middle) ** 2).sum(axis=1)


def free(made, x, starts, ridge):
    middle = (made.lower + made.upper) / 2
    return batch.follow(made.chain, x, starts, middle, ridge, made.margin, False)


def test_constraints_never_make_the_answer_better():
    made, x = coman(), humans(40, 8)
    q, _ = ground_truth(made, x, 6, RIDGE, stream(9))
    # Started where the constrained answer is, the unconstrained one can only go down.
    without = free(made, x, q[:, None], RIDGE)
    bound = objective(made, q, x, RIDGE)
    assert (without.cost <= bound + ALGEBRA).all()
    assert (without.cost < bound - 1e-6).any()


@pytest.mark.parametrize("constrained", [False, True], ids=["free", "constrained"])
def test_the_stated_cost_is_the_objective_at_the_returned_pose(constrained):
    made, x = coman(), wild(40, 10)
    middle = (made.lower + made.upper) / 2
    starts = np.broadcast_to(made.anchor, (40, 1, 11))
    found = batch.follow(made.chain, x, starts, middle, RIDGE, made.margin, constrained)
    assert found.feasible.all()
    assert np.allclose(found.cost, objective(made, found.q, x, RIDGE), rtol=0, atol=1e-9)


def test_limits_and_collisions_have_an_effect_and_none_where_they_are_off():
    made, x = coman(), humans(80, 11)
    x = np.concatenate([x, batch.skeletons(made.chain, np.zeros((1, 11)))])  # arms down: collides
    q, _ = relaxed_poses(made, x, RIDGE)
    report = made.certifier().check(q)
    assert (report.clearance < made.margin).any()
    bent = batch.skeletons(made.chain, made.anchor[None] + [[0, 0, 2.2] + [0] * 8])
    out, residual = relaxed_poses(made, bent, RIDGE)
    assert residual[0] < RECOVERED
    assert made.certifier().check(out).limit_margin[0] < 0.0  # the waist turns farther than it can
    kept, distance = ground_truth(made, bent, 8, RIDGE, stream(12))
    assert made.certifier().require(kept, made.margin).limit_margin[0] >= 0.0
    assert distance[0] > residual[0]


def test_more_starts_are_never_worse():
    made, x = coman(), wild(25, 13)
    q = [ground_truth(made, x, starts, RIDGE, stream(14))[0] for starts in (2, 6)]
    few, many = (objective(made, pose, x, RIDGE) for pose in q)
    assert (many <= few + 1e-9).all()


def test_the_answer_is_a_function_of_the_seed_and_of_the_row_alone():
    made, x = coman(), humans(12, 15)
    q, _ = ground_truth(made, x, 5, RIDGE, stream(16))
    again, _ = ground_truth(made, x, 5, RIDGE, stream(16))
    backwards, _ = ground_truth(made, x[::-1], 5, RIDGE, stream(16))
    assert np.array_equal(q, again)
    assert np.array_equal(q, backwards[::-1])


@pytest.mark.parametrize("threads", [1, 4])
def test_the_answer_does_not_depend_on_the_number_of_threads(monkeypatch, threads):
    made, x = coman(), humans(600, 17)
    monkeypatch.setattr(batch, "CHUNK", 64)
    want, _ = relaxed_poses(made, x, RIDGE)
    monkeypatch.setattr(batch, "workers", lambda: threads)
    assert np.array_equal(relaxed_poses(made, x, RIDGE)[0], want)


def test_the_relaxed_answer_is_where_the_slope_ends():
    made, x = coman(), humans(10, 18)
    middle = (made.lower + made.upper) / 2
    found = free(made, x, np.broadcast_to(made.anchor, (10, 1, 11)), 1e-3)
    for pose, want in zip(found.q, x, strict=True):
        here, J = skeleton_and_jacobian(made, pose)
        assert np.abs(J.T @ (here - want) + 1e-3 * (pose - middle)).max() < 1e-5


def test_a_tilted_robot_is_retargeted_as_an_upright_one(tmp_path):
    tilted = edited(ARMS_YAML, ("[0.0, 0.0, 0.0]", "[0.4, -1.1, 2.3]"))
    for folder, yaml in (("plain", ARMS_YAML), ("tilted", tilted)):
        made = Robot.from_file(write_arms(tmp_path / folder, yaml), MARGIN, "midpoint")
        x = batch.skeletons(made.chain, feasible(made, 20, 19))
        q, distance = ground_truth(made, x, 6, RIDGE, stream(20))
        assert distance.max() < RECOVERED
        made.certifier().require(q, MARGIN)


# --- whole turns


def violation(q, lower, upper):
    return np.maximum(lower - q, 0.0) + np.maximum(q - upper, 0.0)


def test_the_nearest_turn_violates_the_range_least_of_all_turns():
    made = coman()
    lower, upper = made.lower, made.upper
    q = 20.0 * relaxed(made, 200, 21)
    best = np.min([violation(q + TURN * k, lower, upper) for k in range(-40, 41)], axis=0)
    assert np.allclose(
        violation(nearest_turn(q, lower, upper), lower, upper), best, rtol=0, atol=1e-9
    )


def test_the_nearest_turn_never_changes_the_skeleton():
    made = coman()
    q = 20.0 * relaxed(made, 200, 22)
    turned = nearest_turn(q, made.lower, made.upper)
    assert np.allclose(np.cos(turned - q), 1.0, rtol=0, atol=ALGEBRA)
    here, there = (batch.skeletons(made.chain, pose) for pose in (q, turned))
    assert np.allclose(here, there, rtol=0, atol=1e-10)


def test_an_angle_within_half_a_turn_of_mid_range_is_left_to_the_bit():
    made = coman()
    q = relaxed(made, 100, 23)
    near = np.abs(q - (made.lower + made.upper) / 2) < np.pi
    turned = nearest_turn(q, made.lower, made.upper)
    assert np.array_equal(turned[near], q[near])


def test_a_skeleton_that_is_not_finite_has_no_distance():
    made, x = coman(), humans(3, 24)
    x[1, 5] = np.nan
    _, residual = relaxed_poses(made, x, RIDGE)
    q, distance = ground_truth(made, x, 3, RIDGE, stream(25))
    assert np.isnan(residual).tolist() == np.isnan(distance).tolist() == [False, True, False]
    made.certifier().require(q, made.margin)


@pytest.mark.parametrize("shape", [(3, 20), (21,), (3, 7, 3)], ids=str)
def test_skeletons_of_another_shape_are_refused(shape):
    made = coman()
    with pytest.raises(ParameterError) as refusal:
        ik.relaxed_poses(made, np.ones(shape), RIDGE)
    assert str(refusal.value) == f"skeletons must have shape (n, 21), got {shape}"


@pytest.mark.parametrize("shape", [(3, 2, 10), (2, 2, 11), (3, 11)], ids=str)
def test_starts_of_another_shape_are_refused(shape):
    made = coman()
    with pytest.raises(ParameterError) as refusal:
        batch.follow(made.chain, humans(3, 26), np.zeros(shape), np.zeros(11), RIDGE, MARGIN, False)
    assert str(refusal.value) == f"starts must have shape (3, k, 11), got {shape}"
