"""Towards a wanted pose, out of dead ends too; compiled.

Going downhill in the skeleton's distance ends at times where no small step helps: a joint at its
end, or bodies in the way of each other, and the wanted pose on the other side. So where the wanted
angles are far off, both ways are tried out in thought for half a second, as if what is wanted
stood still: downhill, and straight for the angles. The robot takes the one on which it is nearer,
and where bodies block it, goes by a pose or two from which the way is proven
(s3le/plan/around.py).
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.kinematics import bones, place
from s3le.kernels.poses import apart
from s3le.plan.around import TRIES, seek
from s3le.plan.causal import SHORTENED, WANTED, Care, advance, search
from s3le.plan.chase import fastest, speeds
from s3le.safety.segment import CERTIFIED, prove

AROUND = 5  # how a step came about, beside those of s3le/plan/causal.py: by a pose to go around by

MODE, LEFT, TURN, WAIT = 0, 1, 2, 3  # entries of Memory.flag
_FAR = 0.5  # [rad] from the wanted angles, from which both ways are tried out,
_LOST = 0.07  # if the skeleton is off by a weighted sum of cosine distances of this and more
_OFTEN = 100  # [ms], so often at most
_THOUGHT, _PART = 12, 0.04  # steps that are thought ahead, and what each takes at least [s]
_END = 8.0  # what the last of them counts
_BETTER = 0.8  # share of the other's cost with which a way is changed
_CLOSE = 0.15  # [rad], and as near as this it is none either
_THERE = 0.05  # [rad], a pose to go around by counts as reached
_STILL = 0.01  # [rad], a step that moves no joint farther is none


class Memory(NamedTuple):
    """What one robot remembers from step to step beside where it is."""

    flag: np.ndarray  # int64 (4,): going for joint angles; poses to go around by; next way to
    # try; time until both ways may be tried out again [ms]
    way: np.ndarray  # [rad], (2, n), poses to go around by, the next one last
    W: np.ndarray  # (n, n), weights of the joints while it goes for them


def memory(W: np.ndarray) -> Memory:
    """An empty memory; W (n, n) weighs the joints while the robot goes for angles."""
    return Memory(np.zeros(4, np.int64), np.zeros((2, len(W))), np.ascontiguousarray(W, float))


@compiled
def lost(chain, q, x, bone):
    """Weighted sum of the bones' cosine distances from the pose's skeleton to x (21,)."""
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    found = np.empty(21)
    place(chain, q, R, p, z)
    bones(chain, R, p, z, found, np.empty((0, n)))
    total = 0.0
    for k in range(21):
        total += bone[k] * (found[k] - x[k]) ** 2
    return 0.5 * total


@compiled
def ahead(chain, balls, q, v, dt, bounds, care, want, x, bone, W, direct):
    """What a way costs in the half second to come: the sum of what is lost after each step.

    Args:
        chain, balls: the robot and distance.reach(chain).
        q, v, dt, bounds, care, want, x, bone, W: see causal.advance.
        direct: each joint goes straight for its angle, through everything; else downhill.
    """
    n = len(q)
    dt = max(dt, _PART)
    here, speed = q.copy(), v.copy()
    low = np.empty(n)
    high = np.empty(n)
    to = np.empty(n)
    total = 0.0
    for k in range(_THOUGHT):
        for i in range(n):
            least, most, _ = speeds(
                here[i], speed[i], dt, dt, bounds.lower[i], bounds.upper[i], bounds.speed[i],
                bounds.acceleration[i],
            )  # fmt: skip
            low[i] = min(max(here[i] + least * dt, bounds.lower[i]), bounds.upper[i])
            high[i] = min(max(here[i] + most * dt, bounds.lower[i]), bounds.upper[i])
            far = want[i] - here[i]
            w = fastest(abs(far), bounds.acceleration[i], dt)
            to[i] = min(max(here[i] + (w if far > 0.0 else -w) * dt, low[i]), high[i])
        if not direct:
            search(chain, balls, here, speed, low, high, dt, bounds, care, want, x, bone, W, to)
        for i in range(n):
            speed[i] = (to[i] - here[i]) / dt
            here[i] = to[i]
        total += lost(chain, here, x, bone) * (_END if k == _THOUGHT - 1 else 1.0)
    return total


@compiled
def pursue(
    chain, swept, s, memory, q, v, before, dt, bounds, care, want, x, bone, W, starts,
    anchor, to, out,
):  # fmt: skip
    """One step; arguments and result as of causal.advance, or AROUND; and these.

    Args:
        memory: a Memory, moved on.
        starts: further poses to go around by [rad], (k, n).
        anchor: a pose that is clear of everything [rad], (n,).
    """
    nothing = np.empty(0)
    if memory.flag[LEFT]:
        if prove(chain, swept, s, q, want, care.between, care.budget)[0] == CERTIFIED:
            memory.flag[LEFT] = 0
            memory.flag[MODE] = 1
        while memory.flag[LEFT]:
            left = memory.flag[LEFT]
            if apart(q, memory.way[left - 1]) < _THERE:
                memory.flag[LEFT] -= 1
                continue
            how = advance(
                chain, swept, s, q, v, before, dt, bounds, care, memory.way[left - 1],
                nothing, bone, memory.W, to, out,
            )  # fmt: skip
            if how >= SHORTENED and apart(q, to) < _STILL:
                memory.flag[LEFT] = 0
                return how
            return AROUND
    direct = memory.flag[MODE] == 1 or len(x) == 0
    how = advance(
        chain, swept, s, q, v, before, dt, bounds, care, want,
        nothing if direct else x, bone, memory.W if direct else W, to, out,
    )  # fmt: skip
    if how == WANTED:
        memory.flag[MODE] = 0
        return how
    far = apart(to, want)
    if len(x) > 0:
        memory.flag[WAIT] -= np.int64(np.ceil(1e3 * dt))
        if far < _CLOSE:
            memory.flag[MODE] = 0
        elif far > _FAR and memory.flag[WAIT] <= 0 and lost(chain, to, x, bone) > _LOST:
            memory.flag[WAIT] = _OFTEN
            quick = Care(
                care.target, care.margin, care.between, care.band, 1, care.budget, care.lead,
                care.curved,
            )  # fmt: skip
            straight = ahead(
                chain, swept.balls, q, v, dt, bounds, quick, want, x, bone, W, True
            )  # fmt: skip
            downhill = ahead(
                chain, swept.balls, q, v, dt, bounds, quick, want, x, bone, W, False
            )  # fmt: skip
            if direct:
                memory.flag[MODE] = 0 if downhill < _BETTER * straight else 1
            else:
                memory.flag[MODE] = 1 if straight < _BETTER * downhill else 0
    if far > _CLOSE and apart(q, to) < _STILL and (direct or how >= SHORTENED):
        # Bodies are in the way.
        memory.flag[LEFT] = seek(
            chain, swept, s, q, want, starts, anchor, care, memory.flag[TURN], memory.way
        )
        memory.flag[TURN] += TRIES
    return how
