"""Small capsules that contain a mesh: one, or several that share its convex hull between them.

Every vertex given lies in the capsule that is returned, and a capsule is convex, so every triangle
does. Where the hull is shared, its triangles that cross a plane are cut there and both parts hold
the cut: then the capsules together hold all of the hull. The search for a small capsule is a
heuristic; that it contains is a maximum over the vertices themselves.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

SLACK = 1e-9  # [m] added to a radius, so that rounding leaves no vertex outside
WORTH = 0.08  # of the volume that each further capsule must save
CLOSE = 0.015  # [m] a capsule that sticks out no farther is not shared
_PROBES = 3000  # points that measure the volume of several capsules together
_MANY = 2000  # points
_SEARCHED = 120  # extreme points that stand for a mesh while a capsule is searched


class Capsule(NamedTuple):
    """All points within radius of the segment from a to b."""

    a: np.ndarray  # [m], (3,)
    b: np.ndarray  # [m], (3,)
    radius: float  # [m]

    @property
    def volume(self) -> float:
        """[m^3]."""
        length = float(np.linalg.norm(self.b - self.a))
        return np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius)


class Fitted(NamedTuple):
    """A capsule and what it stands for."""

    capsule: Capsule
    points: np.ndarray  # what it contains: corners of its triangles [m], (n, 3)
    hull: float  # volume of their convex hull [m^3]
    adds: float  # how far the capsule reaches beyond that hull [m]


def fit(points: np.ndarray) -> Capsule:
    """A small capsule that contains every point (n, 3) [m]; the same for the same points."""
    outer = extreme(points)
    crude = sorted((_crude(outer, way) for way in _ways(outer)), key=lambda c: c.volume)
    best = min((_refined(outer, start) for start in crude[:2]), key=lambda c: c.volume)
    return around(points, best.a, best.b)


def around(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> Capsule:
    """The thinnest capsule about a segment that contains every point (n, 3) [m]."""
    return Capsule(a, b, float(to_segment(points, a, b).max()) + SLACK)


def share(triangles: np.ndarray, most: int) -> list[Fitted]:
    """One capsule for the triangles' convex hull, or up to `most` where that saves volume.

    What is shared is the hull, so that capsules hold it too: a check with hulls then finds nothing
    that they miss. Ways to share are grids along the shape's own axes or the frame's, tried with
    crude capsules on the hull of the extreme points, which has few triangles; the best one is then
    made on all.

    Args:
        triangles: corners [m], (n, 3, 3).
        most: capsules at most.
    """
    one = _fitted(triangles)
    if most < 2 or one.adds <= CLOSE:
        return [one]
    outer = extreme(one.points)
    try:
        proxy = outer[ConvexHull(outer).simplices]
        solid = one.points[ConvexHull(one.points).simplices]
    except (QhullError, ValueError):
        return [one]
    low, high = one.capsule.a, one.capsule.b
    room = np.stack([np.minimum(low, high), np.maximum(low, high)])
    room += one.capsule.radius * np.array([[-1.0], [1.0]])
    probes = room[0] + spread(_PROBES) * (room[1] - room[0])
    whole = (to_segment(probes, low, high) <= one.capsule.radius).sum()
    best, found = 1.0, None
    for frame in (np.eye(3), _axes(outer)):
        for counts in _grids(most):
            inside = np.zeros(len(probes), bool)
            for part in _cells(proxy, frame, counts):
                points = part.reshape(-1, 3)
                crude = min((_crude(points, w) for w in [*frame, *_axes(points)]),
                            key=lambda c: c.volume)  # fmt: skip
                inside |= to_segment(probes, crude.a, crude.b) <= crude.radius
            n = int(np.prod(counts))
            if inside.sum() / whole + (n - 1) * WORTH < best:
                best, found = inside.sum() / whole + (n - 1) * WORTH, (frame, counts)
    if found is None:
        return [one]
    parts = [_fitted(part) for part in _cells(solid, *found)]
    # Every corner is held by name, not only as a point of the hull that was cut.
    far = [to_segment(one.points, p.capsule.a, p.capsule.b) - p.capsule.radius for p in parts]
    nearest = np.argmin(far, axis=0)
    return [
        part._replace(points=np.concatenate([part.points, one.points[nearest == k]]))
        for k, part in enumerate(parts)
    ]


def _grids(most: int) -> list[tuple[int, int, int]]:
    sizes = range(1, most + 1)
    grids = [(x, y, z) for x in sizes for y in sizes for z in sizes if 1 < x * y * z <= most]
    return sorted(grids, key=lambda g: (g[0] * g[1] * g[2], g))


def _cells(
    triangles: np.ndarray, frame: np.ndarray, counts: tuple[int, int, int]
) -> list[np.ndarray]:
    """The triangles cut by a grid of equal cells along the rows of frame; empty ones left out."""
    parts = [triangles]
    for way, count in zip(frame, counts, strict=True):
        height = triangles.reshape(-1, 3) @ way
        for at in np.linspace(height.min(), height.max(), count + 1)[1:-1]:
            parts = [half for part in parts for half in cut(part, way, at) if len(half)]
    return parts


def cut(triangles: np.ndarray, way: np.ndarray, at: float) -> tuple[np.ndarray, np.ndarray]:
    """The triangles (n, 3, 3) below and above the plane way . x = at, those across it cut."""
    height = triangles @ way - at  # (n, 3)
    above = height > 0.0
    count = above.sum(axis=1)
    low, high = [triangles[count == 0]], [triangles[count == 3]]
    for lone, one, two in ((True, high, low), (False, low, high)):
        rows = np.flatnonzero(count == (1 if lone else 2))
        if not len(rows):
            continue
        apex = np.argmax(above[rows] == lone, axis=1)
        turn = (apex[:, None] + np.arange(3)) % 3  # the lone corner first
        p = np.take_along_axis(triangles[rows], turn[:, :, None], axis=1)
        h = np.take_along_axis(height[rows], turn, axis=1)
        edge = [
            p[:, 0] + (h[:, 0] / (h[:, 0] - h[:, k]))[:, None] * (p[:, k] - p[:, 0]) for k in (1, 2)
        ]
        one.append(np.stack([p[:, 0], *edge], axis=1))
        two.append(np.stack([p[:, 1], p[:, 2], edge[0]], axis=1))
        two.append(np.stack([p[:, 2], edge[0], edge[1]], axis=1))
    return np.concatenate(low), np.concatenate(high)


def hull_volume(points: np.ndarray) -> float:
    """Volume of the convex hull [m^3]; 0 where the points lie in a plane."""
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def extreme(points: np.ndarray) -> np.ndarray:
    """Up to _SEARCHED points that lie farthest in evenly spread directions, (k, 3)."""
    if len(points) > _MANY:  # sorting that many takes longer than all the rest
        points = points[np.unique((points @ directions(_SEARCHED).T).argmax(axis=0))]
    points = np.unique(points, axis=0)
    if len(points) <= _SEARCHED:
        return points
    return points[np.unique((points @ directions(_SEARCHED).T).argmax(axis=0))]


def reach_beyond(capsules: list[Capsule], points: np.ndarray) -> float:
    """How far capsules reach beyond the convex hull of the points that they contain [m].

    The largest difference of the support functions, taken over 2,000 directions, so up to about a
    tenth of a millimetre too small.
    """
    ways = directions(2000)
    own = [np.maximum(ways @ c.a, ways @ c.b) + c.radius for c in capsules]
    return float((np.max(own, axis=0) - (extreme(points) @ ways.T).max(axis=0)).max())


def volume(capsules: list[Capsule]) -> float:
    """Volume of capsules together [m^3]; of several from 20,000 points, good to a hundredth."""
    if len(capsules) == 1:
        return capsules[0].volume
    ends = np.array([(c.a, c.b) for c in capsules])
    radius = np.array([c.radius for c in capsules])[:, None, None]
    low, high = (ends - radius).min(axis=(0, 1)), (ends + radius).max(axis=(0, 1))
    probes = low + spread(20_000) * (high - low)
    inside = np.any([to_segment(probes, c.a, c.b) <= c.radius for c in capsules], axis=0)
    return float(inside.mean() * np.prod(high - low))


def _fitted(triangles: np.ndarray) -> Fitted:
    points = triangles.reshape(-1, 3)
    capsule = fit(points)
    return Fitted(capsule, points, hull_volume(points), reach_beyond([capsule], points))


def _crude(points: np.ndarray, way: np.ndarray) -> Capsule:
    """A capsule along a direction, through the middle of what lies across it."""
    other = np.eye(3)[int(np.argmin(np.abs(way)))]
    first = np.cross(way, other)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(way, first), way])
    local = points @ frame.T
    centre = (local[:, :2].min(axis=0) + local[:, :2].max(axis=0)) / 2
    across = np.hypot(*(local[:, :2] - centre).T)
    radius = across.max()
    cap = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = (local[:, 2] + cap).min(), (local[:, 2] - cap).max()
    if low > high:
        low = high = (low + high) / 2
    a, b = (np.array([*centre, t]) @ frame for t in (low, high))
    return around(points, a, b)


def _refined(points: np.ndarray, start: Capsule) -> Capsule:
    """Move both ends until the volume falls no more."""
    size = max(float(np.ptp(points, axis=0).max()), 1e-6)
    middle = points.mean(axis=0)
    local = (points - middle) / size

    def volume(ends: np.ndarray) -> float:
        radius = to_segment(local, ends[:3], ends[3:]).max()
        return radius**2 * (np.linalg.norm(ends[3:] - ends[:3]) + 4.0 / 3.0 * radius)

    ends = np.concatenate([start.a - middle, start.b - middle]) / size
    for step in (0.1, 0.03):
        simplex = np.concatenate([ends[None], ends + step * np.eye(6)])
        found = minimize(
            volume, ends, method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 300, "xatol": 1e-4, "fatol": 1e-7},
        )  # fmt: skip
        ends = found.x if found.fun < volume(ends) else ends
    return around(points, ends[:3] * size + middle, ends[3:] * size + middle)


def to_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of each point (n, 3) to the segment from a to b [m], (n,)."""
    along = b - a
    square = along @ along
    rel = points - a
    if square > 0.0:
        rel = rel - np.clip(rel @ along / square, 0.0, 1.0)[:, None] * along
    return np.sqrt((rel * rel).sum(axis=1))


def _ways(points: np.ndarray) -> list[np.ndarray]:
    return [*np.eye(3), *_axes(points), *directions(24)[:12]]


def _axes(points: np.ndarray) -> np.ndarray:
    """Main axes of the points, (3, 3), rows."""
    return np.linalg.eigh(np.cov(points.T))[1].T


def spread(count: int) -> np.ndarray:
    """Points spread evenly in the unit cube (Roberts' sequence), (count, 3)."""
    g = 1.2207440846057596  # the real root of g^4 = g + 1
    return (0.5 + np.arange(1, count + 1)[:, None] * g ** -np.arange(1.0, 4.0)) % 1.0


def directions(count: int) -> np.ndarray:
    """Directions spread evenly (Fibonacci's spiral), (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
