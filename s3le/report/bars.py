"""How far each method stays from the ground truth, motion by motion."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from s3le.show import style

_TALLEST = 22  # groups in one column before the chart takes a second one
_COLUMNS = 3  # at most
_ANGLES = (5, 10, 15, 20, 25, 30, 40, 50, 60, 75, 90, 120, 180)  # [deg], ticks on top
_ENTRIES = 4  # of the legend in a line
_MEAN = "mean over\nmotions"
_LONGEST, _LETTER = 26, 0.072  # letters of a line of a motion's name, [inch] for each


class _Split(NamedTuple):
    name: str
    clips: list[str]
    value: dict[tuple[str, str], float]  # (clip, method) -> cosine distance
    frames: int | None  # in all clips together; None where some are not known


def draw(
    path: Path, rows: list[dict[str, Any]], methods: list[tuple[str, str]], title: str
) -> None:
    """Draw mean cosine distance to the ground truth for each motion and method.

    A method is a bar. A brute-force search of the same pool (style.BRUTE_FORCE), where that
    pool's method is drawn too, is a line across the method's bar. The first group of each split
    is the mean over its motions, each motion counting once. Motions stay in the order given.

    Args:
        path: the PNG or SVG to write.
        rows: one per motion and method: "split", "clip", "method", "to_truth" [-], "frames";
            a to_truth that is None or not finite counts as not measured.
        methods: (key, label) in the order to draw; rows of other methods are left out.
        title: above everything.
    """
    keys = [key for key, _ in methods]
    splits = _gather(rows, keys)
    with style.sheet():
        if not splits or not methods:
            figure = style.figure(6.0, 1.6)
            figure.text(0.02, 0.95, title, va="top", size=12, weight="bold")
            style.note(figure, "nothing to draw: no motions or no methods")
            style.save(figure, path)
            return
        over = {key: style.BRUTE_FORCE[key] for key in keys if style.BRUTE_FORCE.get(key) in keys}
        bars = [key for key in keys if key not in over.values()]
        largest = max(max(len(split.clips) for split in splits), 1)
        columns = min(-(-(largest + 1) // _TALLEST), _COLUMNS)
        _chart(path, splits, methods, bars, over, columns, title)


def _gather(rows: list[dict[str, Any]], keys: list[str]) -> list[_Split]:
    splits = []
    for name in dict.fromkeys(row["split"] for row in rows):
        own = [row for row in rows if row["split"] == name]
        clips = list(dict.fromkeys(str(row["clip"]) for row in own))
        value = {}
        for row in own:
            got = row.get("to_truth")
            if row["method"] in keys and isinstance(got, (int, float)) and np.isfinite(got):
                value[str(row["clip"]), row["method"]] = float(got)
        counts = {row["clip"]: row.get("frames") for row in own}
        known = [count for count in counts.values() if count is not None]
        whole = sum(known) if len(known) == len(counts) else None
        splits.append(_Split(str(name), clips, value, whole))
    return splits


def _chart(path, splits, methods, bars, over, columns, title):
    thick = 0.125 if columns == 1 else 0.095  # [inch] a bar
    lines = max(_lines(clip).count("\n") + 1 for split in splits for clip in [*split.clips, ""])
    group = max(thick * len(bars) + 0.11, 0.135 * lines + 0.04)
    mean_group = 0.17 * len(bars) + 0.16
    panels = []  # for each split its clips, column by column
    for split in splits:
        share = max(-(-len(split.clips) // columns), 1)
        panels.append([split.clips[i * share : (i + 1) * share] for i in range(columns)])
    tall = [mean_group + group * max(len(clips) for clips in parts) for parts in panels]

    width = (8.2, 11.5, 15.0)[columns - 1]
    names = [line for split in splits for clip in split.clips for line in _lines(clip).split("\n")]
    left = max(*(max(_LETTER * len(n), style.wide(n, 8.0)) for n in names), 0.75) + 0.15
    gap = 0.25
    room = (width - 0.25) / columns
    kinds = [[m for m in methods if m[0] in bars], [m for m in methods if m[0] not in bars]]
    legend = [-(-len(kind) // _ENTRIES) for kind in kinds]
    title = style.wrapped(title, width - 0.3, 12.0, bold=True)
    more = 0.2 * title.count("\n")
    head, foot = 0.52 + more + 0.19 * sum(legend), 0.52
    above, below = 0.60, 0.34  # of each split: its name and the angles; the scale
    height = head + sum(tall) + (above + below) * len(splits) + foot
    figure = style.figure(width, height)
    top = max([*(v for split in splits for v in split.value.values()), 0.01]) * 1.04

    figure.text(0.12 / width, 1 - 0.12 / height, title, va="top", size=12, weight="bold")
    y = height - 0.42 - more
    for kind, lines in zip(kinds, legend, strict=True):
        _legend(figure, methods, kind, set(bars), (0.10 / width, y / height))
        y -= 0.19 * lines
    y = height - head
    for split, parts, inches in zip(splits, panels, tall, strict=True):
        count = f"{split.frames} frames" if split.frames is not None else "frames not stated"
        motions = f"{len(split.clips)} motion" + ("s" if len(split.clips) != 1 else "")
        figure.text(
            0.12 / width, (y - 0.22) / height, f"{split.name}: {motions}, {count}",
            size=10, weight="bold", va="center",
        )  # fmt: skip
        y -= above
        for column, clips in enumerate(parts):
            own = (mean_group if column == 0 else 0.0) + group * len(clips)
            if not own:
                continue
            start = 0.05 + column * room + left
            axes = figure.add_axes(
                (start / width, (y - own) / height, (room - left - gap) / width, own / height)
            )
            _panel(axes, split, clips, column == 0, methods, bars, over, (thick, group, mean_group))
            axes.set_xlim(0.0, top)
            _angles(axes, top)
        y -= inches + below
    figure.text(
        0.12 / width, 0.12 / height,
        "Lower is better. Scale below: mean over frames of the cosine distance between the "
        "method's and the ground truth's\nseven bone directions; above: the angle by which every "
        "single bone would have to be off to give that distance.",
        size=7.5, color=style.QUIET, va="bottom",
    )  # fmt: skip
    style.save(figure, path)


def _panel(axes: Axes, split, clips, mean, methods, bars, over, sizes):
    """Groups from the top; the axes' y is in inches."""
    thick, group, mean_group = sizes
    spare = {key: i for i, (key, _) in enumerate(methods)}
    ticks, y = [], 0.0
    for clip in ([None] if mean else []) + clips:
        inches, bar = (mean_group, 0.17) if clip is None else (group, thick)
        if clip is None:
            axes.axhspan(y, y + inches, color=style.BAND, zorder=0)
        first = y + (inches - bar * len(bars)) / 2
        for place, key in enumerate(bars):
            middle = first + (place + 0.5) * bar
            value, n = _value(split, clip, key)
            if value is None:
                _words(axes, 0.0, middle, "not measured", 5.5, style.QUIET)
            else:
                colour = style.colour(key, spare[key])
                axes.barh(middle, value, bar * 0.86, color=colour, linewidth=0)
                if clip is None:
                    few = f" ({n} of {len(split.clips)} motions)" if n < len(split.clips) else ""
                    beside = max(value, _value(split, clip, over.get(key))[0] or 0.0)
                    _words(axes, beside, middle, f"{value:.3f}{few}", 7, style.INK)
            under = _value(split, clip, over.get(key))[0]
            if under is not None:
                _tick(axes, under, middle, bar, style.colour(over[key]))
        ticks.append((y + inches / 2, _MEAN if clip is None else _lines(clip)))
        y += inches
    axes.set_ylim(y, 0.0)
    axes.set_yticks([at for at, _ in ticks], [name for _, name in ticks])
    for label, (_, name) in zip(axes.get_yticklabels(), ticks, strict=True):
        label.set_fontweight("bold" if name == _MEAN else "normal")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_color(style.QUIET)
    axes.spines["bottom"].set_visible(False)
    axes.tick_params(axis="x", length=0)
    axes.locator_params(axis="x", nbins=6)
    axes.grid(axis="x")


def _value(split: _Split, clip: str | None, key: str) -> tuple[float | None, int]:
    """Distance of a method on a motion, or its mean over motions; and of how many motions."""
    if clip is not None:
        return split.value.get((clip, key)), 1
    got = [split.value[c, key] for c in split.clips if (c, key) in split.value]
    return (float(np.mean(got)) if got else None), len(got)


def _tick(axes: Axes, x: float, middle: float, bar: float, colour: str) -> None:
    half = bar * 0.52
    for line, ink in ((3.4, "white"), (1.8, colour)):
        axes.plot([x, x], [middle - half, middle + half], "-", color=ink, linewidth=line,
                  solid_capstyle="butt", zorder=4)  # fmt: skip


def _words(axes: Axes, x: float, y: float, text: str, size: float, colour: str) -> None:
    axes.annotate(text, (x, y), (4, 0), textcoords="offset points", va="center", size=size,
                  color=colour, zorder=5)  # fmt: skip


def _legend(figure, methods, kind, bars, corner):
    spare = {key: i for i, (key, _) in enumerate(methods)}
    handles = []
    for key, label in kind:
        colour = style.colour(key, spare[key])
        if key in bars:
            handles.append(Patch(color=colour, label=label))
        else:
            handles.append(
                Line2D([], [], color=colour, marker="|", markersize=9, markeredgewidth=2,
                       linestyle="none", label=label)
            )  # fmt: skip
    if handles:
        figure.legend(
            handles=handles, loc="upper left", bbox_to_anchor=corner, ncols=_ENTRIES,
            handlelength=1.2, handletextpad=0.5, columnspacing=1.3, borderaxespad=0.0,
            borderpad=0.2, labelspacing=0.35, fontsize=8,
        )  # fmt: skip


def _angles(axes: Axes, top: float) -> None:
    """A second scale above: the angle of a bone at that cosine distance."""
    above = axes.twiny()
    above.set_xlim(0.0, top)
    marks = [(1.0 - np.cos(np.radians(angle)), angle) for angle in _ANGLES]
    shown: list[tuple[float, float]] = []
    for at, angle in marks:
        if at <= top and (not shown or at - shown[-1][0] > 0.075 * top):
            shown.append((at, angle))
    above.set_xticks([at for at, _ in shown], [f"{angle}°" for _, angle in shown])
    above.tick_params(axis="x", length=2, labelsize=7, labelcolor=style.QUIET, pad=1)
    for side in ("top", "bottom", "left", "right"):
        above.spines[side].set_visible(False)


def _lines(name: str) -> str:
    """A name in as many lines as it needs."""
    return style.wrapped(name, _LONGEST * _LETTER, 8.0)
