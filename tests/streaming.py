"""A retargeter over a few thousand poses of COMAN, and motions that collide, for several tests."""

from dataclasses import replace
from functools import cache

import numpy as np
from worlds import MARGIN, coman, inside_limits, relaxed

from s3le.kernels import batch
from s3le.retarget.propose import LookUp
from s3le.retarget.settings import Settings
from s3le.retarget.stream import Retargeter
from s3le.safety.paths import CERTIFIED, certify, sampled
from s3le.search import neighbours

BETWEEN = 0.0005  # [m]
DEFAULT = Settings(
    k=4, iterations=6, target=0.004, between=BETWEEN, ridge=1e-3, toll=0.003,
    speed_factor=1.0, cutoff=0.0, quickness=1.0, delay=False, check=True,
)  # fmt: skip
SPEED = 4.0  # [rad/s], COMAN's
AGREEMENT = 1e-7  # [m], of kernels and coal (test_distance.py)
DT = 1.0 / 30.0


@cache
def stored(n=3000):
    made = coman()
    q = batch.project(made.chain, made.anchor, relaxed(made, n, 5), MARGIN).q
    return q, batch.skeletons(made.chain, q)


@cache
def retargeter(**changed):
    q, x = stored()
    chosen = replace(DEFAULT, **changed)
    return Retargeter(coman(), LookUp(q, neighbours.build(x, exact=True), chosen.k, None), chosen)


@cache
def motion(n=120, seed=1):
    """Skeletons of a smooth motion that collides: of poses within limits, not projected."""
    made, knots = coman(), inside_limits(coman(), n // 15 + 2, seed)
    at = np.arange(n) / 15.0
    share = (at % 1.0)[:, None] ** 2 * (3.0 - 2.0 * (at % 1.0)[:, None])
    q = (1.0 - share) * knots[at.astype(int)] + share * knots[at.astype(int) + 1]
    return batch.skeletons(made.chain, q)


def held_to_its_word(q, v, dt, via=None, speed=SPEED, judged=3):
    """Poses by coal, curves by proof and, the closest of them, by dense sampling, speeds.

    Where no time passed nothing may have moved; via are rows within steps, see plan.steps.Step.
    """
    made, q, v, dt = coman(), np.asarray(q), np.asarray(v), np.asarray(dt, float)
    report = made.certifier().check(q)
    assert (report.clearance >= MARGIN).all() and (report.limit_margin >= 0.0).all()
    still = dt == 0.0
    assert (q[1:][still] == q[:-1][still]).all() and (v[1:][still] == v[:-1][still]).all()
    t, at, fast = [0.0], [q[0]], [v[0]]
    for k in np.flatnonzero(~still):
        for after, here, w in (*(via[k] if via else ()), (dt[k], q[k + 1], v[k + 1])):
            t.append(dt[:k].sum() + after)
            at, fast = [*at, here], [*fast, w]
    t, at, fast = np.array(t), np.array(at), np.array(fast)
    took = np.diff(t)[:, None]
    assert np.abs(np.diff(at, axis=0) - 0.5 * took * (fast[1:] + fast[:-1])).max(initial=0) < 1e-8
    found = certify(made, at, BETWEEN - AGREEMENT, time=t, v=fast)
    assert (found.status == CERTIFIED).all()
    assert (np.abs(fast) <= speed * (1.0 + 1e-9)).all()
    checker = made.certifier()
    for row in np.argsort(found.bound)[:judged]:
        moments = np.linspace(t[row], t[row + 1], 40)
        there = sampled(t, at, fast, np.full(40, row), moments)[0]
        assert checker.check(there).clearance.min() >= BETWEEN - AGREEMENT
