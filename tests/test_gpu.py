"""The torch kernels against the compiled ones: one specification, two kernels."""

import functools

import numpy as np
import pytest
import torch
from worlds import (
    ARMS_YAML,
    MARGIN,
    SEGMENT_PAIRS,
    coman,
    edited,
    exact_distance,
    inside_limits,
    pair_distances,
    relaxed,
    segments,
    skeleton_and_jacobian,
    write_arms,
)

from s3le import machine
from s3le.errors import ParameterError
from s3le.gpu import batch as gpu
from s3le.gpu import distance, kinematics
from s3le.gpu.chain import put
from s3le.gpu.start import blend, nearest_rows
from s3le.kernels import batch, solver
from s3le.kernels.batch import FALLBACK, SAME, SOLVED
from s3le.kernels.distance import nearest_on_segments, reach, separation

AGREE = 1e-9  # [m] or [-], torch against numba, both float64
CHUNKS = 1e-6  # [rad], between chunk sizes; see s3le.gpu.batch
ROBOTS = ["coman", "coman_authors", "tilted arms"]
EVERYTHING = 100.0  # [m], a band that leaves nothing out


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(params=ROBOTS)
def made(request, tmp_path):
    return tilted_arms(tmp_path) if request.param == "tilted arms" else coman(name=request.param)


def tilted_arms(folder):
    tilt = edited(ARMS_YAML, ("[0.0, 0.0, 0.0]", "[0.4, -1.1, 2.3]"))
    return machine.make(write_arms(folder, tilt), MARGIN, "midpoint")


def rows_last(q):
    return torch.tensor(q).T.contiguous()


def project(made, q, **how):
    return gpu.project(made.chain, made.robot.anchor, q, made.margin, "cpu", **how)


def far(a, b):
    return np.linalg.norm(a - b, axis=1)  # [rad]


def same(a, b):
    """Rows that differ by no more than rounding carried on by the iterations."""
    return (np.abs(a - b) <= CHUNKS).all(axis=1)


# --- kinematics


def test_skeletons_agree(made):
    q = np.concatenate([relaxed(made, 200, 1), 30.0 * relaxed(made, 20, 2)])
    ours = gpu.skeletons(made.chain, q, "cpu")
    assert np.allclose(ours, batch.skeletons(made.chain, q), rtol=0, atol=AGREE)


@pytest.mark.parametrize("neck", ["midpoint", "joint"])
def test_jacobians_agree(neck):
    made = coman(neck=neck)
    q = relaxed(made, 30, 3)
    solid = put(made.chain, "cpu")
    x, J = kinematics.bones_and_jacobian(solid, *kinematics.place(solid, rows_last(q)))
    for row, pose in enumerate(q):
        want_x, want_J = skeleton_and_jacobian(made, pose)
        assert np.allclose(x[:, row], want_x, rtol=0, atol=AGREE)
        assert np.allclose(J[:, :, row], want_J, rtol=0, atol=AGREE)


def test_jacobians_agree_on_a_tilted_base(tmp_path):
    made = tilted_arms(tmp_path)
    q = relaxed(made, 20, 4)
    solid = put(made.chain, "cpu")
    _, J = kinematics.bones_and_jacobian(solid, *kinematics.place(solid, rows_last(q)))
    for row, pose in enumerate(q):
        assert np.allclose(J[:, :, row], skeleton_and_jacobian(made, pose)[1], rtol=0, atol=AGREE)


# --- distances


def test_clearances_agree(made):
    q = np.concatenate([inside_limits(made, 300, 5), relaxed(made, 60, 6, alpha=2.0)])
    ours = gpu.clearances(made.chain, q, "cpu")
    assert np.allclose(ours, batch.clearances(made.chain, q), rtol=0, atol=AGREE)
    assert (ours < MARGIN).any() and (ours > MARGIN).any()


def test_every_pair_s_distance_and_gradient_agree(made):
    q = np.concatenate([inside_limits(made, 20, 7), [made.robot.anchor, 0.0 * made.robot.anchor]])
    solid = put(made.chain, "cpu")
    apart = distance.measure(solid, rows_last(q))
    every = torch.arange(len(made.chain.pair))[:, None].expand(-1, len(q))
    G = distance.gradients(solid, apart, every)
    for row, pose in enumerate(q):
        want_d, want_G = pair_distances(made, pose, EVERYTHING)
        assert np.allclose(apart.distance[:, row], want_d, rtol=0, atol=AGREE)
        assert np.allclose(G[row], want_G, rtol=0, atol=AGREE)


def test_a_program_is_told_of_the_nearest_pairs_and_of_no_far_one():
    made, band, goal = coman(), 0.1, 0.002
    q = inside_limits(made, 20, 8)
    gap, G, short = nearest_rows(put(made.chain, "cpu"), rows_last(q), goal, band, 32)
    for row, pose in enumerate(q):
        d, slopes = pair_distances(made, pose, band)
        order = np.argsort(d, kind="stable")[:32]
        told = gap[row] > -1.0
        assert told.sum() == len(order)
        assert np.allclose(goal - gap[row][told], d[order], rtol=0, atol=AGREE)
        assert np.allclose(G[row][told], slopes[order], rtol=0, atol=AGREE)
        assert (G[row][~told] == 0.0).all()
        assert short[row] == pytest.approx(np.maximum(goal - d, 0.0).sum(), abs=AGREE)


def stacked(kind):
    """Random segment pairs of one kind: (3, 1, rows) first ends and directions, and the pairs."""
    rng = np.random.default_rng(SEGMENT_PAIRS.index(kind))
    pairs = [segments(kind, rng)[:2] for _ in range(200)]
    A, B = (torch.tensor(np.array([pair[i] for pair in pairs])) for i in range(2))
    ends = (A[:, 0], A[:, 1] - A[:, 0], B[:, 0], B[:, 1] - B[:, 0])
    return [v.T[:, None].contiguous() for v in ends], pairs


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_distances_of_segments_agree_and_are_exact(kind):
    ends, pairs = stacked(kind)
    ours = distance.nearest_on_segments(*ends)[0][0]
    witness = np.empty((2, 3))
    for got, (A, B) in zip(ours.tolist(), pairs, strict=True):
        assert got == pytest.approx(nearest_on_segments(A, B, witness), abs=AGREE)
        assert got == pytest.approx(exact_distance(A, B), abs=1e-12)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_witness_points_and_normals_of_segments_agree(kind):
    ends, pairs = stacked(kind)
    _, s, t = distance.nearest_on_segments(*ends)
    at_a, at_b, normal = (v[:, 0].T.numpy() for v in distance.separation(*ends, s, t))
    witness, want = np.empty((2, 3)), np.empty(3)
    for row, (A, B) in enumerate(pairs):
        gap = separation(A, B, witness, want)
        assert np.linalg.norm(normal[row]) == pytest.approx(1.0, abs=AGREE)
        if gap > 1e-6 and kind not in ("parallel", "nearly parallel", "collinear"):
            # Parallel segments have many nearest points, and any two of them will do.
            assert np.allclose(at_a[row], witness[0], rtol=0, atol=1e-8)
            assert np.allclose(normal[row], want, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("A", "B"),
    [
        ([(0, 0, 0), (0, 0, 0)], [(0, 0, 0), (0, 0, 0)]),
        ([(0, 0, 0), (1, 0, 0)], [(0.5, 0, 0), (0.5, 0, 0)]),
        ([(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (1, 0, 0)]),
        ([(0, 0, 0), (1, 0, 0)], [(0.2, 0, 0), (0.8, 0, 0)]),
        ([(-1, 0, 0), (1, 0, 0)], [(0, -1, 0), (0, 1, 0)]),
    ],
    ids=["one point", "point in a segment", "same segment", "one within another", "crossing"],
)
def test_segments_that_meet_have_the_same_way_out(A, B):
    A, B = np.array(A, float), np.array(B, float)
    ends = [torch.tensor(v)[:, None, None] for v in (A[0], A[1] - A[0], B[0], B[1] - B[0])]
    gap, s, t = distance.nearest_on_segments(*ends)
    witness, want = np.empty((2, 3)), np.empty(3)
    assert gap.item() == separation(A, B, witness, want) == 0.0
    assert np.allclose(distance.separation(*ends, s, t)[2][:, 0, 0], want, rtol=0, atol=AGREE)


# --- projection


@functools.cache
def sampled(name="coman", n=330):
    made = coman(name=name)
    q = relaxed(made, n, 20)
    clipped = np.clip(q, made.robot.lower, made.robot.upper)
    hit = batch.clearances(made.chain, clipped) < made.margin
    return q, hit, project(made, q), batch.project(made.chain, made.robot.anchor, q, made.margin)


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_projections_are_feasible_by_the_independent_check(name):
    made = coman(name=name)
    made.certifier().require(sampled(name)[2].q, made.margin)


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_projections_are_as_near_as_the_compiled_kernel_s(name):
    q, hit, ours, theirs = sampled(name)
    ratio = far(ours.q, q)[hit] / far(theirs.q, q)[hit]
    assert len(ratio) > 150
    assert np.median(ratio) <= 1.001  # measured: 1.000000
    assert np.quantile(ratio, 0.95) <= 1.001  # measured: 1.0000
    assert (np.abs(ratio - 1.0) < 1e-6).mean() > 0.95  # measured: 0.99
    assert np.array_equal(ours.how == SAME, theirs.how == SAME)
    assert (ours.how == FALLBACK).mean() < 0.01  # measured: 0


def test_relaxed_limits_far_out_and_another_margin_are_projected_too():
    made = coman(0.012)
    q = relaxed(made, 60, 22, alpha=4.0)
    found = project(made, q)
    made.certifier().require(found.q, 0.012)
    assert (found.how == FALLBACK).mean() < 0.05


def test_a_robot_on_a_tilted_base_is_projected(tmp_path):
    made = tilted_arms(tmp_path)
    q = relaxed(made, 200, 30, 0.5)
    found = project(made, q)
    made.certifier().require(found.q, MARGIN)
    theirs = batch.project(made.chain, made.robot.anchor, q, MARGIN)
    assert (found.how == SOLVED).any()
    assert far(found.q, q).mean() <= 1.001 * far(theirs.q, q).mean()


def test_blending_is_the_same_rule_as_on_the_processors():
    made = coman()
    q = relaxed(made, 200, 31, 0.5)
    found = project(made, q, kind="blend")
    theirs = batch.project(made.chain, made.robot.anchor, q, MARGIN, kind="blend")
    np.testing.assert_allclose(found.q, theirs.q, atol=1e-12)
    assert (found.how == theirs.how).all() and (found.how == FALLBACK).any()
    with pytest.raises(ParameterError, match="must be one of nearest, blend"):
        project(made, q, kind="blended")


def test_a_feasible_pose_comes_back_to_the_bit():
    made = coman()
    q = inside_limits(made, 400, 23)
    q = q[batch.clearances(made.chain, q) >= made.margin]
    found = project(made, q)
    assert np.array_equal(found.q, q) and len(q) > 100
    assert (found.how == SAME).all()


def test_a_zero_keeps_its_sign():
    made = coman()
    q = made.robot.anchor[None].copy()
    q[q == 0.0] = -0.0
    assert project(made, q).q.tobytes() == q.tobytes()


def test_projecting_twice_is_projecting_once_to_the_bit():
    once = sampled()[2]
    twice = project(coman(), once.q)
    assert np.array_equal(twice.q, once.q) and (twice.how == SAME).all()


def test_the_same_call_gives_the_same_bits():
    q = sampled()[0][:150]
    once, again = project(coman(), q), project(coman(), q)
    assert np.array_equal(once.q, again.q) and np.array_equal(once.how, again.how)


def test_the_rows_around_a_row_and_the_chunk_change_no_more_than_rounding():
    q, _, found, _ = sampled()
    order = np.random.default_rng(25).permutation(150)
    other = project(coman(), q[order], rows=64)
    assert same(other.q, found.q[order]).mean() >= 0.98  # measured: all
    assert np.array_equal(other.how, found.how[order])


def test_blending_agrees():
    made = coman()
    q = np.clip(relaxed(made, 100, 26), made.robot.lower, made.robot.upper)
    solid, anchor = put(made.chain, "cpu"), torch.tensor(made.robot.anchor)[:, None]
    ours, safe = blend(solid, anchor, MARGIN, rows_last(q))
    assert safe.all()
    for row, pose in enumerate(q):
        assert solver.blend(made.chain, reach(made.chain), made.robot.anchor, MARGIN, pose)
        assert np.allclose(ours[:, row], pose, rtol=0, atol=AGREE)


def test_an_anchor_that_collides_leaves_no_fallback_but_the_solver():
    made = coman()
    zero = np.zeros((1, 11))  # arms down: the hands are in the thighs
    solid = put(made.chain, "cpu")
    _, safe = blend(solid, torch.zeros(11, 1, dtype=torch.float64), MARGIN, rows_last(zero))
    assert not safe.any()


NASTY = {
    "zero": lambda low, high: 0.0 * low,
    "on every lower limit": lambda low, high: low,
    "on every upper limit": lambda low, high: high,
    "just past every limit": lambda low, high: np.nextafter(high, np.inf),
    "far outside": lambda low, high: 100.0 * high - 50.0 * low,
    "a million radians": lambda low, high: np.full(len(low), 1e6),
    "minus a million": lambda low, high: np.full(len(low), -1e6),
    "next to overflow": lambda low, high: np.full(len(low), 1e300),
    "tiny": lambda low, high: np.full(len(low), 1e-310),
}


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_nasty_poses_are_projected_and_harm_no_other_row(name):
    made = coman(name=name)
    nasty = np.array([make(made.robot.lower, made.robot.upper) for make in NASTY.values()])
    plain = sampled(name)[0][:40]
    found = project(made, np.concatenate([nasty, plain]))
    made.certifier().require(found.q, made.margin)
    assert same(found.q[len(nasty) :], sampled(name)[2].q[:40]).mean() >= 0.95  # measured: all
    theirs = batch.project(made.chain, made.robot.anchor, nasty[:-2], made.margin).q
    ours = found.q[: len(theirs)]
    assert (far(ours, nasty[:-2]) <= 1.001 * far(theirs, nasty[:-2])).all()


# --- the door


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf], ids=str)
def test_a_pose_that_is_not_finite_has_no_clearance_and_no_projection(bad):
    made = coman()
    q = np.tile(made.robot.anchor, (5, 1))
    q[3, 7] = bad
    assert np.isnan(gpu.clearances(made.chain, q, "cpu")).tolist() == [False] * 3 + [True, False]
    with pytest.raises(ParameterError) as refusal:
        project(made, q)
    assert str(refusal.value) == "poses to project must be finite, row 3 is not"


@pytest.mark.parametrize("shape", [(11,), (3, 10), (2, 3, 11)], ids=str)
def test_poses_of_another_robot_are_refused(shape):
    made = coman()
    for ask in (gpu.skeletons, gpu.clearances):
        with pytest.raises(ParameterError) as refusal:
            ask(made.chain, np.zeros(shape), "cpu")
        assert str(refusal.value) == f"poses must have shape (n, 11), got {shape}"
    with pytest.raises(ParameterError, match="poses must have shape"):
        project(made, np.zeros(shape))
    with pytest.raises(ParameterError, match=r"the anchor must have shape \(11,\), got \(10,\)"):
        gpu.project(made.chain, np.zeros(10), np.zeros((1, 11)), MARGIN, "cpu")


@pytest.mark.parametrize("device", ["gpu", "mps", "", "cuda:x"])
def test_a_device_of_another_kind_is_refused(device):
    with pytest.raises(ParameterError, match="device must be cpu or cuda"):
        gpu.skeletons(coman().chain, np.zeros((1, 11)), device)


@pytest.mark.parametrize("device", ["cuda", "cuda:1"])
def test_a_gpu_that_torch_does_not_see_is_refused(monkeypatch, device):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ParameterError, match="sees 0 CUDA devices; use device 'cpu'"):
        gpu.skeletons(coman().chain, np.zeros((1, 11)), device)


def test_a_chunk_without_rows_is_refused():
    with pytest.raises(ParameterError, match="at least one row, got 0"):
        project(coman(), np.zeros((1, 11)), rows=0)


def test_nothing_asked_is_nothing_answered():
    made, none = coman(), np.empty((0, 11))
    assert gpu.skeletons(made.chain, none, "cpu").shape == (0, 21)
    assert gpu.clearances(made.chain, none, "cpu").shape == (0,)
    found = project(made, none)
    assert found.q.shape == (0, 11) and found.how.shape == (0,)


def test_the_given_poses_are_left_as_they_were_and_may_be_read_only():
    q = sampled()[0][:20].copy()
    q.setflags(write=False)
    before = q.copy()
    project(coman(), q)
    assert np.array_equal(q, before)


def test_progress_adds_up_to_the_rows():
    done, made = [], coman()
    gpu.clearances(made.chain, inside_limits(made, 130, 27), "cpu", done.append, rows=50)
    assert done == [50, 50, 30]
