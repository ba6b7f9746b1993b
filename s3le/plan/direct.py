"""One step for joints alone: what each would do by itself, and what bodies leave of it; compiled.

Each joint chases the place where the motion that is wanted would come to rest if it braked now: so
it ends up on that motion, at its speed, and does not swing about it. If bodies are farther away
than is aimed at, at the end of the step and where the robot would come to rest, that is the step.
Else pairs are kept apart at both: a robot that moves makes the step nearest to that one; one that
hardly does, the step after which it would come to rest nearest to where it is wanted. Whatever it
is has to be proven; what cannot be is left to causal.advance.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import near_pairs, place_capsules
from s3le.kernels.kinematics import place
from s3le.kernels.qp import SOLVED, inverse_factor, solve
from s3le.plan.causal import BRAKED, LIMITED, Care, advance, brake, safe, search
from s3le.plan.chase import fastest, speeds, stopping
from s3le.plan.why import closest
from s3le.safety.curve import EPS

_SLOW = 0.5  # [rad/s], a robot whose joints are no faster hardly moves
_HALVES = 4  # times that a step that does not lead nearer is halved
_NEARER = 1e-9  # [rad^2], by how much it has to
_FINE = 0.03  # [rad/s], a round of the search that changes no joint's speed by more is the last


@compiled
def press(chain, balls, q, low, high, dt, bounds, care, end, W, c):
    """The step of a box after which the robot would come to rest nearest to a pose.

    Where a joint comes to rest moves by 1 + m times what the step does if it brakes in m rows
    more; so do what it costs and how far bodies are apart there.

    Args:
        chain, balls: the robot and distance.reach(chain).
        q: where the robot is [rad], (n,).
        low, high: the box [rad], (n,).
        dt: duration of the step [s].
        bounds, care: see causal.
        end: where the robot is to come to rest [rad], (n,).
        W: weights of the joints, (n, n).
        c: a pose of the box; receives the one that was found [rad], (n,).
    """
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    at = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    pairs = len(chain.pair)
    d = np.empty(2 * pairs)
    G = np.empty((2 * pairs, n))
    h = np.empty(2 * pairs)
    H = np.empty((n, n))
    factor = np.empty((n, n))
    g = np.empty(n)
    lower = np.empty(n)
    upper = np.empty(n)
    step = np.empty(n)
    rest = np.empty(n)
    times = np.ones(n)
    most = np.zeros(1)
    for _ in range(care.steps):
        moving = False
        for i in range(n):
            w, a = (c[i] - q[i]) / dt, bounds.acceleration[i]
            m = np.floor(abs(w) / (a * dt)) if a < np.inf else 0.0
            on = stopping(abs(w), a, dt)
            rest[i] = c[i] + on if w > 0.0 else c[i] - on
            times[i] = 1.0 + m
            moving = moving or m > 0.0
            lower[i] = low[i] - c[i]
            upper[i] = high[i] - c[i]
        for i in range(n):
            g[i] = 0.0
            for j in range(n):
                H[i, j] = W[i, j] * times[i] * times[j]
                g[i] += W[i, j] * times[i] * (rest[j] - end[j])
        place(chain, c, R, at, z)
        place_capsules(chain, R, at, ends)
        count = near_pairs(chain, ends, balls, at, z, care.target + care.band, d, G)
        if moving:
            place(chain, rest, R, at, z)
            place_capsules(chain, R, at, ends)
            more = near_pairs(
                chain, ends, balls, at, z, care.target + care.band, d[count:], G[count:]
            )  # fmt: skip
            for k in range(count, count + more):
                for i in range(n):
                    G[k, i] *= times[i]
            count += more
        if not inverse_factor(H, factor):
            return
        share = 1.0
        while True:
            for k in range(count):
                gap = care.target - d[k]
                h[k] = gap * share if gap > 0.0 else gap
            status = solve(factor, g, lower, upper, G, h, count, step, most)
            if status == SOLVED or share == 0.0:
                break
            share = share * 0.5 if share > 0.2 else 0.0
        if status != SOLVED:
            return
        size = 0.0
        for i in range(n):
            c[i] = min(max(c[i] + step[i], low[i]), high[i])
            size = max(size, abs(step[i]))
        if size < _FINE * dt:
            return


@compiled
def cost(q, to, dt, bounds, end, W):
    """What it costs that the robot comes to rest elsewhere than at a pose, after a step `to`.

    Args:
        q, to: where the step begins and ends [rad], (n,).
        dt, bounds, end, W: see press.
    """
    n = len(q)
    off = np.empty(n)
    for i in range(n):
        w = (to[i] - q[i]) / dt
        on = stopping(abs(w), bounds.acceleration[i], dt)
        off[i] = (to[i] + on if w > 0.0 else to[i] - on) - end[i]
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += off[i] * W[i, j] * off[j]
    return total


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
    end = np.empty(n)
    slow = True
    for i in range(n):
        slow = slow and abs(v[i]) <= max(1.01 * bounds.acceleration[i] * dt, _SLOW)
        a, most = bounds.acceleration[i] * (1.0 - EPS), bounds.speed[i] * (1.0 - EPS)
        least, greatest, _ = speeds(
            q[i], v[i], mean, dt, bounds.lower[i], bounds.upper[i], most, a
        )  # fmt: skip
        low[i] = min(max(q[i] + least * dt, bounds.lower[i]), bounds.upper[i])
        high[i] = min(max(q[i] + greatest * dt, bounds.lower[i]), bounds.upper[i])
        on = stopping(min(abs(rate[i]), most), a, dt)
        end[i] = want[i] + on if rate[i] > 0.0 else want[i] - on
        far = end[i] - q[i]
        w = fastest(abs(far), a, dt)
        c[i] = min(max(q[i] + (w if far > 0.0 else -w) * dt, low[i]), high[i])
        w = (c[i] - q[i]) / dt
        on = stopping(abs(w), a, dt)
        rest[i] = min(max(c[i] + (on if w > 0.0 else -on), bounds.lower[i]), bounds.upper[i])
    out[1] = 0.0
    to[:] = c
    if (
        closest(chain, swept.balls, c)[0] >= care.target
        and closest(chain, swept.balls, rest)[0] >= care.target
    ):
        slow = False
    elif not slow:
        plain = Care(
            care.target, care.margin, care.between, care.band, care.steps, care.budget, 0.0,
            care.curved,
        )  # fmt: skip
        search(
            chain, swept.balls, q, v, low, high, dt, bounds, plain, c, np.empty(0), bone, W, to
        )  # fmt: skip
    if slow:
        press(chain, swept.balls, q, low, high, dt, bounds, care, end, W, to)
        # Around bodies the way bends more than the search knows, and a robot that is pressed
        # against one would swing: only a step that leads nearer is made, else half of it.
        brake(q, v, mean, dt, bounds, c)
        least = cost(q, c, dt, bounds, end, W)
        for _ in range(_HALVES):
            if cost(q, to, dt, bounds, end, W) < least - _NEARER:
                break
            for i in range(n):
                to[i] = 0.5 * (to[i] + c[i])
        if not cost(q, to, dt, bounds, end, W) < least - _NEARER:
            to[:] = c
            if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
                return BRAKED
    if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
        return LIMITED
    return advance(
        chain, swept, s, q, v, before, dt, bounds, care, want, np.empty(0), bone, W, to, out
    )  # fmt: skip
