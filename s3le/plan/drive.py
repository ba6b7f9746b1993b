"""Rows after rows: what a motion keeps, and a robot driven along one that does not; compiled."""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.solver import clearance_of
from s3le.plan.pursue import pursue
from s3le.safety.segment import CERTIFIED, prove


@compiled
def examine(chain, swept, s, q, care, first, last, clearance, proven, where, bound):
    """Measure rows first to last - 1, and prove the paths that end at them.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        q: poses [rad], (m, n).
        care: a causal.Care; between and budget are read.
        first, last: rows.
        clearance: receives that of each pose [m], (m,).
        proven: receives whether the path from the row before is, bool (m,); True for row 0.
        where: receives at which share of the path it failed, (m,).
        bound: receives the proven clearance of each path [m], (m,); NaN: none.
    """
    for t in range(first, last):
        clearance[t] = clearance_of(chain, swept.balls, q[t])
        proven[t] = True
        where[t] = 0.0
        bound[t] = clearance[t]
        if t > 0:
            found = prove(chain, swept, s, q[t - 1], q[t], care.between, care.budget)
            proven[t] = found[0] == CERTIFIED
            bound[t] = found[1] if proven[t] else np.nan
            if not proven[t]:
                # Where it collides; else the middle of what could not be decided.
                where[t] = found[3] if np.isfinite(found[3]) else 0.5 * (1.0 + found[2])


@compiled
def drive(
    chain, swept, s, memory, times, wanted, x, bone, W, starts, anchor, rule, bounds, care,
    first, stop, q, how, bound,
):  # fmt: skip
    """Follow wanted poses row by row, until the robot is on them again.

    Args:
        chain, swept, s, bounds, care: see causal.advance.
        memory: a pursue.Memory.
        times: [s], (m,), rising.
        wanted: [rad], (m, n).
        x: their skeletons, (m, 21), or (0, 21).
        bone, W: see causal.search; W (m or 1, n, n).
        starts, anchor, rule: see pursue.
        first: row of q where the robot is; it comes from the row before, or stands, at row 0.
        stop: row from which on it may end with two rows as wanted.
        q: receives the motion [rad], (m, n), from row first + 1 on.
        how, bound: receive how each step came about and the proven clearance [m], (m,).

    Returns:
        The last row that was written.
    """
    m, n = wanted.shape
    v = np.zeros(n)
    out = np.zeros(2)
    before = times[1] - times[0]
    if first > 0:
        before = times[first] - times[first - 1]
        for i in range(n):
            v[i] = (q[first, i] - q[first - 1, i]) / before
    same = 0
    for t in range(first + 1, m):
        dt = times[t] - times[t - 1]
        skeleton = x[t] if len(x) > 0 else np.empty(0)
        how[t] = pursue(
            chain, swept, s, memory, q[t - 1], v, before, dt, bounds, care, wanted[t], skeleton,
            bone, W[min(t, len(W) - 1)], starts, anchor, rule, q[t], out,
        )  # fmt: skip
        bound[t] = out[0]
        same += 1
        for i in range(n):
            v[i] = (q[t, i] - q[t - 1, i]) / dt
            if q[t, i] != wanted[t, i]:
                same = 0
        before = dt
        if same >= 2 and t >= stop:
            return t
    return m - 1
