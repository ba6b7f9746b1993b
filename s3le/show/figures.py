"""What one picture of a figure shows, and the one camera and scale that all of them share.

The human is known only as seven directions, so it is drawn with nominal segment lengths; the
robot is drawn from its capsules. A strip puts such pictures beside each other, a film after
each other.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_rgb

from s3le.errors import ParameterError
from s3le.show.camera import extent
from s3le.show.human import stick_figures
from s3le.skeleton import DIM

BODY = "#9fb4c7"  # a robot without a colour of its own
LEGS = "#f3f5f7"
_STILL = 1e-9  # [m] a body that never moves further than this stands still
_NOTHING = np.array([-0.3, 0.3, 0.0, 0.5])  # [m] of a picture in which nothing is


class Row(NamedTuple):
    """One figure over time; either a skeleton or capsules, one entry per moment."""

    label: str
    skeleton: np.ndarray | None = None  # (n, 21), unit vectors ordered as skeleton.BONES
    ends: np.ndarray | None = None  # [m], (n, b, 2, 3), capsule ends, x forward, y left, z up
    radius: np.ndarray | None = None  # [m], (b,)
    marked: np.ndarray | None = None  # bool (n,): collides; None: not one
    note: list[str] | None = None  # a few words below each cell
    colour: str | None = None  # of the robot's bodies, e.g. its method's (style.colour)
    still: np.ndarray | None = None  # bool (b,): drawn lighter; None: those that never move

    @property
    def human(self) -> bool:
        """Is it the human?"""
        return self.skeleton is not None


def check(row: Row, n: int) -> None:
    """Refuse a row that is not of n moments.

    Raises:
        ParameterError: neither or both of skeleton and capsules, or an array of another length
            or shape; names the row.
    """
    where = f"strip row {row.label!r}"
    if (row.skeleton is None) == (row.ends is None):
        raise ParameterError(f"{where} needs either a skeleton or capsule ends")
    if row.skeleton is not None and np.shape(row.skeleton) != (n, DIM):
        raise ParameterError(
            f"{where}: skeleton must have shape ({n}, {DIM}), got {np.shape(row.skeleton)}"
        )
    if row.ends is not None:
        shape, radii = np.shape(row.ends), () if row.radius is None else np.shape(row.radius)
        if len(shape) != 4 or shape[0] != n or shape[2:] != (2, 3) or radii != shape[1:2]:
            raise ParameterError(
                f"{where}: ends must have shape ({n}, b, 2, 3) and radius (b,), "
                f"got {shape} and {radii}"
            )
        if row.still is not None and np.shape(row.still) != radii:
            raise ParameterError(
                f"{where}: still must have shape {radii}, got {np.shape(row.still)}"
            )
    for name, value in (("marked", row.marked), ("note", row.note)):
        if value is not None and len(value) != n:
            raise ParameterError(f"{where}: {name} must have {n} entries, got {len(value)}")


class Cells:
    """The pictures of one row, drawn when they are asked for."""

    def __init__(self, row: Row):
        """Take a row that check has passed."""
        self.row = row
        if row.skeleton is not None:
            self.ends, self.radius, names = stick_figures(row.skeleton)
            self.colours = np.array([to_rgb(name) for name in names])
        else:
            self.ends, self.radius = np.asarray(row.ends, float), np.asarray(row.radius, float)
            self.colours = np.tile(soft(row.colour or BODY), (len(self.radius), 1))
            self.colours[still(row)] = to_rgb(LEGS)

    @cached_property
    def good(self) -> np.ndarray:
        """Moments that have a pose, bool (n,)."""
        return np.isfinite(self.ends).all(axis=(1, 2, 3))

    @property
    def lowest(self) -> float | None:
        """Height of the lowest point of all moments [m]; None: there is no pose."""
        low = (self.ends[self.good][..., 2] - self.radius[:, None]).min(axis=(1, 2), initial=np.inf)
        return float(low.min()) if len(low) else None


class Window(NamedTuple):
    """What part of the picture plane a figure needs, in camera coordinates [m]."""

    left: float
    right: float
    low: float
    high: float
    floor: float | None  # height of the floor it stands on, world z; None: none is drawn


def window(shown: list[Cells], view: np.ndarray | None = None, floor: bool = True) -> Window:
    """The window that holds every moment of some figures.

    Args:
        shown: the figures.
        view: the camera's rotation (camera.camera); None: its usual one.
        floor: put a floor below the lowest of them.
    """
    drawn = [extent(c.ends[c.good], c.radius, view) for c in shown if c.good.any()]
    boxes = np.array(drawn or [_NOTHING])
    lowest = [c.lowest for c in shown if c.lowest is not None]
    return Window(
        float(boxes[:, 0].min()), float(boxes[:, 1].max()),
        float(boxes[:, 2].min()), float(boxes[:, 3].max()),
        min(lowest) if floor and lowest else None,
    )  # fmt: skip


def still(row: Row) -> np.ndarray:
    """Bodies of a robot to draw lighter, bool (b,)."""
    if row.still is not None:
        return np.asarray(row.still, bool)
    ends = np.asarray(row.ends, float)
    ends = ends[np.isfinite(ends).all(axis=(1, 2, 3))]
    if len(ends) < 2:
        return np.zeros(len(np.asarray(row.radius)), bool)
    still = (np.ptp(ends, axis=0) <= _STILL).all(axis=(1, 2))
    return still & ~still.all()  # a robot that never moves is not all legs


def soft(colour: str) -> np.ndarray:
    """A surface of this colour: lighter than the ink of a chart, so that shading shows."""
    rgb = np.array(to_rgb(colour))
    light = rgb @ [0.30, 0.59, 0.11]  # luma
    return rgb + (1.0 - rgb) * np.clip(0.75 - light, 0.2, 0.5)
