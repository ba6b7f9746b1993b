"""The independent check against lengths by hand: what it measures, and what it never lets pass."""

import numpy as np
import pytest
from worlds import ARMS_URDF, MARGIN, arms_points, edited, exact_distance, relaxed, write_arms

from s3le.errors import CertificateError
from s3le.robot.certificate import Certifier, placements, point_positions
from s3le.robot.robot import Robot

ALGEBRA = 1e-9  # [m]
R_SHOULDER = 2
CORES = {"upper": (1 / 6, 5 / 6, 0.04), "lower": (0.2, 0.8, 0.03)}  # shares of a limb, radius [m]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


def cores(made, q):
    """Core (2, 3) and radius [m] of every body, by hand."""
    at = arms_points(dict(zip(made.joint_names, q, strict=True)))
    out = {"body_0": (np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.4]]), 0.1)}
    for side in "rl":
        for limb, ends in (("upper", ("shoulder", "elbow")), ("lower", ("elbow", "hand"))):
            a, b = (at[f"{side}_{end}"] for end in ends)
            first, last, radius = CORES[limb]
            out[f"{side}_{limb}_0"] = np.array([a + first * (b - a), a + last * (b - a)]), radius
    return out


def by_hand(made, q):
    """Signed distance of every watched pair [m]."""
    core = cores(made, q)
    found = []
    for a, b in made.watched:
        (one, r1), (two, r2) = (core[made.bodies[k].name] for k in (a, b))
        found.append(float(exact_distance(one, two)) - r1 - r2)
    return np.array(found)


def some(made, n=30, seed=2):
    return relaxed(made, n, seed)  # beyond the limits, and colliding


def test_clearance_pair_and_room_are_those_by_hand(arms):
    q = some(arms)
    report = arms.certifier().check(q)
    for row, pose in enumerate(q):
        gaps = by_hand(arms, pose)
        assert gaps[report.pair[row]] == pytest.approx(gaps.min(), abs=ALGEBRA)
        if gaps.min() > -0.03:  # where cores cross, how deep they are is coal's to say
            assert report.clearance[row] == pytest.approx(gaps.min(), abs=ALGEBRA)
        room = min(*(pose - arms.lower), *(arms.upper - pose))
        assert report.limit_margin[row] == pytest.approx(room, abs=0)
    assert (report.limit_margin < 0.0).any() and (report.clearance < 0.0).any()


def test_one_pose_is_measured_as_a_row_of_many(arms):
    q, checker = some(arms), arms.certifier()
    report = checker.check(q)
    for row, pose in enumerate(q):
        assert checker.one(pose) == (report.clearance[row], report.limit_margin[row])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("joint", [0, 3])
def test_what_is_no_pose_has_no_clearance_no_pair_and_no_room(arms, bad, joint):
    q, checker = np.tile(arms.anchor, (3, 1)), arms.certifier()
    q[1, joint] = bad
    report = checker.check(q)
    assert np.isnan([report.clearance[1], report.limit_margin[1]]).all() and report.pair[1] == -1
    assert (report.pair[[0, 2]] >= 0).all() and (report.clearance[[0, 2]] > MARGIN).all()
    assert np.isnan(checker.one(q[1])).all()
    with pytest.raises(CertificateError, match="1 of 3 poses are not feasible; row 1 is not fin"):
        checker.require(q, MARGIN)


def test_a_pose_at_its_margin_and_at_its_limit_passes_and_beyond_it_does_not(arms):
    checker, q = arms.certifier(), np.tile(arms.anchor, (2, 1))
    q[1, R_SHOULDER] = arms.upper[R_SHOULDER]
    report = checker.check(q)
    least = float(report.clearance.min())
    assert report.limit_margin[1] == 0.0
    passed = checker.require(q, least)
    for one, other in zip(passed, report, strict=True):
        assert (one == other).all()
    with pytest.raises(CertificateError, match="poses are not feasible"):
        checker.require(q, np.nextafter(least, 1.0))
    for end, sign in (("upper", 1.0), ("lower", -1.0)):
        q[1, R_SHOULDER] = np.nextafter(getattr(arms, end)[R_SHOULDER], sign * np.inf)
        with pytest.raises(CertificateError, match="1 of 2 poses are not feasible; row 1: r_shoul"):
            checker.require(q, 0.0)


def test_a_refusal_says_row_what_and_how_much(arms):
    checker, q = arms.certifier(), np.tile(arms.anchor, (4, 1))
    q[2:, R_SHOULDER] = 1.2  # into the trunk
    gaps = by_hand(arms, q[2])
    names = arms.pair_name(int(gaps.argmin()))
    with pytest.raises(CertificateError) as refusal:
        checker.require(q, MARGIN)
    report = checker.check(q)
    assert str(refusal.value) == (
        f"2 of 4 poses are not feasible; row 2: {names} are {report.clearance[2] * 1e3:.4f} mm "
        "apart, wanted at least 2.0000 mm"
    )
    q[0, R_SHOULDER] = 3.5
    with pytest.raises(CertificateError) as refusal:
        checker.require(q, MARGIN)
    assert str(refusal.value) == (
        "3 of 4 poses are not feasible; row 0: r_shoulder at 3.500000 rad is outside "
        "[-3.0000, 3.0000]"
    )


@pytest.mark.parametrize("n", [0, 1, 999, 1000, 2001])
def test_progress_adds_up_and_comes_every_thousand(arms, n):
    told = []
    report = arms.certifier().check(np.tile(arms.anchor, (n, 1)), told.append)
    assert sum(told) == n and told.count(1000) == n // 1000 and told[-1] == n % 1000
    assert len(report.clearance) == len(report.pair) == len(report.limit_margin) == n
    if n:
        assert np.ptp(report.clearance) == 0.0 and report.clearance[0] > MARGIN


def test_only_watched_pairs_are_measured(arms):
    names = [body.name for body in arms.bodies]
    pair = np.array([[names.index("body_0"), names.index("l_lower_0")]])
    q = arms.anchor.copy()
    q[R_SHOULDER] = 1.2  # the other arm is in the trunk
    report = Certifier(arms, pair).check(q[None])
    core = cores(arms, q)
    want = float(exact_distance(core["body_0"][0], core["l_lower_0"][0])) - 0.1 - 0.03
    assert report.pair[0] == 0 and report.clearance[0] == pytest.approx(want, abs=ALGEBRA)


def test_bodies_are_placed_where_their_cores_are(arms):
    q = some(arms)[3]
    for body, at in zip(arms.bodies, placements(arms, q), strict=True):
        core, _ = cores(arms, q)[body.name]
        assert np.allclose(at.getTranslation(), core.mean(axis=0), rtol=0, atol=ALGEBRA)
        along = (core[1] - core[0]) / np.linalg.norm(core[1] - core[0])
        assert abs(at.getRotation()[:, 2] @ along) == pytest.approx(1.0, abs=1e-9)


def test_points_are_where_algebra_puts_them(arms):
    q = some(arms)[5]
    want = arms_points(dict(zip(arms.joint_names, q, strict=True)))
    found = dict(zip(arms.points, point_positions(arms, q), strict=True))
    assert set(found) == set(want)
    for name, place in want.items():
        assert np.allclose(found[name], place, rtol=0, atol=ALGEBRA), name


SHAPES = {  # the trunk: half length and radius of the capsule that contains it [m]
    '<capsule radius="0.1" length="0.3"/>': (0.15, 0.1),
    '<sphere radius="0.12"/>': (0.0, 0.12),
    '<box size="0.06 0.08 0.4"/>': (0.2, 0.05),
    '<cylinder radius="0.1" length="0.3"/>': (0.15, 0.1),
}


@pytest.mark.parametrize("turn", ["0 0 0", "3.141592653589793 0 0", "1.5707963267948966 0 0"])
@pytest.mark.parametrize("shape", SHAPES)
def test_another_shape_is_measured_as_a_capsule_that_contains_it(tmp_path, shape, turn):
    urdf = edited(
        ARMS_URDF,
        ('<origin xyz="0 0 0.25"/>', f'<origin xyz="0 0 0.25" rpy="{turn}"/>'),
        ('<capsule radius="0.1" length="0.3"/>', shape),
    )
    made = Robot.from_file(write_arms(tmp_path, urdf=urdf), MARGIN, "midpoint")
    trunk = made.bodies[0]
    half, radius = SHAPES[shape]
    assert np.linalg.norm(trunk.b - trunk.a) / 2 >= half - 0.1 - ALGEBRA
    assert trunk.radius >= radius - ALGEBRA
    q = made.anchor.copy()
    q[R_SHOULDER] = -0.3
    report = made.certifier().check(q[None])
    gaps = []
    for a, b in made.watched:
        ends = []
        for body in (made.bodies[a], made.bodies[b]):
            core = np.stack([trunk.a, trunk.b]) if body is trunk else cores(made, q)[body.name][0]
            ends.append((core, body.radius))
        gaps.append(float(exact_distance(ends[0][0], ends[1][0])) - ends[0][1] - ends[1][1])
    assert report.clearance[0] == pytest.approx(min(gaps), abs=1e-7)
