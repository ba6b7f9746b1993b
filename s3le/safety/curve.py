"""The ways that joints move from one moment to another, each a polynomial in time; compiled.

A path is told by 6 numbers a joint, over t from 0 to 1: it starts at an angle, at a rate, and

    q'' = first up to t = one,   q'' = second from there to t = two,   and then the joint stands.

A straight path has q'' = 0. A step from (q, v) to (q', v') is one parabola, which has to meet both:
q' - q = (v + v') dt / 2. A stop brakes as hard as the joint may for as many steps of dt as fill,
and what is left of its speed in one more, so that rows dt apart have one parabola between two.
"""

import numpy as np

from s3le.kernels.compiled import compiled

START, RATE, FIRST, ONE, SECOND, TWO = range(6)  # rows of a path (6, n)
ROWS = 6


@compiled
def straight(q0, q1, path):
    """The straight path from q0 to q1 [rad], (n,), into path (6, n)."""
    for i in range(len(q0)):
        path[START, i] = q0[i]
        path[RATE, i] = q1[i] - q0[i]
        path[FIRST, i] = path[SECOND, i] = 0.0
        path[ONE, i] = path[TWO, i] = 1.0


@compiled
def parabola(q, v, w, dt, path):
    """The step of dt [s] that begins at q [rad], at speed v, and ends at speed w [rad/s]."""
    for i in range(len(q)):
        path[START, i] = q[i]
        path[RATE, i] = v[i] * dt
        path[FIRST, i] = (w[i] - v[i]) * dt
        path[SECOND, i] = 0.0
        path[ONE, i] = path[TWO, i] = 1.0


@compiled
def stop(q, v, acceleration, dt, path):
    """The motion from (q, v) to rest, each joint by itself; how long it takes [s], 0: it rests.

    Args:
        q, v: angles [rad] and speeds [rad/s], (n,).
        acceleration: of each joint [rad/s^2], (n,); inf: it stops within dt.
        dt: duration of the steps in which it is driven [s].
        path: receives it, (6, n), over the whole of that time.
    """
    longest = 0.0
    for i in range(len(q)):
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
        path[SECOND, i] = back * left / dt * longest * longest
        if longest > 0.0:
            path[ONE, i] /= longest
            path[TWO, i] /= longest
    return longest


@compiled
def position(path, t, q):
    """Angles at t, into q [rad], (n,)."""
    for i in range(len(q)):
        one = min(t, path[ONE, i])
        rate = path[RATE, i] + path[FIRST, i] * one
        two = min(t, path[TWO, i]) - one
        q[i] = path[START, i] + one * (path[RATE, i] + 0.5 * path[FIRST, i] * one)
        if two > 0.0:
            q[i] += two * (rate + 0.5 * path[SECOND, i] * two)


@compiled
def rate(path, t, w):
    """dq/dt at t, into w (n,)."""
    for i in range(len(w)):
        one = min(t, path[ONE, i])
        w[i] = path[RATE, i] + path[FIRST, i] * one
        if t >= path[TWO, i] and path[TWO, i] < 1.0:
            w[i] = 0.0
        elif t > one:
            w[i] += path[SECOND, i] * (t - one)


@compiled
def extremes(path, fastest, bent):
    """The greatest |dq/dt| and |q''| of each joint on the whole path, (n,); NaN stays NaN."""
    for i in range(len(fastest)):
        one, two = path[ONE, i], path[TWO, i] - path[ONE, i]
        between = path[RATE, i] + path[FIRST, i] * one
        fastest[i] = max(abs(path[RATE, i]), abs(between))
        bent[i] = abs(path[FIRST, i]) if one > 0.0 else 0.0
        if two > 0.0:
            fastest[i] = max(fastest[i], abs(between + path[SECOND, i] * two))
            bent[i] = max(bent[i], abs(path[SECOND, i]))
        if not np.isfinite(path[START, i] + path[RATE, i] + path[FIRST, i] + path[SECOND, i]):
            fastest[i] = bent[i] = np.nan


@compiled
def span(path, low, high):
    """The least and the greatest angle of each joint on the path [rad], (n,)."""
    ends = np.empty(4)
    for i in range(len(low)):
        one, two = path[ONE, i], path[TWO, i]
        first, second = path[FIRST, i], path[SECOND, i]
        between = path[RATE, i] + first * one
        at_one = path[START, i] + one * (path[RATE, i] + 0.5 * first * one)
        ends[0] = path[START, i]
        ends[1] = at_one
        ends[2] = at_one + (two - one) * (between + 0.5 * second * (two - one))
        ends[3] = ends[0]
        low[i], high[i] = ends.min(), ends.max()
        for part in range(2):  # where it turns back
            begin = path[START, i] if part == 0 else at_one
            speed, bend = (path[RATE, i], first) if part == 0 else (between, second)
            length = one if part == 0 else two - one
            turn = -speed / bend if bend != 0.0 else -1.0
            if 0.0 < turn < length:
                low[i] = min(low[i], begin + 0.5 * speed * turn)
                high[i] = max(high[i], begin + 0.5 * speed * turn)
