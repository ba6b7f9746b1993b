"""Which axis of a BVH file is up: its rest pose and its motion must not disagree.

Bones' offsets say it where the rest pose stands; in files whose bones all lie along one axis
(LAFAN1, Rokoko, SOMA) they say nothing. The motion says it where most trunks are upright, or where
the lowest joint stays on a floor at zero. A body that lies along an axis looks as if it stood along
it: so a trunk alone decides only where somebody stands on a floor, and no floor lies across.
"""

from pathlib import Path

import numpy as np

from s3le.errors import ClipError

LEAN = 40.0  # [deg] that the median trunk may lean from the axis that is taken for up
RESTS = 0.8  # least cosine of a rest pose's trunk that stands
FLOOR = (-0.15, 0.6)  # [trunks] where the lowest joint is, in the median, of a body on a floor
WANDERS = 0.5  # [trunks] between the 5th and 95th percentile of the lowest joint on a floor
STANDS = (0.6, 4.0)  # [trunks] of a hip's height over zero
UNDER = (-0.4, 0.8)  # [trunks] of the lowest joint's height where the file has legs
ABOVE = 0.05  # [trunks] that the hip is above it at least
_AXES = {"y-up": 1, "z-up": 2}
SAY = "say which axis is up: --axes y-up or --axes z-up"


def up(
    path: Path | str,
    rest: np.ndarray,
    hip: np.ndarray,
    neck: np.ndarray,
    joints: np.ndarray,
    legs: bool,
) -> tuple[str, list[str]]:
    """The axes of a file, y-up or z-up, and what is to be said of how they were found.

    Args:
        path: for messages.
        rest: from hip to neck in the rest pose, (3,), in the file's axes and unit.
        hip, neck: in the motion, (n, 3).
        joints: all joints that are looked at, (n, j, 3).
        legs: whether knees and ankles are among them.

    Raises:
        ClipError: rest pose and motion disagree, or neither says which axis is up.
    """
    trunk = neck - hip
    stands = _along(rest[None], RESTS)
    points = _along(trunk, np.cos(np.radians(LEAN)))
    if stands is not None:
        if points not in (None, stands):
            raise ClipError(
                f"{path}: its rest pose is {stands} and trunks in the motion point {points}: "
                f"somebody lies, or the axes were changed; {SAY}"
            )
        return stands, [] if stands == "y-up" else ["axes z-up, by its rest pose"]
    length = float(np.median(np.linalg.norm(trunk, axis=1)))
    floors = [axes for axes, k in _AXES.items() if _floor(hip[:, k], joints[:, :, k], length)]
    if points is not None:
        k = _AXES[points]
        if floors and floors != [points]:
            raise ClipError(
                f"{path}: trunks point {points}, but all that moves stays on a floor "
                f"{' and '.join(floors)}: somebody may lie; {SAY}"
            )
        if not _stands(hip[:, k], joints[:, :, k] if legs else None, length):
            raise ClipError(
                f"{path}: trunks point {points}, but nobody stands on a floor at zero of that "
                f"axis, and the rest pose says nothing: somebody may lie; {SAY}"
            )
        return points, [f"axes {points}, by where trunks point"]
    if len(floors) == 1:
        return floors[0], [f"axes {floors[0]}, by the floor"]
    raise ClipError(
        f"{path}: neither its rest pose nor its motion tells which axis is up "
        f"(trunks point along {_way(trunk)}); {SAY}"
    )


def _along(trunks: np.ndarray, least: float) -> str | None:
    """The axes along which the median of these trunks (n, 3) points; None: neither."""
    way = _median_way(trunks)
    return next((axes for axes, k in _AXES.items() if way[k] >= least), None)


def _median_way(trunks: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(trunks, axis=1)
    if not (length > 0.0).any():
        return np.zeros(3)
    way = np.median(trunks[length > 0.0] / length[length > 0.0, None], axis=0)
    return way / max(np.linalg.norm(way), 1e-9)


def _way(trunks: np.ndarray) -> str:
    return f"({', '.join(f'{v:.2f}' for v in _median_way(trunks))})"


def _stands(hip: np.ndarray, heights: np.ndarray | None, trunk: float) -> bool:
    """Whether a hip (n,) is as high as one stands or sits, and the lowest joint (n, j) at zero."""
    lowest = 0.0 if heights is None else np.median(heights.min(axis=1)) / trunk
    high = np.median(hip) / trunk
    return bool(STANDS[0] <= high <= STANDS[1] and UNDER[0] <= lowest <= UNDER[1])


def _floor(hip: np.ndarray, heights: np.ndarray, trunk: float) -> bool:
    """Whether a body stays on a floor at zero of this axis: hip (n,), all joints (n, j)."""
    if not trunk > 0.0:
        return False
    lowest = heights.min(axis=1) / trunk
    low, middle, high = np.percentile(lowest, (5, 50, 95))
    on = FLOOR[0] <= middle <= FLOOR[1] and high - low <= WANDERS
    return bool(on and np.median(hip) / trunk >= ABOVE)
