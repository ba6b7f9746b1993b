"""The latent spaces of the methods: where robot poses lie, and where human frames come to lie."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from s3le.show import style

_HUES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8c6d31", "#7f3c8d")
_NAMED = 8  # motions with a colour of their own; with more, all frames share one
_POSES = "#a7b0b8"
_PANEL, _LEGEND = 3.3, 0.95  # [inch]


class Space(NamedTuple):
    """One latent space in its plane of greatest variance."""

    method: str
    poses: np.ndarray  # (n, 2) latents of robot poses
    human: np.ndarray  # (m, 2) latents of human frames
    truth: np.ndarray  # (m, 2) latents of these frames' ground-truth poses
    motion: np.ndarray  # int (m,), into motions
    motions: list[str]
    rank: float  # effective number of latent dimensions
    apart: float  # rms distance of human from truth over the poses' spread, all dimensions [-]


def draw(path: Path, spaces: list[Space]) -> None:
    """Draw a panel for each latent space.

    Each human frame is a dot, joined by a line to the latent of its ground-truth pose: where the
    two domains share their latent space, the lines are short. Axes are cut at the range of all
    that is drawn, with one scale in both directions.

    Args:
        path: the PNG or SVG to write.
        spaces: what to draw, from left to right.
    """
    with style.sheet():
        figure = style.figure(_PANEL * max(len(spaces), 1), _PANEL + _LEGEND)
        if not spaces:
            style.note(figure, "nothing to draw: no latent space")
            style.save(figure, path)
            return
        motions = spaces[0].motions
        few = len(motions) <= _NAMED
        width, height = figure.get_size_inches()
        for k, space in enumerate(spaces):
            ax = figure.add_axes(
                ((k + 0.04) / len(spaces), (_LEGEND - 0.1) / height, 0.92 / len(spaces),
                 (_PANEL - 0.45) / height)
            )  # fmt: skip
            colours = np.array([_HUES[i % len(_HUES)] if few else _HUES[0] for i in space.motion])
            across, up = space.poses.T
            ax.scatter(across, up, s=2.0, color=_POSES, linewidths=0, rasterized=True)
            lines = list(np.stack([space.human, space.truth], axis=1))
            ax.add_collection(LineCollection(lines, colors=colours, linewidths=0.5, alpha=0.5))
            across, up = space.human.T
            ax.scatter(across, up, s=9.0, c=colours, linewidths=0)
            ax.set_aspect("equal", "datalim")
            ax.set_xticks([])
            ax.set_yticks([])
            ax.set_title(style.TRAINED.get(space.method, space.method))
            told = f"{space.rank:.1f} dimensions in use; frame to ground truth {space.apart:.2f}"
            ax.set_xlabel(told, size=8.0, color=style.QUIET)
        keys = [_dot(_POSES, "robot poses", 3.0)]
        if few:
            keys += [_dot(_HUES[i], f"human, {name}", 4.0) for i, name in enumerate(motions)]
        else:
            keys.append(_dot(_HUES[0], f"human frames of {len(motions)} motions", 4.0))
        keys.append(Line2D([], [], color=style.QUIET, lw=0.8, label="to its ground-truth pose"))
        figure.legend(handles=keys, loc="lower center", ncols=min(len(keys), 4))
        style.save(figure, path)


def _dot(colour: str, label: str, size: float) -> Line2D:
    return Line2D([], [], color=colour, marker="o", ls="", markersize=size, label=label)
