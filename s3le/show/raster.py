"""The rays of a picture of capsules, compiled: where they hit, and how that is lit.

A key light, a sky and a soft highlight; crevices are darkened where neighbours stand nearer to the
viewer, rims and seams get an outline, and a floor a shadow that fades with the bodies' height.
"""

import numpy as np

from s3le.kernels.compiled import compiled

_LIGHT = np.array([-0.50, 0.72, 0.62]) / np.sqrt(0.50**2 + 0.72**2 + 0.62**2)
_HALF = (_LIGHT + np.array([0.0, 0.0, 1.0])) / np.linalg.norm(_LIGHT + np.array([0.0, 0.0, 1.0]))
_STEP = 0.012  # [m] a jump in depth that earns an outline
_SPREAD = 0.05  # [m] how far crevices are darkened
_NONE = -1e3  # [m], a depth at which nothing is


def rays(
    turned: np.ndarray,
    radius: np.ndarray,
    colours: np.ndarray,
    corner: tuple[float, float],
    scale: float,
    size: tuple[int, int],
    fine: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Cast fine x fine rays per pixel and take their mean.

    Args:
        turned: capsule ends in camera coordinates [m], (b, 2, 3).
        radius: [m], (b,).
        colours: red, green, blue in [0, 1], (b, 3).
        corner: left and upper edge of the picture in camera coordinates [m].
        scale: pixels per metre.
        size: height and width in pixels.
        fine: rays per pixel and direction.

    Returns:
        Colour (h, w, 3), black where nothing is, and cover in [0, 1], (h, w, 1).
    """
    height, width = size[0] * fine, size[1] * fine
    sharp = scale * fine
    u = corner[0] + (np.arange(width) + 0.5) / sharp
    v = corner[1] - (np.arange(height) + 0.5) / sharp
    depth = np.full((height, width), -np.inf)
    body = np.full((height, width), -1, np.int32)
    turned = np.ascontiguousarray(turned, float)
    radius = np.ascontiguousarray(radius, float)
    _cast(turned, radius, u, v, depth, body)
    crevice = np.zeros((height, width))
    _crevices(depth, body, max(1, round(_SPREAD * sharp)), crevice)
    colour, cover = np.zeros((*size, 3)), np.zeros((*size, 1))
    colours = np.ascontiguousarray(colours, float)
    _paint(turned, radius, colours, u, v, depth, body, crevice, fine, _LIGHT, _HALF, colour, cover)
    return colour, cover


def shadow(
    ends: np.ndarray,
    radius: np.ndarray,
    floor: float,
    u: np.ndarray,
    v: np.ndarray,
    view: np.ndarray,
) -> np.ndarray:
    """Share of light that a floor loses below the bodies, (h, w), fading with their height.

    Args:
        ends: capsule ends in the world [m], (b, 2, 3).
        radius: [m], (b,).
        floor: its height [m].
        u: camera coordinates of the columns of pixels [m], (w,).
        v: of the rows, (h,).
        view: the camera's rotation, (3, 3).
    """
    lost = np.zeros((len(v), len(u)))
    _shadow(
        np.ascontiguousarray(ends, float), np.ascontiguousarray(radius, float), float(floor),
        u, v, np.ascontiguousarray(view), lost,
    )  # fmt: skip
    return lost


@compiled
def _cast(turned, radius, u, v, depth, body):
    """The nearest hit of every ray, and whose it is."""
    for k in range(len(radius)):
        a, b, r = turned[k, 0], turned[k, 1], radius[k]
        first = np.searchsorted(u, min(a[0], b[0]) - r)
        last = np.searchsorted(u, max(a[0], b[0]) + r)
        top = np.searchsorted(-v, -max(a[1], b[1]) - r)
        bottom = np.searchsorted(-v, -min(a[1], b[1]) + r)
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        across = 0.0
        if length > 1e-9:
            dx, dy, dz = dx / length, dy / length, dz / length
            across = 1.0 - dz * dz
        for i in range(top, bottom):
            for j in range(first, last):
                best = -np.inf
                for end in range(2):
                    c = turned[k, end]
                    inside = r * r - (u[j] - c[0]) ** 2 - (v[i] - c[1]) ** 2
                    if inside >= 0.0:
                        best = max(best, c[2] + np.sqrt(inside))
                if across > 1e-12:
                    ox, oy, oz = u[j] - a[0], v[i] - a[1], -a[2]
                    od = ox * dx + oy * dy + oz * dz
                    half = oz - dz * od
                    rest = ox * ox + oy * oy + oz * oz - od * od - r * r
                    under = half * half - across * rest
                    if under >= 0.0:
                        w = (np.sqrt(under) - half) / across
                        at = od + w * dz
                        if 0.0 <= at <= length:
                            best = max(best, w)
                if best > depth[i, j]:
                    depth[i, j] = best
                    body[i, j] = k


@compiled
def _blur(values, reach, out):
    """Mean over a square of 2 reach + 1 pixels, zeros beyond the edge."""
    height, width = values.shape
    wide = 2 * reach + 1
    half = np.empty((height, width))
    for i in range(height):
        total = 0.0
        for j in range(min(reach, width)):
            total += values[i, j]
        for j in range(width):
            if j + reach < width:
                total += values[i, j + reach]
            if j - reach - 1 >= 0:
                total -= values[i, j - reach - 1]
            half[i, j] = total / wide
    column = np.zeros(width)
    for i in range(min(reach, height)):
        for j in range(width):
            column[j] += half[i, j]
    for i in range(height):
        for j in range(width):
            if i + reach < height:
                column[j] += half[i + reach, j]
            if i - reach - 1 >= 0:
                column[j] -= half[i - reach - 1, j]
            out[i, j] = column[j] / wide


@compiled
def _crevices(depth, body, reach, lost):
    height, width = depth.shape
    filled, weight = np.zeros((height, width)), np.zeros((height, width))
    for i in range(height):
        for j in range(width):
            if body[i, j] >= 0:
                filled[i, j] = depth[i, j]
                lost[i, j] = 1.0
    _blur(lost, reach, weight)
    spread = np.empty((height, width))
    for _ in range(2):
        _blur(filled, reach, spread)
        for i in range(height):
            for j in range(width):
                solid = body[i, j] >= 0
                filled[i, j] = spread[i, j] / max(weight[i, j], 1e-9) if solid else 0.0
    for i in range(height):
        for j in range(width):
            if body[i, j] >= 0:
                lost[i, j] = min(max(3.2 * (filled[i, j] - depth[i, j]), 0.0), 0.38)


@compiled
def _ink(depth, body, i, j):
    """Share of light lost on the rim of the nearer body, and less at seams."""
    height, width = depth.shape
    ink = 0.0
    for step in range(1, 3):
        for side in range(4):
            y, x = i, j
            if side == 0:
                y = (i + step) % height
            elif side == 1:
                y = (i - step) % height
            elif side == 2:
                x = (j + step) % width
            else:
                x = (j - step) % width
            beside = depth[y, x] if body[y, x] >= 0 else _NONE
            if depth[i, j] - beside > _STEP:
                return 0.62
            if step == 1 and body[y, x] != body[i, j]:
                ink = 0.20
    return ink


@compiled
def _paint(turned, radius, colours, u, v, depth, body, crevice, fine, light, bright, out, cover):
    """Shade every ray that hit, and take the mean of those of a pixel."""
    share = 1.0 / (fine * fine)
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            k = body[i, j]
            if k < 0:
                continue
            a, b = turned[k, 0], turned[k, 1]
            dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            px, py, pz = u[j] - a[0], v[i] - a[1], depth[i, j] - a[2]
            t = (px * dx + py * dy + pz * dz) / max(dx * dx + dy * dy + dz * dz, 1e-18)
            t = min(max(t, 0.0), 1.0)
            nx, ny = (px - t * dx) / radius[k], (py - t * dy) / radius[k]
            nz = (pz - t * dz) / radius[k]
            key = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
            sky = 0.5 + 0.5 * ny
            facing = min(max(nz, 0.0), 1.0)
            strength = (0.60 + 0.14 * sky + 0.40 * key) * (0.80 + 0.20 * facing)
            shine = max(nx * bright[0] + ny * bright[1] + nz * bright[2], 0.0)
            gloss = 0.16 * shine**28
            dark = (1.0 - crevice[i, j]) * (1.0 - _ink(depth, body, i, j)) * share
            for c in range(3):
                lit = min(max(colours[k, c] * strength + gloss, 0.0), 1.0)
                out[i // fine, j // fine, c] += lit * dark
            cover[i // fine, j // fine, 0] += share


@compiled
def _shadow(ends, radius, floor, u, v, view, lost):
    for k in range(len(radius)):
        a, b, r = ends[k, 0], ends[k, 1], radius[k]
        over = min(a[2], b[2]) - r - floor
        weight = 0.34 * np.exp(-max(over, 0.0) / 0.12)
        if weight < 0.02:
            continue
        dx, dy = b[0] - a[0], b[1] - a[1]
        soft = 0.03 + 0.5 * max(over, 0.0)
        for i in range(len(v)):
            w = (floor - v[i] * view[1, 2]) / view[2, 2]  # the floor point that a pixel sees
            for j in range(len(u)):
                x = v[i] * view[1, 0] + w * view[2, 0] + u[j] * view[0, 0] - a[0]
                y = v[i] * view[1, 1] + w * view[2, 1] + u[j] * view[0, 1] - a[1]
                t = min(max((x * dx + y * dy) / max(dx * dx + dy * dy, 1e-12), 0.0), 1.0)
                gap = np.sqrt((x - t * dx) ** 2 + (y - t * dy) ** 2) - r
                dim = weight * min(max(0.5 - gap / (2.0 * soft), 0.0), 1.0)
                if dim > lost[i, j]:
                    lost[i, j] = dim
