"""What a door is: a reader of files from outside, good files for it, and what it owes."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Files = dict[str, bytes]  # by name
STRICT = re.compile(rb"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")


class Reading(NamedTuple):
    """A file that was read although it is broken: the files as written, and what came of them."""

    files: Files
    result: Any
    folder: Path
    told: list[str]  # warnings given meanwhile


class Door(NamedTuple):
    """One reader.

    Attributes:
        goods: sets of good files.
        broken: which of the names are mutated, one at a time.
        read: reads the folder; refuses with S3leError.
        owed: asserts that the result is what the bytes must give.
        exact: whether damage never goes unseen, so that what is read equals the good file's.
    """

    goods: list[Files]
    broken: tuple[str, ...]
    read: Callable[[Path], Any]
    owed: Callable[[Reading], None] = lambda _: None
    exact: bool = False


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    assert len(dict(pairs)) == len(pairs), "a key is there twice"
    return dict(pairs)
