"""Motions whose speed is continuous: rows of where the robot is and how fast, parabolas between.

A row is (q, v). From one to the next, dt later, each joint is accelerated evenly, so that

    q' = q + (v + v') dt / 2      and the parabola's control point is      c = q + v dt / 2.

Then c' = c + v' (dt + dt') / 2: control points move as the rows of a straight motion do, v' being
the speed of their step and (v' - v) / dt its change. So whatever looks for a step, or plans a
motion, does it on control points as it does on rows, with the same bounds: speeds and
accelerations of the curve are those of its control points at every moment, and it stays in their
box. What is measured and proven is the curve: this file. Compiled.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.poses import AGREEMENT
from s3le.kernels.solver import clearance_of
from s3le.safety import curve
from s3le.safety.rest import rests, within
from s3le.safety.segment import CERTIFIED, prove_curve


@compiled
def safe(chain, swept, s, c, v, to, lasts, dt, bounds, care, out):
    """Is the step between two control points proven, and a motion from its end to rest as well?

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        c, to: control points of this step and the next [rad], (n,).
        v: the speed at which it begins [rad/s], (n,).
        lasts: duration of the parabola about c [s].
        dt: time between the control points [s]; the parabola about the next takes what is left.
        bounds, care: see causal.
        out: receives [proven clearance of the path [m], more poses looked at].
    """
    n = len(c)
    w = np.empty(n)
    q = np.empty(n)
    end = np.empty(n)
    for i in range(n):
        w[i] = (to[i] - c[i]) / dt
        q[i] = c[i] - 0.5 * lasts * v[i]
        end[i] = c[i] + 0.5 * lasts * w[i]
    if not clearance_of(chain, swept.balls, end) >= care.margin + AGREEMENT:
        return False
    path = np.empty((curve.ROWS, n))
    curve.parabola(q, v, w, lasts, path)
    if not within(chain, path):
        return False
    found = prove_curve(chain, swept, s, path, care.between, care.budget)
    out[1] += found[6]
    if found[0] != CERTIFIED:
        return False
    bound = found[1]
    good, used = rests(
        chain, swept, s, end, w, bounds.acceleration, 2.0 * dt - lasts, care.margin, care.between,
        care.budget, path,
    )  # fmt: skip
    out[1] += used
    if not good:
        return False
    out[0] = bound
    return True


@compiled
def examine(
    chain, swept, s, c, dt, grid, bounds, care, first, last, clearance, proven, where, bound
):  # fmt: skip
    """Measure and prove what control points first to last - 1 complete.

    Row t, for t at least 1, is where the step from control point t - 1 to t is half done; there the
    robot is to keep the margin, and to have a proven stop. With it the parabola about control point
    t - 1 is complete, which begins at row t - 1.

    Args:
        chain, swept, s, bounds, care: see safe.
        c: control points [rad], (m, n).
        dt: duration of the parabola about each [s], (m,).
        grid: duration of the steps of a motion to rest [s].
        first, last: control points.
        clearance: receives that of each row [m], (m,); of row 0 that of row 1.
        proven: receives whether parabola and stop are proven, bool (m,); True for row 0.
        where: receives at which share of the parabola it failed, (m,).
        bound: receives the proven clearance of each parabola [m], (m,); NaN: none.
    """
    n = c.shape[1]
    v = np.empty(n)
    w = np.empty(n)
    q = np.empty(n)
    end = np.empty(n)
    path = np.empty((curve.ROWS, n))
    for t in range(first, last):
        proven[t] = True
        where[t] = 0.0
        row = max(t, 1)
        if row >= len(c):  # a motion of one control point stands
            clearance[t] = bound[t] = clearance_of(chain, swept.balls, c[t])
            continue
        for i in range(n):
            w[i] = (c[row, i] - c[row - 1, i]) / (0.5 * (dt[row - 1] + dt[row]))
            end[i] = c[row, i] - 0.5 * dt[row] * w[i]
        clearance[t] = bound[t] = clearance_of(chain, swept.balls, end)
        if t == 0:
            continue
        if t > 1:
            for i in range(n):
                v[i] = (c[t - 1, i] - c[t - 2, i]) / (0.5 * (dt[t - 2] + dt[t - 1]))
                q[i] = c[t - 1, i] - 0.5 * dt[t - 1] * v[i]
            curve.parabola(q, v, w, dt[t - 1], path)
            found = prove_curve(chain, swept, s, path, care.between, care.budget)
            proven[t] = found[0] == CERTIFIED
            bound[t] = found[1] if proven[t] else np.nan
            if not proven[t]:
                where[t] = found[3] if np.isfinite(found[3]) else 0.5 * (1.0 + found[2])
        if proven[t] and clearance[t] >= care.margin:
            proven[t] = rests(
                chain, swept, s, end, w, bounds.acceleration, grid, care.margin, care.between,
                care.budget, path,
            )[0]  # fmt: skip
            if not proven[t]:
                bound[t] = np.nan
                where[t] = 1.0
