"""Where a robot could not do what was wanted: the modes of a motion's rows, told by kind.

A file without modes is judged by what it does: rows in which no joint moves stand still.
"""

from typing import NamedTuple

import numpy as np

from s3le.motion.trajectory import BETWEEN
from s3le.show.motions import Shown, poses, upcoming


class Kind(NamedTuple):
    """A kind of mode."""

    label: str
    colour: str  # the same on white and on dark grey


# Okabe and Ito's palette, as s3le.show.style has it.
PLAIN = Kind("follows", "#8aa0b3")
SLOWED = Kind("slowed", "#E69F00")
DETOUR = Kind("detour", "#CC79A7")
HELD = Kind("held", "#c4161c")
APPROACH = Kind("approach", "#56B4E9")
STILL = Kind("still", "#c4161c")
KINDS = (PLAIN, SLOWED, DETOUR, HELD, APPROACH, STILL)  # in reading order

_KIND_OF = {
    "limited": SLOWED,
    "planned": SLOWED,
    "shortened": SLOWED,
    "detour": DETOUR,
    "braked": HELD,
    "held": HELD,
    "halted": HELD,
    "dropped": HELD,
    "beyond": HELD,
    "forced": HELD,
    "start": APPROACH,
    "lead_in": APPROACH,
}


def kinds(shown: Shown, times: np.ndarray) -> np.ndarray:
    """Kind of each moment, as an index into KINDS, int (n,)."""
    words = shown.trajectory.mode
    if words is not None:
        # A row on the way between two frames is of the kind of the frame that it leads to.
        rows = np.where(words == BETWEEN, len(words) - 1, np.arange(len(words)))
        leads = np.minimum.accumulate(rows[::-1])[::-1]
        found, which = np.unique(words, return_inverse=True)
        kind = np.array([KINDS.index(_KIND_OF.get(str(word), PLAIN)) for word in found], int)
        return kind[which[leads[upcoming(shown, times)]]]
    q = poses(shown, times)
    still = np.abs(np.diff(q, axis=0, prepend=q[:1] + 1.0)).max(axis=1) == 0.0
    return np.where(still, KINDS.index(STILL), KINDS.index(PLAIN))


def word(shown: Shown, kind: int) -> str:
    """What is said of a kind; a file without modes does not say that the robot follows."""
    unsaid = shown.trajectory.mode is None and KINDS[kind] is PLAIN
    return "moves" if unsaid else KINDS[kind].label


def spans(kind: np.ndarray) -> list[tuple[int, int, Kind]]:
    """Runs of moments of one kind but PLAIN: (first, one after the last, kind)."""
    edges = np.flatnonzero(np.diff(kind, prepend=-1, append=-1))
    runs = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return [(a, b, KINDS[kind[a]]) for a, b in runs if KINDS[kind[a]] is not PLAIN]
