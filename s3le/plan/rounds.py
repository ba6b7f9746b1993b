"""The nearest motion in a window of time: Gauss-Newton rounds about the interior-point method.

Each round linearises the skeleton and the clearances of pairs that come near, at the motion that
the round before found, and solves the program that this makes. Limits, speeds and accelerations
are linear as they are, so that every round keeps them. What a round does is compiled; that there
are rounds is not, since everything compiled anew around everything else is what takes long.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels import batch
from s3le.kernels.compiled import compiled
from s3le.kernels.distance import near_pairs, place_capsules
from s3le.kernels.kinematics import bones, place
from s3le.plan.chase import further
from s3le.plan.interior import improve, warm, warm_rows
from s3le.robot.chain import Chain
from s3le.safety.curve import EPS
from s3le.skeleton import DIM

MORE = 24  # linearised clearances a frame that there is room for, in the mean
_LAST = 25  # most iterations after the last linearisation


class Aim(NamedTuple):
    """What a motion is to be near to, and what it costs not to be; one entry a frame."""

    wanted: np.ndarray  # [rad], (m, n)
    x: np.ndarray  # (m, 21), skeleton of the wanted pose; (0, 21): there is none
    bone: np.ndarray  # (21,), weights of the skeleton's components
    W: np.ndarray  # (m or 1, n, n), weights of the joints beside it
    whole: np.ndarray  # [rad], (m, N), poses of all joints of the chain; those of ours are not read
    own: np.ndarray  # int64 (n,), which of the N are ours; all, where nobody else moves any


def cost(chain: Chain, aim: Aim, part: slice, q: np.ndarray) -> float:
    """What some rows of a motion are off from what is wanted.

    Args:
        chain: the robot.
        aim: of the whole motion.
        part: which rows of it.
        q: these [rad], (k, n).
    """
    off = q - aim.wanted[part]
    W = aim.W[part] if len(aim.W) > 1 else aim.W
    total = float((off[:, None, :] @ W @ off[:, :, None]).sum())
    if len(aim.x):
        x = np.empty((len(off), DIM))
        batch._skeletons(chain, q, x)
        total += float((aim.bone * np.square(x - aim.x[part])).sum())
    return 0.5 * total


class Custom(NamedTuple):
    """How planning is done."""

    band: float  # [m], pairs farther than this over the target are left out
    soft: float  # stiffness of the clearances in the first round, [1/m^2],
    stiff: float  # and in the last; what lacks e costs half of it times e^2
    steady: float  # weight of the squared second differences
    small: float  # product of slack and multiplier at which a solve ends
    rounds: int  # most linearisations
    inner: int  # most iterations of each solve
    fine: float  # [rad], a round that moves no joint farther is the last one


@compiled
def bound(p, m, times, lasts, lower, upper, speed, acceleration):
    """Write the limits of a window into its program.

    Args:
        p: the program; fixed says which frames count as given.
        m: frames in use.
        times: [s], (m,), rising.
        lasts: time in which the speed changes at each frame [s], (m,).
        lower, upper: [rad], (n,).
        speed: [rad/s], (n,); inf: any.
        acceleration: [rad/s^2], (n,); inf: any.
    """
    n = len(lower)
    p.coef[:m] = 0.0
    p.on[:m] = False
    for t in range(m):
        p.on[t, 0] = not p.fixed[t]
        p.coef[t, 0, 1] = 1.0
        room = 1.0
        for i in range(n):
            ease = EPS * (upper[i] - lower[i])
            p.low[t, 0, i] = lower[i] + ease
            p.high[t, 0, i] = upper[i] - ease
        if t > 0:
            dt = times[t] - times[t - 1]
            p.on[t, 1] = not (p.fixed[t] and p.fixed[t - 1])
            p.coef[t, 1, 0] = -1.0
            p.coef[t, 1, 1] = 1.0
            for i in range(n):
                most = min(speed[i] * dt, 1e3) * (1.0 - EPS)
                p.low[t, 1, i] = -most
                p.high[t, 1, i] = most
        if 0 < t < m - 1:
            before, after = times[t] - times[t - 1], times[t + 1] - times[t]
            room = 0.5 * (before + after)
            p.on[t, 2] = not (p.fixed[t] and p.fixed[t - 1] and p.fixed[t + 1])
            p.coef[t, 2, 0] = room / before
            p.coef[t, 2, 1] = -room / before - room / after
            p.coef[t, 2, 2] = room / after
            for i in range(n):
                most = min(acceleration[i] * room * lasts[t], 1e3) * (1.0 - EPS)
                p.low[t, 2, i] = -most
                p.high[t, 2, i] = most


@compiled
def _add(p, t, count, d, G, own, need, one, other):
    """Rows for the pairs found at a pose that moves with frames t and t + 1.

    Pairs for which there is no room are left to the proof, which looks at all of them.

    Args:
        p, t: the program, and the first of the frames.
        count, d, G: the pairs, see distance.near_pairs.
        own, need: see Aim, Program.
        one, other: what the pose moves by if a joint of frame t, or of t + 1, does, (n,).
    """
    n = len(own)
    k = p.count[0]
    for j in range(count):
        if k >= len(p.frame):
            return
        p.frame[k] = t
        for i in range(n):
            p.row[k, 0, i] = one[i] * G[j, own[i]]
            p.row[k, 1, i] = other[i] * G[j, own[i]]
        p.need[k] = need - d[j]
        k += 1
    p.count[0] = k


@compiled
def linearise(chain, balls, p, m, aim, target, between, rests, acceleration, custom):
    """Skeleton and clearances at p.q into H, g and the rows.

    Args:
        chain, balls: the robot and distance.reach(chain).
        p, m: the program and its frames in use.
        aim: an Aim of these frames.
        target: clearance to aim at [m], (m,).
        between: (m,), share of the way to the next frame at which the path is to keep it too; 0:
            none.
        rests: (m,), duration of the steps in which a robot that comes to the frame would brake [s],
            where it is to keep that clearance at rest too; 0: not asked.
        acceleration: with which it would [rad/s^2], (n,).
        custom: a Custom.
    """
    n, every = p.q.shape[1], aim.whole.shape[1]
    own = aim.own
    R = np.empty((every + 1, 3, 3))
    at = np.empty((every + 1, 3))
    z = np.empty((every, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    x = np.empty(21)
    J = np.empty((21, every))
    d = np.empty(len(chain.pair))
    G = np.empty((len(chain.pair), every))
    pose = np.empty(every)
    one = np.ones(n)
    other = np.zeros(n)
    p.count[0] = 0
    for t in range(m):
        if not p.fixed[t]:
            W = aim.W[min(t, len(aim.W) - 1)]
            for i in range(n):
                p.g[t, i] = 0.0
                for j in range(n):
                    p.H[t, i, j] = W[i, j]
                    p.g[t, i] += W[i, j] * (p.q[t, j] - aim.wanted[t, j])
            for i in range(every):
                pose[i] = aim.whole[t, i]
            for i in range(n):
                pose[own[i]] = p.q[t, i]
            place(chain, pose, R, at, z)
            if len(aim.x) > 0:
                bones(chain, R, at, z, x, J)
                for k in range(21):
                    off = aim.bone[k] * (x[k] - aim.x[t, k])
                    for i in range(n):
                        p.g[t, i] += J[k, own[i]] * off
                        c = aim.bone[k] * J[k, own[i]]
                        if c != 0.0:
                            for j in range(n):
                                p.H[t, i, j] += c * J[k, own[j]]
            place_capsules(chain, R, at, ends)
            found = near_pairs(chain, ends, balls, at, z, target[t] + custom.band, d, G)
            one[:] = 1.0
            other[:] = 0.0
            _add(p, t, found, d, G, own, target[t], one, other)
        if between[t] > 0.0 and t + 1 < m and not (p.fixed[t] and p.fixed[t + 1]):
            share = between[t]
            for i in range(every):
                pose[i] = (1.0 - share) * aim.whole[t, i] + share * aim.whole[t + 1, i]
            for i in range(n):
                pose[own[i]] = (1.0 - share) * p.q[t, i] + share * p.q[t + 1, i]
            place(chain, pose, R, at, z)
            place_capsules(chain, R, at, ends)
            found = near_pairs(chain, ends, balls, at, z, target[t] + custom.band, d, G)
            one[:] = 1.0 - share
            other[:] = share
            _add(p, t, found, d, G, own, target[t], one, other)
        if rests[t] > 0.0 and t > 0 and not (p.fixed[t] and p.fixed[t - 1]):
            dt = rests[t]
            for i in range(every):
                pose[i] = aim.whole[t, i]
            for i in range(n):
                w, a = (p.q[t, i] - p.q[t - 1, i]) / dt, acceleration[i]
                pose[own[i]] = p.q[t, i] + further(w, a, dt)
                one[i] = -np.floor(abs(w) / (a * dt)) if a < np.inf else 0.0
                other[i] = 1.0 - one[i]
            place(chain, pose, R, at, z)
            place_capsules(chain, R, at, ends)
            found = near_pairs(chain, ends, balls, at, z, target[t] + custom.band, d, G)
            _add(p, t - 1, found, d, G, own, target[t], one, other)


def settle_window(
    chain, balls, p, m, aim, target, between, rests, acceleration, custom, anew, out, stride=np.inf
) -> bool:  # fmt: skip
    """Find the nearest motion in a window.

    Args:
        chain, balls: the robot and distance.reach(chain).
        p: the program, after `bound`; q is where it begins and receives the motion.
        m: frames in use.
        aim: an Aim of these frames.
        target, between, rests, acceleration: see linearise.
        custom: a Custom.
        anew: begin without the multipliers of an earlier call.
        out: receives [rounds, iterations, most that the last round moved a joint [rad]].
        stride: a round that would move a joint farther [rad] goes a share of its way, so that
            the motion stays on the side of each body on which it is; then every round is solved
            to its end, and q must be within the limits when it begins.
    """
    out[:] = 0.0
    mu = 1e-5
    stiff = custom.stiff
    for turn in range(custom.rounds):
        before = p.q[:m].copy()
        linearise(chain, balls, p, m, aim, target, between, rests, acceleration, custom)
        first = anew and turn == 0
        stiff = custom.soft * 4.0**turn if anew else custom.stiff
        stiff = min(stiff, custom.stiff)
        mu = 1e-2 if first else min(max(mu, 1e-7), 1e-3)
        warm(p, m, mu, 0.05 if first else 1e-4, first)
        warm_rows(p, mu, stiff)
        inner = _LAST if stride < np.inf else custom.inner
        mu, done = improve(p, m, stiff, custom.steady, custom.small, inner)
        out[0] += 1.0
        out[1] += done
        most = np.abs(p.q[:m] - before).max()
        if not most < np.inf:  # catches NaN
            return False
        out[2] = most
        if most > stride:
            p.q[:m] = before + stride / most * (p.q[:m] - before)
        if most < custom.fine and stiff == custom.stiff:
            break
    # A restart moves slacks off their walls; limits are kept when the last step is a whole one.
    if not stride < np.inf:
        mu, done = improve(p, m, stiff, custom.steady, custom.small, _LAST)
        out[1] += done
    return bool(np.isfinite(p.q[:m]).all())
