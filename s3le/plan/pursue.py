"""Towards a wanted pose, out of dead ends too; compiled.

Going downhill in the skeleton's distance ends at times where no small step helps: a joint at its
end, or bodies in the way of each other, and the wanted pose on the other side. Then the robot goes
for the wanted joint angles instead, and where bodies block that, by a pose or two from which the
way is proven (s3le/kernels/around.py).
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.around import TRIES, seek
from s3le.kernels.compiled import compiled
from s3le.kernels.kinematics import bones, place
from s3le.kernels.refine import apart
from s3le.kernels.segment import CERTIFIED, prove
from s3le.plan.causal import LIMITED, SHORTENED, WANTED, advance

AROUND = 6  # how a step came about, beside those of s3le/plan/causal.py: by a pose to go around by

MODE, LEFT, TURN = 0, 1, 2  # entries of Memory.flag
_STUCK = 0.07  # weighted sum of cosine distances lost from which it may be a dead end,
_NEARER = 0.97  # if a step leaves more than this share of it
_OUT = 0.03  # lost, with which it is one no more
_CLOSE = 0.15  # [rad], and as near as this it is none either
_THERE = 0.05  # [rad], a pose to go around by counts as reached
_STILL = 0.01  # [rad], a step that moves no joint farther is none


class Memory(NamedTuple):
    """What one robot remembers from step to step beside where it is."""

    flag: np.ndarray  # int64 (3,): going for joint angles; poses to go around by; next way to try
    way: np.ndarray  # [rad], (2, n), poses to go around by, the next one last
    W: np.ndarray  # (n, n), weights of the joints while it goes for them


def memory(W: np.ndarray) -> Memory:
    """An empty memory; W (n, n) weighs the joints while the robot goes for angles."""
    return Memory(np.zeros(3, np.int64), np.zeros((2, len(W))), np.ascontiguousarray(W, float))


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
def pursue(
    chain, swept, s, memory, q, v, before, dt, bounds, care, want, drift, x, bone, W, starts,
    anchor, rule, to, out,
):  # fmt: skip
    """One step; arguments and result as of causal.advance, or AROUND; and

    Args:
        memory: a Memory, moved on.
        starts: further poses to go around by [rad], (k, n).
        anchor: a pose that is clear of everything [rad], (n,).
        rule: a kernels.refine.Rule; margin, between and budget are read.
    """
    nothing = np.empty(0)
    calm = np.zeros(len(q))
    if memory.flag[LEFT]:
        if prove(chain, swept, s, q, want, rule.between, rule.budget)[0] == CERTIFIED:
            memory.flag[LEFT] = 0
            memory.flag[MODE] = 1
        while memory.flag[LEFT]:
            left = memory.flag[LEFT]
            if apart(q, memory.way[left - 1]) < _THERE:
                memory.flag[LEFT] -= 1
                continue
            how = advance(
                chain, swept, s, q, v, before, dt, bounds, care, memory.way[left - 1], calm,
                nothing, bone, memory.W, to, out,
            )  # fmt: skip
            if how >= SHORTENED and apart(q, to) < _STILL:
                memory.flag[LEFT] = 0
                return how
            return AROUND
    direct = memory.flag[MODE] == 1 or len(x) == 0
    how = advance(
        chain, swept, s, q, v, before, dt, bounds, care, want, drift,
        nothing if direct else x, bone, memory.W if direct else W, to, out,
    )  # fmt: skip
    if how == WANTED:
        memory.flag[MODE] = 0
        return how
    far = apart(to, want)
    if len(x) > 0:
        gone = lost(chain, to, x, bone)
        if direct:
            if gone < _OUT or far < _CLOSE:
                memory.flag[MODE] = 0
        elif gone > _STUCK and far > _CLOSE and gone > _NEARER * lost(chain, q, x, bone):
            memory.flag[MODE] = 1
    if direct and far > _CLOSE and how >= LIMITED and apart(q, to) < _STILL:
        # Bodies are in the way.
        memory.flag[LEFT] = seek(
            chain, swept, s, q, want, starts, anchor, rule, memory.flag[TURN], memory.way
        )
        memory.flag[TURN] += TRIES
    return how
