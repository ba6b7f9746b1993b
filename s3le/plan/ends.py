"""How near to its limits a joint may get at speed, whatever steps come; compiled.

A joint at speed w after a step of dt that brakes at a goes on by no more than (w - a dt / 2)^2 /
2 a however long the steps to come are, and by all of it if they are infinitely short: rows of a
joint that brakes lie on one parabola. With steps as long as the last one (chase.stopping) it is
less, by up to a dt^2 / 8.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.plan.causal import ROUNDING
from s3le.plan.chase import stopping

_SPARE = 1e-6  # share of the way to a limit that is kept, so that no rounding exceeds it


@compiled
def within_reach(q, dt, bounds, low, high):
    """Narrow limits so that a joint that could stop before them in steps of dt can in any.

    Args:
        q: where the robot is [rad], (n,).
        dt: duration of the next step [s].
        bounds: a causal.Bounds.
        low, high: receive the limits that chase.fastest is to look at [rad], (n,).
    """
    for i in range(len(q)):
        low[i], high[i] = bounds.lower[i], bounds.upper[i]
        a = bounds.acceleration[i]
        if not a < np.inf:
            continue
        for side in range(2):
            room = q[i] - bounds.lower[i] if side == 0 else bounds.upper[i] - q[i]
            if room <= 0.5 * a * dt * dt:
                continue  # after this step it can stand still at once
            w = np.sqrt(2.0 * a * room) - 0.5 * a * dt
            far = (w * dt + stopping(w, a, dt)) * (1.0 - _SPARE)
            if side == 0:
                low[i] = q[i] - far
            else:
                high[i] = q[i] + far


@compiled
def allowed(q, v, to, mean, dt, bounds):
    """Is a step within limits, speed and acceleration, whatever looked for it?

    Args:
        q, v: where the robot is [rad] and the speed of its last step [rad/s], (n,).
        to: where the step leads [rad], (n,).
        mean: of the last step's and this one's duration [s].
        dt: duration of this one [s].
        bounds: a causal.Bounds.
    """
    for i in range(len(q)):
        w = (to[i] - q[i]) / dt
        if not (  # written so that NaN is refused
            bounds.lower[i] <= to[i] <= bounds.upper[i]
            and abs(w) <= bounds.speed[i] * (1.0 + ROUNDING)
            and abs(w - v[i]) <= bounds.acceleration[i] * mean * (1.0 + ROUNDING)
        ):
            return False
    return True
