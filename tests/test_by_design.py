"""Bodies that overlap by design: no deeper than their baseline, at poses, on paths, by two ways."""

from functools import cache

import numpy as np
import pytest
from worlds import MARGIN, coman, exact_distance, inside_limits, placed, relaxed

from s3le.kernels import batch
from s3le.robot.bounded import never_deeper, over_range
from s3le.robot.pairs import BASELINE, BOUNDED, DEEPER, NEIGHBOURS, RESTING, SURE, told
from s3le.safety import audit, segment
from s3le.safety.paths import CERTIFIED, COLLIDES, certify
from s3le.safety.swept import swept

BETWEEN = 0.0005
ALGEBRA = 1e-9  # [m]


def covered():
    return coman(name="coman_covered")


def raw(made, pair, q):
    """Signed distance of a pair at poses [m], by the definition and no baseline."""
    radii = made.bodies[pair.a].radius + made.bodies[pair.b].radius
    ends = [placed(made, pose)[3][:, :2] for pose in q]
    return np.array([float(exact_distance(e[pair.a], e[pair.b])) - radii for e in ends])


def feasible(made, n, seed):
    return batch.project(made.chain, made.anchor, relaxed(made, n, seed), made.margin).q


def some(made, reason):
    """Pairs of a reason; of those with a baseline, the ones that are nearer than the margin."""
    near = [pair for pair in made.pairs if pair.reason == reason]
    return [pair for pair in near if reason != BASELINE or made.designed(pair)]


@cache
def poses():
    return inside_limits(covered(), 4000, 11)


@pytest.mark.parametrize("reason", [BASELINE, BOUNDED])
def test_the_baseline_is_the_deepest_at_the_anchor_and_at_zero(reason):
    made = covered()
    assert some(made, reason)
    stands = np.stack([made.anchor, np.clip(np.zeros(made.n_dof), made.lower, made.upper)])
    for pair in some(made, reason):
        assert pair.baseline == pytest.approx(raw(made, pair, stands).min(), abs=1e-6)


def test_what_is_proven_never_deeper_is_never_deeper_and_what_is_not_is_somewhere():
    made, q = covered(), poses()[:1500]
    for pair in some(made, BOUNDED):
        assert raw(made, pair, q).min() >= pair.baseline - DEEPER
    for pair in some(made, BASELINE):
        assert raw(made, pair, q).min() < pair.baseline - DEEPER


def test_the_proof_takes_no_floor_that_some_pose_is_below():
    made, q = covered(), poses()[:800]
    for pair in some(made, BOUNDED):
        one, other = made.bodies[pair.a], made.bodies[pair.b]
        seen = raw(made, pair, q).min()
        assert never_deeper(made, one, other, seen - DEEPER)
        assert not never_deeper(made, one, other, seen + 1e-7)


def test_the_range_of_neighbours_holds_all_that_poses_show():
    made, q = covered(), poses()[:400]
    for pair in some(made, NEIGHBOURS):
        one, other = made.bodies[pair.a], made.bodies[pair.b]
        found = raw(made, pair, q)
        assert over_range(made, one, other) == pair.seen
        assert pair.seen[0] - 1e-5 <= found.min() and found.max() <= pair.seen[1] + 1e-5
        assert "overlap by" in told(pair)


def test_every_pair_but_neighbours_is_covered():
    made = covered()
    assert {p.reason for p in made.pairs if p.reason not in SURE} == {NEIGHBOURS}
    body = [one.joint for one in made.bodies]
    for pair in some(made, NEIGHBOURS):
        a, b = body[pair.a], body[pair.b]
        assert a in made.path_to(b)[-2:] or b in made.path_to(a)[-2:] or -1 in (a, b)


def test_feasible_poses_come_no_deeper_and_the_kernels_agree_with_the_certificate():
    made = covered()
    q = feasible(made, 60, 5)
    for pair in some(made, BASELINE):
        assert raw(made, pair, q).min() >= pair.baseline - RESTING - ALGEBRA
    wide = poses()[:60]
    assert np.allclose(
        batch.clearances(made.chain, wide), made.certifier().check(wide).clearance, atol=1e-7
    )


def test_paths_that_are_certified_come_no_deeper_and_some_would():
    made = covered()
    q = feasible(made, 120, 6)
    deep = [raw(made, p, poses()[:600]) < p.baseline - DEEPER for p in some(made, BASELINE)]
    q = np.concatenate([q, poses()[:600][np.any(deep, axis=0)][:40]])  # these must be refused
    found = certify(made, q, BETWEEN)
    share, refused = np.linspace(0.0, 1.0, 40)[:, None], 0
    for row, status in enumerate(found.status):
        way = (1.0 - share) * q[row] + share * q[row + 1]
        deepest = [(raw(made, p, way) - p.baseline).min() for p in some(made, BASELINE)]
        if status == CERTIFIED:
            assert min(deepest) >= -DEEPER - ALGEBRA
        refused += min(deepest) < -DEEPER
    assert refused


def test_a_floor_above_the_margin_is_kept_too():
    made = covered()
    chain, q = made.chain, made.anchor
    apart = batch.pair_distances(chain, q[None])[0]
    # After a near pair is decided, the balls around two that are far decide them.
    near = np.argmin(np.where(chain.slack == 0.0, apart, np.inf))
    rows = np.array([near, np.argmax(apart)])
    two = chain._replace(pair=chain.pair[rows], slack=np.array([0.0, 1.0]))
    for more, status in ((-1e-3, CERTIFIED), (1e-3, COLLIDES)):
        its = two._replace(floor=np.array([0.0, apart[rows[1]] + more]))
        found = segment.prove(its, swept(its), segment.scratch(its), q, q.copy(), BETWEEN, 5)
        assert found[0] == status


def test_a_pose_that_is_deeper_is_broken_and_named():
    made = covered()
    for pair in some(made, BASELINE):
        deep = next(q for q in poses() if raw(made, pair, q[None])[0] < pair.baseline - 0.002)
        row = [tuple(two) for two in made.watched].index((pair.a, pair.b))
        seen = batch.pair_distances(made.chain, deep[None])[0, row]
        want = raw(made, pair, deep[None])[0] - pair.baseline + MARGIN + RESTING
        assert seen == pytest.approx(want, abs=ALGEBRA) and seen < MARGIN
        report = audit.audit(made, np.arange(2.0), np.stack([deep, deep]), audit.demands(made))
        assert not report.holds


def test_the_certificate_names_the_baselines():
    listed = audit.by_design(covered())
    assert {(one["a"], one["b"]) for one in listed} >= {("Waist_0", "DWS_0")}
    for one in listed:
        assert one["reason"] in (BASELINE, BOUNDED) and one["baseline_m"] < 0.0
