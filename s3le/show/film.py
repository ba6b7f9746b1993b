"""A film's pictures: human and robots side by side, at one scale, seen by one camera.

Below each robot stands how its motion goes and how far its bodies are apart; below all a line of
time with the stretches in which it is slowed or held.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from s3le.errors import ParameterError
from s3le.show import style
from s3le.show.camera import Camera, render
from s3le.show.figures import Cells, Row, check, window
from s3le.show.human import stand

_PAD, _TITLE, _WORDS, _LINE, _FOOT = 10, 34, 24, 9, 30  # [pixels]
_TEXT = 17  # [pixels] of another line of a title
_ROOM = 0.04  # [m] around a figure
_TALLEST = 0.9  # of a picture's height to its width, below which the width decides the scale


class Track(NamedTuple):
    """What is said of one row over time."""

    spans: list[tuple[int, int, str]]  # (first, one after the last moment, colour)


class Film:
    """A film that is drawn one picture after the other; call within style.sheet."""

    def __init__(
        self,
        times: np.ndarray,
        rows: list[Row],
        tracks: list[Track],
        legend: list[tuple[str, str]],
        camera: Camera,
        width: int,
        fine: int,
    ) -> None:
        """Lay out the pictures.

        Args:
            times: moments [s], (n,).
            rows: figures from left to right; their notes are written below them.
            tracks: of the robots among them, from top to bottom.
            legend: words and colours that explain the tracks.
            camera: where all are seen from.
            width: of a picture [pixels]; made even, as films want it.
            fine: rays per pixel and direction.

        Raises:
            ParameterError: there is no moment or row, or a row does not fit.
        """
        if not len(times) or not rows:
            raise ParameterError("a film needs at least one moment and one figure")
        for row in rows:
            check(row, len(times))
        self.times, self._rows, self._fine = np.asarray(times, float), rows, fine
        self._cells = [_grounded(row, rows) for row in rows]
        self._view = camera.rotation()
        self._window = window(self._cells, self._view)
        w = self._window
        self._width = max(width, 160 * len(rows)) // 2 * 2
        self._cell = (self._width - _PAD * (len(rows) + 1)) // len(rows)
        wide, tall = w.right - w.left + 2 * _ROOM, w.high - w.low + 2 * _ROOM
        self._scale = min(self._cell / wide, _TALLEST * self._width / tall)
        self._tall = round(tall * self._scale)
        # The figures stay in the middle of their cells.
        self._corner = ((w.left + w.right - self._cell / self._scale) / 2, w.high + _ROOM)
        self._labels = [style.wrapped(row.label, self._cell / 100, 10, bold=True) for row in rows]
        lines = max(label.count("\n") + 1 for label in self._labels)
        self._title = _TITLE + _TEXT * (lines - 1)
        height = self._title + self._tall + _WORDS + (_LINE + 3) * max(len(tracks), 1) + _FOOT
        self.size = self._width, height + height % 2
        self._draw_frame(tracks, legend)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Pictures, uint8 (height, width, 3), first row on top."""
        return map(self.picture, range(len(self.times)))

    def picture(self, i: int) -> np.ndarray:
        """The picture of one moment."""
        self._canvas.restore_region(self._blank)
        self._clock.set_text(f"{self.times[i]:.2f} s")
        self._cursor.set_x(self._along(i) - 1.0 / self.size[0])
        for words, row in zip(self._words, self._rows, strict=True):
            words.set_text(style.printable(row.note[i]) if row.note is not None else "")
        for artist in (self._clock, self._cursor, *self._words):
            self._figure.draw_artist(artist)
        page = np.array(np.asarray(self._canvas.buffer_rgba())[..., :3])
        for column, cells in enumerate(self._cells):
            x = _PAD + column * (self._cell + _PAD)
            part = page[self._title : self._title + self._tall, x : x + self._cell]
            if not cells.good[i]:
                part[:] = 242
                continue
            part[:] = render(
                cells.ends[i], cells.radius, cells.colours, self._corner, self._scale,
                part.shape[:2], self._window.floor, self._view, self._fine,
            )  # fmt: skip
            if cells.row.marked is not None and cells.row.marked[i]:
                for edge in (part[:2], part[-2:], part[:, :2], part[:, -2:]):
                    edge[:] = _ALARM
        return page

    def _along(self, i: float) -> float:
        """Where on the line of time a moment lies, as a share of the width."""
        share = i / max(len(self.times) - 1, 1)
        return (_PAD + share * (self._width - 2 * _PAD)) / self._width

    def _draw_frame(self, tracks: list[Track], legend: list[tuple[str, str]]) -> None:
        """All that never changes, drawn once, and the words that do."""
        width, height = self.size
        self._figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        text, box = self._figure.text, self._box
        middles = [_PAD + (k + 0.5) * self._cell + k * _PAD for k in range(len(self._rows))]
        for row, label, middle in zip(self._rows, self._labels, middles, strict=True):
            text(middle / width, 1 - (self._title / 2 + 3) / height, label, ha="center",
                 va="center", size=10, weight="bold", color=row.colour or style.INK)  # fmt: skip
        self._words = [
            text(middle / width, 1 - (self._title + self._tall + 12) / height, "", ha="center",
                 va="center", size=8.5, color=style.QUIET, animated=True)
            for middle in middles
        ]  # fmt: skip
        top = self._title + self._tall + _WORDS
        for number, track in enumerate(tracks or [Track([])]):
            y = top + number * (_LINE + 3)
            box(self._along(0), y, self._along(len(self.times) - 1), _LINE, "#dfe5ea")
            for first, end, colour in track.spans:
                last = min(end, len(self.times) - 1)
                box(self._along(first), y, max(self._along(last), self._along(first) + 2 / width),
                    _LINE, colour)  # fmt: skip
        foot = 1 - (height - _FOOT / 2) / height
        self._clock = text(_PAD / width, foot, "", va="center", size=10, weight="bold",
                           color=style.INK, animated=True)  # fmt: skip
        at = 96
        for words, colour in legend:
            box(at / width, height - _FOOT / 2 - 5, (at + 10) / width, 10, colour)
            words = style.printable(words)
            text((at + 15) / width, foot, words, va="center", size=8.5, color=style.QUIET)
            at += 30 + 7 * len(words)
        bottom = top + max(len(tracks), 1) * (_LINE + 3)
        self._cursor = box(0, top - 3, 2 / width, bottom - top + 3, style.INK, animated=True)
        self._canvas.draw()
        self._blank = self._canvas.copy_from_bbox(self._figure.bbox)

    def _box(self, x0: float, y: float, x1: float, tall: float, colour: str, **how) -> Rectangle:
        """A box from share x0 to x1 of the width, y pixels below the upper edge."""
        width, height = self.size
        made = Rectangle(
            (x0, 1 - (y + tall) / height), x1 - x0, tall / height,
            transform=self._figure.transFigure, facecolor=colour, edgecolor="none", **how,
        )  # fmt: skip
        self._figure.add_artist(made)
        return made


_ALARM = np.array([int(style.ALARM[i : i + 2], 16) for i in (1, 3, 5)], np.uint8)


def _grounded(row: Row, rows: list[Row]) -> Cells:
    """A row's figures; the human's hip at the robots' height, on a stand for the legs it lacks."""
    cells = Cells(row)
    lowest = [c.lowest for c in (Cells(r) for r in rows if not r.human) if c.lowest is not None]
    if not row.human or not lowest:
        return cells
    ends, radius, colours = stand(-min(lowest))
    again = np.broadcast_to(ends, (len(cells.ends), *ends.shape))
    cells.ends = np.concatenate([cells.ends, again], axis=1)
    cells.radius = np.concatenate([cells.radius, radius])
    cells.colours = np.concatenate([cells.colours, [to_rgb(c) for c in colours]])
    return cells
