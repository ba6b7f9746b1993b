"""What the rows of a motion keep; compiled."""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.solver import clearance_of
from s3le.safety.segment import CERTIFIED, prove

WANTED, PLANNED, DRIVEN = range(3)  # where a row comes from


class Plan(NamedTuple):
    """A motion that holds, one entry a row."""

    q: np.ndarray  # [rad], (m, n)
    how: np.ndarray  # uint8 (m,): WANTED (to the bit), PLANNED, DRIVEN
    clearance: np.ndarray  # [m], (m,), of the pose
    bound: np.ndarray  # [m], (m,), proven of the path from the row before; of row 0 its pose's
    v: np.ndarray | None = None  # [rad/s], (m, n), at each row; None: straight from row to row


def origin(same: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """Where each row comes from, uint8 (m,), see Plan; bool (m,): as wanted to the bit, driven."""
    return np.where(same, WANTED, np.where(driven, DRIVEN, PLANNED)).astype(np.uint8)


@compiled
def examine(chain, swept, s, q, care, first, last, clearance, proven, where, bound):
    """Measure rows first to last - 1, and prove the paths that end at them.

    Args:
        chain, swept, s: the robot, swept(chain) and a segment.scratch(chain) of this thread's own.
        q: poses [rad], (m, n).
        care: a causal.Care; between and budget are read.
        first, last: rows.
        clearance: receives that of each pose [m], (m,).
        proven: receives whether the path from the row before is, bool (m,); True for row 0.
        where: receives at which share of the path it failed, (m,).
        bound: receives the proven clearance of each path [m], (m,); NaN: none.
    """
    for t in range(first, last):
        clearance[t] = clearance_of(chain, swept.balls, q[t])
        proven[t] = True
        where[t] = 0.0
        bound[t] = clearance[t]
        if t > 0:
            found = prove(chain, swept, s, q[t - 1], q[t], care.between, care.budget)
            proven[t] = found[0] == CERTIFIED
            bound[t] = found[1] if proven[t] else np.nan
            if not proven[t]:
                # Where it collides; else the middle of what could not be decided.
                where[t] = found[3] if np.isfinite(found[3]) else 0.5 * (1.0 + found[2])
