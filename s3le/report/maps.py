"""The synthetic example: which point of Feasible Y each point of Relaxed X is answered with.

One colour for each point of Feasible X and its y. Every point of Relaxed X wears the colour of
its answer, so that a learnt map is right where it looks like the true one; below, how far off the
answer is.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import Normal, Stroke

from s3le.errors import ParameterError
from s3le.show import style

# Of the corners (0, 0), (1, 0), (0, 1), (1, 1) of Feasible X; between them colours are mixed. The
# last one is the colour of a quarter of Relaxed X, the two before it end the other edges on which
# the projection lands, so these three stand well apart, in lightness too.
CORNERS = ("#2a3f9d", "#d1352b", "#12957a", "#ffe067")
_SIDE = 2.0  # of Relaxed X
_OUTLINE = [(1, 0), (2, 0), (2, 2), (0, 2), (0, 1), (1, 1), (1, 0)]  # of the invariant region
_LINES = (0.2, 0.4, 0.6, 0.8)  # coordinates in Feasible X with a thin line each
_FINER = 3  # cells drawn along each cell of the grid, in Feasible Y
_REGIONS = {"error_invariant": "within the red dashes", "error_all": "everywhere"}
_ROOM = 0.06  # around Feasible Y


def draw(path: Path, points: Mapping[str, np.ndarray], figures: Mapping[str, Any]) -> None:
    """Draw the true map and both learnt ones, in colours of correspondence.

    Args:
        path: the PNG to write.
        points: columns of table synthetic.
        figures: errors as synthetic.figures has them, with "shown", the seed of the points; what
            is missing is not written.

    Raises:
        ParameterError: the grid points of a variant are not a square grid in row order.
    """
    with style.sheet():
        learnt = {v: _grid(points, v) for v in (False, True) if np.any(points["nt_xent"] == v)}
        if not learnt:
            figure = style.figure(6.0, 1.6)
            style.note(figure, "synthetic example: no points")
        else:
            figure = _sheet(points, learnt, figures)
        style.save(figure, path)


def colours(x: np.ndarray) -> np.ndarray:
    """RGB in [0, 1], (..., 3), of points of Feasible X, (..., 2).

    Corner colours mixed bilinearly as squares of their values, which is about linear in light, so
    that mixtures stay bright.
    """
    corner = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in CORNERS])
    right, up = np.clip(x[..., :1], 0.0, 1.0), np.clip(x[..., 1:], 0.0, 1.0)
    weights = ((1 - right) * (1 - up), right * (1 - up), (1 - right) * up, right * up)
    return np.sqrt(sum(w * c**2 for w, c in zip(weights, corner, strict=True)))


def _grid(points: Mapping[str, np.ndarray], nt_xent: bool) -> dict[str, np.ndarray]:
    """Grid points of one variant as squares (g, g, 2), x_1 along the first axis."""
    at = (points["nt_xent"] == nt_xent) & (points["kind"] == "grid")
    side = round(float(at.sum()) ** 0.5)
    wanted = np.linspace(0.0, _SIDE, max(side, 1))
    wanted = np.stack(np.meshgrid(wanted, wanted, indexing="ij"), axis=-1)
    x = points["x"][at]
    if side < 2 or len(x) != side**2 or not np.allclose(x.reshape(wanted.shape), wanted):
        raise ParameterError(f"synthetic: {len(x)} grid points are no square grid in row order")
    names = ("x", "x_true", "y_true", "x_answer", "y_answer")
    return {name: points[name][at].reshape(side, side, 2) for name in names}


def _sheet(
    points: Mapping[str, np.ndarray],
    learnt: Mapping[bool, dict[str, np.ndarray]],
    figures: Mapping[str, Any],
) -> Figure:
    figure = style.figure(11.0, 8.5)
    truth = next(iter(learnt.values()))
    glue = points["x"][(points["kind"] == "glue") & (points["nt_xent"] == points["nt_xent"][0])]
    heads = {False: "learnt without NT-Xent", True: "learnt with NT-Xent"}
    shown = figures.get("shown")
    seed = f"; shown is seed {shown}" if shown is not None else ""
    figure.text(
        0.012, 0.985, "Synthetic example: one colour, one correspondence",
        va="top", size=12, weight="bold",
    )  # fmt: skip
    gaps = [_gap(own) for own in learnt.values()]
    worst = max(float(np.max(gaps)), 1e-9)
    grid = figure.subplots(2, 3, squeeze=False)
    figure.subplots_adjust(
        left=0.050, right=0.938, top=0.885, bottom=0.115, wspace=0.16, hspace=0.27
    )
    above, below = grid
    _square(above[0], truth["x_true"])
    above[0].set_title("the true map", pad=29)
    for place, words in (((0.5, 0.5), "Feasible X"), ((1.0, 1.5), "projection-invariant region")):
        above[0].text(*place, words, size=8.5, ha="center", va="center", color=style.INK,
                      path_effects=_halo(2.2), zorder=6)  # fmt: skip
    _bent(below[0], truth)
    below[0].set_title("Feasible Y")
    for column, (variant, own) in enumerate(learnt.items(), start=1):
        _square(above[column], own["x_answer"])
        above[column].set_title(heads[variant], pad=29)
        above[column].plot(*glue.T, "o", ms=3.6, mfc="white", mec=style.INK, mew=0.8, zorder=6)
        shade = _gaps(below[column], own, worst)
        below[column].set_title("error, point by point")
        _errors(above[column], figures.get("with_nt_xent" if variant else "without_nt_xent"))
    for axes in grid[:, len(learnt) + 1 :].flat:
        axes.set_visible(False)
    scale = figure.add_axes((0.952, 0.14, 0.010, 0.30))
    figure.colorbar(shade, cax=scale)
    scale.set_title("in y", size=8, weight="normal", loc="center", color=style.QUIET)
    above[0].set_ylabel("$x_2$", parse_math=True)
    below[0].set_ylabel("$y_2$", parse_math=True)
    count = f"mean and standard deviation over {figures.get('seeds', 'some')} seeds"
    figure.text(
        0.012, 0.012,
        "Upper row: Relaxed X. Each point wears the colour of the point of Feasible X whose y "
        "answers it; thin lines are that point's coordinates 0.2 to 0.8; white dots are the glue\n"
        "pairs; the red dashes enclose the points that share their projection with others. "
        "Feasible Y: the y of each point in its colour; the outlined edge is what the region within"
        f"\nthe dashes belongs on. Errors: mean absolute error in y, {count}{seed}.",
        size=7.5, color=style.QUIET, va="bottom", linespacing=1.35,
    )  # fmt: skip
    return figure


def _square(axes: Axes, x: np.ndarray) -> None:
    """Relaxed X in the colours of points x (g, g, 2) of Feasible X."""
    _plane(axes, colours(x))
    at = np.linspace(0.0, _SIDE, len(x))
    for coordinate in (0, 1):
        values = x[..., coordinate].T
        levels = [level for level in _LINES if values.min() < level < values.max()]
        if levels:
            axes.contour(at, at, values, levels, colors="white", linewidths=0.7, alpha=0.85)
    _outline(axes)


def _plane(axes: Axes, values: np.ndarray, **how: Any) -> AxesImage:
    """Values (g, g) or colours (g, g, 3) of the grid points, each filling its cell."""
    half = _SIDE / (len(values) - 1) / 2
    extent = (-half, _SIDE + half, -half, _SIDE + half)
    image = axes.imshow(
        values.swapaxes(0, 1), origin="lower", extent=extent, interpolation="nearest", **how
    )
    axes.set(xlim=(0, _SIDE), ylim=(0, _SIDE), aspect="equal")
    axes.set_xlabel("$x_1$", parse_math=True, labelpad=1)
    axes.set_xticks([0, 1, 2])
    axes.set_yticks([0, 1, 2])
    return image


def _outline(axes: Axes) -> None:
    """Red dashes around the projection-invariant region."""
    line = axes.plot(*np.transpose(_OUTLINE), "--", color=style.ALARM, linewidth=1.7, zorder=5,
                     clip_on=False)[0]  # fmt: skip
    line.set_path_effects(_halo(3.4))


def _bent(axes: Axes, own: dict[str, np.ndarray]) -> None:
    """Feasible Y in its colours, the image of x_1 = 1 and x_2 = 1 outlined."""
    # The cells of the grid, taken to Y; those beyond Feasible X have no area there.
    y, x = (_finer(own[name]) for name in ("y_true", "x_true"))
    cells = np.stack((y[:-1, :-1], y[1:, :-1], y[1:, 1:], y[:-1, 1:]), axis=2).reshape(-1, 4, 2)
    face = colours((x[:-1, :-1] + x[1:, 1:]) / 2.0).reshape(-1, 3)
    axes.add_collection(
        PolyCollection(list(cells), facecolors=face, edgecolors=face, linewidths=0.4), autolim=False
    )
    edge, tint = (np.concatenate((rows[-1], rows[::-1, -1])) for rows in (y, x))
    axes.plot(*edge.T, "-", color=style.INK, linewidth=5.0, zorder=3, solid_capstyle="round")
    axes.add_collection(
        LineCollection(
            list(np.stack((edge[:-1], edge[1:]), axis=1)), colors=colours(tint[1:]), linewidths=3.0,
            zorder=4, capstyle="round",
        ),
        autolim=False,
    )  # fmt: skip
    low, high = y.min(axis=(0, 1)) - _ROOM, y.max(axis=(0, 1)) + _ROOM
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_xlabel("$y_1$", parse_math=True, labelpad=1)


def _finer(rows: np.ndarray) -> np.ndarray:
    """A grid (g, g, 2) with points between, linearly interpolated, so that colours run smoothly."""
    for axis in (0, 1):
        at = np.linspace(0, rows.shape[axis] - 1, _FINER * (rows.shape[axis] - 1) + 1)
        low = np.minimum(at.astype(int), rows.shape[axis] - 2)
        share = np.expand_dims(at - low, [1, 2] if axis == 0 else [0, 2])
        rows = (1 - share) * rows.take(low, axis) + share * rows.take(low + 1, axis)
    return rows


def _gap(own: dict[str, np.ndarray]) -> np.ndarray:
    """Mean absolute error in y at each grid point, (g, g)."""
    return np.abs(own["y_answer"] - own["y_true"]).mean(axis=-1)


def _gaps(axes: Axes, own: dict[str, np.ndarray], worst: float) -> AxesImage:
    """Errors over Relaxed X, on a scale from 0 to worst."""
    image = _plane(axes, _gap(own), cmap="magma_r", vmin=0.0, vmax=worst)
    _outline(axes)
    return image


def _errors(axes: Axes, found: Mapping[str, Any] | None) -> None:
    """The variant's errors, between its title and its map."""
    for line, (key, where) in enumerate(_REGIONS.items()):
        if found and key in found:
            axes.annotate(
                f"error {where}: {found[key]['mean']:.3f} ± {found[key]['sd']:.3f}",
                (0.0, 1.0), (0, 16 - 11 * line), xycoords="axes fraction",
                textcoords="offset points", size=8, color=style.QUIET,
            )  # fmt: skip


def _halo(width: float) -> list:
    return [Stroke(linewidth=width, foreground="white"), Normal()]
