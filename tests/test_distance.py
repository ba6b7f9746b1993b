"""Capsule distances against coal and slow geometry, their gradients, and the certificate."""

import re
from dataclasses import replace

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

from s3le.errors import CertificateError
from s3le.kernels import batch
from s3le.kernels.distance import nearest_on_segments, separation
from s3le.robot import certificate as certifier
from s3le.robot import chain
from s3le.robot.certificate import PER_METRE, Certifier
from s3le.robot.pairs import KEPT
from s3le.robot.robot import Robot
from s3le.tuples.certified import certificate

GEOMETRY = 1e-9  # [m], kernel against coal
ALGEBRA = 1e-12  # [m], kernel against exact geometry
DIFFERENCE = 1e-6  # [m/rad], central differences
AGREEMENT = 1e-7  # [m], on any capsules at all; what is promised is 1e-6
PAIRS = 150  # random pairs of each kind


def pairs_of(kind: str):
    rng = np.random.default_rng(SEGMENT_PAIRS.index(kind))
    return [segments(kind, rng) for _ in range(PAIRS)]


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_kernel_s_distance_is_exact(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind):
        want = exact_distance(A, B)
        assert nearest_on_segments(np.stack([A, B]), 0, 1, witness) == pytest.approx(
            want, abs=ALGEBRA
        )


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_kernel_s_clearance_is_coal_s(kind):
    witness = np.empty((2, 3))
    for A, B, r1, r2 in pairs_of(kind):
        ours = nearest_on_segments(np.stack([A, B]), 0, 1, witness) - r1 - r2
        unit = PER_METRE  # in metres coal itself is 1e-6 m off
        theirs = coal_distance(A * unit, B * unit, r1 * unit, r2 * unit) / unit
        rounding = AGREEMENT if kind == "nearly parallel" else GEOMETRY
        assert ours == pytest.approx(theirs, abs=rounding)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_distance_does_not_depend_on_which_segment_or_which_end_is_first(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind)[:40]:
        want = nearest_on_segments(np.stack([A, B]), 0, 1, witness)
        for first, second in ((B, A), (A[::-1].copy(), B), (A, B[::-1].copy())):
            gap = nearest_on_segments(np.stack([first, second]), 0, 1, witness)
            assert gap == pytest.approx(want, abs=ALGEBRA)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_witness_points_lie_on_their_segments_and_are_that_far_apart(kind):
    witness = np.empty((2, 3))
    for A, B, _, _ in pairs_of(kind):
        gap = nearest_on_segments(np.stack([A, B]), 0, 1, witness)
        assert np.linalg.norm(witness[1] - witness[0]) == pytest.approx(gap, abs=ALGEBRA)
        for point, segment in zip(witness, (A, B), strict=True):
            on = exact_distance(np.array([point, point]), segment)
            assert on == pytest.approx(0.0, abs=ALGEBRA)


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_normal_is_a_direction_from_the_first_to_the_second_even_where_they_meet(kind):
    witness, normal = np.empty((2, 3)), np.empty(3)
    for A, B, _, _ in pairs_of(kind):
        gap = separation(np.stack([A, B]), 0, 1, witness, normal)
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
    assert separation(np.array([A, B], float), 0, 1, witness, normal) == 0.0
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
    file = write_arms(tmp_path, urdf=edited(ARMS_URDF, *shapes))
    made = Robot.from_file(file, MARGIN, "midpoint")
    q = inside_limits(made, 200, 3)
    theirs = made.certifier().check(q)
    assert np.allclose(batch.clearances(made.chain, q), theirs.clearance, rtol=0, atol=GEOMETRY)


@pytest.mark.parametrize("short_of", [0.0, 1e-7, 3e-6, 1e-4, 0.01], ids="{:g} rad".format)
def test_a_box_upside_down_is_placed_where_the_kernels_place_it(tmp_path, short_of):
    lower = ('<collision><origin xyz="0 0 -0.125"/>',
             f'<collision><origin xyz="0 0 -0.125" rpy="{np.pi - short_of!r} 0 0"/>')  # fmt: skip
    box = ('<capsule radius="0.03" length="0.15"/>', '<box size="0.04 0.04 0.2"/>')
    file = write_arms(tmp_path, urdf=edited(ARMS_URDF, lower, box))
    made = Robot.from_file(file, MARGIN, "joint")
    q = inside_limits(made, 50, 9)
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
    radii = made.chain.body_radius[made.watched].sum(axis=1) - made.slack()
    compared = total = 0
    for pose in inside_limits(made, 10, 6):
        d, G = pair_distances(made, pose, everything)
        for joint in range(made.n_dof):
            shift = step * np.eye(made.n_dof)[joint]
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
    waist = [made.joint_names.index(f"Waist{way}") for way in ("Lat", "Sag", "Yaw")]
    kinds = [p.kind for p in made.pairs if p.reason in KEPT]
    arms = np.array([kind in ("limb-limb", "within a limb") for kind in kinds])
    d, G = pair_distances(made, inside_limits(made, 1, 7)[0], 100.0)
    assert len(d) == len(arms)
    assert (G[np.ix_(arms, waist)] == 0.0).all()
    assert (np.abs(G[np.ix_(~arms, waist)]).max(axis=1) > 0.0).any()


# --- the certificate


def both_clearances(made, a, b, q):
    """Clearance of bodies a and b alone at poses q [m]: by the kernels, and by the certifier."""
    watched = np.array([[a, b]])
    ours = batch.clearances(chain.build(made, watched, made.neck), q)
    return ours, Certifier(made, watched).check(q).clearance


def two_capsules(folder, A, B, r1, r2):
    """A robot whose bodies 0 and 1, on the base and on an upper arm, are these capsules at zero."""
    box = '<box size="0.1 0.1 0.1"/>'
    trunk, upper = '<capsule radius="0.1" length="0.3"/>', '<capsule radius="0.04" length="0.2"/>'
    urdf = edited(ARMS_URDF, (trunk, box), (upper, box), (upper, box))
    made = Robot.from_file(write_arms(folder, urdf=urdf), MARGIN, "midpoint")
    base, arm, *others = made.bodies
    B = B - made.joints[arm.joint].translation
    base, arm = base._replace(a=A[0], b=A[1], radius=r1), arm._replace(a=B[0], b=B[1], radius=r2)
    assert base.joint == -1 and made.joints[arm.joint].parent == -1
    return replace(made, bodies=(base, arm, *others))


@pytest.mark.parametrize("kind", SEGMENT_PAIRS)
def test_the_certificate_agrees_on_any_two_capsules(tmp_path, kind):
    for capsules in pairs_of(kind)[:40]:
        made = two_capsules(tmp_path, *capsules)
        ours, theirs = both_clearances(made, 0, 1, np.zeros((1, 4)))
        assert ours == pytest.approx(theirs, abs=AGREEMENT)


def beside_a_grain(rng):
    """A limb, and a segment of 0.2 micrometres across its first end and askew to it [m]."""
    way, other = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    start, angle = rng.normal(0.0, 0.3, 3), rng.uniform(0.3, 1.2)
    limb = np.array([start, start + 0.3 * (np.sin(angle) * way + np.cos(angle) * other)])
    grain = start + 0.1 * way + np.outer([-1e-7, 1e-7], other)
    return limb, grain, 0.01, 0.02


def test_without_its_own_unit_of_length_the_certificate_would_miss_a_collision(
    tmp_path, monkeypatch
):
    rng, off = np.random.default_rng(10), []
    for _ in range(10):
        made = two_capsules(tmp_path, *beside_a_grain(rng))
        ours, theirs = both_clearances(made, 0, 1, np.zeros((1, 4)))
        assert ours == pytest.approx(theirs, abs=AGREEMENT)
        with monkeypatch.context() as patch:
            patch.setattr(certifier, "PER_METRE", 1.0)
            off.append(both_clearances(made, 0, 1, np.zeros((1, 4)))[1] - ours)
    assert np.max(off) > 0.01  # [m]


def test_the_unit_of_length_changes_no_digit_elsewhere(monkeypatch):
    made = coman()
    q = np.concatenate([inside_limits(made, 200, 11), relaxed(made, 100, 12, alpha=2.0)])
    report = made.certifier().check(q)
    monkeypatch.setattr(certifier, "PER_METRE", 1.0)
    in_metres = made.certifier().check(q)
    assert np.array_equal(report.clearance, in_metres.clearance)
    assert np.array_equal(report.pair, in_metres.pair)


def test_the_certificate_agrees_on_arms_nearly_parallel_touching_and_nested(tmp_path):
    made = Robot.from_file(write_arms(tmp_path), MARGIN, "midpoint")
    names = [body.name for body in made.bodies]
    right, left = names.index("r_lower_0"), names.index("l_lower_0")
    rng = np.random.default_rng(13)
    q = inside_limits(made, 20_000, 14)
    askew = rng.choice([-1.0, 1.0], len(q)) * 10.0 ** rng.uniform(-12, -3, len(q))  # [rad]
    q[::10] = [0.5, 0.5, -0.5, -0.5]  # folded across each other
    q[:, 3] = q[:, 0] + q[:, 1] - q[:, 2] + askew  # the forearms point the same way, almost
    q = q[((q >= made.lower) & (q <= made.upper)).all(axis=1)]
    ours, theirs = both_clearances(made, right, left, q)
    assert np.allclose(ours, theirs, rtol=0, atol=AGREEMENT)
    assert len(q) > 5000 and ours.min() < -0.05 and ours.max() > 0.1
    assert (np.abs(ours) < 1e-3).any()


def test_the_certificate_agrees_on_coman_with_limbs_that_mirror_each_other():
    made = coman()
    names = made.joint_names
    rng = np.random.default_rng(15)
    q = inside_limits(made, 3000, 16)
    q[:1500] = 0.0  # arms along the legs: upright segments side by side, hands in the thighs
    for left in (name for name in names if name.startswith("L")):
        sign = 1.0 if left.endswith(("Sag", "bj")) else -1.0
        q[1500:, names.index("R" + left[1:])] = sign * q[1500:, names.index(left)]
    q[:, [names.index("WaistLat"), names.index("WaistYaw")]] = 0.0
    q += rng.normal(size=q.shape) * 10.0 ** rng.uniform(-12, -3, (len(q), 1))
    ours, theirs = batch.clearances(made.chain, q), made.certifier().check(q).clearance
    assert np.allclose(ours, theirs, rtol=0, atol=AGREEMENT)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf], ids=str)
def test_a_pose_that_is_not_finite_has_no_clearance_and_no_certificate(bad):
    made = coman()
    q = np.tile(made.anchor, (3, 1))
    q[1, 4] = bad
    clearance = batch.clearances(made.chain, q)
    assert np.isnan(clearance).tolist() == [False, True, False]
    assert not clearance[1] >= made.margin
    report = made.certifier().check(q)
    assert np.isnan(report.clearance).tolist() == [False, True, False]
    assert np.isnan(report.limit_margin[1]) and report.pair[1] == -1
    one = np.array([made.certifier().one(row) for row in q])
    assert (one[[0, 2]] == np.array(report[::2]).T[[0, 2]]).all() and np.isnan(one[1]).all()
    with pytest.raises(CertificateError) as refusal:
        certificate(made, q)
    assert str(refusal.value) == "1 of 3 poses are not feasible; row 1 is not finite"


def test_a_pose_outside_its_limits_is_refused_by_joint_and_passes_within():
    made = coman()
    joint = made.joint_names.index("LElbj")
    q = made.anchor[None].copy()
    q[0, joint] = made.upper[joint]
    assert certificate(made, q)["limit_margin"] == pytest.approx(0.0, abs=0.0)
    q[0, joint] = np.nextafter(made.upper[joint], 1.0)
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
    made.certifier().check(np.tile(made.anchor, (1203, 1)), done.append)
    assert sum(done) == 1203
