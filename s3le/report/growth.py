"""How the time of one query grows with the number of stored poses (paper, Conclusion)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from s3le.show import style

SEARCHES = {"exact": ("looking at all", "-"), "walk": ("walk over a graph", "--")}
SPACES = {"s3le": ("S3LE's latents", "s3le"), "skeleton": ("skeletons", "lwl2")}
_GAP = 0.125  # between two labels, share of the axes' height


def draw(path: Path, rows: list[dict[str, Any]], note: str) -> None:
    """Draw processor time of one query against stored rows, both scales logarithmic.

    A thick line is the median, the thin one above it the 99th percentile.

    Args:
        path: the PNG to write.
        rows: one per space, search and number of rows: "space" (SPACES), "search" (SEARCHES),
            "rows", "us_p50", "us_p99".
        note: below the picture: machine, threads, what was asked.
    """
    with style.sheet():
        figure = style.figure(7.6, 4.6)
        figure.text(
            0.02, 0.965, "Time of one query against the number of stored poses",
            va="top", size=12, weight="bold",
        )  # fmt: skip
        figure.text(0.02, 0.02, note, size=7.5, color=style.QUIET, va="bottom")
        lines = _lines(rows)
        if not lines:
            style.note(figure, "nothing to draw: no rows")
        else:
            axes = figure.add_axes((0.105, 0.215, 0.66, 0.665))
            _panel(axes, lines)
        style.save(figure, path)


def _lines(rows: list[dict[str, Any]]) -> dict[tuple[str, str], np.ndarray]:
    """Rows, median and 99th percentile of each line, (3, points), by rows."""
    found = {}
    for search in SEARCHES:
        for space in SPACES:
            own = [r for r in rows if r["space"] == space and r["search"] == search]
            points = np.array([[r["rows"], r["us_p50"], r["us_p99"]] for r in own], float)
            if len(points):
                found[space, search] = points[np.argsort(points[:, 0])].T
    return found


def _panel(axes: Axes, lines: dict[tuple[str, str], np.ndarray]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for (space, search), (n, median, worst) in lines.items():
        colour = style.colour(SPACES[space][1])
        axes.plot(n, worst, SEARCHES[search][1], color=colour, linewidth=0.8, alpha=0.55)
        axes.plot(n, median, SEARCHES[search][1], color=colour, linewidth=1.6, marker="o",
                  markersize=3.5)  # fmt: skip
    axes.set_xlabel("stored poses")
    axes.set_ylabel("time of one query")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: time_of(value)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.grid(axis="both")
    _label_ends(axes, lines)


def _label_ends(axes: Axes, lines: dict[tuple[str, str], np.ndarray]) -> None:
    """Name each line where it ends, names pushed apart until none covers another."""
    axes.get_ylim()  # settles the limits that the positions depend on
    to_axes = axes.transData + axes.transAxes.inverted()
    high = {key: to_axes.transform((line[0, -1], line[1, -1]))[1] for key, line in lines.items()}
    order = sorted(high, key=lambda key: high[key])
    place = [high[key] for key in order]
    for _ in order:
        for i in range(1, len(place)):
            short = max(0.0, _GAP - (place[i] - place[i - 1])) / 2.0
            place[i - 1] -= short
            place[i] += short
    for (space, search), y in zip(order, place, strict=True):
        words, colour = SPACES[space]
        axes.annotate(
            f"{words}, {time_of(lines[space, search][1, -1])}\n{SEARCHES[search][0]}",
            xy=(1.0, high[space, search]), xytext=(1.03, y), xycoords="axes fraction",
            va="center", size=8, color=style.colour(colour), annotation_clip=False,
        )  # fmt: skip


def time_of(us: float) -> str:
    """A time with its unit, two digits."""
    for unit, size in (("s", 1e6), ("ms", 1e3)):
        if us >= 0.9995 * size:
            return f"{us / size:.2g} {unit}"
    return f"{us:.2g} µs" if us < 99.5 else f"{us:.0f} µs"
