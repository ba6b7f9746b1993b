"""A picture of a robot in its anchor: bodies, vectors, and the pairs that nobody watches."""

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


def draw(path: Path, shown: Shown) -> None:
    """Draw the robot twice, solid and with lines through it, and write the PNG.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    with style.sheet():
        box = camera.extent(shown.ends, shown.radius)
        left, right, low, high = box + (-0.05, 0.05, -0.05, 0.05)
        size = round((high - low) * _SCALE), round((right - left) * _SCALE)
        colours = np.array([_rgb(_COLOURS[kind]) for kind in shown.kinds])
        floor = float((shown.ends[..., 2] - shown.radius[:, None]).min())
        images = [
            camera.render(shown.ends, shown.radius, tone, (left, high), _SCALE, size, floor)
            for tone in (colours, colours + _FAINT * (1.0 - colours))
        ]
        lines = [row for note in shown.notes for row in textwrap.wrap(note, 150)]
        below = 0.16 * len(lines) + 0.35
        width, height = 2 * size[1] / style.DPI + 0.4, size[0] / style.DPI + 0.9 + below
        figure = style.figure(max(width, 7.0), height)
        figure.text(0.02, 1 - 0.15 / height, shown.title, va="top", size=12, weight="bold")
        for k, image in enumerate(images):
            place = (0.02 + 0.49 * k, below / height, 0.47, 1 - (below + 0.75) / height)
            axes = figure.add_axes(place)
            axes.imshow(image, extent=(left, right, low, high), interpolation="antialiased")
            axes.set_axis_off()
            axes.set_title(
                "bodies" if k == 0 else "vectors, and pairs that are not watched (red)", size=9
            )
        _lines(axes, shown)
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        for k, line in enumerate(lines):
            y = (below - 0.2 - 0.16 * k) / height
            figure.text(0.02, y, line, size=7.5, va="top", color=style.QUIET)
        style.save(figure, path)


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
