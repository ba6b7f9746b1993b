"""Proj_Q: always feasible by coal, the identity where it may be, and near to the nearest pose."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import OneByOne, around, search
from worlds import (
    ARMS_YAML,
    MARGIN,
    coman,
    edited,
    inside_limits,
    pair_distances,
    relaxed,
    write_arms,
)

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.kernels.batch import FALLBACK, SAME, SOLVED
from s3le.kernels.distance import reach
from s3le.kernels.solver import blend, clearance_of, minimise, restore
from s3le.robot.robot import Robot
from s3le.tuples.certified import projection_counts

SAMPLES, ALPHA = 1500, 0.2
ROUNDING = 1e-9  # [rad]


def project(made, q):
    return batch.project(made.chain, made.anchor, q, made.margin)


def far(a, b):
    return np.linalg.norm(a - b, axis=1)  # [rad]


@functools.cache
def sampled():
    """Relaxed poses, their clipped poses, their projections, and which of them collided."""
    made = coman()
    q = relaxed(made, SAMPLES, 20, ALPHA)
    clipped = np.clip(q, made.lower, made.upper)
    return q, clipped, project(made, q), batch.clearances(made.chain, clipped) < made.margin


def blended(made, q):
    """The authors' projection: clip, then blend towards the anchor until nothing collides."""
    out = np.clip(q, made.lower, made.upper)
    balls = reach(made.chain)
    for row in out:
        assert blend(made.chain, balls, made.anchor, made.margin, row)
    return out


# --- laws


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
@pytest.mark.parametrize("alpha", [0.0, 0.2, 1.0, 4.0])
def test_every_projection_is_feasible_by_the_independent_check(name, alpha):
    made = coman(name=name)
    found = project(made, relaxed(made, 300, 21, alpha))
    made.certifier().require(found.q, made.margin)


@pytest.mark.parametrize("margin", [0.0, 0.005, 0.012], ids=lambda m: f"{m * 1e3:g} mm")
def test_another_margin_is_kept_too(margin):
    made = coman(margin)
    found = project(made, relaxed(made, 250, 22))
    report = made.certifier().require(found.q, margin)
    assert report.clearance.min() < margin + 1e-4  # [m], and the contact is used to the full
    assert (found.how == FALLBACK).mean() < 0.05


def test_blending_is_the_authors_rule_and_nothing_else():
    made = coman()
    q, _, nearest, collided = sampled()
    found = batch.project(made.chain, made.anchor, q, made.margin, kind="blend")
    assert found.q.tobytes() == blended(made, q).tobytes()
    assert ((found.how == FALLBACK) == collided).all()
    made.certifier().require(found.q, made.margin)
    moved, least = (far(p.q, q)[collided].mean() for p in (found, nearest))
    assert moved > 1.3 * least  # which is why it is not the default


def test_another_kind_of_projection_is_refused_by_name():
    made = coman()
    with pytest.raises(ParameterError, match="must be one of nearest, blend, got 'blended'"):
        batch.project(made.chain, made.anchor, relaxed(made, 2, 1), MARGIN, kind="blended")


def test_a_feasible_pose_comes_back_to_the_bit():
    made = coman()
    q = inside_limits(made, 400, 23)
    q = q[batch.clearances(made.chain, q) >= made.margin]
    found = project(made, q)
    assert np.array_equal(found.q, q) and len(q) > 100
    assert (found.how == SAME).all()


def test_projecting_twice_is_projecting_once_to_the_bit():
    made, (_, _, once, _) = coman(), sampled()
    twice = project(made, once.q)
    assert np.array_equal(twice.q, once.q)
    assert (twice.how == SAME).all()


def test_the_given_poses_are_left_as_they_were():
    q = relaxed(coman(), 20, 24)
    before = q.copy()
    project(coman(), q)
    assert np.array_equal(q, before)


def test_a_row_s_projection_does_not_depend_on_the_rows_around_it():
    q, _, found, _ = sampled()
    order = np.random.default_rng(25).permutation(len(q))
    shuffled = project(coman(), q[order])
    assert np.array_equal(shuffled.q, found.q[order])
    assert np.array_equal(shuffled.how, found.how[order])
    for row in (0, 700, 1499):
        assert np.array_equal(project(coman(), q[row : row + 1]).q[0], found.q[row])


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_projection_does_not_depend_on_the_number_of_threads(monkeypatch, threads):
    q, _, found, _ = sampled()
    monkeypatch.setattr(batch, "workers", lambda: threads)
    assert np.array_equal(project(coman(), q).q, found.q)


@pytest.mark.parametrize("chunk", [1, 7, 10_000])
def test_a_projection_does_not_depend_on_the_size_of_chunks(monkeypatch, chunk):
    q, _, found, _ = sampled()
    monkeypatch.setattr(batch, "CHUNK", chunk)
    again = project(coman(), q[:600])
    assert np.array_equal(again.q, found.q[:600])
    assert np.array_equal(again.how, found.how[:600])


def test_projecting_again_gives_the_same_bits():
    q, _, found, _ = sampled()
    again = project(coman(), q)
    assert again.q.tobytes() == found.q.tobytes() and again.how.tobytes() == found.how.tobytes()


def test_poses_one_at_a_time_are_projected_as_in_a_batch():
    q, _, found, _ = sampled()
    for row in range(300):
        alone = project(coman(), q[row : row + 1])
        assert np.array_equal(alone.q[0], found.q[row]) and alone.how[0] == found.how[row]


def test_nothing_to_project_is_nothing():
    found = project(coman(), np.empty((0, 11)))
    assert found.q.shape == (0, 11) and found.how.shape == (0,)


def test_progress_adds_up_to_the_rows():
    done = []
    made = coman()
    batch.project(made.chain, made.anchor, sampled()[0], made.margin, done.append)
    assert sum(done) == SAMPLES


def test_how_a_projection_came_about_is_told():
    q, clipped, found, collided = sampled()
    was_inside = (q == clipped).all(axis=1)
    assert np.array_equal(found.how == SAME, was_inside & ~collided)
    assert np.array_equal(found.q[~collided], clipped[~collided])
    counts = projection_counts(coman(), q, found)
    assert counts["feasible"] + counts["solved"] + counts["fallback"] == SAMPLES
    assert counts["collided"] == collided.sum()


# --- nearness


def test_the_fallback_is_rare():
    assert (sampled()[2].how == FALLBACK).mean() < 0.01


def test_no_projection_is_farther_than_blending_towards_the_anchor():
    made, (q, _, found, _) = coman(), sampled()
    assert (far(found.q, q) <= far(blended(made, q), q) + ROUNDING).all()


def test_the_joints_move_at_most_0_65_times_as_far_as_by_blending():
    made, (q, clipped, found, collided) = coman(), sampled()
    assert 0.4 < collided.mean() < 0.7
    ours, theirs = far(found.q, clipped)[collided], far(blended(made, q), clipped)[collided]
    assert np.median(ours / theirs) <= 0.65  # measured: 0.54


def test_no_small_feasible_step_leads_nearer():
    made, (q, _, found, collided) = coman(), sampled()
    rng = np.random.default_rng(26)
    for row in np.flatnonzero(collided)[:40]:
        here = found.q[row]
        way = rng.normal(size=(400, 11))
        way *= rng.uniform(1e-4, 0.1, (400, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        there = np.clip(here + way, made.lower, made.upper)
        there = there[batch.clearances(made.chain, there) >= made.margin]
        gain = np.linalg.norm(here - q[row]) - far(there, q[row])
        assert gain.max(initial=-1.0) < 1e-3  # [rad]


# --- against slow references of their own libraries


@functools.cache
def slowly():
    """The reference of COMAN, and the first rows that collide."""
    made = coman()
    return OneByOne(made, made.margin), np.flatnonzero(sampled()[3])[:40]


def test_the_reference_s_gradients_are_the_kernels():
    for pose in inside_limits(coman(), 20, 31):
        d, G = slowly()[0].gradients(pose, 0.1)
        ours, slopes = pair_distances(coman(), pose, 0.1)
        assert np.allclose(d, ours, rtol=0, atol=ROUNDING) and len(d) > 0
        assert np.allclose(G, slopes, rtol=0, atol=1e-6)  # [m/rad]


def test_blending_is_that_of_the_reference():
    slow, rows = slowly()
    q = sampled()[0][rows]
    theirs = np.array([slow.blend(pose).q for pose in q])
    assert np.allclose(blended(coman(), q), theirs, rtol=0, atol=ROUNDING)


def test_the_joints_move_no_farther_than_by_one_sqp_at_a_time():
    slow, rows = slowly()
    q, _, found, _ = sampled()
    ratios = []
    for row in rows:
        starts = (q[row], slow.blend(q[row]).q)
        reached = [slow.nearest(q[row], start) for start in starts]
        theirs = min(np.linalg.norm(one.q - q[row]) for one in reached if one.solved)
        ratios.append(np.linalg.norm(found.q[row] - q[row]) / theirs)
    assert np.median(ratios) <= 1.02  # measured: 1.000
    assert np.mean(ratios) <= 1.02  # measured: 1.000


def test_what_the_reference_calls_solved_is_certified():
    slow, rows = slowly()
    reached = [slow.nearest(pose, pose) for pose in sampled()[0][rows]]
    solved = np.array([one.q for one in reached if one.solved])
    assert len(solved) > 30
    coman().certifier().require(solved, MARGIN)


def test_the_median_projection_is_the_best_pose_that_many_starts_find():
    made, (q, _, found, collided) = coman(), sampled()
    low, high = made.lower, made.upper
    rng = np.random.default_rng(32)
    pool = inside_limits(made, 400, 33)
    pool = pool[batch.clearances(made.chain, pool) >= MARGIN]
    ratios = []
    for row in np.flatnonzero(collided)[:20]:
        starts = pool[rng.choice(len(pool), 40, replace=False)]
        starts = np.concatenate([starts, around(found.q[row], 20, low, high, rng)])
        best = search(made.chain, q[row], starts, MARGIN, found.q[row])
        made.certifier().require(best[None], MARGIN)
        ratios.append(np.linalg.norm(found.q[row] - q[row]) / np.linalg.norm(best - q[row]))
    assert np.median(ratios) <= 1.001  # measured: 1.000
    assert np.max(ratios) <= 1.2  # measured: 1.000


def test_a_search_over_the_whole_space_finds_poses_hardly_nearer():
    made, (q, _, found, collided) = coman(), sampled()
    balls, out, none = reach(made.chain), np.empty(3), np.empty(0)
    starts = project(made, inside_limits(made, 120, 27)).q
    rng = np.random.default_rng(28)
    ratios = []
    for row in np.flatnonzero(collided)[:60]:
        ours = best = np.linalg.norm(found.q[row] - q[row])
        for start in starts[rng.choice(len(starts), 40, replace=False)]:
            trial = start.copy()
            minimise(made.chain, balls, False, none, q[row], 0.0, MARGIN, True, 60, trial, out)
            if clearance_of(made.chain, balls, trial) >= MARGIN or restore(
                made.chain, balls, MARGIN, trial
            ):
                best = min(best, np.linalg.norm(trial - q[row]))
        ratios.append(ours / best)
    assert np.median(ratios) <= 1.1  # measured: 1.000, on 300 samples 1.000
    assert np.quantile(ratios, 0.95) <= 1.2  # measured: 1.000, on 300 samples 1.000


# --- nasty inputs

NASTY = {
    "zero (hands in the thighs)": lambda low, high, anchor: 0.0 * low,
    "the anchor": lambda low, high, anchor: anchor,
    "on every lower limit": lambda low, high, anchor: low,
    "on every upper limit": lambda low, high, anchor: high,
    "just past every limit": lambda low, high, anchor: np.nextafter(high, np.inf),
    "far outside": lambda low, high, anchor: 100.0 * high - 50.0 * low,
    "a million radians": lambda low, high, anchor: np.full(len(low), 1e6),
    "minus a million": lambda low, high, anchor: np.full(len(low), -1e6),
    "next to overflow": lambda low, high, anchor: np.full(len(low), 1e300),
    "tiny": lambda low, high, anchor: np.full(len(low), 1e-310),
    "one joint wild": lambda low, high, anchor: np.where(np.arange(len(low)) == 3, 1e9, anchor),
}  # fmt: skip


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
@pytest.mark.parametrize("make", NASTY.values(), ids=NASTY)
def test_nasty_poses_are_projected_to_feasible_ones(name, make):
    made = coman(name=name)
    robot = made
    q = make(robot.lower, robot.upper, robot.anchor)[None]
    found = project(made, q)
    made.certifier().require(found.q, made.margin)
    assert np.array_equal(project(made, found.q).q, found.q)


ANGLES = st.floats(allow_nan=False, allow_infinity=False)


@settings(deadline=None, max_examples=60)
@given(q=st.lists(ANGLES | st.floats(-4, 4), min_size=11, max_size=11))
def test_any_finite_pose_is_projected_to_a_feasible_one_that_stays(q):
    made = coman()
    found = project(made, np.array([q]))
    made.certifier().require(found.q, made.margin)
    assert np.array_equal(project(made, found.q).q, found.q)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**31), alpha=st.floats(0, 8), margin=st.sampled_from([0.0, MARGIN, 0.012]),
    name=st.sampled_from(["coman", "coman_authors"]),
)  # fmt: skip
def test_a_projection_keeps_any_margin_and_leaves_a_pose_that_only_needs_clipping(
    seed, alpha, margin, name
):
    made = coman(margin, name)
    q = relaxed(made, 5, seed, alpha)
    found = project(made, q)
    made.certifier().require(found.q, margin)
    assert ((made.lower <= found.q) & (found.q <= made.upper)).all()
    clipped = np.clip(q, made.lower, made.upper)
    free = batch.clearances(made.chain, clipped) >= margin
    assert np.array_equal(found.q[free], clipped[free])  # to the bit


def test_the_anchor_stays_where_it_is():
    made = coman()
    found = project(made, made.anchor[None])
    assert np.array_equal(found.q[0], made.anchor) and found.how[0] == SAME


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf], ids=str)
def test_a_pose_that_is_not_finite_is_refused_by_row(bad):
    q = relaxed(coman(), 5, 29)
    q[3, 7] = bad
    with pytest.raises(ParameterError) as refusal:
        project(coman(), q)
    assert str(refusal.value) == "poses to project must be finite, row 3 is not"


def test_poses_of_another_robot_are_refused():
    with pytest.raises(ParameterError) as refusal:
        project(coman(), np.zeros((2, 7)))
    assert str(refusal.value) == "poses must have shape (n, 11), got (2, 7)"


@pytest.mark.parametrize("upright", ["[0.0, 0.0, 0.0]", "[0.4, -1.1, 2.3]"], ids=["up", "tilted"])
def test_another_robot_is_projected_as_well(tmp_path, upright):
    file = write_arms(tmp_path, edited(ARMS_YAML, ("[0.0, 0.0, 0.0]", upright)))
    made = Robot.from_file(file, MARGIN, "midpoint")
    q = relaxed(made, 400, 30, 0.5)
    found = project(made, q)
    made.certifier().require(found.q, MARGIN)
    assert (far(found.q, q) <= far(blended(made, q), q) + ROUNDING).all()
    assert (found.how == SOLVED).any()


def test_a_single_joint_is_clipped_to_its_limit_and_the_others_stay():
    made = coman()
    q = made.anchor[None].copy()
    joint = made.joint_names.index("WaistYaw")
    q[0, joint] = 2.0
    found = project(made, q)
    want = made.anchor.copy()
    want[joint] = made.upper[joint]
    assert np.array_equal(found.q[0], want) and found.how[0] == SOLVED
