"""One step for joints alone: what each would do by itself, and what bodies leave of it; compiled.

Each joint chases the place where the motion that is wanted would come to rest if it braked now: so
it ends up on that motion, at its speed, and does not swing about it. If bodies are farther away
than is aimed at, at the end of the step and where the robot would come to rest, that is the step.
Else the pose nearest to it is looked for with pairs kept apart. Whatever it is has to be proven;
what cannot be is left to causal.advance.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.plan.causal import _EPS, LIMITED, Care, advance, safe, search
from s3le.plan.chase import fastest, speeds, stopping
from s3le.plan.why import closest


@compiled
def direct(chain, swept, s, q, v, before, dt, bounds, care, want, rate, bone, W, to, out):
    """One step; arguments and result as of causal.advance, or WANTED never; and this.

    Args:
        rate: how fast what is wanted moves [rad/s], (n,).
    """
    n = len(q)
    mean = 0.5 * (before + dt)
    low = np.empty(n)
    high = np.empty(n)
    rest = np.empty(n)
    c = np.empty(n)
    for i in range(n):
        a, most = bounds.acceleration[i] * (1.0 - _EPS), bounds.speed[i] * (1.0 - _EPS)
        least, greatest, _ = speeds(
            q[i], v[i], mean, dt, bounds.lower[i], bounds.upper[i], most, a
        )  # fmt: skip
        low[i] = min(max(q[i] + least * dt, bounds.lower[i]), bounds.upper[i])
        high[i] = min(max(q[i] + greatest * dt, bounds.lower[i]), bounds.upper[i])
        on = stopping(min(abs(rate[i]), most), a, dt)
        far = want[i] + (on if rate[i] > 0.0 else -on) - q[i]
        w = fastest(abs(far), a, dt)
        c[i] = min(max(q[i] + (w if far > 0.0 else -w) * dt, low[i]), high[i])
        w = (c[i] - q[i]) / dt
        on = stopping(abs(w), a, dt)
        rest[i] = min(max(c[i] + (on if w > 0.0 else -on), bounds.lower[i]), bounds.upper[i])
    out[1] = 0.0
    to[:] = c
    if not (
        closest(chain, swept.balls, c)[0] >= care.target
        and closest(chain, swept.balls, rest)[0] >= care.target
    ):
        plain = Care(
            care.target, care.margin, care.between, care.band, care.steps, care.budget, 0.0
        )  # fmt: skip
        search(
            chain, swept.balls, q, v, low, high, dt, bounds, plain, c, np.empty(0), bone, W, to
        )  # fmt: skip
    if safe(chain, swept, s, q, to, dt, bounds, care, out):
        return LIMITED
    return advance(
        chain, swept, s, q, v, before, dt, bounds, care, want, np.empty(0), bone, W, to, out
    )  # fmt: skip
