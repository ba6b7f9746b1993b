"""Files that appear whole or not at all: the one way in which this project puts a file in place."""

import os
from collections.abc import Callable
from pathlib import Path


def replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Let fill(part) write a file beside path, then put it in path's place in one step.

    Whatever ends this process, path is what it was or the whole new file. What a process that is
    gone has left beside path is cleared away.

    Args:
        path: where; the folder is made if need be.
        fill: writes the file that it is given.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _clear(path)
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


def _clear(path: Path) -> None:
    """Remove the parts of path that nobody writes any more."""
    for left in path.parent.iterdir():
        number = left.name.removeprefix(f".{path.name}.").removesuffix(".part")
        if left.name == f".{path.name}.{number}.part" and number.isdecimal():
            try:
                os.kill(int(number), 0)
            except ProcessLookupError:
                left.unlink(missing_ok=True)
            except OSError:
                pass  # somebody else's process: it lives
