"""What is known of each row of a retargeted motion, and how each can have come about."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np


class Mode(StrEnum):
    """How a row of a retargeted motion was obtained; all but forced and halted are certified."""

    START = "start"  # the first pose; nothing leads to it
    REFINED = "refined"  # the pose wanted, refined towards the human
    LOOKUP = "lookup"  # the pose wanted, as it is stored
    PLANNED = "planned"  # of a file: as near to it as limits in time and other bodies allow
    LIMITED = "limited"  # of a stream: towards it, as far as the joints get in the time
    SHORTENED = "shortened"  # the first part of a step whose whole could not be proven
    DETOUR = "detour"  # another way, for the straight one could not be proven
    BRAKED = "braked"  # slows down along what was proven before: nothing else could be proven
    HELD = "held"  # stands still: at rest, or no time has passed
    HALTED = "halted"  # had to stand still at once, harder than its accelerations allow
    GAVE_WAY = "gave_way"  # of a stream among given joints: out of their way, as far as proven
    FORCED = "forced"  # the given joints left no certified way; nothing is claimed of it
    LEAD_IN = "lead_in"  # on the way from a given pose to the human's first
    DROPPED = "dropped"  # the frame could not be used; towards the one before it


class Rows(NamedTuple):
    """One entry a row."""

    q: np.ndarray  # [rad], (n, n_dof)
    mode: np.ndarray  # Mode, object (n,)
    clearance: np.ndarray  # [m], (n,), of the pose
    bound: np.ndarray  # [m], (n,), proven of the path from the row before
    distance: np.ndarray  # (n,), mean cosine distance to the human; NaN: no human yet
    wanted: np.ndarray  # (n,), the same of the pose wanted, before all limits in time
    seconds: np.ndarray  # [s], (n,), what each took; NaN: nothing was computed
    v: np.ndarray  # [rad/s], (n, n_dof)


def rows_of(each: Sequence[tuple[Any, ...]]) -> Rows:
    """Columns of rows, each with the fields of Rows in their order."""
    q, mode, *numbers = zip(*each, strict=True)
    words = np.empty(len(mode), object)
    words[:] = mode
    return Rows(np.array(q, float), words, *(np.array(part, float) for part in numbers))
