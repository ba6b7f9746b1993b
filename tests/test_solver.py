"""The solver by itself, on two planar arms: optimal where it is done, never out of its box."""

import numpy as np
import pytest
from scipy.optimize import nnls
from worlds import (
    MARGIN,
    all_clearances,
    inside_limits,
    pair_distances,
    placed,
    relaxed,
    skeleton_and_jacobian,
    write_arms,
)

from s3le.kernels import batch
from s3le.kernels.distance import reach
from s3le.kernels.solver import blend, clearance_of, minimise, minimise_within, restore
from s3le.kernels.solver import restore_within as restore_in
from s3le.robot.robot import Robot

SLACK = 1e-6  # [m], aimed for beyond the margin
RIDGE = 1e-2
FLAT = np.zeros(21)
N = 4


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


def solved(made, q, follow=None, ridge=0.0, collide=True, steps=60, box=None, fine=0.0, band=0.1):
    """(pose, objective, violation, iterations) from q towards q, or towards a skeleton."""
    chain, out, at = made.chain, np.zeros(3), np.array(q, float)
    low, high = box or (chain.lower, chain.upper)
    minimise_within(
        chain, reach(chain), low, high, follow is not None, FLAT if follow is None else follow,
        np.array(q, float), ridge, MARGIN, collide, band, fine, steps, at, out,
    )  # fmt: skip
    return at, *out


def slack(made, q):
    """Least signed distance of a watched pair, without any shortcut [m]."""
    return all_clearances(made, placed(made, q)[3]).min()


def pushed(made, n, seed, size=0.4):
    """Feasible poses, and others near by that need not be."""
    q = batch.project(made.chain, made.anchor, relaxed(made, n, seed), MARGIN).q
    return q, q + np.random.default_rng(seed).uniform(-size, size, q.shape)


def leftover(made, q, slope, low, high):
    """How much of the slope no active limit or distance explains, of its size."""
    d, G = pair_distances(made, q, 0.1)
    eye = np.eye(N)
    normals = [eye[q <= low + 1e-9], -eye[q >= high - 1e-9], G[d <= MARGIN + 2 * SLACK]]
    normals = np.concatenate(normals)
    rest = nnls(normals.T, slope)[1] if len(normals) else np.linalg.norm(slope)
    return rest / (1.0 + np.linalg.norm(slope))


def test_the_nearest_feasible_pose_is_one_that_no_small_step_betters(arms):
    chain, blocked = arms.chain, 0
    for want in pushed(arms, 25, 3)[1]:
        q, cost, short, steps = solved(arms, want)
        assert (chain.lower <= q).all() and (q <= chain.upper).all() and steps <= 60
        gaps = all_clearances(arms, placed(arms, q)[3])
        missing = np.maximum(MARGIN + SLACK - gaps, 0.0).sum()
        assert short == pytest.approx(missing, abs=1e-10)
        assert cost == pytest.approx(0.5 * ((q - want) ** 2).sum(), abs=1e-12)
        if short <= 0.0:
            assert leftover(arms, q, q - want, chain.lower, chain.upper) < 1e-3
            blocked += gaps.min() < MARGIN + 2 * SLACK
    assert blocked > 1


def test_a_pose_that_may_stay_stays(arms):
    q = batch.project(arms.chain, arms.anchor, relaxed(arms, 8, 5), MARGIN + 1e-4).q
    for pose in q:
        found, cost, short, steps = solved(arms, pose)
        assert (found == pose).all() and cost == 0.0 and short == 0.0 and steps == 1


def test_a_skeleton_that_the_robot_can_have_is_reached_and_others_as_far_as_may_be(arms):
    chain, reached = arms.chain, 0
    for start, goal in zip(*pushed(arms, 12, 1), strict=True):
        x_ref = skeleton_and_jacobian(arms, goal)[0]
        q, cost, short, _ = solved(arms, start, x_ref, RIDGE)
        x, J = skeleton_and_jacobian(arms, q)
        want = 0.5 * ((x - x_ref) ** 2).sum() + 0.5 * RIDGE * ((q - start) ** 2).sum()
        assert cost == pytest.approx(want, abs=1e-12)
        if short <= 0.0:
            slope = J.T @ (x - x_ref) + RIDGE * (q - start)
            assert leftover(arms, q, slope, chain.lower, chain.upper) < 2e-3
            reached += cost < 0.1
    assert reached > 1


def test_without_collisions_and_limits_the_pose_is_free_of_both(arms):
    goal = np.array([-1.2, 0.2, 3.4, 0.3])  # an arm in the trunk, the other beyond a limit
    x_ref = skeleton_and_jacobian(arms, goal)[0]
    start = goal - [-0.2, 0.1, 0.2, 0.1]
    q, cost, short, _ = solved(arms, start, x_ref, 1e-6, collide=False)
    assert np.allclose(q, goal, atol=1e-3) and cost < 1e-6 and short == 0.0
    assert (q > arms.chain.upper).any() and slack(arms, q) < MARGIN
    held, *_ = solved(arms, start, x_ref, 1e-6)
    assert (held <= arms.chain.upper).all() and slack(arms, held) >= MARGIN


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_it_takes_no_more_steps_than_it_may_and_clips_before_the_first(arms, steps):
    want = np.array([9.0, -9.0, 1.2, 0.3])
    q, *_, done = solved(arms, want, steps=steps)
    assert done == steps
    if not steps:
        assert (q == np.clip(want, arms.chain.lower, arms.chain.upper)).all()
    free, *_ = solved(arms, want, collide=False, steps=steps)
    assert (free == want).all()


def test_a_box_is_never_left(arms):
    rng = np.random.default_rng(4)
    for want in relaxed(arms, 12, 7):
        middle = np.clip(want, arms.chain.lower, arms.chain.upper)
        low = np.maximum(middle - rng.uniform(0, 0.2, N), arms.chain.lower)
        high = np.minimum(middle + rng.uniform(0, 0.2, N), arms.chain.upper)
        q, *_ = solved(arms, want + 1.0, box=(low, high))
        assert (low <= q).all() and (q <= high).all()
        restored = middle.copy()
        there = restore_in(arms.chain, reach(arms.chain), low, high, MARGIN, restored)
        assert (low <= restored).all() and (restored <= high).all()
        assert there == (slack(arms, restored) >= MARGIN) or not there


def test_a_coarse_end_comes_sooner_and_is_hardly_another(arms):
    sooner = 0
    for start, goal in zip(*pushed(arms, 10, 2), strict=True):
        x_ref = skeleton_and_jacobian(arms, goal)[0]
        q, cost, short, steps = solved(arms, start, x_ref, RIDGE)
        rough, cost_rough, short_rough, fewer = solved(arms, start, x_ref, RIDGE, fine=0.05)
        assert fewer <= steps and cost_rough >= cost - 1e-6 or short > 0.0 or short_rough > 0.0
        sooner += fewer < steps
    assert sooner > 3


def test_minimise_is_minimise_within_the_limits(arms):
    chain = arms.chain
    for want in relaxed(arms, 6, 9):
        q, out = want.copy(), np.zeros(3)
        minimise(chain, reach(chain), False, FLAT, want, 0.0, MARGIN, True, 60, q, out)
        found, *rest = solved(arms, want)
        assert (found == q).all() and (out == rest).all()


def barely(made, n=10, seed=6):
    """Poses a little below the margin."""
    q = batch.project(made.chain, made.anchor, relaxed(made, 4 * n, seed), MARGIN).q
    q = q[[slack(made, pose) < MARGIN + 1e-4 for pose in q]]
    rng, out = np.random.default_rng(seed), []
    for pose in q:
        moved = np.clip(pose + rng.uniform(-0.01, 0.01, N), made.chain.lower, made.chain.upper)
        if slack(made, moved) < MARGIN - 1e-4:
            out.append(moved)
    return out[:n]


def test_a_pose_a_little_too_close_is_brought_to_the_margin_and_hardly_beyond(arms):
    poses = barely(arms)
    assert len(poses) > 4
    for pose in poses:
        q = pose.copy()
        assert restore(arms.chain, reach(arms.chain), MARGIN, q)
        assert MARGIN <= slack(arms, q) < MARGIN + 1e-4
        d, G = pair_distances(arms, pose, 0.02)
        least = max((MARGIN - d) / np.linalg.norm(G, axis=1))  # [rad], by the steepest way
        assert least * 0.9 < np.linalg.norm(q - pose) < 3.0 * least + 1e-4
        tight = pose.copy()  # in a box of no size there is no way
        assert not restore_in(arms.chain, reach(arms.chain), pose, pose, MARGIN, tight)
        assert (tight == pose).all()
    clear = arms.anchor.copy()
    assert restore(arms.chain, reach(arms.chain), MARGIN, clear)
    assert (clear == arms.anchor).all()


def test_clearance_is_the_least_of_all_and_nan_for_what_is_no_pose(arms):
    balls = reach(arms.chain)
    for pose in inside_limits(arms, 10, 8):
        assert clearance_of(arms.chain, balls, pose) == pytest.approx(slack(arms, pose), abs=1e-12)
    for joint in range(N):
        for bad in (np.nan, np.inf, -np.inf):
            pose = arms.anchor.copy()
            pose[joint] = bad
            assert np.isnan(clearance_of(arms.chain, balls, pose))


def slow_blend(made, q, rounds=400):
    """The authors' projection, literally."""
    chain, q = made.chain, q.copy()
    for _ in range(rounds):
        gaps = all_clearances(made, placed(made, q)[3])
        moved = np.zeros(N, bool)
        for a, b in chain.pair[gaps < MARGIN]:
            moved |= chain.moves[chain.body_frame[a]] | chain.moves[chain.body_frame[b]]
        if not moved.any():
            return q
        towards = np.clip(0.95 * q + 0.05 * made.anchor, chain.lower, chain.upper)
        q = np.where(moved, towards, q)
    return made.anchor


def test_blending_moves_the_joints_of_what_collides_a_twentieth_at_a_time(arms):
    moved = 0
    for pose in inside_limits(arms, 15, 11):
        q = pose.copy()
        assert blend(arms.chain, reach(arms.chain), arms.anchor, MARGIN, q)
        assert np.allclose(q, slow_blend(arms, pose), rtol=0, atol=1e-12)
        moved += (q != pose).any()
    assert moved > 3


def test_blending_ends_at_the_anchor_and_says_no_where_that_is_not_clear(arms):
    pose = np.array([1.5, 0.0, 1.2, 0.0])  # an arm in the trunk, and it is its own anchor
    q = pose.copy()
    assert not blend(arms.chain, reach(arms.chain), pose, MARGIN, q)
    assert (q == pose).all()
