"""The camera that all figures are seen through, and the picture of capsules that it takes.

Parallel projection. Every pixel's ray is intersected with every capsule in closed form and the
nearest hit is kept (s3le.show.raster), so bodies that run into each other at a joint look right
without sorting; no screen and no GPU is needed.

Camera coordinates: right, up, towards the viewer [m]. World: x forward, y left, z up.
"""

from typing import NamedTuple

import numpy as np

from s3le.show import raster

AZIMUTH = 22.0  # [deg] the camera stands in front, this far towards the subject's left
ELEVATION = 14.0  # [deg] and this far above

FINE = 3  # rays per pixel and direction, of a still picture


class Camera(NamedTuple):
    """Where all figures are seen from."""

    azimuth: float = AZIMUTH  # [deg]
    elevation: float = ELEVATION  # [deg], above 0: a floor is seen from above

    def rotation(self) -> np.ndarray:
        """World -> camera coordinates, (3, 3); rows are right, up, towards the viewer."""
        az, el = np.radians(self.azimuth), np.radians(self.elevation)
        towards = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        right = np.array([-np.sin(az), np.cos(az), 0.0])
        return np.stack([right, np.cross(towards, right), towards])

    def __str__(self) -> str:
        """Words for a caption."""
        side = "left" if self.azimuth >= 0.0 else "right"
        where = f"{abs(self.azimuth):g}° to its {side}" if self.azimuth else "its front"
        return f"seen from {where} and {self.elevation:g}° above"


USUAL = Camera()


def camera() -> np.ndarray:
    """The usual camera's rotation, (3, 3)."""
    return USUAL.rotation()


def extent(ends: np.ndarray, radius: np.ndarray, view: np.ndarray | None = None) -> np.ndarray:
    """What capsules cover in the picture: (left, right, low, high) [m].

    Args:
        ends: world ends [m], shape (..., b, 2, 3); rows that are not finite are left out.
        radius: [m], shape (b,).
        view: the camera's rotation; None: the usual one.

    Returns:
        Shape (4,); zeros if nothing is finite.
    """
    seen = ends @ (camera() if view is None else view).T  # (..., b, 2, 3)
    grown = np.broadcast_to(np.asarray(radius)[:, None, None], (*seen.shape[:-1], 1))
    seen, grown = seen[..., :2].reshape(-1, 2), grown.reshape(-1, 1)
    good = np.isfinite(seen).all(axis=1)
    if not good.any():
        return np.zeros(4)
    low, high = (seen - grown)[good].min(axis=0), (seen + grown)[good].max(axis=0)
    return np.array([low[0], high[0], low[1], high[1]])


def render(
    ends: np.ndarray,
    radius: np.ndarray,
    colours: np.ndarray,
    corner: tuple[float, float],
    scale: float,
    size: tuple[int, int],
    floor: float | None = None,
    view: np.ndarray | None = None,
    fine: int = FINE,
) -> np.ndarray:
    """Draw capsules on white.

    Args:
        ends: world ends [m], shape (b, 2, 3), finite.
        radius: [m], shape (b,), above 0.
        colours: red, green, blue in [0, 1], shape (b, 3).
        corner: left and upper edge of the picture in camera coordinates [m].
        scale: pixels per metre.
        size: height and width in pixels.
        floor: height of a floor that receives soft shadows [m], world z; None: no floor.
        view: the camera's rotation; None: the usual one.
        fine: rays per pixel and direction.

    Returns:
        Picture, uint8 of shape (height, width, 3), first row on top.
    """
    view = camera() if view is None else view
    picture = np.ones((*size, 3))
    if floor is not None:
        across, down = _pixels(corner, scale, size)
        picture *= 1.0 - raster.shadow(ends, radius, floor, across, down, view)[..., None]
    # Only the pixels around the bodies are worth rays.
    left, right, low, high = extent(ends, radius, view)
    top, bottom = (round((corner[1] - side) * scale) for side in (high, low))
    first, last = (round((side - corner[0]) * scale) for side in (left, right))
    rows = slice(max(top - 2, 0), max(min(bottom + 2, size[0]), 0))
    columns = slice(max(first - 2, 0), max(min(last + 2, size[1]), 0))
    part = rows.stop - rows.start, columns.stop - columns.start
    if min(part) > 0:
        start = corner[0] + columns.start / scale, corner[1] - rows.start / scale
        colour, cover = raster.rays(
            ends @ view.T, radius, np.asarray(colours, float), start, scale, part, fine
        )
        picture[rows, columns] = picture[rows, columns] * (1.0 - cover) + colour
    return np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def _pixels(corner, scale, size):
    """Camera coordinates of pixel centres: columns (w,) and rows (h,) [m]."""
    height, width = size
    across = corner[0] + (np.arange(width) + 0.5) / scale
    return across, corner[1] - (np.arange(height) + 0.5) / scale
