"""What the engine can run, and what it gets back."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

from s3le.errors import EngineError

Counts = dict[str, float | int]
Progress = Callable[[int, Counts], object]  # rows done since the last call, all counts so far


class Job(NamedTuple):
    """One shard to make."""

    number: int
    rows: int


class Made(NamedTuple):
    """One shard that has been made."""

    job: Job
    data: bytes  # the whole file
    counts: Counts  # what was counted while it was made; summed over shards


class Task(Protocol):
    """How the shards of one table are made; hashable plain data, so that it can be sent."""

    table: str  # name of the table
    module: str  # module whose code, with all it imports, makes the rows
    shard_rows: int  # rows of every shard but the last

    def __hash__(self) -> int:
        """By value: its fingerprint is kept under it."""

    def about(self) -> Mapping[str, Any]:
        """Everything but code and machine that can change a row, as JSON."""

    def make(self, job: Job) -> Made:
        """Make one shard; depends on nothing but self and job.

        Asked for fewer rows, it must give the first rows of the whole shard.
        """

    def note(self) -> Mapping[str, Any]:
        """What the manifest of the finished table says beside its shards, as JSON."""


def jobs(rows: int, shard_rows: int) -> list[Job]:
    """The shards that rows come in.

    Raises:
        EngineError: there is no row to make, or a shard would hold none.
    """
    if rows < 1 or shard_rows < 1:
        raise EngineError(f"cannot make {rows} rows in shards of {shard_rows}")
    full, rest = divmod(rows, shard_rows)
    return [Job(k, shard_rows) for k in range(full)] + ([Job(full, rest)] if rest else [])


def total(parts: Iterator[Counts] | list[Counts]) -> Counts:
    """Counts of all shards together."""
    whole: Counts = {}
    for part in parts:
        for name, value in part.items():
            whole[name] = whole.get(name, 0) + value
    return whole
