"""The feasible pose nearest to a skeleton: a few steps from poses at hand, for one frame; compiled.

    minimise 1/2 |x(q) - x|^2 + ridge/2 |q - start|^2    within limits, at the clearance wanted

Starts are the answer to the frame before, which is near where motion is smooth, and the best of
the poses that a look-up proposes, which is near the best there is. The result is never farther
from x than the best feasible proposal: where refining gains nothing, that proposal is returned.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.poses import AGREEMENT, apart, cost_of, inside
from s3le.kernels.solver import clearance_of, minimise_within, restore_within

NOTHING, LOOKUP, REFINED = 0, 1, 2  # where a result comes from
_ELSEWHERE = 0.2  # [rad], a robot farther than this from its last answer starts anew
_GOOD = 0.035  # sum of cosine distances, 0.005 a bone, with which no proposal is looked into
BAND = 0.05  # [m], pairs farther than this over the target do not enter a quadratic program
FINE = 2e-3  # [rad], a solve ends with a step smaller than this


class Rule(NamedTuple):
    """How to refine; what s3le.retarget.settings says, as the kernels want it."""

    target: float  # [m], clearance that refinement aims at
    margin: float  # [m], clearance that every pose keeps
    ridge: float  # weight of the pull towards the start [-]
    toll: float  # what a pose farther off must gain, in mean cosine distance [1/rad]
    steps: int  # most iterations of each solve


@compiled
def settle(chain, balls, lowest, highest, margin, q):
    """Bring q, which is in the box or nearly, to the margin or above it; False where that fails."""
    if not inside(q, lowest, highest):
        return False
    goal = margin + AGREEMENT
    if not clearance_of(chain, balls, q) >= goal:
        if not restore_within(chain, balls, lowest, highest, goal, q):
            return False
    return inside(q, lowest, highest) and clearance_of(chain, balls, q) >= goal


@compiled
def refine(chain, balls, x, starts, last, here, warm, rule, q, out):
    """Find a feasible pose near the skeleton x.

    Args:
        chain, balls: the robot and distance.reach(chain).
        x: the skeleton, (21,), unit vectors.
        starts: poses proposed [rad], (k, n); they need not be feasible.
        last: the answer to the frame before [rad], (n,), if warm.
        here: where the robot is [rad], (n,), if warm.
        warm: are there such poses?
        rule: a Rule.
        q: receives the pose [rad], (n,), as it was where the result is NOTHING.
        out: receives [cost of q, cost of the best feasible proposal, iterations]; inf: none.

    Returns:
        REFINED, LOOKUP (a proposal as it is) or NOTHING (no feasible pose was found).
    """
    count, n = starts.shape
    trial = np.empty(n)
    start = np.empty(n)
    solved = np.zeros(3)
    cost = np.empty(count)
    for k in range(count):
        cost[k] = cost_of(chain, starts[k], x) if np.isfinite(starts[k]).all() else np.inf
    order = np.argsort(cost)
    best = np.inf
    least = np.inf
    how = NOTHING
    iterations = 0.0
    # The last answer, where the robot is if that is elsewhere, and the best proposal; the best
    # three proposals where there is nothing yet.
    for turn in range(3):
        if warm and turn == 0:
            start[:] = last
        elif warm and turn == 1:
            if apart(last, here) < _ELSEWHERE:
                continue
            start[:] = here
        else:
            k = turn - 2 if warm else turn
            if warm and least < _GOOD:
                break
            if k >= count or not cost[order[k]] < np.inf:
                continue
            start[:] = starts[order[k]]
        trial[:] = start
        minimise_within(
            chain, balls, chain.lower, chain.upper, True, x, start, rule.ridge, rule.target, True,
            BAND, FINE, rule.steps, trial, solved,
        )  # fmt: skip
        iterations += solved[2]
        if settle(chain, balls, chain.lower, chain.upper, rule.margin, trial):
            found = cost_of(chain, trial, x)
            least = min(least, found)
            if warm:
                found += 7.0 * rule.toll * apart(trial, here)
            if found < best:
                best = found
                how = REFINED
                q[:] = trial
    if how != NOTHING:
        best = cost_of(chain, q, x)
    least = np.inf
    for turn in range(count):
        k = order[turn]
        if not cost[k] < np.inf:
            break
        if inside(starts[k], chain.lower, chain.upper) and (
            clearance_of(chain, balls, starts[k]) >= rule.margin
        ):
            least = cost[k]
            if least < best:
                best = least
                how = LOOKUP
                q[:] = starts[k]
            break
    out[0] = best
    out[1] = least
    out[2] = iterations
    return how
