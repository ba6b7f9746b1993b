"""A way around what stands between two poses: a pose or two to go by, all of it proven; compiled.

Bodies block each other mostly because an arm is in the way of the other, or of the trunk. So an
arm, or both, are opened some way towards the anchor, where everything is clear; carried, so opened,
to the other side; and closed again. Other ways lead by the arms of the anchor, and of poses that a
look-up proposes. The trunk keeps to where the robot comes from and where it goes, for a trunk that
swings is what people see; where all that fails, the way leads by the anchor as it is. Which are
tried turns from call to call: a frame has time for a few.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.poses import AGREEMENT, apart, inside
from s3le.kernels.solver import clearance_of
from s3le.safety.segment import CERTIFIED, prove
from s3le.skeleton import POINTS

_SHARES = (0.15, 0.35, 0.7)  # of the way to the anchor that is opened
TRIES = 4  # ways that are tried in a call
_FARTHER = 2.5  # times as far as straight on that a way may be,
_BEYOND = 1.5  # [rad], and this much
_R_HAND, _L_HAND = POINTS.index("r_hand"), POINTS.index("l_hand")


@compiled
def opened(chain, q, other, group, share, out):
    """Turn joints some way to another pose.

    Args:
        chain: the robot.
        q, other: from and to [rad], (n,).
        group: all joints but those that carry both hands (0), the right arm's (1), the left's (2).
        share: of the way.
        out: receives the pose [rad], (n,).

    Returns:
        False where the group is empty.
    """
    right = chain.point_frame[_R_HAND]
    left = chain.point_frame[_L_HAND]
    some = False
    for i in range(len(q)):
        of_right, of_left = chain.moves[right, i], chain.moves[left, i]
        out[i] = q[i]
        if (not (of_right and of_left) if group == 0 else
            of_right and not of_left if group == 1 else of_left and not of_right):  # fmt: skip
            some = True
            out[i] += share * (other[i] - q[i])
    return some


@compiled
def clear(chain, swept, care, q):
    """Is the pose within limits and at the margin?"""
    return inside(q, chain.lower, chain.upper) and (
        clearance_of(chain, swept.balls, q) >= care.margin + AGREEMENT
    )


@compiled
def seek(chain, swept, s, q, want, starts, anchor, care, turn, way):
    """Look for a way from q to want.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        q, want: poses that keep the margin [rad], (n,).
        starts: further poses to go by [rad], (k, n).
        anchor: a pose that is clear of everything [rad], (n,).
        care: a causal.Care; margin, between and budget are read.
        turn: which way to try first.
        way: receives the poses to go by [rad], (2, n), the next one last.

    Returns:
        How many poses to go by; 0: none was found.
    """
    n = len(q)
    first = np.empty(n)
    second = np.empty(n)
    simple = 3 * len(_SHARES)
    kinds = simple + 2 + len(starts)
    least = _FARTHER * apart(q, want) + _BEYOND
    found = 0
    for attempt in range(TRIES):
        kind = (turn + attempt) % kinds
        if kind < simple:
            share = _SHARES[kind // 3]
            if not opened(chain, q, anchor, kind % 3, share, first):
                continue
            opened(chain, want, anchor, kind % 3, share, second)
        elif kind == simple + 1:
            first[:] = anchor
            second[:] = anchor
        else:
            other = anchor if kind == simple else starts[kind - simple - 2]
            if not opened(chain, q, other, 0, 1.0, first):
                continue
            opened(chain, want, other, 0, 1.0, second)
        far = apart(q, first) + apart(first, second) + apart(second, want)
        if not far < least or not (
            clear(chain, swept, care, first) and clear(chain, swept, care, second)
        ):
            continue
        if (
            prove(chain, swept, s, q, first, care.between, care.budget)[0] == CERTIFIED
            and prove(chain, swept, s, second, want, care.between, care.budget)[0] == CERTIFIED
            and prove(chain, swept, s, first, second, care.between, care.budget)[0] == CERTIFIED
        ):
            least = far
            found = 2
            way[1] = first
            way[0] = second
    return found
