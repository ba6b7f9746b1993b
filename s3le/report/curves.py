"""Training curves: one panel per method, every loss term by its name in words."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from s3le.show import style

TERMS = {  # key in a history: (words, colour, line)
    "recon_x": ("skeletons rebuilt", "#0072B2", "-"),
    "recon_q": ("poses rebuilt", "#D55E00", "-"),
    "consensus": ("latent consensus", "#009E73", "-"),
    "nt_xent": ("contrast (NT-Xent)", "#222222", "-"),
    "prior_x": ("prior, skeletons", "#56B4E9", "-"),
    "prior_y": ("prior, poses", "#E69F00", "-"),
    "discriminator": ("discriminators", "#7f7f7f", "--"),
    "x_to_q": ("skeleton to pose", "#CC79A7", "-"),
    "q_to_x": ("pose to skeleton", "#8c6d31", "-"),
}
_SPARE = ("#8855aa", "#999933", "#6699cc", "#aa4455")
_LOG_FROM = 20.0  # ratio of largest to smallest value from which the scale is logarithmic
_COLUMNS = 3
_GAP = 0.062  # between two labels, share of the axes' height


def draw(path: Path, histories: dict[str, list[dict[str, float]]]) -> None:
    """Draw how each loss term fell.

    Values that are not finite leave a gap. A panel whose values are all positive and spread
    widely has a logarithmic scale; one that also holds values at or below zero and spreads
    widely is logarithmic but for a linear part around zero; others are linear.

    Args:
        path: the PNG or SVG to write.
        histories: for each method its rows, "step" and the loss terms [-] by name.
    """
    names = style.TRAINED
    order = [key for key in names if key in histories]
    order += [key for key in histories if key not in names]
    with style.sheet():
        columns = min(_COLUMNS, max(len(order), 1))
        lines = -(-max(len(order), 1) // columns)
        figure = style.figure(4.3 * columns + 0.2, 3.3 * lines + 0.35)
        if not order:
            style.note(figure, "no training history")
        else:
            grid = figure.subplots(lines, columns, squeeze=False)
            figure.subplots_adjust(
                left=0.62 / figure.get_figwidth(),
                right=1.0 - 1.42 / figure.get_figwidth(),
                bottom=0.55 / figure.get_figheight(),
                top=1.0 - 0.42 / figure.get_figheight(),
                wspace=0.82,
                hspace=0.42,
            )
            for axes, method in zip(grid.flat, order, strict=False):
                _panel(axes, histories[method])
                axes.set_title(names.get(method, method))
            for axes in grid.flat[len(order) :]:
                axes.set_visible(False)
            for axes in grid[:, 0]:
                axes.set_ylabel("weighted loss [-]")
        style.save(figure, path)


def _panel(axes: Axes, rows: list[dict[str, float]]) -> None:
    keys = list(dict.fromkeys(key for row in rows for key in row if key != "step"))
    keys.sort(key=lambda key: list(TERMS).index(key) if key in TERMS else len(TERMS))
    steps = np.array([row.get("step", i) for i, row in enumerate(rows)], float)
    terms = {key: np.array([_number(row.get(key)) for row in rows]) for key in keys}
    terms = {key: values for key, values in terms.items() if np.isfinite(values).any()}
    if not terms:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no rows", ha="center", color=style.QUIET, transform=axes.transAxes)
        return
    spare = iter(_SPARE * (1 + len(terms)))
    looks = {key: TERMS.get(key) or (key.replace("_", " "), next(spare), "-") for key in terms}
    for key, values in terms.items():
        _, colour, line = looks[key]
        alone = "o" if np.isfinite(values).sum() == 1 else None
        axes.plot(steps, values, line, color=colour, linewidth=1.4, marker=alone, markersize=4)
    _scale(axes, np.concatenate(list(terms.values())))
    axes.grid(axis="y")
    axes.set_xlabel("step")
    axes.margins(x=0.0 if len(rows) > 1 else 0.1)
    axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    axes.locator_params(axis="x", nbins=5)
    _label_ends(axes, terms, looks)


def _scale(axes: Axes, values: np.ndarray) -> None:
    values = values[np.isfinite(values)]
    sizes = np.abs(values[values != 0.0])
    if not len(sizes) or sizes.max() < _LOG_FROM * sizes.min():
        return
    if (values > 0.0).all():
        axes.set_yscale("log")
    else:
        axes.set_yscale("symlog", linthresh=max(sizes.max() * 1e-3, sizes.min()))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _label_ends(axes: Axes, terms: dict[str, np.ndarray], looks: dict[str, tuple]) -> None:
    """Name each line where it ends, names pushed apart until none covers another."""
    axes.get_ylim()  # settles the limits that the positions depend on
    to_axes = axes.transData + axes.transAxes.inverted()
    last = {key: values[np.isfinite(values)][-1] for key, values in terms.items()}
    high = {key: to_axes.transform((0.0, value))[1] for key, value in last.items()}
    order = sorted(terms, key=lambda key: (high[key], key))
    place = np.array([high[key] for key in order])
    for i in range(1, len(place)):
        place[i] = max(place[i], place[i - 1] + _GAP)
    place -= max(0.0, place[-1] - 1.0)  # at the top there is no room above
    for i in reversed(range(len(place) - 1)):
        place[i] = min(place[i], place[i + 1] - _GAP)
    for key, y in zip(order, place, strict=True):
        words, colour, _ = looks[key]
        axes.annotate(
            words,
            xy=(1.0, high[key]),
            xytext=(1.06, y),
            xycoords="axes fraction",
            va="center",
            size=7.5,  # in ink: the line to it has the colour, which not every one is legible in
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkB": 0},
        )


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float, np.number)) else np.nan
