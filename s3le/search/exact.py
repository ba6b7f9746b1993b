"""Exact nearest neighbours by looking at every row, compiled; the truth that others are held to."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.threads import workers
from s3le.types import Progress

_QUERIES = 16  # of a worker's share
_TILE = 128  # rows that are summed at once
_LOOK = 16  # coordinates after which it is seen whether a tile still matters


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
    columns = np.ascontiguousarray(np.transpose(stored), np.float32)
    queries = np.ascontiguousarray(queries, np.float32)
    row, distance = np.empty((len(queries), 1), np.int64), np.empty((len(queries), 1))
    slices = [slice(i, i + _QUERIES) for i in range(0, len(queries), _QUERIES)]

    def work(at: slice) -> None:
        scan(columns, queries[at], metric == "l1", row[at], distance[at])

    with ThreadPoolExecutor(workers()) as pool:
        for at, _ in zip(slices, pool.map(work, slices), strict=True):
            if progress:
                progress(len(queries[at]))
    return row[:, 0], distance[:, 0]


@compiled
def scan(columns, queries, absolute, rows, distances):
    """The nearest stored rows of each query by looking at all, nearest first; equals by the lower.

    Args:
        columns: what is stored, one coordinate a line, float32 (d, n): a processor then works on
            several rows at once.
        queries: float32 (m, d).
        absolute: sum absolute differences, not squares; either in float64, in the order of d.
        rows: int64 (m, k), filled with row numbers; no more than there are stored.
        distances: float64 (m, k), filled with distances.

    Returns:
        For each query k, or 0 if it is not finite; then rows are -1, distances infinite.
    """
    rows[:] = -1
    distances[:] = np.inf
    found = np.zeros(len(queries), np.int64)
    total = np.empty(_TILE)
    last = rows.shape[1] - 1
    for first in range(0, columns.shape[1], _TILE):  # in the cache once for all queries
        count = min(_TILE, columns.shape[1] - first)
        for q in range(len(queries)):
            total[:] = 0.0
            for j in range(len(columns)):
                if j % _LOOK == _LOOK - 1 and total[:count].min() >= distances[q, last]:
                    break  # none of them can come nearer any more
                column = columns[j, first : first + count]
                at = np.float64(queries[q, j])
                if absolute:
                    for i in range(count):
                        total[i] += abs(np.float64(column[i]) - at)
                else:
                    for i in range(count):
                        total[i] += (np.float64(column[i]) - at) ** 2
            for i in range(count):
                if total[i] < distances[q, last]:
                    found[q] = place(rows[q], distances[q], found[q], first + i, total[i])
    if not absolute:
        distances[:] = np.sqrt(distances)
    return found


@compiled
def place(rows, distances, found, row, distance):
    """Put a row where it belongs among the nearest; how many there are then."""
    at = found
    while at > 0 and (
        distances[at - 1] > distance or (distances[at - 1] == distance and rows[at - 1] > row)
    ):
        if at < len(rows):
            rows[at] = rows[at - 1]
            distances[at] = distances[at - 1]
        at -= 1
    if at == len(rows):
        return found
    rows[at] = row
    distances[at] = distance
    return min(found + 1, len(rows))
