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
_WHOLE = [(x, y, z) for x in range(1, 6) for y in range(1, 6) for z in range(1, 6)
          if x * y * z in (3, 4, 6, 8, 9, 12, 16) and min(x, y, z) == 1]  # fmt: skip
_KEPT = 2  # grids of a count whose capsules are searched well


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
        self.look(WAYS, np.ones(len(WAYS)))

    def look(self, ways: np.ndarray, weights: np.ndarray) -> None:
        """Ask reach in these directions (k, 3), which count so much (k,), mean 1.

        Between directions a capsule may bulge unseen: those from which others come belong to them.
        """
        self.ways, self.weights = ways, weights
        self.support = (self.corners @ ways.T).max(axis=0)

    def whole(self) -> Part:
        """The piece in one capsule."""
        return Part(self.corners, self.fit(self.corners, 2))

    def excess(self, held: Sequence[Capsule]) -> float:
        """How far capsules reach beyond the piece, a mean over directions near the largest [m]."""
        far = self.ways @ np.array([(c.a, c.b) for c in held]).reshape(-1, 3).T
        far = far.reshape(len(self.ways), -1, 2).max(axis=2) + [c.radius for c in held]
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

    def furthest(self, held: Sequence[Capsule]) -> float:
        """How far capsules reach beyond the piece in any direction that is asked [m]."""
        far = self.ways @ np.array([(c.a, c.b) for c in held]).reshape(-1, 3).T
        far = far.reshape(len(self.ways), -1, 2).max(axis=2) + [c.radius for c in held]
        return float((far.max(axis=1) - self.support).max())

    def grids(self, most: int, limit: float = np.inf) -> list[list[Part]]:
        """The whole piece in grids of cells, the best few of each count, each cell well held.

        None reaches farther than a limit [m]: what frees one side must not fill the other.

        Cuts one after another are chosen by what each gains at once; strips along a flat face gain
        only together.
        """
        frames, edges = [np.eye(3), _axes(self.corners)], _edges(self.corners)
        if np.abs(frames[1]).max(axis=1).min() > _ALONG:
            frames = frames[:1]
        crude: dict[int, list[tuple[float, list[np.ndarray]]]] = {}
        for frame in frames:
            for counts in _WHOLE:
                cells = _cells(self.corners, edges, frame, counts)
                if len(cells) == np.prod(counts):
                    far = self.excess([self._crude(cell) for cell in cells])
                    crude.setdefault(len(cells), []).append((far, cells))
        found = []
        for rows in crude.values():
            for _, cells in sorted(rows, key=lambda row: row[0])[:_KEPT]:
                parts = pruned([Part(cell, self.fit(cell)) for cell in cells])
                ends = [[*one.capsule.a, one.capsule.radius] for one in parts]
                near = self.furthest([one.capsule for one in parts]) <= limit
                if len(parts) <= most and near and np.isfinite(ends).all():
                    found.append(parts)
        return found

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

        square = (points * points).sum(axis=1)

        def beyond(ends: np.ndarray) -> float:
            # As to_segment has it, written out: this is asked a hundred thousand times.
            a, along = ends[:3], ends[3:] - ends[:3]
            at, on = points @ along - a @ along, along @ along
            share = np.minimum(np.maximum(at / max(on, 1e-300), 0.0), 1.0)
            off = square - 2.0 * (points @ a) + a @ a - share * (2.0 * at - share * on)
            radius = np.sqrt(max(float(off.max()), 0.0))
            far = np.maximum(self.ways @ a, self.ways @ ends[3:]) + (radius - self.support)
            far = np.maximum(far / size, 0.0) ** 2
            return float(self.weights @ (far * far * far))

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


def pruned(parts: Sequence[Part]) -> list[Part]:
    """Without parts that another one's capsule holds: it takes their corners, and holds both.

    Inside a piece the capsules of its faces bulge into each other and leave nothing to hold.
    """
    left = list(parts)
    for part in sorted(parts, key=lambda one: one.capsule.radius):
        for k, other in enumerate(left):
            a, b, radius = other.capsule
            if other is not part and (to_segment(part.points, a, b) <= radius - 1e-6).all():
                left[k] = Part(np.concatenate([other.points, part.points]), other.capsule)
                left = [one for one in left if one is not part]
                break
    return left


def _cells(
    points: np.ndarray, edges: np.ndarray, frame: np.ndarray, counts: tuple[int, int, int]
) -> list[np.ndarray]:
    """Corners of the cells that a grid of equal steps along the rows of frame cuts a part into."""
    parts: list[tuple[np.ndarray, np.ndarray | None]] = [(points, edges)]
    for way, count in zip(frame, counts, strict=True):
        height = points @ way
        for at in np.linspace(height.min(), height.max(), count + 1)[1:-1]:
            parts = [half for part in parts for half in halves(*part, way, float(at))]
    return [cell for cell, _ in parts]


def _edges(points: np.ndarray) -> np.ndarray:
    """Edges of the hull of corners (n, 3) as rows of two, and more: those within its faces."""
    try:
        faces = ConvexHull(points).simplices
    except (QhullError, ValueError):
        return np.empty((0, 2), int)
    return np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def halves(
    points: np.ndarray, edges: np.ndarray | None, way: np.ndarray, at: float
) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """What a plane way . x = at makes of a convex part: corners of both halves, or all of it.

    The corners on each side, and where the plane meets the edges: the hull of these is the half.
    Edges are found where they are not known and are needed.
    """
    height = points @ way - at
    if height.min() > -_THIN or height.max() < _THIN:
        return [(points, edges)]
    edges = _edges(points) if edges is None else edges
    if not len(edges):
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
