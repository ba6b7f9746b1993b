"""One step towards a wanted pose, and always a proven way to stop; compiled.

The robot stands at q and came there at speed v. What speed and acceleration allow next is a box.
If the wanted pose is in it, and the path there is proven, and so is the way on which every joint
then brakes as hard as it may, it is taken as it is. Else the pose of the box is looked for whose
skeleton, or whose joints, are nearest, with pairs kept apart both there and where the robot would
come to rest. If its paths cannot be proven: part of the way from the braking step to it; and at
last the braking step itself, which was proven with the step before.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import near_pairs, place_capsules
from s3le.kernels.kinematics import bones, place
from s3le.kernels.poses import AGREEMENT, inside
from s3le.kernels.qp import SOLVED, inverse_factor, solve
from s3le.kernels.solver import clearance_of
from s3le.plan import curved
from s3le.plan.chase import fastest, further, speeds
from s3le.safety.curve import EPS
from s3le.safety.segment import CERTIFIED, prove

WANTED, LIMITED, SHORTENED, BRAKED, HELD = range(5)  # how a step came about

ROUNDING = 1e-9  # share by which a speed or acceleration may exceed its limit: of floats
_PARTS = 4  # parts of the way to the refused pose that are tried
_AIM = 0.03  # [s], steps in which the way is counted that a braking joint goes on, at least: with
# shorter ones a joint would be slowed down for a wanted pose that moves on before it is reached
_LONG = 64  # most rows of a braking motion that are looked at


class Bounds(NamedTuple):
    """What each joint may do, (n,)."""

    lower: np.ndarray  # [rad]
    upper: np.ndarray  # [rad]
    speed: np.ndarray  # [rad/s]
    acceleration: np.ndarray  # [rad/s^2]


class Care(NamedTuple):
    """How a step is looked for and proven."""

    target: float  # [m], clearance that is aimed at
    margin: float  # [m], clearance that every pose keeps
    between: float  # [m], clearance that every path keeps
    band: float  # [m], pairs farther than this over the target are left out
    steps: int  # most iterations of a search
    budget: int  # most poses that a proof looks at
    lead: float  # share of the way on which it would brake that counts as gone already
    curved: bool  # poses are control points of a curve (plan/curved.py); False: rows themselves


@compiled
def brake(q, v, mean, dt, bounds, out):
    """The step on which every joint slows down as much as it may, into out (n,); True: it moves."""
    some = False
    for i in range(len(q)):
        slower = max(abs(v[i]) - bounds.acceleration[i] * (1.0 - EPS) * mean, 0.0)
        out[i] = q[i]
        if slower > 0.0:
            some = True
            far = slower * dt
            out[i] = q[i] + far if v[i] > 0.0 else q[i] - far
            out[i] = min(max(out[i], bounds.lower[i]), bounds.upper[i])
    return some


@compiled
def within(q, v, mean, dt, bounds, to):
    """Is the pose `to` (n,) where speed, acceleration, limits, and stopping before them allow?"""
    for i in range(len(q)):
        if not bounds.lower[i] <= to[i] <= bounds.upper[i]:
            return False
        w = (to[i] - q[i]) / dt
        if not abs(w) <= bounds.speed[i] * (1.0 + ROUNDING):
            return False
        if not abs(w - v[i]) <= bounds.acceleration[i] * mean * (1.0 + ROUNDING):
            return False
        room = bounds.upper[i] - q[i] if w > 0.0 else q[i] - bounds.lower[i]
        most = fastest(room, bounds.acceleration[i], dt)
        if not abs(w) <= most * (1.0 + ROUNDING) + 1e-12:
            return False
    return True


@compiled
def clear(chain, swept, s, q0, q1, care, out):
    """Does q1 keep the margin, and the path to it? Its proven clearance into out[0] [m]."""
    if not clearance_of(chain, swept.balls, q1) >= care.margin + AGREEMENT:
        return False
    found = prove(chain, swept, s, q0, q1, care.between, care.budget)
    out[1] += found[6]
    if found[0] != CERTIFIED:
        return False
    out[0] = found[1]
    return True


@compiled
def safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
    """Is the step from q to `to` proven, and a braking motion from there to rest as well?"""
    if care.curved:
        return curved.safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out)
    if not clear(chain, swept, s, q, to, care, out):
        return False
    n = len(q)
    bound = out[0]
    here = to.copy()
    then = np.empty(n)
    w = np.empty(n)
    for i in range(n):
        w[i] = (to[i] - q[i]) / dt
    for _ in range(_LONG):
        if not brake(here, w, dt, dt, bounds, then):
            out[0] = bound
            return True
        if not clear(chain, swept, s, here, then, care, out):
            return False
        for i in range(n):
            w[i] = (then[i] - here[i]) / dt
            here[i] = then[i]
    return False


@compiled
def search(chain, balls, q, v, low, high, dt, bounds, care, want, x, bone, W, c):
    """The pose of a box that is nearest to what is wanted, pairs kept apart.

    Args:
        chain, balls: the robot and distance.reach(chain).
        q: where the robot is [rad], (n,).
        v: its last speed [rad/s], (n,).
        low, high: the box [rad], (n,).
        dt: duration of the step [s].
        bounds, care: see there.
        want: [rad], (n,).
        x: skeleton wanted, (21,); of length 0: none.
        bone: weights of its components, (21,).
        W: weights of the joints, (n, n).
        c: receives the pose [rad], (n,).
    """
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    at = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    seen = np.empty(21)
    J = np.empty((21, n))
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
    goal = np.empty(n)
    times = np.ones(n)
    most = np.zeros(1)
    for i in range(n):
        c[i] = min(max(want[i], low[i]), high[i])
    for _ in range(care.steps):
        moving = False
        for i in range(n):
            w = (c[i] - q[i]) / dt
            unit = bounds.acceleration[i] * dt
            m = np.floor(abs(w) / unit) if unit < np.inf else 0.0
            rest[i] = c[i] + further(w, bounds.acceleration[i], dt)
            times[i] = 1.0 + m
            moving = moving or m > 0.0
            goal[i] = c[i] + care.lead * further(w, bounds.acceleration[i], max(dt, _AIM))
            lower[i] = low[i] - c[i]
            upper[i] = high[i] - c[i]
        for i in range(n):
            g[i] = 0.0
            for j in range(n):
                H[i, j] = W[i, j]
                g[i] += W[i, j] * (goal[j] - want[j])
        place(chain, goal, R, at, z)
        if len(x) > 0:
            bones(chain, R, at, z, seen, J)
            for k in range(21):
                off = bone[k] * (seen[k] - x[k])
                for i in range(n):
                    g[i] += J[k, i] * off
                    e = bone[k] * J[k, i]
                    for j in range(n):
                        H[i, j] += e * J[k, j]
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
            break
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
            break
        size = 0.0
        for i in range(n):
            c[i] = min(max(c[i] + step[i], low[i]), high[i])
            size = max(size, abs(step[i]))
        if size < 2e-3:
            break


@compiled
def straight(q, low, high, to):
    """Shorten the straight step from q to `to` (n,), to end in the box; False: it cannot."""
    least, most = 0.0, 1.0
    for i in range(len(q)):
        far = to[i] - q[i]
        if far == 0.0:
            if not low[i] <= q[i] <= high[i]:
                return False
            continue
        one, other = (low[i] - q[i]) / far, (high[i] - q[i]) / far
        least = max(least, min(one, other))
        most = min(most, max(one, other))
    if not (least <= most and most > 0.0):
        return False
    for i in range(len(q)):
        to[i] = min(max(q[i] + most * (to[i] - q[i]), low[i]), high[i])
    return True


@compiled
def advance(
    chain, swept, s, q, v, before, dt, bounds, care, want, x, bone, W, to, out
):  # fmt: skip
    """One step.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        q: where the robot is [rad], (n,), certified.
        v: speed of its last step [rad/s], (n,).
        before, dt: duration of the last step and of this one [s].
        bounds, care: see there.
        want, x, bone, W: see search.
        to: receives the pose to go to [rad], (n,).
        out: receives [proven clearance of the path [m], poses looked at in proofs].

    Returns:
        WANTED, LIMITED (as near as the joints get), SHORTENED (part of the way), BRAKED, or HELD:
        all joints stand still at once, which is proven, but may be a change of speed that is
        greater than allowed.
    """
    n = len(q)
    mean = 0.5 * (before + dt)
    out[1] = 0.0
    if within(q, v, mean, dt, bounds, want):
        to[:] = want
        if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
            return WANTED
    low = np.empty(n)
    high = np.empty(n)
    fits = True
    for i in range(n):
        least, most, good = speeds(
            q[i], v[i], mean, dt, bounds.lower[i], bounds.upper[i],
            bounds.speed[i] * (1.0 - EPS), bounds.acceleration[i] * (1.0 - EPS),
        )  # fmt: skip
        fits = fits and good
        low[i] = min(max(q[i] + least * dt, bounds.lower[i]), bounds.upper[i])
        high[i] = min(max(q[i] + most * dt, bounds.lower[i]), bounds.upper[i])
    c = np.empty(n)
    search(
        chain, swept.balls, q, v, low, high, dt, bounds, care, want, x, bone, W, c
    )  # fmt: skip
    if inside(c, low, high):
        to[:] = c
        if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
            return LIMITED
    b = np.empty(n)
    brake(q, v, mean, dt, bounds, b)
    for i in range(n):
        to[i] = want[i]
    # Where the joints are what counts, the straight way may be free though the nearest one is not.
    if len(x) == 0 and straight(q, low, high, to):
        if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
            return SHORTENED
    share = 0.5
    for _ in range(_PARTS):
        for i in range(n):
            to[i] = min(max(b[i] + share * (c[i] - b[i]), low[i]), high[i])
        if inside(to, low, high) and safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
            return SHORTENED
        share *= 0.4
    to[:] = b
    if safe(chain, swept, s, q, v, to, mean, dt, bounds, care, out):
        return BRAKED
    to[:] = q
    found = prove(chain, swept, s, q, q, care.between, care.budget)
    out[0] = found[1]
    return HELD
