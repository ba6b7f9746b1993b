"""Convex hulls of a robot's own collision meshes, kept beside its robot file."""

import io
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from s3le.onboard.source import Source


def pack(source: Source) -> bytes:
    """Corners of the hull of every piece with triangles, as the bytes of an NPZ file.

    Its arrays are called LINK/K, the K-th piece of a link, (n, 3) [m] in the link's frame, float64.
    Capsules and spheres have no corners and are left out, and so is what is flat.
    """
    arrays: dict[str, Any] = {}
    for link, shapes in source.shapes.items():
        for k, shape in enumerate(shapes):
            found = corners(shape.triangles.reshape(-1, 3))
            if len(found):
                arrays[f"{link}/{k}"] = found
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def corners(points: np.ndarray) -> np.ndarray:
    """The points (n, 3) that span the hull; none where they lie in a plane."""
    points = np.unique(points, axis=0)
    try:
        return points[np.sort(ConvexHull(points).vertices)]
    except (QhullError, ValueError):
        return points[:0]
