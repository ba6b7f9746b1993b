"""One step of a robot towards a pose that is wanted: never an unproven pose or path; compiled.

The robot stands at q0, whose clearance is known. Where the wanted pose lies farther off than the
joints may turn in dt, the box of what they may do is searched for the pose nearest to the skeleton
(limiting the step joint by joint, or scaling it, gives a worse skeleton; docs/tried.md). Then the
straight path to it is proven. If that fails: what can be reached from q0 downhill, staying clear;
the part of the path that is proven; and at last q0 itself, a path of no length. So there is always
an answer, and every answer is proven. Where that leaves the robot behind an obstacle, it goes
around by a pose to which and from which the whole way is proven.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.solver import clearance_of, minimise_within
from s3le.retarget.around import TRIES, seek
from s3le.retarget.refine import (
    AGREEMENT,
    BAND,
    FINE,
    NOTHING,
    apart,
    cost_of,
    inside,
    refine,
    settle,
)
from s3le.safety.segment import CERTIFIED, prove

WANTED, EASED, LIMITED, DETOUR, SHORTENED, HELD = range(6)  # how a step came about

_ROOM = 1e-9  # share of a speed that is not used, so that no rounding exceeds it
_PARTS = 6  # times that a refused step is made shorter
_STUCK = 0.1  # sum of cosine distances lost to an obstacle from which a way around is looked for
_THERE = 0.02  # [rad], a pose to go around by counts as reached

WARM, AROUND, TURN = 0, 1, 2  # entries of Memory.flag


class Memory(NamedTuple):
    """What one robot in motion remembers from frame to frame."""

    q: np.ndarray  # [rad], (n,), where it is, certified
    v: np.ndarray  # [rad/s], (n,), how it got there
    last: np.ndarray  # [rad], (n,), the pose last wanted
    way: np.ndarray  # [rad], (2, n), poses it goes around by, the next one last
    flag: np.ndarray  # int64 (3,): is there a last, poses to go around by, which way to try next
    want: np.ndarray  # [rad], (n,), the pose wanted now
    next: np.ndarray  # [rad], (n,), the pose to go to
    out: np.ndarray  # (8,), see frame


def memory(n_dof: int) -> Memory:
    """An empty memory for a robot of n_dof joints."""
    a, b, c, d, e = (np.zeros(n_dof) for _ in range(5))
    return Memory(a, b, c, np.zeros((2, n_dof)), np.zeros(3, np.int64), d, e, np.zeros(8))


@compiled
def slowly(far, dt, brake):
    """Fastest that a joint may go and still stop where it is far [rad] to go: [rad/s]."""
    # v dt + v^2 / (2 brake) = far: from then on it slows down, and ends there.
    return brake * (np.sqrt(dt * dt + 2.0 * max(far, 0.0) / brake) - dt)


@compiled
def reachable(chain, q0, v0, want, dt, speed, brake, lowest, highest):
    """The box of poses that the joints can reach in dt [s], into lowest and highest [rad], (n,).

    Args:
        chain: the robot.
        q0, v0: where the robot is [rad] and how fast [rad/s], (n,).
        want: where it is wanted [rad], (n,).
        dt: time that the step takes [s], above 0.
        speed: most that each joint may do [rad/s], (n,); never exceeded.
        brake: most change of speed [rad/s^2], inf: any. A joint that nears want, or a limit, keeps
            slow enough to stop there, and every joint's speed changes no faster, where limits
            and speed leave the choice.
        lowest, highest: receive the box; q0 is not in it if the joint is not to stop at once.
    """
    for i in range(len(q0)):
        most = speed[i] * (1.0 - _ROOM)
        low, high = -most, most
        if brake < np.inf:
            low = max(low, -slowly(q0[i] - chain.lower[i], dt, brake))
            high = min(high, slowly(chain.upper[i] - q0[i], dt, brake))
            far = want[i] - q0[i]
            # From brake dt^2 away it can be there at once, and stop with the step after.
            slow = max(slowly(abs(far), dt, brake), min(abs(far) / dt, brake * dt))
            if far < 0.0:
                low = max(low, -slow)
            else:
                high = min(high, slow)
            low = min(max(low, v0[i] - brake * dt), most)
            high = max(min(high, v0[i] + brake * dt), -most)
            if low > high:  # it cannot stop in time: it slows down as much as it may
                low = high = max(-most, min(most, low if v0[i] > 0.0 else high))
        # The limits come last, and hold always.
        lowest[i] = min(max(q0[i] + low * dt, chain.lower[i]), chain.upper[i])
        highest[i] = min(max(q0[i] + high * dt, chain.lower[i]), chain.upper[i])


@compiled
def advance(chain, swept, s, x, want, q0, v0, dt, speed, brake, rule, q, out):
    """Go from q0 towards want.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        x: skeleton that is wanted, (21,).
        want: pose that is wanted [rad], (n,), feasible.
        q0, v0: where the robot is [rad], certified, and how fast [rad/s], (n,).
        dt: time that the step takes [s], above 0.
        speed, brake: see reachable.
        rule: a refine.Rule.
        q: receives the pose to go to [rad], (n,).
        out: receives [proven clearance of the path [m], poses looked at in proofs].

    Returns:
        WANTED, EASED (as near as the brake lets it), LIMITED (as near as the joints get in the
        time), DETOUR, SHORTENED or HELD.
    """
    n = len(q0)
    lowest = np.empty(n)
    highest = np.empty(n)
    reachable(chain, q0, v0, want, dt, speed, brake, lowest, highest)
    solved = np.zeros(3)
    looked = 0.0
    q[:] = want
    how = WANTED
    fits = inside(want, lowest, highest)
    if not fits:
        how = EASED
        for i in range(n):
            if abs(want[i] - q0[i]) > speed[i] * (1.0 - _ROOM) * dt:
                how = LIMITED
            q[i] = min(max(want[i], lowest[i]), highest[i])
        minimise_within(
            chain, swept.balls, lowest, highest, True, x, want, rule.pull, rule.target, True,
            BAND, FINE, rule.steps, q, solved,
        )  # fmt: skip
    refused = q.copy()
    if settle(chain, swept.balls, lowest, highest, rule.margin, q):
        found = prove(chain, swept, s, q0, q, rule.between, rule.budget)
        looked += found[6]
        if found[0] == CERTIFIED:
            out[0] = found[1]
            out[1] = looked
            return how
        refused[:] = q
    # No brakes where they would lead into a collision.
    reachable(chain, q0, v0, want, dt, speed, np.inf, lowest, highest)
    best = np.inf
    how = HELD
    trial = np.empty(n)
    bound = np.nan
    # Downhill from where the robot is, clear of everything.
    trial[:] = q0
    minimise_within(
        chain, swept.balls, lowest, highest, True, x, want, rule.pull, rule.target, True,
        BAND, FINE, rule.steps, trial, solved,
    )  # fmt: skip
    if settle(chain, swept.balls, lowest, highest, rule.margin, trial):
        found = prove(chain, swept, s, q0, trial, rule.between, rule.budget)
        looked += found[6]
        if found[0] == CERTIFIED:
            how = DETOUR
            best = cost_of(chain, trial, x)
            bound = found[1]
            q[:] = trial
    # The first part of the refused step.
    share = 1.0
    found = prove(chain, swept, s, q0, refused, rule.between, rule.budget)
    looked += found[6]
    share = min(0.999 * found[2], 0.95)
    for _ in range(_PARTS):
        for i in range(n):
            trial[i] = q0[i] + share * (refused[i] - q0[i])
        if inside(trial, lowest, highest) and (
            clearance_of(chain, swept.balls, trial) >= rule.margin + AGREEMENT
        ):
            found = prove(chain, swept, s, q0, trial, rule.between, rule.budget)
            looked += found[6]
            if found[0] == CERTIFIED:
                cost = cost_of(chain, trial, x)
                if cost < best:
                    how = SHORTENED
                    best = cost
                    bound = found[1]
                    q[:] = trial
                break
        share *= 0.5
    if how == HELD:
        q[:] = q0
        found = prove(chain, swept, s, q0, q0, rule.between, rule.budget)
        bound = found[1]
    out[0] = bound
    out[1] = looked
    return how


@compiled
def straight(chain, swept, s, q0, v0, goal, dt, speed, brake, rule, q, out):
    """Go along the straight path to goal as far as the joints get; True where that is proven."""
    n = len(q0)
    lowest = np.empty(n)
    highest = np.empty(n)
    for attempt in range(2):
        most = brake if attempt == 0 else np.inf
        reachable(chain, q0, v0, goal, dt, speed, most, lowest, highest)
        share = 1.0
        for i in range(n):
            far = goal[i] - q0[i]
            if far > 0.0:
                share = min(share, (highest[i] - q0[i]) / far)
            elif far < 0.0:
                share = min(share, (lowest[i] - q0[i]) / far)
        if not share > 0.0:
            continue
        for i in range(n):
            q[i] = min(max(q0[i] + share * (goal[i] - q0[i]), lowest[i]), highest[i])
        if not inside(q, chain.lower, chain.upper):
            return False
        if not clearance_of(chain, swept.balls, q) >= rule.margin + AGREEMENT:
            return False
        found = prove(chain, swept, s, q0, q, rule.between, rule.budget)
        out[0] = found[1]
        out[1] += found[6]
        return found[0] == CERTIFIED
    return False


@compiled
def pursue(chain, swept, s, m, x, starts, anchor, dt, speed, brake, rule, out):
    """Go from m.q towards m.want, around what is in the way; the pose to go to into m.next.

    Arguments and results are those of frame, the last as of advance.
    """
    if m.flag[AROUND]:
        if prove(chain, swept, s, m.q, m.want, rule.between, rule.budget)[0] == CERTIFIED:
            m.flag[AROUND] = 0
        while m.flag[AROUND]:
            left = m.flag[AROUND]
            if apart(m.q, m.way[left - 1]) < _THERE or (
                left == 2
                and prove(chain, swept, s, m.q, m.way[0], rule.between, rule.budget)[0] == CERTIFIED
            ):
                m.flag[AROUND] -= 1
                continue
            if straight(
                chain, swept, s, m.q, m.v, m.way[left - 1], dt, speed, brake, rule, m.next, out
            ):  # fmt: skip
                return DETOUR
            m.flag[AROUND] = 0
    how = advance(chain, swept, s, x, m.want, m.q, m.v, dt, speed, brake, rule, m.next, out)
    if how < DETOUR or cost_of(chain, m.next, x) - cost_of(chain, m.want, x) < _STUCK:
        return how
    # An obstacle stands between. If all of the straight path is free, only the way there was bad.
    if prove(chain, swept, s, m.q, m.want, rule.between, rule.budget)[0] == CERTIFIED:
        m.way[0] = m.want
        left = 1
    else:
        left = seek(
            chain, swept, s, m.q, m.want, starts, anchor, rule, m.flag[TURN], m.way
        )  # fmt: skip
        m.flag[TURN] += TRIES
    if left == 0:
        return how
    kept = m.next.copy()
    if straight(
        chain, swept, s, m.q, m.v, m.way[left - 1], dt, speed, brake, rule, m.next, out
    ):  # fmt: skip
        m.flag[AROUND] = left
        return DETOUR
    m.next[:] = kept
    out[0] = prove(chain, swept, s, m.q, m.next, rule.between, rule.budget)[1]
    return how


@compiled
def frame(chain, swept, s, m, x, starts, anchor, dt, speed, brake, rule):
    """One frame: the pose wanted for the skeleton x into m.want, the pose to go to into m.next.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        m: a Memory; q, v and last are read, and are the caller's to move on.
        x: skeleton that is wanted, (21,), unit vectors.
        starts: poses proposed [rad], (k, n).
        anchor: a pose that is clear of everything [rad], (n,).
        dt: time that the step takes [s], above 0; without a last pose it is not used.
        speed, brake: see reachable.
        rule: a refine.Rule.

    Returns:
        (found, how): what refine and advance return; how is WANTED where there was no last pose.
        m.out receives [proven clearance of the path [m], poses looked at in proofs, cost of want,
        cost of the best proposal, iterations, cost of next, clearance of next [m]].
    """
    warm = m.flag[WARM] == 1
    found = refine(chain, swept.balls, x, starts, m.last, m.q, warm, rule, m.want, m.out[2:5])
    m.out[0] = np.nan
    m.out[1] = 0.0
    how = WANTED
    if found == NOTHING:
        how = HELD
        m.want[:] = m.last
        m.next[:] = m.q
    elif warm:
        how = pursue(chain, swept, s, m, x, starts, anchor, dt, speed, brake, rule, m.out[0:2])
    else:
        m.next[:] = m.want
    m.out[5] = cost_of(chain, m.next, x)
    m.out[6] = clearance_of(chain, swept.balls, m.next)
    if not warm or found == NOTHING:
        m.out[0] = m.out[6]
    return found, how
