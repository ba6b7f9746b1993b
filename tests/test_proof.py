"""The proof, once more and slowly: each part of a path, each pair, both bounds as printed.

What kernels/segment.py leaves out to be fast must change no digit of what it says.
"""

import numpy as np
import pytest
from proofs import prove
from worlds import (
    MARGIN,
    all_clearances,
    coman,
    exact_distance,
    placed,
    relaxed,
    write_arms,
)

from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, certify
from s3le.safety.swept import swept, travels

BETWEEN, ROUNDING, ALGEBRA = 0.0005, 1e-9, 1e-11  # [m]
JOINTS = 4


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Robot.from_file(write_arms(tmp_path_factory.mktemp("arms")), MARGIN, "midpoint")


@pytest.fixture(scope="module")
def paths(arms):
    """Pairs of feasible poses: far, near, hardly apart, and along single joints."""
    rng, out = np.random.default_rng(3), []
    q = batch.project(arms.chain, arms.anchor, relaxed(arms, 24, 8), MARGIN).q
    out += list(zip(q, np.roll(q, -1, axis=0), strict=True))
    for size, share in ((1.0, 1.0), (0.3, 1.0), (0.02, 1.0), (1.5, 0.4)):
        step = rng.uniform(-size, size, q.shape) * (rng.random(q.shape) < share)
        near = np.clip(q + step, arms.lower, arms.upper)
        near = batch.project(arms.chain, arms.anchor, near, MARGIN).q
        out += list(zip(q, near, strict=True))
    return out


def bounds_of(made, q0, q1):
    """V and A of every body from each frame, as kernels/swept.py prints them: dicts by (b, f)."""
    chain, radius = made.chain, swept(made.chain).radius
    v, a = {}, {}
    for body, frame in enumerate(chain.body_frame):
        own = [frame]
        while own[-1] > 0:
            own.append(chain.parent[own[-1] - 1])
        for f in own:
            between = own[: own.index(f)]  # frames whose joints lie between the body and f
            joints = [one - 1 for one in between]  # the farthest from the base first
            rates = {j: abs(q1[j] - q0[j]) for j in joints}
            v[body, f] = sum(rates[j] * radius[body, j] for j in joints)
            a[body, f] = sum(
                rates[j] * (rates[j] * radius[body, j]
                            + 2 * sum(rates[k] * radius[body, k] for k in joints[:i]))
                for i, j in enumerate(joints)
            )  # fmt: skip
    return v, a


def nearest_points(A, B):
    """The nearest points of two segments: an end and what is nearest to it, or both within."""
    pairs = []
    for P, Q in ((A, B), (B, A)):
        way = Q[1] - Q[0]
        for end in P:
            share = np.clip((end - Q[0]) @ way / (way @ way), 0.0, 1.0)
            pair = end, Q[0] + share * way
            pairs.append(pair if P is A else pair[::-1])
    ways = np.stack([A[1] - A[0], B[0] - B[1]], axis=1)
    shares = np.linalg.lstsq(ways, B[0] - A[0], rcond=None)[0]
    if (shares > 0.0).all() and (shares < 1.0).all():
        pairs.append((A[0] + shares[0] * ways[:, 0], B[0] - shares[1] * ways[:, 1]))
    return min(pairs, key=lambda pair: np.linalg.norm(pair[1] - pair[0]))


def second_order(sides, row, C, bend):
    """Least of (1 - s) f(a) + s f(b) - s (1 - s) bend / 2 over s and the ends of both cores."""
    normals = []
    for R, ends in sides:
        x, y = nearest_points(*(ends[body, :2] for body in row))
        gap = np.linalg.norm(y - x)
        if not gap > 1e-9:
            return -np.inf
        normals.append(R[C].T @ (y - x) / gap)  # as seen from C
    mean = sum(normals)
    if not np.linalg.norm(mean) > 1e-3:
        return -np.inf
    n, least = mean / np.linalg.norm(mean), np.inf
    for e in range(2):
        for g in range(2):
            f = [(R[C] @ n) @ (ends[row[1], g] - ends[row[0], e]) for R, ends in sides]
            turning = np.clip(0.5 + (f[0] - f[1]) / bend, 0.0, 1.0) if bend > 0.0 else 0.0
            for s in (0.0, turning, 1.0):
                least = min(least, (1 - s) * f[0] + s * f[1] - s * (1 - s) * bend / 2)
    return least


def slow_proof(made, q0, q1, margin, budget):
    """(status, bound, until, t, used)."""
    chain, carrier = made.chain, swept(made.chain).carrier
    v, a = bounds_of(made, q0, q1)

    def look(t):
        R, _, _, ends = placed(made, (1.0 - t) * q0 + t * q1)
        return R, ends

    def gap(ends, row):
        return float(exact_distance(*(ends[body, :2] for body in row)))

    low, used = np.inf, 0
    parts = [(0.0, 1.0, list(range(len(chain.pair))), np.inf)]
    while parts:
        left, right, rows, _ = parts.pop()
        sides, h, still, least = (look(left), look(right)), right - left, [], np.inf
        for row in rows:
            bodies, C = chain.pair[row], carrier[row]
            radii = chain.body_radius[bodies].sum()
            d = [gap(ends, bodies) - radii for _, ends in sides]
            for t, found in zip((left, right), d, strict=True):
                if found < margin:
                    return COLLIDES, np.nan, left, t, used
            travel = h * sum(v[body, C] for body in bodies)
            bend = h * h * sum(a[body, C] for body in bodies)
            bound, most = (sum(d) - travel) / 2, sum(d) / 2 - bend / 8
            if most > bound and most >= margin:
                bound = max(bound, second_order(sides, bodies, C, bend) - radii)
            bound -= ROUNDING
            if bound >= margin:
                low = min(low, bound)
            else:
                least = min(least, bound)
                still.append(row)
        if not still:
            continue
        if used >= budget:
            return UNDECIDED, min(low, least, *(part[3] for part in parts)), left, np.nan, used
        used += 1
        middle = (left + right) / 2
        parts += [(middle, right, still, least), (left, middle, still, np.inf)]
    return CERTIFIED, low, 1.0, np.nan, used


@pytest.mark.parametrize("budget", [0, 1, 2, 5, 200])
@pytest.mark.parametrize("margin", [BETWEEN, 0.002])
def test_the_proof_says_what_the_printed_bounds_say_part_by_part(arms, paths, budget, margin):
    seen = set()
    for q0, q1 in paths[:: 1 if budget < 200 else 3]:
        found = prove(arms, q0, q1, margin, budget)
        status, bound, until, t, used = slow_proof(arms, q0, q1, margin, budget)
        assert (found.status, found.used, found.until) == (status, used, until)
        # Where the first order is enough, the second is not asked for the last nanometre.
        assert np.isnan(bound) == np.isnan(found.bound)
        assert not found.bound > bound + ALGEBRA and not found.bound < bound - ROUNDING - ALGEBRA
        assert found.t == pytest.approx(t, abs=0, nan_ok=True)
        seen.add(status)
        if status == COLLIDES:
            clearances = all_clearances(arms, placed(arms, (1 - t) * q0 + t * q1)[3])
            assert found.pair == clearances.argmin()
            assert found.clearance == pytest.approx(clearances.min(), abs=ALGEBRA)
        else:
            assert found.pair == -1 and np.isnan(found.clearance)
    assert CERTIFIED in seen and seen & {UNDECIDED, COLLIDES}


@pytest.mark.parametrize("way", [1, -1], ids=["to meet", "to part"])
def test_hands_that_meet_are_found_however_far_apart_they_are_at_the_other_end(arms, way):
    """So far that, seen from that end alone, they need not be looked at."""
    apart, meeting = np.pi + np.array([[-0.3, 0.3], [0.45, -0.45]])  # over the head
    joints = [arms.joint_names.index(f"{side}_shoulder") for side in "lr"]
    ends = np.zeros((2, JOINTS))
    ends[0, joints], ends[1, joints] = apart, meeting
    gaps = [all_clearances(arms, placed(arms, q)[3]) for q in ends]
    pair = gaps[1].argmin()
    assert gaps[0].min() > 0.0 and (np.delete(gaps[1], pair) > 0.0).all() and gaps[1][pair] < 0.0
    chain, bounds = arms.chain, swept(arms.chain)
    v, _ = bounds_of(arms, *ends)
    a, b = chain.pair[pair]
    centres = placed(arms, ends[0])[3][[a, b], 2]
    assert np.linalg.norm(centres[0] - centres[1]) > (
        BETWEEN + bounds.balls[[a, b]].sum() + (v[a, 0] + v[b, 0]) / 2
    )
    found = prove(arms, *ends[::way], BETWEEN)
    assert found.status == COLLIDES and found.pair == pair and found.clearance < 0.0


def test_bounds_on_travel_are_the_printed_sums(arms, paths):
    chain = arms.chain
    shape = len(chain.body_frame), JOINTS + 1
    for q0, q1 in paths[::9]:
        travel, bend = np.full(shape, np.nan), np.full(shape, np.nan)
        travels(chain, swept(chain), np.abs(q1 - q0), np.zeros(len(q0)), travel, bend)
        v, a = bounds_of(arms, q0, q1)
        assert {tuple(at) for at in np.argwhere(np.isfinite(travel))} == set(v)
        for at in v:
            assert travel[at] == pytest.approx(v[at], abs=ALGEBRA)
            assert bend[at] == pytest.approx(a[at], abs=ALGEBRA)


def test_radii_about_parallel_axes_are_lengths_of_the_arm(arms):
    bounds, names = swept(arms.chain), [body.name for body in arms.bodies]
    want = np.zeros((len(names), JOINTS))
    for side in "lr":
        joints = [arms.joint_names.index(f"{side}_{part}") for part in ("shoulder", "elbow")]
        want[names.index(f"{side}_upper_0"), joints[0]] = 0.25  # [m], the far end of its core
        want[names.index(f"{side}_lower_0"), joints[1]] = 0.2
        want[names.index(f"{side}_lower_0"), joints[0]] = 0.3 + 0.2
    assert np.allclose(bounds.radius, want, rtol=0, atol=ALGEBRA)
    for (a, b), carrier in zip(arms.watched, bounds.carrier, strict=True):
        sides = {names[body][:2] for body in (a, b)}  # two bodies of an arm share its shoulder
        joint = f"{sides.pop()}shoulder" if len(sides) == 1 else None
        assert carrier == (1 + arms.joint_names.index(joint) if joint else 0)


def test_radii_about_axes_that_turn_each_other_hold_at_all_angles_and_are_as_small_as_they_were():
    made = coman()
    chain, radius = made.chain, swept(made.chain).radius
    n, seen = made.n_dof, np.zeros_like(radius)
    for q in np.random.default_rng(6).uniform(-np.pi, np.pi, (150, n)):
        R, p, z, ends = placed(made, q)
        for body, frame in enumerate(chain.body_frame):
            for j in np.flatnonzero(chain.moves[frame]):
                away = ends[body, :2] - p[j + 1]
                far = np.linalg.norm(away - np.outer(away @ z[j], z[j]), axis=1).max()
                seen[body, j] = max(seen[body, j], far)
    assert (seen <= radius + ALGEBRA).all() and (radius[seen == 0.0] == 0.0).all()
    # Angles at random come near the bounds; a larger bound would hold too, and prove less.
    share = seen[radius > 0.0] / radius[radius > 0.0]
    assert share.min() > 0.7 and (share > 0.97).mean() > 0.4
    assert radius.sum() == pytest.approx(37.8893283824105, abs=1e-9)  # [m]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1000.5, -1000.5])
@pytest.mark.parametrize("end", [0, 1])
def test_an_end_that_is_no_pose_is_undecided_at_once(arms, bad, end):
    ends = np.tile(arms.anchor, (2, 1))
    ends[end, 3] = bad
    found = prove(arms, *ends, BETWEEN)
    assert found[0] == UNDECIDED and np.isnan(found.bound)
    assert (found.until, found.pair, found.used) == (0.0, -1, 0)
    assert np.isnan([found.t, found.clearance]).all()
    batched = certify(arms, ends, BETWEEN)
    assert batched.status[0] == UNDECIDED and np.isnan(batched.bound[0])


def test_a_batch_says_what_one_after_another_say(arms, paths):
    q = np.array([pose for path in paths[:20] for pose in path])
    found = certify(arms, q, BETWEEN, 5)
    for row in range(len(q) - 1):
        one = prove(arms, q[row], q[row + 1], BETWEEN, 5)
        for name, value in one._asdict().items():
            assert np.array_equal(getattr(found, name)[row], value, equal_nan=True), name


def test_a_path_too_short_to_halve_again_is_undecided(arms):
    """Bisected to a pose that keeps the margin by less than the rounding that is taken off."""
    low, high = arms.anchor, arms.anchor.copy()
    high[arms.joint_names.index("r_shoulder")] = 1.0
    for _ in range(60):
        middle = (low + high) / 2
        clear = batch.clearances(arms.chain, middle[None])[0] >= BETWEEN
        low, high = (middle, high) if clear else (low, middle)
    found = prove(arms, low, arms.anchor, BETWEEN, 200)
    assert found.status == UNDECIDED and found.used == segment._SLOTS - 2
    assert found.bound < BETWEEN and found.until == 0.0
    assert prove(arms, low, arms.anchor, BETWEEN - 1e-8, 200).status == CERTIFIED
    back = prove(arms, arms.anchor, low, BETWEEN, 60)
    assert back.status == UNDECIDED and back.used == 60 and 0.99 < back.until < 1.0
