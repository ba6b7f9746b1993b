"""The few nearest stored latents of one frame, in a time that hardly grows with their number.

    index = neighbours.build(z)               # or neighbours.load(path); read-only from then on
    seeker = index.seeker(k=12)               # one for each thread
    rows, distances = seeker(z_of_the_frame)  # its own arrays, overwritten by the next call

By default a walk over a graph (s3le/search/graph.py): approximate, which costs nearness and never
safety, since whatever it finds is a stored pose. `exact=True` looks at all rows instead, and so
does every metric that has no graph (l1). A file is numbers and a checksum; nothing in it is run.
"""

import hashlib
import json
import os
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ModelError, ParameterError
from s3le.search import graph as graphs
from s3le.search.exact import scan
from s3le.search.graph import Graph, walk_to
from s3le.search.metrics import METRICS, normalised
from s3le.store.atomic import replace
from s3le.types import Progress

WIDTH = 64  # rows that a walk keeps: more find more, in proportionally more time
MOST = 2**30  # rows; a walk numbers them in 31 bits
_MAGIC = b"s3le neighbours 1\n"
_HEAD = 4096  # bytes that the second line has at most
_AGAIN = "build it again"


class Found(NamedTuple):
    """The nearest stored rows of each query, nearest first."""

    rows: np.ndarray  # int64 (m, k)
    distances: np.ndarray  # float64 (m, k)


class Neighbours:
    """Stored latents that can be asked for the nearest; read-only once built.

    Attributes:
        metric: "l2", "l1" or "cosine" (length of the difference of unit vectors, as in
            s3le.search.metrics).
        graph: what a walk goes along; None: every query looks at all rows.
        stored: the latents, unit vectors for cosine, (n, d).
        columns: the same, (d, n), for looking at all rows; None where there is a graph.
    """

    def __init__(self, metric: str, graph: Graph | None, stored: np.ndarray):
        """Take what `build` or `load` made."""
        self.metric, self.graph, self.stored = metric, graph, stored
        self.columns = None if graph else np.ascontiguousarray(stored.T)
        for array in (stored, *(graph or (self.columns,))):
            array.setflags(write=False)

    def __len__(self) -> int:
        """How many latents are stored."""
        return len(self.stored)

    def __str__(self) -> str:
        """How many latents of which kind, and how they are searched."""
        how = "a walk over a graph" if self.graph else "exact, looking at all"
        return f"{len(self)} latents of {self.stored.shape[1]} numbers, {self.metric}, {how}"

    def seeker(self, k: int, width: int = WIDTH) -> "Seeker":
        """What answers one query after another with the k nearest; not to be shared by threads.

        Args:
            k: rows wanted.
            width: rows that a walk keeps, at least k; no matter for an exact search.

        Raises:
            ParameterError: k or width is out of range.
        """
        return Seeker(self, k, width)

    def query(self, z: np.ndarray, k: int, width: int = WIDTH) -> Found:
        """The k nearest stored rows of each latent.

        Args:
            z: queries, (m, d).
            k, width: see `seeker`.

        Raises:
            ParameterError: k or width is out of range, z has another width or is not finite.
        """
        z = np.asarray(z)
        if z.ndim != 2 or z.shape[1] != self.stored.shape[1]:
            raise ParameterError(f"cannot search {z.shape} among stored {self.stored.shape}")
        seeker = self.seeker(k, width)
        found = Found(np.empty((len(z), k), np.int64), np.empty((len(z), k)))
        for i in range(len(z)):
            try:
                found.rows[i], found.distances[i] = seeker(z[i])
            except ParameterError:
                raise ParameterError(f"query latent {i} is not finite") from None
        return found

    def save(self, path: Path) -> None:
        """Write latents and graph as one file, whole or not at all; equal indices, equal bytes.

        Args:
            path: where; the folder is made if need be.
        """
        none = np.empty((len(self), 0), np.int32)
        arrays = self.graph.links if self.graph else none, self.stored
        digest = hashlib.sha256()
        for array in arrays:
            digest.update(array.data)
        head = {
            "metric": self.metric,
            "shape": self.stored.shape,
            "degree": arrays[0].shape[1],
            "sha256": digest.hexdigest(),
        }

        def fill(part: Path) -> None:
            with part.open("wb") as file:
                file.write(_MAGIC + json.dumps(head, sort_keys=True).encode() + b"\n")
                for array in arrays:
                    file.write(array.tobytes() if not array.size else array.data)

        replace(path, fill)


class Seeker:
    """Answers one query after another, into arrays of its own.

    Attributes:
        rows: int64 (k,), the last answer, nearest first.
        distances: float64 (k,), theirs.
        scratch: what search.graph.walk_to wants, for a caller that is itself compiled.
    """

    def __init__(self, index: Neighbours, k: int, width: int):
        """See Neighbours.seeker."""
        if not 1 <= k <= len(index):
            raise ParameterError(f"k must be in 1..{len(index)} (the rows stored), got {k!r}")
        if not k <= width <= graphs.WIDEST:
            raise ParameterError(f"width must be in k..{graphs.WIDEST}, got {width!r}, k {k!r}")
        self.rows = np.full(k, -1, np.int64)
        self.distances = np.full(k, np.inf)
        self.scratch = graphs.scratch(index.graph, width) if index.graph else None
        self._graph, self._columns, self._metric = index.graph, index.columns, index.metric
        self._z = np.full(index.stored.shape[1], np.nan, np.float32)
        self._seek()  # compiles, so that the first query does not

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pair (rows, distances) of one latent, (d,), nearest first.

        Raises:
            ParameterError: z has another length, or is not finite.
        """
        if np.shape(z) != self._z.shape:
            raise ParameterError(f"query has shape {np.shape(z)}, {self._z.shape} is wanted")
        with np.errstate(over="ignore", invalid="ignore"):  # what becomes infinite is refused
            self._z[:] = z
            if self._metric == "cosine":
                self._z[:] = normalised(self._z[None])[0]
        if not self._seek():
            raise ParameterError("query latent is not finite")
        return self.rows, self.distances

    def _seek(self) -> int:
        if self._graph is not None:
            return walk_to(self._graph, self.scratch, self._z, self.rows, self.distances)
        one = self._z[None], self._metric == "l1", self.rows[None], self.distances[None]
        return scan(self._columns, *one)[0]


def build(
    z: np.ndarray, metric: str = "l2", exact: bool = False, progress: Progress | None = None
) -> Neighbours:
    """Make latents searchable.

    The same latents give the same index, to the byte, whatever the number of threads.

    Args:
        z: latents of the stored poses, (n, d).
        metric: one of index.METRICS; l1 is always exact.
        exact: look at all rows in every query.
        progress: called with numbers of rows done.

    Raises:
        ParameterError: unknown metric, nothing stored, or a latent that is not finite.
    """
    if metric not in METRICS:
        raise ParameterError(f"metric must be one of {', '.join(METRICS)}, got {metric!r}")
    z = np.array(z, np.float32, order="C")
    if z.ndim != 2 or not z.size or len(z) > MOST:
        raise ParameterError(f"cannot index latents of shape {z.shape}")
    _refuse_not_finite(z)
    if metric == "cosine":
        z = normalised(z)
    if exact or metric == "l1":
        return Neighbours(metric, None, z)
    graph = graphs.build(z, progress)
    return Neighbours(metric, graph, graph.stored)


def load(path: Path) -> Neighbours:
    """Read what `Neighbours.save` wrote.

    Raises:
        ModelError: the file is missing, damaged, or of another kind.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ModelError(f"{path} is no index of neighbours; {_AGAIN}")
            metric, stored, links = _read(file)
    except FileNotFoundError:
        raise ModelError(f"{path} is missing; {_AGAIN}") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError, ParameterError) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise ModelError(f"{path} cannot be read ({reason}); {_AGAIN}") from None
    graph = graphs.assemble(stored, links) if links.size else None
    return Neighbours(metric, graph, stored)


def _read(file: BufferedReader) -> tuple[str, np.ndarray, np.ndarray]:
    """Metric, latents and links of a file, past its magic line, fit for a walk to follow.

    Raises:
        ValueError, KeyError, TypeError: anything is not as `save` writes it.
    """
    head = json.loads(file.readline(_HEAD))
    metric, (n, d), degree = head["metric"], head["shape"], head["degree"]
    if metric not in METRICS or degree not in (0, graphs.DEGREE) or (degree and metric == "l1"):
        raise ValueError(f"metric {metric!r}, {degree!r} links a row")
    size = 4 * n * (degree + d)
    left = os.fstat(file.fileno()).st_size - file.tell()
    if not (1 <= n <= MOST and d >= 1 and size == left):
        raise ValueError(f"{left} bytes of numbers, {size} wanted; cut off or changed")
    links = graphs.aligned((n, degree), np.int32)
    stored = np.empty((n, d), np.float32)
    digest = hashlib.sha256()
    for array in (links, stored):
        if array.size:
            file.readinto(array.data.cast("B"))
        digest.update(array.data)
    if digest.hexdigest() != head["sha256"]:
        raise ValueError("its checksum is another; damaged or changed")
    # A checksum can be forged; what the walk takes for granted is looked at.
    if degree and not (-1 <= links.min() and links.max() < n):
        raise ValueError("a link leads nowhere")
    _refuse_not_finite(stored)
    return metric, stored, links


def _refuse_not_finite(z: np.ndarray) -> None:
    if not np.isfinite(z).all():
        row = int(np.argmin(np.isfinite(z).all(axis=1)))
        raise ParameterError(f"stored latent {row} is not finite")
