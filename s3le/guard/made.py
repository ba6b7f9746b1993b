"""What becomes of one episode, and how much work it is."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from s3le.guard.forced import Forced
from s3le.guard.layouts.episode import Episode
from s3le.plan import gentle
from s3le.safety import audit

TRIES = 7  # reserves that are tried where a motion does not hold as it is rounded, each the double
SAME = 1e-5  # [rad], a row that planning moves less is put back
Progress = Callable[[int], object]


class Made(NamedTuple):
    """What became of one episode."""

    q: np.ndarray  # [rad], (m, n), as it will lie in the file
    before: audit.Report  # of the motion as it was
    after: audit.Report  # of q; holds, but for what is forced
    how: np.ndarray  # uint8 (m,), examine.WANTED, PLANNED or DRIVEN
    reserve: float  # [rad], what was kept of every limit because the file rounds
    forced: tuple[Forced, ...] = ()  # steps for which others leave no certified way
    v: np.ndarray | None = None  # [rad/s], (m, n), of the curve that holds; None: straight rows do

    def paced(self, episode: Episode) -> np.ndarray | None:
        """Speeds that are to be written; None: those in the file are, or it has no place."""
        if self.v is None or episode.pace is None:
            return None
        same = episode.v is not None and (self.v == episode.v).all()
        return None if same else self.v


def jerk(episodes: Sequence[Episode], made: Sequence[Made], limit: float) -> dict[str, Any]:
    """What a summary tells of the jerk of what came out; see gentle.about."""
    pairs = zip(episodes, made, strict=True)
    return gentle.about([(one.time, done.q, done.v) for one, done in pairs], limit)


def looks(rows: int) -> int:
    """Rows that `check` tells its progress of, for an episode of so many."""
    return 2 * rows - 1


def work(rows: int) -> int:
    """Rows that `nearest` tells its progress of, for an episode of so many."""
    return 5 * rows - 2
