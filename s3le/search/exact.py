"""Exact nearest neighbours by looking at every row, compiled; the truth that others are held to."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from s3le.kernels.batch import workers
from s3le.kernels.compiled import compiled
from s3le.types import Progress

_QUERIES = 16  # a worker's share: the stored rows then pass through the cache once for all of them


def nearest(
    stored: np.ndarray, queries: np.ndarray, metric: str, progress: Progress | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Row of the nearest stored vector for each query; ties go to the lowest row.

    Args:
        stored: float32 (n, d).
        queries: float32 (m, d).
        metric: "l2" or "l1"; distances are summed in float64.
        progress: called with numbers of queries done.

    Returns:
        Pair (row, distance): int64 (m,) and float64 (m,).
    """
    stored = np.ascontiguousarray(stored, np.float32)
    queries = np.ascontiguousarray(queries, np.float32)
    row = np.full(len(queries), -1, np.int64)
    distance = np.full(len(queries), np.inf)
    slices = [slice(i, i + _QUERIES) for i in range(0, len(queries), _QUERIES)]

    def work(at: slice) -> None:
        _nearest(stored, queries[at], metric == "l1", row[at], distance[at])

    with ThreadPoolExecutor(workers()) as pool:
        for at, _ in zip(slices, pool.map(work, slices), strict=True):
            if progress:
                progress(len(queries[at]))
    return row, distance if metric == "l1" else np.sqrt(distance)


@compiled
def _nearest(stored, queries, absolute, row, distance):
    d = stored.shape[1]
    for i in range(len(stored)):
        for k in range(len(queries)):
            total = 0.0
            best = distance[k]
            for j in range(d):
                diff = np.float64(stored[i, j]) - np.float64(queries[k, j])
                total += abs(diff) if absolute else diff * diff
                if total >= best:
                    break
            if total < best:
                distance[k] = total
                row[k] = i
