"""The stored poses of a method and the exact look-up among their latents (paper, eq. dlu)."""

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels.batch import Progress
from s3le.kernels.nearest import nearest

METRICS = ("l2", "l1", "cosine")


def look_up(
    stored: np.ndarray, queries: np.ndarray, metric: str, progress: Progress | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest stored latent of each query, by looking at all; ties go to the lowest row.

    Args:
        stored: latents of the stored poses, (n, d).
        queries: latents of the frames, (m, d).
        metric: one of METRICS: d_Y of eq. (dlu), which the paper leaves open.
        progress: called with numbers of queries done.

    Returns:
        Pair (row, distance): int64 (m,) and float64 (m,).

    Raises:
        ParameterError: unknown metric, nothing stored, or vectors of another length or not finite.
    """
    if metric not in METRICS:
        raise ParameterError(f"metric must be one of {', '.join(METRICS)}, got {metric!r}")
    if not len(stored) or stored.shape[1:] != queries.shape[1:]:
        raise ParameterError(f"cannot search {queries.shape} among stored {stored.shape}")
    for what, z in (("stored", stored), ("query", queries)):
        if not np.isfinite(z).all():
            row = int(np.flatnonzero(~np.isfinite(z).all(axis=1))[0])
            raise ParameterError(f"{what} latent {row} is not finite")
    if metric == "cosine":
        stored, queries = normalised(stored), normalised(queries)
    return nearest(stored, queries, "l1" if metric == "l1" else "l2", progress)


def normalised(z: np.ndarray) -> np.ndarray:
    """Latents scaled to length 1; a zero latent stays zero."""
    return z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-12)
