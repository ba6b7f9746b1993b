"""A way to rest: is the motion proven on which a robot that moves would brake? Compiled."""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.poses import AGREEMENT
from s3le.kernels.solver import clearance_of
from s3le.safety import curve
from s3le.safety.curve import BEYOND
from s3le.safety.segment import CERTIFIED, prove_curve

_FEW = 8  # rows of a stop that are looked at one by one; one of more keeps the margin throughout


@compiled
def within(chain, path):
    """Does a path stay within the limits of all joints, at every moment?"""
    n = path.shape[1]
    low = np.empty(n)
    high = np.empty(n)
    curve.span(path, low, high)
    for i in range(n):
        if not (chain.lower[i] - BEYOND <= low[i] and high[i] <= chain.upper[i] + BEYOND):
            return False
    return True


@compiled
def rests(chain, swept, s, q, v, acceleration, dt, margin, between, budget, path):
    """Is the motion proven on which each joint brakes from (q, v), and its end a good pose?

    Its rows dt apart keep the margin, and so does its end; all of it keeps `between` and limits.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        q, v: where it begins [rad], which keeps the margin, and the speed there [rad/s], (n,).
        acceleration: with which each joint brakes [rad/s^2], (n,).
        dt: see curve.stop.
        margin, between: [m].
        budget: most poses that the proof looks at.
        path: receives the motion, (curve.ROWS, n).

    Returns:
        (is it, poses looked at).
    """
    lasts = curve.stop(q, v, acceleration * (1.0 - curve.EPS), dt, path)
    if not lasts > 0.0:
        return lasts == 0.0, 0
    here = np.empty(len(q))
    rows = int(np.round(lasts / dt))
    level, first = between, 1
    if rows > _FEW:
        level, first = margin + AGREEMENT, rows
    for row in range(first, rows + 1):
        curve.position(path, row / rows, here)
        if not clearance_of(chain, swept.balls, here) >= margin + AGREEMENT:
            return False, 0
    if not within(chain, path):
        return False, 0
    found = prove_curve(chain, swept, s, path, level, budget)
    return found[0] == CERTIFIED, found[6]


@compiled
def rests_rows(chain, swept, s, q, v, acceleration, dt, margin, between, budget, good):
    """Has each row (m, n) a proven way to rest? Into good, bool (m,); dt (m,) [s]."""
    path = np.empty((curve.ROWS, q.shape[1]))
    for row in range(len(q)):
        good[row] = rests(
            chain, swept, s, q[row], v[row], acceleration, dt[row], margin, between, budget, path
        )[0]  # fmt: skip
