"""Shaded pictures of capsules, without a screen or a GPU.

Parallel projection. Every pixel's ray is intersected with every capsule in closed form and the
nearest hit is kept, so bodies that run into each other at a joint look right without sorting.

Camera coordinates: right, up, towards the viewer [m]. World: x forward, y left, z up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

AZIMUTH = 22.0  # [deg] the camera stands in front, this far towards the subject's left
ELEVATION = 14.0  # [deg] and this far above

_LIGHT = np.array([-0.50, 0.72, 0.62])
_FINE = 3  # rays per pixel and direction, of a still picture
_STEP = 0.012  # [m] a jump in depth that earns an outline
_SPREAD = 0.05  # [m] how far crevices are darkened


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


class Painter(NamedTuple):
    """The two parts of a picture that take time; s3le.show.raster has them compiled."""

    # (ends in camera coordinates, radius, colours, corner, scale, size, rays per pixel and
    # direction) -> colour (h, w, 3), black where nothing is, and cover (h, w, 1)
    rays: Callable[..., tuple[np.ndarray, np.ndarray]]
    # (ends, radius, floor, u, v, view) -> share of light lost (h, w)
    shadow: Callable[..., np.ndarray]
    fine: int  # rays per pixel and direction


def render(
    ends: np.ndarray,
    radius: np.ndarray,
    colours: np.ndarray,
    corner: tuple[float, float],
    scale: float,
    size: tuple[int, int],
    floor: float | None = None,
    view: np.ndarray | None = None,
    painter: Painter | None = None,
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
        painter: what casts the rays; None: this file.

    Returns:
        Picture, uint8 of shape (height, width, 3), first row on top.
    """
    view = camera() if view is None else view
    painter = painter or PLAIN
    picture = np.ones((*size, 3))
    if floor is not None:
        across, down = _pixels(corner, scale, size)
        picture *= 1.0 - painter.shadow(ends, radius, floor, across, down, view)[..., None]
    # Only the pixels around the bodies are worth rays.
    left, right, low, high = extent(ends, radius, view)
    top, bottom = (round((corner[1] - side) * scale) for side in (high, low))
    first, last = (round((side - corner[0]) * scale) for side in (left, right))
    rows = slice(max(top - 2, 0), max(min(bottom + 2, size[0]), 0))
    columns = slice(max(first - 2, 0), max(min(last + 2, size[1]), 0))
    part = rows.stop - rows.start, columns.stop - columns.start
    if min(part) > 0:
        start = corner[0] + columns.start / scale, corner[1] - rows.start / scale
        colour, cover = painter.rays(
            ends @ view.T, radius, np.asarray(colours, float), start, scale, part, painter.fine
        )
        picture[rows, columns] = picture[rows, columns] * (1.0 - cover) + colour
    return np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def _pixels(corner, scale, size):
    """Camera coordinates of pixel centres: columns (w,) and rows (h,) [m]."""
    height, width = size
    across = corner[0] + (np.arange(width) + 0.5) / scale
    return across, corner[1] - (np.arange(height) + 0.5) / scale


def _rays(turned, radius, colours, corner, scale, size, fine):
    """Cast fine x fine rays per pixel and take their mean."""
    layers = _each(turned, radius, colours, corner, scale * fine, [n * fine for n in size])
    return tuple(
        layer.reshape(size[0], fine, size[1], fine, -1).mean(axis=(1, 3)) for layer in layers
    )


def _each(turned, radius, colours, corner, scale, size):
    """One ray per pixel: colour (h, w, 3), black where nothing is, and cover (h, w, 1)."""
    u, v = _pixels(corner, scale, size)
    depth = np.full(size, -np.inf)  # towards the viewer
    normal = np.zeros((*size, 3))
    body = np.full(size, -1)
    for k, (a, b) in enumerate(turned):
        rows, columns = _box(a, b, radius[k], u, v)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            continue
        hit, out = _hit(a, b, radius[k], u[columns], v[rows])
        nearer = hit > depth[rows, columns]
        depth[rows, columns][nearer] = hit[nearer]
        normal[rows, columns][nearer] = out[nearer]
        body[rows, columns][nearer] = k
    solid = body >= 0
    picture = np.zeros((*size, 3))
    lit = _shade(normal[solid], np.asarray(colours)[body[solid]])
    dark = (1.0 - _crevices(depth, solid, scale)) * (1.0 - _outlines(depth, body, solid))
    picture[solid] = lit * dark[solid][:, None]
    return picture, solid[..., None].astype(float)


def _box(a, b, r, u, v):
    """Rows and columns that a capsule can touch."""
    columns = np.searchsorted(u, [min(a[0], b[0]) - r, max(a[0], b[0]) + r])
    rows = np.searchsorted(-v, [-max(a[1], b[1]) - r, -min(a[1], b[1]) + r])
    return slice(*rows.tolist()), slice(*columns.tolist())


def _hit(a, b, r, u, v):
    """Depth (h, w), -inf for a miss, and outward normal (h, w, 3) of the first hit of each ray."""
    shape = (len(v), len(u))
    plane = np.stack([*np.broadcast_arrays(u[None, :], v[:, None]), np.zeros(shape)], axis=-1)
    best = np.full(shape, -np.inf)
    for end in (a, b):
        inside = r**2 - ((plane - end)[..., :2] ** 2).sum(axis=-1)
        ball = np.where(inside >= 0.0, end[2] + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
        best = np.maximum(best, ball)
    along = b - a
    length = float(np.linalg.norm(along))
    if length > 1e-9:
        # Distance from the axis equals r: a quadratic in the depth w of the point o + w e.
        d = along / length
        o = plane - a
        across = 1.0 - d[2] ** 2
        if across > 1e-12:
            od = o @ d
            half = o[..., 2] - d[2] * od
            rest = (o**2).sum(axis=-1) - od**2 - r**2
            under = half**2 - across * rest
            w = (-half + np.sqrt(np.maximum(under, 0.0))) / across
            at = od + w * d[2]
            side = (under >= 0.0) & (at >= 0.0) & (at <= length)
            best = np.maximum(best, np.where(side, w, -np.inf))
    point = plane.copy()
    point[..., 2] = np.where(np.isfinite(best), best, 0.0)
    share = np.clip((point - a) @ along / max(length**2, 1e-18), 0.0, 1.0)
    return best, (point - a - share[..., None] * along) / r


def _shade(normal, colour):
    """Light a surface: key light, sky, a soft highlight, darker where it turns away."""
    light = _LIGHT / np.linalg.norm(_LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    key = np.maximum(normal @ light, 0.0)
    sky = 0.5 + 0.5 * normal[:, 1]
    facing = np.clip(normal[:, 2], 0.0, 1.0)
    strength = (0.60 + 0.14 * sky + 0.40 * key) * (0.80 + 0.20 * facing)
    gloss = 0.16 * np.maximum(normal @ half, 0.0) ** 28
    return np.clip(colour * strength[:, None] + gloss[:, None], 0.0, 1.0)


def _crevices(depth, solid, fine):
    """Share of light lost where neighbours stand nearer to the viewer, (h, w)."""
    reach = max(1, round(_SPREAD * fine))
    filled = np.where(solid, depth, 0.0)
    weight = np.maximum(_blur(solid.astype(float), reach), 1e-9)
    for _ in range(2):  # twice a box is nearly a bell
        filled = np.where(solid, _blur(filled, reach) / weight, 0.0)
    return np.where(solid, np.clip(3.2 * (filled - np.where(solid, depth, 0.0)), 0.0, 0.38), 0.0)


def _blur(values, reach):
    """Mean over a square of 2 reach + 1 pixels, zeros beyond the edge."""
    for axis in (0, 1):
        wide = [(0, 0), (0, 0)]
        wide[axis] = (reach + 1, reach)
        total = np.cumsum(np.pad(values, wide), axis=axis)
        n = values.shape[axis]
        high = np.take(total, np.arange(2 * reach + 1, 2 * reach + 1 + n), axis=axis)
        values = (high - np.take(total, np.arange(n), axis=axis)) / (2 * reach + 1)
    return values


def _outlines(depth, body, solid):
    """Share of light lost on the rim of the nearer body, and less at seams, (h, w)."""
    ink = np.zeros(depth.shape)
    flat = np.where(solid, depth, -1e3)
    for step in (1, 2):
        for axis, by in ((0, step), (0, -step), (1, step), (1, -step)):
            beside, whose = np.roll(flat, by, axis), np.roll(body, by, axis)
            ink = np.maximum(ink, np.where(flat - beside > _STEP, 0.62, 0.0))
            if step == 1:
                ink = np.maximum(ink, np.where(whose != body, 0.20, 0.0))
    return np.where(solid, ink, 0.0)


def _shadow(ends, radius, floor, u, v, view):
    """Share of light a floor loses below the bodies, (h, w), fading with their height."""
    right, up, towards = view
    # The floor point (x, y, floor) that a pixel sees.
    w = (floor - v * up[2]) / towards[2]  # (h,)
    base = v[:, None] * up[:2] + w[:, None] * towards[:2]  # (h, 2)
    spot = base[:, None, :] + u[None, :, None] * right[:2]  # (h, w, 2)
    lost = np.zeros(spot.shape[:2])
    for (a, b), r in zip(ends, radius, strict=True):
        over = min(a[2], b[2]) - r - floor
        weight = 0.34 * np.exp(-max(over, 0.0) / 0.12)
        if weight < 0.02:
            continue
        along = (b - a)[:2]
        share = np.clip((spot - a[:2]) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        away = spot - a[:2] - share[..., None] * along
        gap = np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2) - r
        soft = 0.03 + 0.5 * max(over, 0.0)
        lost = np.maximum(lost, weight * np.clip(0.5 - gap / (2.0 * soft), 0.0, 1.0))
    return lost


PLAIN = Painter(_rays, _shadow, _FINE)
