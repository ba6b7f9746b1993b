"""Motions as the rows of a strip or a film: bodies, clearances and words for some moments."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from s3le.kernels import batch
from s3le.show import motions, pace
from s3le.show.figures import Row
from s3le.show.motions import Human, Shown
from s3le.show.style import SPARE, colour

_COLOURS = (colour("s3le"), colour("lwl2"), *SPARE[:2], colour("ale"), *SPARE[2:])


class Told(NamedTuple):
    """One robot over some moments."""

    row: Row
    kind: np.ndarray  # int (n,), index into pace.KINDS
    clearance: np.ndarray  # [m], (n,)


def human(seen: Human, times: np.ndarray) -> Row:
    """The row of the human."""
    return Row(f"human: {seen.label}", skeleton=motions.skeletons(seen, times))


def robot(
    shown: Shown,
    times: np.ndarray,
    number: int,
    several: bool,
    progress: Callable[[int], object] | None = None,
) -> Told:
    """The row of one motion.

    Args:
        shown: the motion.
        times: moments [s], (n,).
        number: which of the motions it is.
        several: there are others, so it needs a colour of its own.
        progress: called with numbers of moments measured.
    """
    chain = shown.robot.chain
    q = motions.poses(shown, times)
    clearance = batch.clearances(chain, q, progress)
    kind = pace.kinds(shown, times)
    words = [
        f"{pace.word(shown, k)}, {c * 1e3:.1f} mm clear"
        if c >= 0.0
        else f"collides by {-c * 1e3:.1f} mm"
        for k, c in zip(kind, clearance, strict=True)
    ]
    row = Row(
        shown.label,
        ends=batch.capsule_ends(chain, q),
        radius=chain.body_radius,
        marked=~(clearance >= 0.0),
        note=words,
        colour=_COLOURS[number % len(_COLOURS)] if several else None,
        still=chain.body_frame == 0,
    )
    return Told(row, kind, clearance)
