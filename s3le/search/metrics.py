"""The stored poses of a method and the exact look-up among their latents (paper, eq. dlu)."""

import numpy as np

from s3le.errors import ParameterError
from s3le.search.exact import nearest
from s3le.types import Progress

METRICS = ("l2", "l1", "cosine")  # of the vectors as they are
LATENT_METRICS = (*METRICS, "decoded", "mahalanobis")  # and of latents brought to X first
RIDGE = 1e-6  # of the fit in `to_skeletons`, in mean variances of a latent's dimension


def look_up(
    stored: np.ndarray, queries: np.ndarray, metric: str, progress: Progress | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest stored latent of each query, by looking at all; ties go to the lowest row.

    Args:
        stored: latents of the stored poses, (n, d).
        queries: latents of the frames, (m, d).
        metric: one of METRICS.
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


def to_skeletons(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The linear map from latents to skeletons that fits stored poses best (least squares).

    |A (z - z')| is a Mahalanobis distance of latents that weighs each direction of the latent
    space by what it moves in the skeleton; directions that hold what a skeleton cannot show
    weigh nothing.

    Args:
        z: latents of the stored poses, (n, d).
        x: their skeletons, (n, 21).

    Returns:
        A, float64 (d, 21), to be applied as z @ A. The same for any number of threads.
    """
    z = np.asarray(z, float) - np.mean(z, axis=0, dtype=float)
    x = np.asarray(x, float) - np.mean(x, axis=0, dtype=float)
    # einsum adds up in one order; a matrix product's depends on its threads.
    inner, outer = np.einsum("ni,nj->ij", z, z), np.einsum("ni,nj->ij", z, x)
    ridge = RIDGE * np.trace(inner) / len(inner)
    if not ridge > 0.0:
        return np.zeros_like(outer)  # latents that do not vary tell nothing
    return np.linalg.solve(inner + ridge * np.eye(len(inner)), outer)


def normalised(z: np.ndarray) -> np.ndarray:
    """Latents scaled to length 1; a zero latent stays zero."""
    return z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-12)
