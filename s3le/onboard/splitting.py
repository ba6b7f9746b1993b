"""Capsules that hold a convex piece between them, and how one of them is cut in two.

A capsule may bulge into the piece that it is a part of: that costs nobody anything. So what is
kept small is how far capsules reach beyond the whole piece, by direction, and directions from
which other bodies come count more. A part is cut by a plane, as a solid: both halves hold the cut,
so capsules that hold the halves hold the part, and all of them together the piece.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from s3le.onboard import capsules
from s3le.onboard.capsules import Capsule, around, directions, to_segment

WAYS = directions(250)  # in which reach is asked while a capsule is searched
_POWER = 6  # of the mean over directions: near enough to the largest, and smooth enough
_EVALUATIONS = 120  # of one round of the search for a capsule

_THIN = 5e-3  # [m], a cell is not thinner
_ALONG = 0.995  # cosine between main axes and the frame's from which on they are the same
_SOME = directions(100)
_GRIDS = sorted(
    ((x, y, z) for x in range(1, 4) for y in range(1, 4) for z in range(1, 4)
     if 1 < x * y * z <= 2), key=lambda counts: (int(np.prod(counts)), counts)
)  # fmt: skip


class Part(NamedTuple):
    """A part of a piece and the capsule that holds it."""

    points: np.ndarray  # [m], (n, 3), corners of the part
    capsule: Capsule


class Splitter:
    """One convex piece, of which capsules hold parts."""

    def __init__(self, points: np.ndarray) -> None:
        """Start with no direction that counts more than others.

        Args:
            points: of the piece [m], (n, 3); not all in a plane.

        Raises:
            QhullError: the points span no volume.
        """
        self.corners = points[np.sort(ConvexHull(points).vertices)]
        self.support = (self.corners @ WAYS.T).max(axis=0)
        self.weights = np.ones(len(WAYS))  # of WAYS, mean 1

    def whole(self) -> Part:
        """The piece in one capsule."""
        return Part(self.corners, self.fit(self.corners, 2))

    def excess(self, held: Sequence[Capsule]) -> float:
        """How far capsules reach beyond the piece, a mean over directions near the largest [m]."""
        far = WAYS @ np.array([(c.a, c.b) for c in held]).reshape(-1, 3).T
        far = far.reshape(len(WAYS), -1, 2).max(axis=2) + [c.radius for c in held]
        beyond = np.maximum(far.max(axis=1) - self.support, 0.0)
        return float((self.weights * beyond**_POWER).mean() ** (1.0 / _POWER))

    def cuts(self, part: Part) -> Iterator[list[Part]]:
        """Grids that share a part, each cell in a capsule that is quickly found."""
        frames, edges = [np.eye(3), _axes(part.points)], _edges(part.points)
        if np.abs(frames[1]).max(axis=1).min() > _ALONG:
            frames = frames[:1]
        for frame in frames:
            for counts in _GRIDS:
                cells = _cells(part.points, edges, frame, counts)
                if len(cells) == np.prod(counts):
                    made = [Part(cell, self._crude(cell)) for cell in cells]
                    if all(np.isfinite([*one.capsule.a, one.capsule.radius]).all() for one in made):
                        yield made

    def _crude(self, points: np.ndarray) -> Capsule:
        outer = _outer(points)
        ways = [*np.eye(3), *_axes(outer)]
        best = min((capsules._crude(outer, w) for w in ways), key=self._rank)
        return around(points, best.a, best.b)

    def fit(self, points: np.ndarray, starts: int = 1) -> Capsule:
        """A capsule that holds all points (n, 3) and reaches little beyond the piece."""
        outer = _outer(points)
        ways = [*np.eye(3), *_axes(outer), *directions(24)[:12]]
        crude = sorted((capsules._crude(outer, way) for way in ways),
                       key=self._rank)  # fmt: skip
        found = [self._searched(outer, start) for start in crude[:starts]]
        best = min([*found, crude[0]], key=self._rank)
        return around(points, best.a, best.b)

    def _rank(self, capsule: Capsule) -> float:
        """Excess of a capsule; a search that has lost its way comes last."""
        far = self.excess([capsule])
        return far if np.isfinite(far) else np.inf

    def _searched(self, points: np.ndarray, start: Capsule) -> Capsule:
        size = max(float(np.ptp(points, axis=0).max()), 1e-6)

        def beyond(ends: np.ndarray) -> float:
            radius = float(to_segment(points, ends[:3], ends[3:]).max())
            far = np.maximum(WAYS @ ends[:3], WAYS @ ends[3:]) + (radius - self.support)
            return float(self.weights @ np.maximum(far / size, 0.0) ** _POWER)

        ends = np.concatenate([start.a, start.b])
        for step in (0.1, 0.03):
            simplex = np.concatenate([ends[None], ends + step * size * np.eye(6)])
            found = minimize(
                beyond, ends, method="Nelder-Mead",
                options={"initial_simplex": simplex, "maxfev": _EVALUATIONS, "xatol": 1e-5,
                         "fatol": 0.0},
            )  # fmt: skip
            ends = found.x if found.fun < beyond(ends) else ends
        return around(points, ends[:3], ends[3:])


def _cells(
    points: np.ndarray, edges: np.ndarray, frame: np.ndarray, counts: tuple[int, int, int]
) -> list[np.ndarray]:
    """Corners of the cells that a grid of equal steps along the rows of frame cuts a part into."""
    parts = [(points, edges)]
    for way, count in zip(frame, counts, strict=True):
        height = points @ way
        for at in np.linspace(height.min(), height.max(), count + 1)[1:-1]:
            cells = [half for part in parts for half in halves(*part, way, float(at))]
            parts = [(cell, known) if known is not None else (cell, _edges(cell))
                     for cell, known in cells]  # fmt: skip
    return [cell for cell, _ in parts]


def _edges(points: np.ndarray) -> np.ndarray:
    """Edges of the hull of corners (n, 3) as rows of two, and more: those within its faces."""
    try:
        faces = ConvexHull(points).simplices
    except (QhullError, ValueError):
        return np.empty((0, 2), int)
    return np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def halves(
    points: np.ndarray, edges: np.ndarray, way: np.ndarray, at: float
) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """What a plane way . x = at makes of a convex part: corners of both halves, or all of it.

    The corners on each side, and where the plane meets the edges: the hull of these is the half.
    """
    height = points @ way - at
    if height.min() > -_THIN or height.max() < _THIN or not len(edges):
        return [(points, edges)]
    low, high = edges[height[edges[:, 0]] * height[edges[:, 1]] < 0.0].T
    share = (height[low] / (height[low] - height[high]))[:, None]
    rim = points[low] + share * (points[high] - points[low])
    below, above = points[height <= 0.0], points[height >= 0.0]
    return [(np.concatenate([side, rim]), None) for side in (below, above)]


def _outer(points: np.ndarray) -> np.ndarray:
    """The points that lie farthest in evenly spread directions."""
    return points[np.unique((points @ _SOME.T).argmax(axis=0))] if len(points) > 60 else points


def _axes(points: np.ndarray) -> np.ndarray:
    """Main axes of the points, (3, 3), rows."""
    return np.linalg.eigh(np.cov(points.T))[1].T
