"""The snapshot strip: moments in time from left to right, the human above, robots below.

The human is known only as seven directions, so it is drawn with nominal segment lengths; the
robot is drawn from its capsules. One camera and one scale [pixels per metre] for every cell.
"""

import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from s3le.errors import ParameterError
from s3le.report import solid, style
from s3le.skeleton import DIM

TRUNK, SHOULDER, UPPER_ARM, FOREARM = 0.50, 0.19, 0.30, 0.26  # [m] nominal adult segments
PELVIS = 0.11  # [m] half width; the pelvis line lies along y by the skeleton's convention

LEFT, RIGHT, MIDDLE, PALE = "#1f9e89", "#8455a8", "#5c6670", "#e2e6ea"
BODY = "#9fb4c7"  # a robot without a colour of its own
LEGS = "#f3f5f7"

_LABEL, _PAD, _LINE = 196, 6, 18  # [pixels]
_WIDEST, _FINEST = 1880, 230.0  # [pixels] for all cells together, [pixels per metre]
_STILL = 1e-9  # [m] a body that never moves further than this stands still


class Row(NamedTuple):
    """One row of the strip; either a skeleton or capsules, one entry per moment."""

    label: str
    skeleton: np.ndarray | None = None  # (n, 21), unit vectors ordered as skeleton.BONES
    ends: np.ndarray | None = None  # [m], (n, b, 2, 3), capsule ends, x forward, y left, z up
    radius: np.ndarray | None = None  # [m], (b,)
    marked: np.ndarray | None = None  # bool (n,): collides; None: not one
    note: list[str] | None = None  # a few words below each cell
    colour: str | None = None  # of the robot's bodies, e.g. its method's (style.colour)
    still: np.ndarray | None = None  # bool (b,): drawn lighter; None: those that never move


def draw(path: Path, times: np.ndarray, rows: list[Row], title: str) -> None:
    """Draw a strip.

    A pose or skeleton that is not finite leaves its cell empty but for the word "none".

    Args:
        path: the PNG to write.
        times: moments [s], shape (n,).
        rows: from top to bottom.
        title: above everything.

    Raises:
        ParameterError: a row has neither or both of skeleton and capsules, or an array of
            another length or shape; names the row.
    """
    times = np.asarray(times, float)
    n = len(times)
    for row in rows:
        _check(row, n)
    with style.sheet():
        if not n or not rows:
            figure = style.figure(6.0, 1.6)
            figure.text(0.02, 0.95, title, va="top", size=12, weight="bold")
            style.note(figure, "nothing to draw: no moments or no rows")
        else:
            figure = _strip(times, rows, title)
        style.save(figure, path)


def stick_figure(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The human of nominal size that has the skeleton x, as thin capsules; hip at the origin.

    Args:
        x: one skeleton, shape (21,).

    Returns:
        Triple (ends (b, 2, 3) [m], radius (b,) [m], colour names (b,)). Head and pelvis are
        there to tell which way is up and front; the skeleton does not hold them.
    """
    bone = np.asarray(x, float).reshape(7, 3)
    hip, side = np.zeros(3), np.array([0.0, PELVIS, 0.0])
    neck = hip + TRUNK * bone[0]
    head = neck + 0.20 * bone[0]
    front = np.cross(bone[4] - bone[1], bone[0])  # of the chest
    nose = head + 0.085 * front / max(np.linalg.norm(front), 1e-9)
    parts = [
        (hip - side, hip + side, 0.020, PALE),
        (neck, neck + 0.13 * bone[0], 0.020, PALE),
        (head, head + 0.03 * bone[0], 0.078, PALE),
        (nose, nose, 0.018, PALE),
        (hip, neck, 0.024, MIDDLE),
        (hip, hip, 0.038, MIDDLE),
        (neck, neck, 0.036, MIDDLE),
    ]
    for first, colour in ((1, RIGHT), (4, LEFT)):
        shoulder = neck + SHOULDER * bone[first]
        elbow = shoulder + UPPER_ARM * bone[first + 1]
        hand = elbow + FOREARM * bone[first + 2]
        for a, b in ((neck, shoulder), (shoulder, elbow), (elbow, hand)):
            parts.append((a, b, 0.022, colour))
        for joint, size in ((shoulder, 0.036), (elbow, 0.034), (hand, 0.042)):
            parts.append((joint, joint, size, colour))
    ends = np.array([[a, b] for a, b, _, _ in parts])
    return ends, np.array([r for _, _, r, _ in parts]), [c for _, _, _, c in parts]


def _check(row: Row, n: int) -> None:
    where = f"strip row {row.label!r}"
    if (row.skeleton is None) == (row.ends is None):
        raise ParameterError(f"{where} needs either a skeleton or capsule ends")
    if row.skeleton is not None and np.shape(row.skeleton) != (n, DIM):
        raise ParameterError(
            f"{where}: skeleton must have shape ({n}, {DIM}), got {np.shape(row.skeleton)}"
        )
    if row.ends is not None:
        shape, radii = np.shape(row.ends), np.shape(row.radius)
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


class _Cell(NamedTuple):
    ends: np.ndarray  # [m], (b, 2, 3)
    radius: np.ndarray
    colours: np.ndarray  # (b, 3)


def _cells(row: Row) -> list[_Cell | None]:
    """What each cell of a row shows; None where there is no pose."""
    cells = []
    if row.skeleton is not None:
        for x in np.asarray(row.skeleton, float):
            if not np.isfinite(x).all():
                cells.append(None)
                continue
            ends, radius, names = stick_figure(x)
            cells.append(_Cell(ends, radius, np.array([to_rgb(name) for name in names])))
        return cells
    ends, radius = np.asarray(row.ends, float), np.asarray(row.radius, float)
    colours = np.tile(_soft(row.colour or BODY), (len(radius), 1))
    colours[_still(row)] = to_rgb(LEGS)
    for pose in ends:
        cells.append(_Cell(pose, radius, colours) if np.isfinite(pose).all() else None)
    return cells


def _still(row: Row) -> np.ndarray:
    """Bodies of a robot to draw lighter, bool (b,)."""
    if row.still is not None:
        return np.asarray(row.still, bool)
    ends = np.asarray(row.ends, float)
    ends = ends[np.isfinite(ends).all(axis=(1, 2, 3))]
    if len(ends) < 2:
        return np.zeros(len(row.radius), bool)
    still = (np.ptp(ends, axis=0) <= _STILL).all(axis=(1, 2))
    return still & ~still.all()  # a robot that never moves is not all legs


def _soft(colour: str) -> np.ndarray:
    """A surface of this colour: lighter than the ink of a chart, so that shading shows."""
    rgb = np.array(to_rgb(colour))
    light = rgb @ [0.30, 0.59, 0.11]  # luma
    return rgb + (1.0 - rgb) * np.clip(0.75 - light, 0.2, 0.5)


def _strip(times: np.ndarray, rows: list[Row], title: str) -> Figure:
    n = len(times)
    shown = [_cells(row) for row in rows]
    # Robots share one window, so that the same height is the same height in every row.
    kinds = ["human" if row.skeleton is not None else "robot" for row in rows]
    spans, floors = {}, {}
    for kind in set(kinds):
        drawn = [c for k, cells in zip(kinds, shown, strict=True) if k == kind for c in cells if c]
        boxes = np.array([solid.extent(c.ends, c.radius) for c in drawn] or [[-0.3, 0.3, 0.0, 0.5]])
        spans[kind] = boxes[:, 0].min(), boxes[:, 1].max(), boxes[:, 2].min(), boxes[:, 3].max()
        lowest = [(c.ends[..., 2] - c.radius[:, None]).min() for c in drawn]
        floors[kind] = min(lowest) if kind == "robot" and lowest else None
    left = min(span[0] for span in spans.values()) - 0.03  # the hip keeps its place in the cell
    right = max(span[1] for span in spans.values()) + 0.03
    scale = min(_FINEST, _WIDEST / n / (right - left))
    wide = max(round((right - left) * scale), 64)
    tall = {kind: round((high - low + 0.06) * scale) for kind, (_, _, low, high) in spans.items()}
    noted = [20 if row.note is not None else 0 for row in rows]
    heights = [tall[kind] + extra for kind, extra in zip(kinds, noted, strict=True)]

    width = max(_LABEL + n * (wide + _PAD) + _PAD, 760)
    title = textwrap.fill(title, max(width // 16, 20))
    caption = textwrap.wrap(_caption(rows, kinds), int((width - _LABEL) / 7.9))
    head = 44 + 27 * (title.count("\n") + 1)
    height = head + sum(heights) + _PAD * len(rows) + 26 + _LINE * len(caption)
    figure = style.figure(width / style.DPI, height / style.DPI)
    page = _Page(figure, width, height)
    page.text(10, 10, title, size=11.0, weight="bold", va="top")
    for column, time in enumerate(times):
        x = _LABEL + column * (wide + _PAD) + wide / 2
        page.text(
            x, head - 8, f"{time:.2f} s", size=8.0, ha="center", va="bottom", color=style.QUIET
        )

    y = head
    for row, kind, cells, extra in zip(rows, kinds, shown, noted, strict=True):
        _label(page, row, kind, y, tall[kind])
        marked = np.zeros(n, bool) if row.marked is None else np.asarray(row.marked, bool)
        for column, cell in enumerate(cells):
            x = _LABEL + column * (wide + _PAD)
            if cell is None:
                page.box(x, y, wide, tall[kind] + extra, fill=style.BAND, edge=None)
                page.text(
                    x + wide / 2, y + tall[kind] / 2, "none",
                    size=7, ha="center", va="center", color=style.QUIET,
                )  # fmt: skip
            else:
                corner = left, spans[kind][3] + 0.03
                picture = solid.render(
                    cell.ends, cell.radius, cell.colours, corner, scale,
                    (tall[kind], wide), floors[kind],
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
    middle = y + tall / 2
    page.text(
        _LABEL - 14,
        middle,
        textwrap.fill(row.label, 17),
        size=9.0,
        ha="right",
        va="center",
        weight="bold",
    )
    if kind == "robot" and row.colour:
        page.box(_LABEL - 8, y + 4, 3, tall - 8, fill=row.colour, edge=None)


def _caption(rows: list[Row], kinds: list[str]) -> str:
    words = [
        f"Every figure faces the viewer: seen from {solid.AZIMUTH:g}° to its left and "
        f"{solid.ELEVATION:g}° above, in parallel projection, all at one scale."
    ]
    if "human" in kinds:
        words.append(
            "Human: measured directions drawn with nominal lengths "
            f"(trunk {TRUNK:.2f} m, neck to shoulder {SHOULDER:.2f} m, "
            f"upper arm {UPPER_ARM:.2f} m, forearm {FOREARM:.2f} m); green its left arm, "
            "violet its right; the pale head and pelvis are not measured."
        )
    if any(kind == "robot" and _still(row).any() for row, kind in zip(rows, kinds, strict=True)):
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

    def text(self, x: float, y: float, text: str, **how: object) -> None:
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

    def image(self, picture: np.ndarray, x: int, y: int) -> None:
        """Place pixels one to one."""
        h, w = picture.shape[:2]
        self.figure.figimage(picture, x, self.height - y - h, origin="upper", zorder=0.5)
