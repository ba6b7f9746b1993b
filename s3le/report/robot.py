"""A picture of a robot: in its anchor, bodies, vectors, pairs that nobody watches; as it stands."""

import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.show import camera, style

_SCALE = 420.0  # pixels per metre
_COLOURS = {"trunk": "#9aa5b1", "right": "#D55E00", "left": "#0072B2"}
_FAINT = 0.75  # how far bodies fade where lines are drawn over them


class Shown(NamedTuple):
    """What is drawn."""

    title: str
    ends: np.ndarray  # [m], (b, 2, 3), capsule ends, x forward, y left, z up
    radius: np.ndarray  # [m], (b,)
    kinds: list[str]  # of each body: trunk, right or left
    bones: np.ndarray  # [m], (k, 2, 3), where the vectors begin and end
    names: list[str]  # of the vectors
    dropped: list[tuple[int, int]]  # bodies whose pair could move but is not watched
    notes: list[str]  # lines below
    standing: "Standing | None" = None  # the robot in its stand pose


class Standing(NamedTuple):
    """The robot in the pose in which it stands."""

    ends: np.ndarray  # [m], (b, 2, 3), capsule ends
    forbid: list[tuple[int, int]]  # bodies whose pair forbids the pose
    hulls: list[np.ndarray]  # [m], (n, 3), corners of what is drawn of it, where that is known


def draw(path: Path, shown: Shown) -> None:
    """Draw the robot solid, with lines through it, and as it stands, and write the PNG.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    with style.sheet():
        both = [shown.ends] + ([shown.standing.ends] if shown.standing else [])
        box = camera.extent(np.concatenate(both), np.tile(shown.radius, len(both)))
        left, right, low, high = box + (-0.05, 0.05, -0.05, 0.05)
        size = round((high - low) * _SCALE), round((right - left) * _SCALE)
        colours = np.array([_rgb(_COLOURS[kind]) for kind in shown.kinds])
        faint = colours + _FAINT * (1.0 - colours)
        views = [
            (shown.ends, colours, "bodies"),
            (shown.ends, faint, "vectors, and pairs that are not watched (red)"),
        ]
        if shown.standing:
            solid = faint if shown.standing.hulls else colours
            for k in {body for pair in shown.standing.forbid for body in pair}:
                solid[k] = _rgb(style.ALARM)
            many = len(shown.standing.forbid)
            words = f"{many} pairs forbid it (red)" if many else "nothing forbids it"
            views.append((shown.standing.ends, solid, f"as it stands: {words}"))
        lines = [row for note in shown.notes for row in textwrap.wrap(note, 150)]
        below = 0.16 * len(lines) + 0.35
        n = len(views)
        width, height = n * size[1] / style.DPI + 0.4, size[0] / style.DPI + 0.9 + below
        figure = style.figure(max(width, 3.5 * n), height)
        figure.text(0.02, 1 - 0.15 / height, shown.title, va="top", size=12, weight="bold")
        drawn = []
        for k, (ends, tone, words) in enumerate(views):
            floor = float((ends[..., 2] - shown.radius[:, None]).min())
            image = camera.render(ends, shown.radius, tone, (left, high), _SCALE, size, floor)
            place = (0.02 + 0.98 * k / n, below / height, 0.96 / n,
                     1 - (below + 0.75) / height)  # fmt: skip
            axes = figure.add_axes(place)
            axes.imshow(image, extent=(left, right, low, high), interpolation="antialiased")
            axes.set_axis_off()
            axes.set_title(words, size=9)
            drawn.append(axes)
        _lines(drawn[1], shown)
        if shown.standing:
            _outlines(drawn[2], shown.standing)
        for axes in drawn:
            axes.set_xlim(left, right)
            axes.set_ylim(low, high)
        for k, line in enumerate(lines):
            y = (below - 0.2 - 0.16 * k) / height
            figure.text(0.02, y, line, size=7.5, va="top", color=style.QUIET)
        style.save(figure, path)


def _outlines(axes, standing: Standing) -> None:
    """Outlines of the hulls, and lines between bodies whose pair forbids the pose."""
    view = camera.camera()
    for corners in standing.hulls:
        ring = outline((corners @ view.T)[:, :2])
        axes.fill(*ring.T, fill=False, edgecolor=style.INK, lw=0.6)
    centres = (standing.ends.mean(axis=1) @ view.T)[:, :2]
    for a, b in standing.forbid:
        axes.plot(*centres[[a, b]].T, color=style.ALARM, lw=0.9)


def outline(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull of points in a plane (n, 2), in order (Andrew's chain)."""
    ordered = points[np.lexsort(points.T[::-1])]
    halves = []
    for row in (ordered, ordered[::-1]):
        chain: list[np.ndarray] = []
        for point in row:
            while len(chain) > 1:
                (x, y), (u, v) = chain[-1] - chain[-2], point - chain[-2]
                if x * v - y * u > 0.0:
                    break
                chain.pop()
            chain.append(point)
        halves += chain[:-1]
    return np.array(halves)


def _lines(axes, shown: Shown) -> None:
    view = camera.camera()
    centres = (shown.ends.mean(axis=1) @ view.T)[:, :2]
    for a, b in shown.dropped:
        axes.plot(*centres[[a, b]].T, color=style.ALARM, lw=0.9, alpha=0.8)
        axes.plot(*centres[[a, b]].T, ".", color=style.ALARM, ms=3)
    for bone, name in zip(shown.bones, shown.names, strict=True):
        flat = (bone @ view.T)[:, :2]
        colour = _COLOURS.get({"r": "right", "l": "left"}.get(_side(name), ""), style.INK)
        axes.annotate(
            "", xy=flat[1], xytext=flat[0],
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0},
        )  # fmt: skip


def _side(name: str) -> str:
    for side in "rl":
        if name.startswith(f"{side}_") or f"to_{side}_" in name:
            return side
    return ""


def _rgb(colour: str) -> list[float]:
    return [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
