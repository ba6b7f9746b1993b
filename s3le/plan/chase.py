"""How fast a joint may go so that it can still stop, and a joint that chases what is wanted.

Rows in time, dt apart; the speed of a step is the difference of its rows over dt, and from step to
step it changes by no more than a times the mean of the two dt. A joint at speed v that brakes goes
on by dt ((v - a dt) + (v - 2 a dt) + ...) if the steps to come are as long as this one. Compiled.
"""

import numpy as np

from s3le.kernels.compiled import compiled


@compiled
def stopping(v, a, dt):
    """How far a joint gets after a step at speed v >= 0 [rad/s] if it brakes from then on [rad]."""
    if not a < np.inf:
        return 0.0
    m = np.floor(v / (a * dt))
    return dt * (m * v - 0.5 * a * dt * m * (m + 1.0))


@compiled
def further(w, acceleration, dt):
    """How far a joint at speed w [rad/s] goes on [rad] while it brakes in steps of dt."""
    unit = acceleration * dt
    if not unit < np.inf:
        return 0.0
    m = np.floor(abs(w) / unit)
    far = dt * (m * abs(w) - 0.5 * unit * m * (m + 1.0))
    return far if w > 0.0 else -far


@compiled
def fastest(far, a, dt):
    """Greatest speed [rad/s] of a step after which a joint can stop within far >= 0 [rad]."""
    if not a < np.inf:
        return far / dt
    unit = a * dt * dt
    m = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * far / unit) - 1.0))
    return (far / dt + 0.5 * a * dt * m * (m + 1.0)) / (m + 1.0)


@compiled
def speeds(q, v, mean, dt, lower, upper, most, a):
    """Least and greatest speed of the next step [rad/s], and whether all limits left a choice.

    Args:
        q, v: angle [rad] and speed of the last step [rad/s].
        mean: of the last step's and the next step's duration [s].
        dt: duration of the next step [s].
        lower, upper: limits [rad].
        most: speed [rad/s].
        a: acceleration [rad/s^2].
    """
    low = max(-most, v - a * mean)
    high = min(most, v + a * mean)
    down = -fastest(max(q - lower, 0.0), a, dt)
    up = fastest(max(upper - q, 0.0), a, dt)
    if low > up or high < down or low > high:  # it cannot stop in time: the ends of the range win
        still = min(max(min(max(0.0, low), high), down), up)
        return still, still, False
    return max(low, down), min(high, up), True


@compiled
def chase(times, wanted, lower, upper, speed, acceleration, spare, given, q):
    """Each joint alone after what is wanted, within its limits, stopping where it is wanted.

    Args:
        times: [s], (m,), rising; may fall, for a motion told backwards.
        wanted: [rad], (m, n), m at least 1.
        lower, upper, speed, acceleration: limits, (n,).
        spare: share of speed and acceleration that is not used.
        given: rows of q that are given, 0 or 2, from which it goes on.
        q: receives the motion [rad], (m, n).
    """
    m, n = wanted.shape
    for i in range(n):
        most, a = speed[i] * (1.0 - spare), acceleration[i] * (1.0 - spare)
        here = min(max(wanted[0, i], lower[i]), upper[i])
        v = 0.0
        before = 0.0
        first = 1
        if given == 2:
            before = abs(times[1] - times[0])
            here = q[1, i]
            v = (q[1, i] - q[0, i]) / before
            first = 2
        else:
            q[0, i] = here
        for t in range(first, m):
            dt = abs(times[t] - times[t - 1])
            if t == 1:  # nothing went before: any speed
                low, high, _ = speeds(here, 0.0, 1e9, dt, lower[i], upper[i], most, a)
            else:
                low, high, _ = speeds(
                    here, v, 0.5 * (dt + before), dt, lower[i], upper[i], most, a
                )  # fmt: skip
            far = wanted[t, i] - here
            v = fastest(abs(far), a, dt)
            v = min(max(v if far > 0.0 else -v, low), high)
            here = min(max(here + v * dt, lower[i]), upper[i])
            q[t, i] = here
            before = dt
