"""The ways that joints move from one moment to another, each a polynomial in time; compiled.

A path is told by 7 numbers a joint, over t from 0 to 1: it starts at an angle, at a rate, and

    q'' = first + jerk t up to t = one,   q'' = second from there to t = two,   then it stands.

A straight path has q'' = 0. A step from (q, v) to (q', v') is the cubic that meets both, as every
controller takes it that is given positions and speeds; where q' - q = (v + v') dt / 2 it is a
parabola. A stop brakes as hard as the joint may for as many steps of dt as fill, and what is left
of its speed in one more, so that rows dt apart have one parabola between two.
"""

import numpy as np

from s3le.kernels.compiled import compiled

START, RATE, FIRST, JERK, ONE, SECOND, TWO = range(7)  # rows of a path (7, n)
ROWS = 7
EPS = 1e-7  # share of every limit that is not used, so that no rounding exceeds it
BEYOND = 1e-9  # [rad], by which a joint may be beyond its limit between rows: of floats


@compiled
def straight(q0, q1, path):
    """The straight path from q0 to q1 [rad], (n,), into path (7, n)."""
    for i in range(len(q0)):
        path[START, i] = q0[i]
        path[RATE, i] = q1[i] - q0[i]
        path[FIRST, i] = path[JERK, i] = path[SECOND, i] = 0.0
        path[ONE, i] = path[TWO, i] = 1.0


@compiled
def parabola(q, v, w, dt, path):
    """The step of dt [s] that begins at q [rad], at speed v, and ends at speed w [rad/s]."""
    for i in range(len(q)):
        path[START, i] = q[i]
        path[RATE, i] = v[i] * dt
        path[FIRST, i] = (w[i] - v[i]) * dt
        path[JERK, i] = path[SECOND, i] = 0.0
        path[ONE, i] = path[TWO, i] = 1.0


@compiled
def cubic(q0, v0, q1, v1, dt, path):
    """The step of dt [s] from q0 [rad] at speed v0 [rad/s] to q1 at speed v1."""
    for i in range(len(q0)):
        far, begin, end = q1[i] - q0[i], v0[i] * dt, v1[i] * dt
        path[START, i] = q0[i]
        path[RATE, i] = begin
        path[FIRST, i] = 6.0 * far - 4.0 * begin - 2.0 * end
        path[JERK, i] = 6.0 * (begin + end) - 12.0 * far
        path[SECOND, i] = 0.0
        path[ONE, i] = path[TWO, i] = 1.0


@compiled
def stop(q, v, acceleration, dt, path):
    """The motion from (q, v) to rest, each joint by itself; how long it takes [s].

    0: it rests; NaN: there is none, for a number is not finite.

    Args:
        q, v: angles [rad] and speeds [rad/s], (n,).
        acceleration: of each joint [rad/s^2], (n,); inf: it stops within dt.
        dt: duration of the steps in which it is driven [s].
        path: receives it, (7, n), over the whole of that time.
    """
    longest = 0.0
    for i in range(len(q)):
        if not (abs(v[i]) < np.inf and abs(q[i]) < np.inf):
            return np.nan
        whole = np.floor(abs(v[i]) / (acceleration[i] * dt)) if acceleration[i] < np.inf else 0.0
        left = abs(v[i]) - (whole * acceleration[i] * dt if whole > 0.0 else 0.0)
        path[ONE, i] = whole * dt
        path[TWO, i] = whole * dt + (dt if left > 0.0 else 0.0)
        longest = max(longest, path[TWO, i])
    for i in range(len(q)):
        a = acceleration[i] if path[ONE, i] > 0.0 else 0.0
        left = max(abs(v[i]) - a * path[ONE, i], 0.0)
        back = -1.0 if v[i] > 0.0 else 1.0
        path[START, i] = q[i]
        path[RATE, i] = v[i] * longest
        path[FIRST, i] = back * a * longest * longest
        path[JERK, i] = 0.0
        path[SECOND, i] = back * left / dt * longest * longest
        if longest > 0.0:
            path[ONE, i] /= longest
            path[TWO, i] /= longest
    return longest


@compiled
def position(path, t, q):
    """Angles at t, into q [rad], (n,)."""
    for i in range(len(q)):
        first, jerk = path[FIRST, i], path[JERK, i]
        one = min(t, path[ONE, i])
        two = min(t, path[TWO, i]) - one
        q[i] = path[START, i] + one * (path[RATE, i] + one * (0.5 * first + one * jerk / 6.0))
        if two > 0.0:
            rate = path[RATE, i] + one * (first + 0.5 * jerk * one)
            q[i] += two * (rate + 0.5 * path[SECOND, i] * two)


@compiled
def speed(path, t, w):
    """dq/dt at t, into w (n,)."""
    for i in range(len(w)):
        one = min(t, path[ONE, i])
        w[i] = path[RATE, i] + one * (path[FIRST, i] + 0.5 * path[JERK, i] * one)
        if t >= path[TWO, i] and path[TWO, i] < 1.0:
            w[i] = 0.0
        elif t > one:
            w[i] += path[SECOND, i] * (t - one)


@compiled
def extremes(path, fastest, bent):
    """The greatest |dq/dt| and |q''| of each joint on the whole path, (n,); NaN stays NaN."""
    for i in range(len(fastest)):
        one, two = path[ONE, i], path[TWO, i] - path[ONE, i]
        begin, first, jerk = path[RATE, i], path[FIRST, i], path[JERK, i]
        between = begin + one * (first + 0.5 * jerk * one)
        fastest[i] = max(abs(begin), abs(between))
        bent[i] = max(abs(first), abs(first + jerk * one)) if one > 0.0 else 0.0
        turn = -first / jerk if jerk != 0.0 else -1.0
        if 0.0 < turn < one:
            fastest[i] = max(fastest[i], abs(begin + 0.5 * first * turn))
        if two > 0.0:
            fastest[i] = max(fastest[i], abs(between + path[SECOND, i] * two))
            bent[i] = max(bent[i], abs(path[SECOND, i]))
        if not np.isfinite(path[START, i] + begin + first + jerk + path[SECOND, i]):
            fastest[i] = bent[i] = np.nan


@compiled
def span(path, low, high):
    """The least and the greatest angle of each joint on the path [rad], (n,)."""
    n = len(low)
    here = np.empty(n)
    position(path, 0.0, low)
    high[:] = low
    for share in (0.5, 1.0):
        position(path, share, here)
        for i in range(n):
            low[i], high[i] = min(low[i], here[i]), max(high[i], here[i])
    for i in range(n):
        one, two = path[ONE, i], path[TWO, i] - path[ONE, i]
        q, v, a, j = path[START, i], path[RATE, i], path[FIRST, i], path[JERK, i]
        end = q + one * (v + one * (0.5 * a + one * j / 6.0))
        low[i], high[i] = min(low[i], end), max(high[i], end)
        # Where it turns back: v + a t + j t^2 / 2 = 0, its two roots without cancelling.
        inner = a * a - 2.0 * j * v
        if inner >= 0.0:
            half = -(a + (np.sqrt(inner) if a > 0.0 else -np.sqrt(inner)))
            for turn in (half / j if j != 0.0 else -1.0, 2.0 * v / half if half != 0.0 else -1.0):
                if 0.0 < turn < one:
                    here[i] = q + turn * (v + turn * (0.5 * a + turn * j / 6.0))
                    low[i], high[i] = min(low[i], here[i]), max(high[i], here[i])
        between, second = v + one * (a + 0.5 * j * one), path[SECOND, i]
        turn = -between / second if second != 0.0 else -1.0
        if 0.0 < turn < two:
            here[i] = end + 0.5 * between * turn
            low[i], high[i] = min(low[i], here[i]), max(high[i], here[i])


@compiled
def steps(q, v, dt, fastest, bent, low, high):
    """Greatest speed and acceleration, least and greatest angle, of each step between rows.

    Args:
        q, v: rows [rad], [rad/s], (m, n).
        dt: from row to row [s], (m - 1,).
        fastest, bent, low, high: receive them [rad/s], [rad/s^2], [rad], [rad], (m - 1, n).
    """
    path = np.empty((ROWS, q.shape[1]))
    for k in range(len(dt)):
        cubic(q[k], v[k], q[k + 1], v[k + 1], dt[k], path)
        extremes(path, fastest[k], bent[k])
        fastest[k] /= dt[k]
        bent[k] /= dt[k] * dt[k]
        span(path, low[k], high[k])


@compiled
def sample(q, v, time, left, at, q_at, v_at):
    """Angles and speeds at given moments of a motion that is told by rows.

    Args:
        q, v, time: rows [rad], [rad/s], (m, n), and when they are [s], (m,).
        left: row that each moment comes after, or is, int (k,).
        at: the moments [s], (k,).
        q_at, v_at: receive them, (k, n).
    """
    path = np.empty((ROWS, q.shape[1]))
    for k in range(len(at)):
        i = left[k]
        dt = time[i + 1] - time[i]
        cubic(q[i], v[i], q[i + 1], v[i + 1], dt, path)
        share = min(max((at[k] - time[i]) / dt, 0.0), 1.0)
        position(path, share, q_at[k])
        speed(path, share, v_at[k])
        v_at[k] /= dt
