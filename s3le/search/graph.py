"""A graph of stored vectors that a greedy walk finds near neighbours in, compiled.

Every row has up to DEGREE links to rows around it, no two of which lie nearer to each other than
to it (Malkov and Yashunin's heuristic, HNSW, arXiv 1603.09320, algorithm 4, on one layer). A walk
starts at the nearest of a few pivots and keeps the `width` nearest rows seen until it has looked
at the links of all of them. Vectors are rounded to 16-bit integers for the walk, so that one is a
line of the cache and every distance in it an exact integer: the graph does not depend on the
order in which a processor adds. The best few are then compared by their true distance.

A walk sees a bounded number of rows, whatever the query. Nothing here checks its arrays.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from s3le.kernels.batch import CHUNK
from s3le.kernels.compiled import compiled
from s3le.kernels.threads import workers
from s3le.search.exact import place
from s3le.search.fetch import fetch
from s3le.types import Progress

DEGREE = 32  # most links of a row; 18 is what the heuristic leaves on average
BUILD_WIDTH = 100  # rows kept by the walk that finds a new row's links
_BUILD_SEEN = 1 << 14  # a power of two, of which such a walk fills three quarters at most
WIDEST = 4096  # rows that a walk may keep
PIVOTS = 256  # rows that a walk may start from
SPARE = 8  # rows beyond those asked for that are compared by their true distance
_LANES = 16  # vectors are filled up with zeros to a multiple of this
_FARTHEST = 46000.0  # between two codes; its square, with room for rounding, is below 2^31
_ROOM = 1.5  # the code reaches this many ranges across: half a range beyond either end
_GROWTH = 0.02  # rows linked at once, of those linked before; they do not see each other
_MOST = 4096  # rows linked at once


class Graph(NamedTuple):
    """The stored vectors and their links, in the caller's order."""

    codes: np.ndarray  # int16 (n, lanes)
    links: np.ndarray  # int32 (n, DEGREE), -1 after the last
    pivots: np.ndarray  # int32 (p,), where walks may start
    pivot_codes: np.ndarray  # int16 (p, lanes)
    stored: np.ndarray  # float32 (n, d)
    centre: np.ndarray  # (d,), the vector of code 0
    reach: np.ndarray  # (d,), how far from the centre a code can say
    scale: np.ndarray  # (1,), codes per unit


class Scratch(NamedTuple):
    """What one walk writes; one for each thread."""

    keys: np.ndarray  # int64 (width,): distance << 32 | row << 1 | looked at
    seen: np.ndarray  # int32, a hash set of rows; its length is a power of two
    code: np.ndarray  # int16 (lanes,), the query's


def scratch(graph: Graph, width: int) -> Scratch:
    """Room for walks that keep the `width` nearest rows."""
    seen = 1 << int(2 * width * DEGREE - 1).bit_length()
    return Scratch(
        np.zeros(width, np.int64),
        np.full(seen, -1, np.int32),
        np.zeros(graph.codes.shape[1], np.int16),
    )


@compiled
def walk_to(graph, scratch, z, rows, distances):
    """The nearest stored rows that a walk finds, nearest first; equals by the lower row.

    Args:
        graph: where to look.
        scratch: see `scratch`, of at least len(rows) width.
        z: the query, float32 (d,).
        rows: int64 (k,), filled with row numbers; no more than there are stored.
        distances: float64 (k,), filled with distances.

    Returns:
        k, or 0 if z is not finite; then rows are -1, distances infinite. Where a walk meets
        fewer than k rows (far more than k of them are equal), all rows are looked at.
    """
    rows[:] = -1
    distances[:] = np.inf
    for j in range(len(z)):
        if not np.isfinite(z[j]):
            return 0
        off = np.float64(z[j]) - graph.centre[j]
        off = min(max(off, -graph.reach[j]), graph.reach[j])
        scratch.code[j] = np.int16(np.rint(off * graph.scale[0]))
    start = _start(graph, len(graph.pivots), scratch.code)
    met = _walk(graph.codes, graph.links, start, scratch.code, scratch.keys, scratch.seen)
    found = 0
    for at in range(min(met, len(rows) + SPARE)):
        i = _row(scratch.keys[at])
        found = place(rows, distances, found, i, _square(graph.stored, i, z))
    if found < len(rows):
        found = 0
        for i in range(len(graph.stored)):
            found = place(rows, distances, found, i, _square(graph.stored, i, z))
    for at in range(found):
        distances[at] = np.sqrt(distances[at])
    return found


@compiled
def _square(stored, i, z):
    """Squared distance of a stored row."""
    total = 0.0
    for j in range(len(z)):
        diff = np.float64(stored[i, j]) - np.float64(z[j])
        total += diff * diff
    return total


@compiled
def _far(codes, i, code):
    """Squared distance of a row from a code; the scale keeps it below 2^31."""
    total = np.int32(0)
    for j in range(len(code)):  # plain, so that the compiler makes vector instructions of it
        diff = np.int32(np.int32(codes[i, j]) - np.int32(code[j]))
        total = np.int32(total + np.int32(diff * diff))
    return total


@compiled
def _key(far, i):
    return (np.int64(far) << 32) | (np.int64(i) << 1)


@compiled
def _row(key):
    return (key & 0xFFFFFFFF) >> 1


@compiled
def _start(graph, pivots, code):
    """The nearest of the first pivots."""
    start = graph.pivots[0]
    nearest = np.int32(2**31 - 1)
    for p in range(pivots):
        far = _far(graph.pivot_codes, p, code)
        if far < nearest:
            nearest = far
            start = graph.pivots[p]
    return start


@compiled
def _walk(codes, links, start, code, keys, seen):
    """Fill keys with the nearest rows that a walk from start meets, nearest first; how many."""
    most = 3 * len(seen) // 4  # rows; also what keeps the hash set from filling up
    fresh = np.empty(links.shape[1], np.int32)
    seen[:] = -1
    seen[_slot(seen, start)] = start
    keys[0] = _key(_far(codes, start, code), start)
    met = looked = 1
    at = 0
    while at < met and looked + links.shape[1] <= most:
        if keys[at] & 1:
            at += 1
            continue
        node = _row(keys[at])
        keys[at] |= 1
        new = 0
        for e in range(links.shape[1]):
            j = links[node, e]
            if j < 0:
                break
            slot = _slot(seen, j)
            if seen[slot] < 0:
                seen[slot] = j
                fetch(codes, j)
                fresh[new] = j
                new += 1
        looked += new
        first = met
        for e in range(new):
            key = _key(_far(codes, fresh[e], code), fresh[e])
            if met == len(keys) and key >= keys[met - 1]:
                continue
            p = met if met < len(keys) else met - 1
            while p > 0 and keys[p - 1] > key:
                keys[p] = keys[p - 1]
                p -= 1
            keys[p] = key
            met = min(met + 1, len(keys))
            first = min(first, p)
        at = min(at, first)
    return met


@compiled
def _slot(seen, j):
    """Where in the hash set a row is, or belongs."""
    mask = len(seen) - 1
    slot = (np.int64(j) * 2654435769 >> 7) & mask
    while seen[slot] != j and seen[slot] >= 0:
        slot = (slot + 1) & mask
    return slot


def build(stored: np.ndarray, progress: Progress | None = None) -> Graph:
    """Link vectors so that walks find them.

    The same vectors give the same graph, whatever the number of threads.

    Args:
        stored: float32 (n, d), finite, n at least 1.
        progress: called with numbers of rows done.
    """
    n = len(stored)
    made = assemble(stored, aligned((n, DEGREE), np.int32))
    order = _insertion(n, made.pivots)
    links = np.full((n, 2 * DEGREE), -1, np.int32)  # thinned out only when twice full
    done = 1
    with ThreadPoolExecutor(workers()) as pool:
        while done < n:
            batch = order[done : done + max(1, min(_MOST, int(_GROWTH * done)))]
            pivots = min(done, len(made.pivots))
            parts = [batch[i : i + CHUNK] for i in range(0, len(batch), CHUNK)]
            _all(pool, _link, [(made, links, pivots, part) for part in parts])
            # Each task adds to rows of its own, in the order of the batch.
            tasks = len(parts)
            _all(pool, _link_back, [(made, links, batch, own, tasks) for own in range(tasks)])
            done += len(batch)
            if progress:
                progress(len(batch))
        _all(pool, _thin, [(made, links, i, min(i + _MOST, n)) for i in range(0, n, _MOST)])
    if progress:
        progress(1)
    return made


def assemble(stored: np.ndarray, links: np.ndarray) -> Graph:
    """The graph of these vectors with these links, best `aligned`; the rest follows from them."""
    n, d = stored.shape
    low, high = stored.min(axis=0).astype(float), stored.max(axis=0).astype(float)
    centre, width = (low + high) / 2.0, high - low
    # From a query at one end of the code's room to a row at the other end of all rows.
    farthest = _ROOM * math.sqrt(math.fsum(width * width))  # the same on every machine
    scale = _FARTHEST / farthest if farthest > 0.0 else 1.0
    stored = np.ascontiguousarray(stored, np.float32)
    codes = aligned((n, -(-d // _LANES) * _LANES), np.int16)
    _encode(stored, centre, scale, codes)
    pivots = np.unique(np.linspace(0, n - 1, min(n, PIVOTS)).astype(np.int32))
    reach = (_ROOM - 0.5) * width
    return Graph(codes, links, pivots, codes[pivots], stored, centre, reach, np.array([scale]))


def _all(pool: ThreadPoolExecutor, work: Callable, calls: list[tuple]) -> None:
    """Make these calls, in this thread where there is but one."""
    if len(calls) == 1:
        work(*calls[0])
    else:
        list(pool.map(lambda call: work(*call), calls))


def aligned(shape: tuple[int, int], dtype: type) -> np.ndarray:
    """An array that begins where a line of the cache does, so that rows do not straddle lines."""
    size = shape[0] * shape[1] * np.dtype(dtype).itemsize
    room = np.empty(size + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + size].view(dtype).reshape(shape)


def _insertion(n: int, pivots: np.ndarray) -> np.ndarray:
    """Pivots first, then the other rows in an order without any order, the same everywhere."""
    mixed = (np.arange(n, dtype=np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(31)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(29)
    mixed[pivots] = 0
    return np.argsort(mixed, kind="stable").astype(np.int32)


@compiled
def _encode(stored, centre, scale, codes):
    codes[:] = 0
    for i in range(len(stored)):
        for j in range(stored.shape[1]):
            codes[i, j] = np.int16(np.rint((np.float64(stored[i, j]) - centre[j]) * scale))


@compiled
def _link(graph, links, pivots, batch):
    """Give each row of a batch its own links, to rows linked before."""
    keys = np.empty(BUILD_WIDTH, np.int64)
    seen = np.empty(_BUILD_SEEN, np.int32)
    for i in batch:
        start = _start(graph, pivots, graph.codes[i])
        met = _walk(graph.codes, links, start, graph.codes[i], keys, seen)
        _choose(graph.codes, keys, met, links[i])


@compiled
def _link_back(graph, links, batch, own, tasks):
    """Link the rows that a batch links to back to it: those of one task among so many."""
    keys = np.empty(links.shape[1] + 1, np.int64)
    for i in batch:
        for e in range(DEGREE):
            j = links[i, e]
            if j < 0:
                break
            if j % tasks != own:
                continue
            have = 0
            while have < links.shape[1] and links[j, have] >= 0:
                have += 1
            if have < links.shape[1]:
                links[j, have] = i
                continue
            for k in range(have):
                keys[k] = _key(_far(graph.codes, links[j, k], graph.codes[j]), links[j, k])
            keys[have] = _key(_far(graph.codes, i, graph.codes[j]), i)
            keys.sort()
            _choose(graph.codes, keys, have + 1, links[j])


@compiled
def _thin(graph, links, first, last):
    """Bring links down to the final number."""
    for i in range(first, last):
        have = 0
        while have < links.shape[1] and links[i, have] >= 0:
            have += 1
        if have <= DEGREE:
            graph.links[i] = links[i, :DEGREE]
            continue
        keys = np.empty(have, np.int64)
        for k in range(have):
            keys[k] = _key(_far(graph.codes, links[i, k], graph.codes[i]), links[i, k])
        keys.sort()
        _choose(graph.codes, keys, have, graph.links[i])


@compiled
def _choose(codes, keys, met, out):
    """Of rows sorted by distance keep those that are nearer to this row than to one kept."""
    kept = 0
    for at in range(met):
        j = _row(keys[at])
        apart = True
        for k in range(kept):
            # Equal counts as nearer: of rows with the same vector, one is enough.
            if _far(codes, j, codes[out[k]]) <= keys[at] >> 32:
                apart = False
                break
        if apart:
            out[kept] = j
            kept += 1
            if kept == DEGREE:
                break
    out[kept:] = -1
