"""Files that appear whole or not at all: the one way in which this project puts a file in place."""

import os
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

_PART = re.compile(r"\..+\.([0-9]{1,9})\.part")  # as replace names it: file, process


def replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Let fill(part) write a file beside path, then put it in path's place in one step.

    Whatever ends this process, path is what it was or the whole new file. What processes that are
    gone have left in its folder is cleared away.

    Args:
        path: where; the folder is made if need be.
        fill: writes the file that it is given.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _clear(path.parent.resolve())
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        fill(part)
        with part.open("rb") as handle:
            os.fsync(handle.fileno())
        os.replace(part, path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # the new name too outlives a power cut
        finally:
            os.close(folder)
    finally:
        part.unlink(missing_ok=True)


@cache
def _clear(folder: Path) -> None:
    """Remove the parts in a folder that nobody writes any more; once in a process."""
    for left in folder.iterdir():
        found = _PART.fullmatch(left.name)
        if found and left.is_file() and not _lives(int(found[1])):
            left.unlink(missing_ok=True)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True
