"""What kept a step from what was wanted: a joint, a limit, or two bodies; compiled."""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import clearance, place_capsules
from s3le.kernels.kinematics import place
from s3le.plan.causal import LIMITED, within
from s3le.plan.chase import fastest, speeds

JOINT, LIMIT, BODIES = range(3)  # kinds of causes
_THERE = 1e-6  # [rad], a joint as near as this is where it is wanted
_ALONE = 0.1  # [rad/s], by which a step may differ from that of joints without bodies
_NEAR = 1e-3  # [m] over what is aimed at; two bodies farther apart are not in the way


@compiled
def closest(chain, balls, q):
    """Least signed distance at q [m], and the row of the watched pair that has it."""
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    place(chain, q, R, p, z)
    place_capsules(chain, R, p, ends)
    return clearance(chain, ends, balls)


@compiled
def why(chain, balls, q, v, before, dt, bounds, target, how, want, to):
    """The cause of a step that does not lead to what was wanted.

    Args:
        chain, balls: the robot and distance.reach(chain).
        q, v: where the robot was [rad] and the speed of its last step [rad/s], (n,).
        before, dt: duration of the last step and of this one [s].
        bounds: a causal.Bounds.
        target: clearance that is aimed at [m].
        how: how the step came about, see causal.
        want, to: what was wanted, and what the answer was [rad], (n,).

    Returns:
        (kind, which): JOINT and the joint that has the longest way to go; LIMIT and the joint that
        is wanted farthest beyond its limits; BODIES and the watched pair that is nearest, at the
        end of the step or where the robot would come to rest: of the wanted step where the joints
        could make it, else of the one that was made.
    """
    n = len(q)
    mean = 0.5 * (before + dt)
    could = within(q, v, mean, dt, bounds, want)
    if could:
        to = want
    slowest, outside = -1, 0
    longest = beyond = off = 0.0
    rest = to.copy()
    for i in range(n):
        a = bounds.acceleration[i]
        goal = min(max(want[i], bounds.lower[i]), bounds.upper[i])
        left = abs(goal - to[i])
        takes = max(left / bounds.speed[i], np.sqrt(left / a))
        if left > _THERE and (takes > longest or slowest < 0):
            longest = takes
            slowest = i
        if abs(want[i] - goal) > beyond:
            beyond = abs(want[i] - goal)
            outside = i
        low, high, _ = speeds(
            q[i], v[i], mean, dt, bounds.lower[i], bounds.upper[i], bounds.speed[i], a
        )  # fmt: skip
        w = fastest(abs(goal - q[i]), a, dt)
        w = min(max(w if goal > q[i] else -w, low), high)
        now = (to[i] - q[i]) / dt
        off = max(off, abs(w - now))
        on = max(abs(now) - 0.5 * a * dt, 0.0) ** 2 / (2.0 * a) if a < np.inf else 0.0
        rest[i] = min(max(to[i] + (on if now > 0.0 else -on), bounds.lower[i]), bounds.upper[i])
    if slowest < 0 and not could:
        return LIMIT, outside
    if how == LIMITED and off <= _ALONE and not could:
        return JOINT, slowest
    gap, pair = closest(chain, balls, to)
    if gap > target + _NEAR:
        later, other = closest(chain, balls, rest)
        if later < gap:
            gap, pair = later, other
    if pair < 0 or (how == LIMITED and gap > target + _NEAR and not could):
        return JOINT, max(slowest, 0)
    return BODIES, pair
