"""Capsule distances against coal and slow geometry, their gradients, and the certificate."""

import re

import numpy as np
import pytest
from worlds import (
    ARMS_URDF,
    MARGIN,
    SEGMENT_PAIRS,
    all_clearances,
    coal_distance,
    coman,
    edited,
    exact_distance,
    inside_limits,
    pair_distances,
    placed,
    relaxed,
    segments,
    write_arms,
)

from s3le import machine
from s3le.certified import certificate
from s3le.errors import CertificateError
from s3le.kernels import batch
from s3le.kernels.distance import nearest_on_segments, separation

GEOMETRY = 1e-9  # [m], kernel against coal
ALGEBRA = 1e-12  # [m], kernel against exact geometry
DIFFERENCE = 1e-6  # [m/rad], central differences
# coal takes segments for parallel long before they are, and short ones for points [m]
COAL_ITSELF = {"nearly parallel": 2e-6, "tiny": 2e-7}
PAIRS = 150  # random pairs of each kind


def pairs_of(kind: str):
    rng = np.random.default_rng(SEGMENT_PAIRS.index(kind))
    return [segments(kind, rng) for _ in range(PAIRS)]


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_kernel_s_distance_is_exact(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind):
        want = exact_distance(A, B)
        assert nearest_on_segments(A, B, witness) == pytest.approx(want, abs=ALGEBRA)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_kernel_s_clearance_is_coal_s(kind):
    witness = np.empty((2, 3))
    for A, B, r1, r2 in pairs_of(kind):
        ours = nearest_on_segments(A, B, witness) - r1 - r2
        theirs = coal_distance(A, B, r1, r2)
        assert ours == pytest.approx(theirs, abs=COAL_ITSELF.get(kind, GEOMETRY))
        assert ours <= theirs + GEOMETRY  # where the two differ, coal is the one that sees too much


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_distance_does_not_depend_on_which_segment_or_which_end_is_first(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind)[:40]:
        want = nearest_on_segments(A, B, witness)
        for first, second in ((B, A), (A[::-1].copy(), B), (A, B[::-1].copy())):
            assert nearest_on_segments(first, second, witness) == pytest.approx(want, abs=ALGEBRA)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_witness_points_lie_on_their_segments_and_are_that_far_apart(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind):
        gap = nearest_on_segments(A, B, witness)
        assert np.linalg.norm(witness[1] - witness[0]) == pytest.approx(gap, abs=ALGEBRA)
        for point, segment in zip(witness, (A, B), strict=True):
            on = exact_distance(np.array([point, point]), segment)
            assert on == pytest.approx(0.0, abs=ALGEBRA)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_normal_is_a_direction_from_the_first_to_the_second_even_where_they_meet(kind):
    witness, normal = np.empty((2, 3)), np.empty(3)
    for A, B, _, _ in pairs_of(kind):
        gap = separation(A, B, witness, normal)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ALGEBRA)
        if gap > 1e-6:
            assert normal * gap == pytest.approx(witness[1] - witness[0], abs=ALGEBRA)


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
def test_bodies_that_share_points_are_at_distance_zero_with_a_way_out(A, B):
    witness, normal = np.empty((2, 3)), np.empty(3)
    assert separation(np.array(A, float), np.array(B, float), witness, normal) == 0.0
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ALGEBRA)


# --- the whole robot


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_clearance_of_coman_is_coal_s(name):
    made = coman(name=name)
    q = np.concatenate([inside_limits(made, 250, 1), relaxed(made, 50, 2, alpha=2.0)])
    ours, theirs = batch.clearances(made.chain, q), made.certifier().check(q)
    assert np.allclose(ours, theirs.clearance, rtol=0, atol=GEOMETRY)
    assert (ours < 0).any() and (ours > MARGIN).any()


SHAPES = {
    "capsules": (),
    "spheres": (('<capsule radius="0.04" length="0.2"/>', '<sphere radius="0.11"/>'),
                ('<capsule radius="0.03" length="0.15"/>', '<sphere radius="0.09"/>')),
    "boxes": (('<capsule radius="0.04" length="0.2"/>', '<box size="0.06 0.25 0.05"/>'),
              ('<capsule radius="0.03" length="0.15"/>', '<box size="0.06 0.06 0.06"/>')),
    "cylinders": (('<capsule radius="0.04" length="0.2"/>',
                   '<cylinder radius="0.04" length="0.2"/>'),
                  ('<capsule radius="0.03" length="0.15"/>',
                   '<cylinder radius="0.08" length="0.02"/>')),
    "a capsule across": (('xyz="0 0 -0.15"', 'xyz="0 0 -0.15" rpy="3.141592653589793 0 0"'),),
}  # fmt: skip


@pytest.mark.parametrize("shapes", SHAPES.values(), ids=SHAPES)
def test_clearance_of_other_shapes_is_coal_s_on_the_capsules_that_contain_them(tmp_path, shapes):
    made = machine.make(write_arms(tmp_path, urdf=edited(ARMS_URDF, *shapes)), MARGIN, "midpoint")
    q = inside_limits(made, 200, 3)
    theirs = made.certifier().check(q)
    assert np.allclose(batch.clearances(made.chain, q), theirs.clearance, rtol=0, atol=GEOMETRY)


def test_skipping_far_pairs_never_changes_the_least_distance():
    made = coman()
    q = inside_limits(made, 25, 4)
    for pose, fast in zip(q, batch.clearances(made.chain, q), strict=True):
        assert fast == pytest.approx(all_clearances(made, placed(made, pose)[3]).min(), abs=ALGEBRA)


@pytest.mark.parametrize("band", [0.02, 0.1, 10.0], ids=["2 cm", "10 cm", "all"])
def test_the_solver_sees_every_pair_within_its_band_and_no_other(band):
    made = coman()
    for pose in inside_limits(made, 8, 5):
        want = all_clearances(made, placed(made, pose)[3])
        found, _ = pair_distances(made, pose, band)
        assert np.allclose(found, want[want < band], rtol=0, atol=ALGEBRA)


def test_gradients_are_the_slopes_of_the_distances_away_from_kinks():
    made = coman()
    step, everything = 1e-5, 100.0  # [rad], [m]
    radii = made.chain.body_radius[made.watched].sum(axis=1)
    compared = total = 0
    for pose in inside_limits(made, 10, 6):
        d, G = pair_distances(made, pose, everything)
        for joint in range(made.robot.n_dof):
            shift = step * np.eye(made.robot.n_dof)[joint]
            ahead, _ = pair_distances(made, pose + shift, everything)
            back, _ = pair_distances(made, pose - shift, everything)
            # A kink or a meeting of segments shows as a second difference; there is no slope.
            smooth = (np.abs(ahead + back - 2 * d) < 1e-8) & (d + radii > 1e-3)
            slope = (ahead - back) / (2 * step)
            assert np.allclose(G[smooth, joint], slope[smooth], rtol=0, atol=DIFFERENCE)
            compared, total = compared + smooth.sum(), total + len(smooth)
    assert compared > 0.97 * total


def test_a_joint_that_carries_both_bodies_does_not_enter_their_gradient():
    made = coman()
    waist = [made.robot.joint_names.index(f"Waist{way}") for way in ("Lat", "Sag", "Yaw")]
    kinds = [p.kind for p in made.pairs if p.reason == "watched"]
    arms = np.array([kind in ("limb-limb", "within a limb") for kind in kinds])
    d, G = pair_distances(made, inside_limits(made, 1, 7)[0], 100.0)
    assert len(d) == len(arms)
    assert (G[np.ix_(arms, waist)] == 0.0).all()
    assert (np.abs(G[np.ix_(~arms, waist)]).max(axis=1) > 0.0).any()


# --- the certificate


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf], ids=str)
def test_a_pose_that_is_not_finite_has_no_clearance_and_no_certificate(bad):
    made = coman()
    q = np.tile(made.robot.anchor, (3, 1))
    q[1, 4] = bad
    clearance = batch.clearances(made.chain, q)
    assert np.isnan(clearance).tolist() == [False, True, False]
    assert not clearance[1] >= made.margin
    report = made.certifier().check(q)
    assert np.isnan(report.clearance).tolist() == [False, True, False]
    assert np.isnan(report.limit_margin[1]) and report.pair[1] == -1
    with pytest.raises(CertificateError) as refusal:
        certificate(made, q)
    assert str(refusal.value) == "1 of 3 poses are not feasible; row 1 is not finite"


def test_a_pose_outside_its_limits_is_refused_by_joint_and_passes_within():
    made = coman()
    joint = made.robot.joint_names.index("LElbj")
    q = made.robot.anchor[None].copy()
    q[0, joint] = made.robot.upper[joint]
    assert certificate(made, q)["limit_margin"] == pytest.approx(0.0, abs=0.0)
    q[0, joint] = np.nextafter(made.robot.upper[joint], 1.0)
    with pytest.raises(CertificateError) as refusal:
        certificate(made, q)
    assert str(refusal.value) == (
        "1 of 1 poses are not feasible; row 0: LElbj at 0.000000 rad is outside [-2.3562, 0.0000]"
    )


def test_a_colliding_pose_is_refused_by_pair_and_passes_without_the_guard():
    made = coman()
    q = np.zeros((2, 11))  # arms down: the hands are in the thighs
    with pytest.raises(CertificateError) as refusal:
        certificate(made, q)
    assert re.fullmatch(
        r"2 of 2 poses are not feasible; row 0: \w+ and \w+ are -\d+\.\d{4} mm apart, "
        r"wanted at least 2\.0000 mm",
        str(refusal.value),
    )
    made.certifier().require(q, -1.0)  # [m], a guard that lets everything through


def test_the_named_pair_is_the_closest_one():
    made = coman()
    q = inside_limits(made, 20, 8)
    report = made.certifier().check(q)
    for pose, pair in zip(q, report.pair, strict=True):
        assert all_clearances(made, placed(made, pose)[3]).argmin() == pair


def test_progress_of_a_check_adds_up_to_its_rows():
    made, done = coman(), []
    made.certifier().check(np.tile(made.robot.anchor, (1203, 1)), done.append)
    assert sum(done) == 1203
