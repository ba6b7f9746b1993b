"""The snapshot strip: moments in time from left to right, the human above, robots below.

The human is known only as seven directions, so it is drawn with nominal segment lengths; the
robot is drawn from its capsules. One camera and one scale [pixels per metre] for every cell.
"""

import textwrap
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from s3le.errors import ParameterError
from s3le.show import style
from s3le.show.camera import FINE, USUAL, Camera, render
from s3le.show.figures import Cells, Row, check, still, window
from s3le.show.human import FOREARM, SHOULDER, TRUNK, UPPER_ARM

_LABEL, _PAD, _LINE = 196, 6, 18  # [pixels]
_NAME = (_LABEL - 20) / style.DPI  # [inch] for a row's name
_WIDEST, _FINEST = 1880, 230.0  # [pixels] for all cells together, [pixels per metre]


class Photos(NamedTuple):
    """Pictures of a camera above the figures, with what was seen in them."""

    label: str
    pictures: list[np.ndarray]  # uint8 (height, width, 3) each, all of one shape, one per moment
    lines: np.ndarray  # [pixels], (n, k, 2, 2): ends (x, y) of k lines; NaN: not drawn
    colours: list[str]  # (k,)


def draw(
    path: Path,
    times: np.ndarray,
    rows: list[Row],
    title: str,
    camera: Camera = USUAL,
    width: int = _WIDEST,
    fine: int = FINE,
    photos: Photos | None = None,
) -> None:
    """Draw a strip.

    A pose or skeleton that is not finite leaves its cell empty but for the word "none".

    Args:
        path: the PNG to write.
        times: moments [s], shape (n,).
        rows: from top to bottom.
        title: above everything.
        camera: where all are seen from.
        width: of all cells together [pixels], at most.
        fine: rays per pixel and direction.
        photos: above all rows.

    Raises:
        ParameterError: a row has neither or both of skeleton and capsules, or an array of
            another length or shape; names the row. Or there is not one photo for each moment.
    """
    times = np.asarray(times, float)
    n = len(times)
    for row in rows:
        check(row, n)
    if photos and not len(photos.pictures) == len(photos.lines) == n:
        raise ParameterError(f"{len(photos.pictures)} photos for {n} moments")
    with style.sheet():
        if not n or not rows:
            figure = style.figure(6.0, 1.6)
            figure.text(0.02, 0.95, title, va="top", size=12, weight="bold")
            style.note(figure, "nothing to draw: no moments or no rows")
        else:
            figure = _strip(times, rows, title, camera, width, fine, photos)
        style.save(figure, path)


def _strip(
    times: np.ndarray,
    rows: list[Row],
    title: str,
    camera: Camera,
    widest: int,
    fine: int,
    photos: Photos | None,
) -> Figure:
    view = camera.rotation()
    n = len(times)
    shown = [Cells(row) for row in rows]
    # Robots share one window, so that the same height is the same height in every row.
    kinds = ["human" if row.human else "robot" for row in rows]
    windows = {
        kind: window([c for c in shown if c.row.human == (kind == "human")], view, kind == "robot")
        for kind in set(kinds)
    }
    left = min(w.left for w in windows.values()) - 0.03  # the hip keeps its place in the cell
    right = max(w.right for w in windows.values()) + 0.03
    scale = min(_FINEST * widest / _WIDEST, widest / n / (right - left))
    wide = max(round((right - left) * scale), 64)
    tall = {kind: round((w.high - w.low + 0.06) * scale) for kind, w in windows.items()}
    noted = [20 if row.note is not None else 0 for row in rows]
    # A long name takes as many lines as it needs; the row below waits for them.
    lines = [style.wrapped(row.label, _NAME, 9.0, bold=True).count("\n") + 1 for row in rows]
    for i, (kind, own) in enumerate(zip(kinds, lines, strict=True)):
        noted[i] = max(noted[i], own * 20 - tall[kind])
    heights = [tall[kind] + extra for kind, extra in zip(kinds, noted, strict=True)]

    seen = round(wide * np.divide(*photos.pictures[0].shape[:2])) + _PAD if photos else 0
    width = max(_LABEL + n * (wide + _PAD) + _PAD, 760)
    title = style.wrapped(title, (width - 20) / style.DPI, 11.0, bold=True)
    letters, room = int((width - _LABEL) / 7.9), 0.95 * (width - _LABEL - 8) / style.DPI
    words = _caption(rows, kinds, camera)
    while max(map(partial(style.wide, size=7.0), caption := textwrap.wrap(words, letters))) > room:
        letters -= 1
    head = 44 + 27 * (title.count("\n") + 1)
    height = head + seen + sum(heights) + _PAD * len(rows) + 26 + _LINE * len(caption)
    figure = style.figure(width / style.DPI, height / style.DPI)
    page = _Page(figure, width, height)
    page.text(10, 10, title, size=11.0, weight="bold", va="top")
    for column, time in enumerate(times):
        x = _LABEL + column * (wide + _PAD) + wide / 2
        page.text(
            x, head - 8, f"{time:.2f} s", size=8.0, ha="center", va="bottom", color=style.QUIET
        )

    y = head + seen
    if photos:
        page.text(
            _LABEL - 14, head + seen / 2, style.wrapped(photos.label, _NAME, 9.0, bold=True),
            size=9.0, ha="right", va="center", weight="bold",
        )  # fmt: skip
        for column in range(n):
            x = _LABEL + column * (wide + _PAD)
            page.photo(photos, column, x, head, wide, seen - _PAD)
    for row, kind, cells, extra in zip(rows, kinds, shown, noted, strict=True):
        _label(page, row, kind, y, tall[kind])
        marked = np.zeros(n, bool) if row.marked is None else np.asarray(row.marked, bool)
        for column, good in enumerate(cells.good):
            x = _LABEL + column * (wide + _PAD)
            if not good:
                page.box(x, y, wide, tall[kind] + extra, fill=style.BAND, edge=None)
                page.text(
                    x + wide / 2, y + tall[kind] / 2, "none",
                    size=7, ha="center", va="center", color=style.QUIET,
                )  # fmt: skip
            else:
                corner = left, windows[kind].high + 0.03
                picture = render(
                    cells.ends[column], cells.radius, cells.colours, corner, scale,
                    (tall[kind], wide), windows[kind].floor, view, fine,
                )  # fmt: skip
                page.image(picture, x, y)
            if row.note is not None:
                page.text(
                    x + wide / 2, y + tall[kind] + extra / 2, row.note[column],
                    size=7, ha="center", va="center", color=style.QUIET,
                )  # fmt: skip
            if marked[column]:
                page.box(x + 1, y + 1, wide - 2, tall[kind] + extra - 2, None, style.ALARM)
                page.text(
                    x + 6, y + 6, "collides", size=7, va="top", color="white", weight="bold",
                    bbox={"facecolor": style.ALARM, "edgecolor": "none", "pad": 1.6},
                )  # fmt: skip
        y += tall[kind] + extra + _PAD
    bar = 0.2  # [m]
    page.box(_LABEL - 14 - bar * scale, y + 14, bar * scale, 3, fill=style.INK, edge=None)
    page.text(_LABEL - 14, y + 22, f"{bar:g} m", size=7, ha="right", va="top", color=style.QUIET)
    page.text(_LABEL, y + 9, "\n".join(caption), size=7, va="top", color=style.QUIET)
    return figure


def _label(page: "_Page", row: Row, kind: str, y: float, tall: int) -> None:
    middle, label = y + tall / 2, style.wrapped(row.label, _NAME, 9.0, bold=True)
    page.text(
        _LABEL - 14,
        middle,
        label,
        size=9.0,
        ha="right",
        va="center",
        weight="bold",
    )
    if kind == "robot" and row.colour:
        page.box(_LABEL - 8, y + 4, 3, tall - 8, fill=row.colour, edge=None)


def _caption(rows: list[Row], kinds: list[str], camera: Camera) -> str:
    words = [f"Every figure is {camera}, in parallel projection, all at one scale."]
    if "human" in kinds:
        words.append(
            "Human: measured directions drawn with nominal lengths "
            f"(trunk {TRUNK:.2f} m, neck to shoulder {SHOULDER:.2f} m, "
            f"upper arm {UPPER_ARM:.2f} m, forearm {FOREARM:.2f} m); green its left arm, "
            "violet its right; the pale head and pelvis are not measured."
        )
    if any(not row.human and still(row).any() for row in rows):
        words.append("Robot: its collision bodies; pale ones stand still.")
    elif "robot" in kinds:
        words.append("Robot: its collision bodies.")
    if any(row.marked is not None and np.any(row.marked) for row in rows):
        words.append("Outlined in red: the robot collides with itself.")
    return " ".join(words)


class _Page:
    """A figure addressed in pixels from its upper left corner, so that images stay sharp."""

    def __init__(self, figure: Figure, width: int, height: int):
        self.figure, self.width, self.height = figure, width, height

    def text(self, x: float, y: float, text: str, **how: Any) -> None:
        self.figure.text(x / self.width, 1.0 - y / self.height, text, **how)

    def box(
        self, x: float, y: float, w: float, h: float, fill: str | None, edge: str | None
    ) -> None:
        self.figure.add_artist(
            Rectangle(
                (x / self.width, 1.0 - (y + h) / self.height),
                w / self.width,
                h / self.height,
                transform=self.figure.transFigure,
                facecolor=fill or "none",
                edgecolor=edge or "none",
                linewidth=1.2 if edge else 0.0,
            )
        )

    def photo(self, photos: Photos, i: int, x: float, y: float, w: float, h: float) -> None:
        """Place a picture, resampled to fit, and its lines."""
        place = x / self.width, 1.0 - (y + h) / self.height, w / self.width, h / self.height
        axes = self.figure.add_axes(place)
        axes.imshow(photos.pictures[i], interpolation="antialiased", aspect="auto")
        rows, columns = photos.pictures[i].shape[:2]
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
        axes.set_axis_off()
        for ends, colour in zip(photos.lines[i], photos.colours, strict=True):
            for wide, ink in ((3.0, "white"), (1.8, colour)):
                axes.plot(*ends.T, color=ink, linewidth=wide, solid_capstyle="round")

    def image(self, picture: np.ndarray, x: int, y: int) -> None:
        """Place pixels one to one."""
        h, w = picture.shape[:2]
        self.figure.figimage(picture, x, self.height - y - h, origin="upper", zorder=0.5)
