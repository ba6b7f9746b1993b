"""Which motions are meant, where each result goes, and what a file holds, as a hash."""

import hashlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from s3le.errors import ParameterError
from s3le.guard.layouts.door import find
from s3le.motion import text
from s3le.store import sidecar

TABLE = "guard.parquet"  # of a folder of results
SIDECAR = ".guard.json"  # behind a result's name
_NOWHERE = Path(os.devnull)  # nothing can lie below it
_READ = {".parquet", ".json", ".jsonl", ".csv"}  # in a folder, what is hashed by what it holds


class Piece(NamedTuple):
    """One motion file, or folder that is one, on its way."""

    name: str  # as results call it: its path below what was given
    source: Path
    target: Path  # in the folder of results
    sidecar: Path  # what is said of the target

    def withdraw(self) -> None:
        """Take away the result and what was said of it."""
        self.sidecar.unlink(missing_ok=True)  # first: nothing is claimed of a part
        if self.target.is_dir():
            shutil.rmtree(self.target)
            return
        for file in _with_side(self.target):
            file.unlink(missing_ok=True)


def pieces(given: Sequence[Path], out: Path | None) -> list[Piece]:
    """The motions that are meant, in order; of a folder all below it, its tree kept.

    Args:
        given: files and folders.
        out: folder of the results; None: there will be none.

    Raises:
        TrajectoryError: there is no such file, or no motion in a folder.
        ParameterError: a result would replace a motion, another result or the table, or lie in a
            folder that is read.
    """
    made: list[Piece] = []
    for path in given:
        found = find(path)
        base = path.resolve()
        inside = base.is_dir() and found != [path]
        if out is not None and base.is_dir() and out.resolve().is_relative_to(base):
            raise ParameterError(
                f"{out} lies in {path}, whose motions are read; give another folder as --out"
            )
        for source in found:
            # By the names that people gave, not by what links point to.
            own = path.name if path.name not in ("", "..") else base.name
            name = source.relative_to(path).as_posix() if inside else own
            if inside and Path(name).name == TABLE:
                continue  # of an earlier guard's results
            target = (_NOWHERE if out is None else out) / name
            made.append(Piece(name, source, target, target.with_name(target.name + SIDECAR)))
    if out is not None:
        _refuse_overlap(made, out)
    return made


def _refuse_overlap(made: list[Piece], out: Path) -> None:
    sources = {piece.source.resolve(): piece for piece in made}
    writer: dict[Path, Piece] = {}
    for piece in made:
        target = piece.target.resolve()
        if target == (out / TABLE).resolve():
            raise ParameterError(f"{piece.source}: {TABLE} is the name of the table; rename it")
        for place in (target, *target.parents):
            if place in sources:
                raise ParameterError(
                    f"{sources[place].source} is a motion, and would be replaced by the result of "
                    f"{piece.source}; give another folder as --out"
                )
        if target in writer:
            raise ParameterError(
                f"{writer[target].source} and {piece.source} would both become {piece.target}; "
                "write them to two folders"
            )
        writer[target] = piece
    for target, piece in writer.items():
        if inner := next((parent for parent in target.parents if parent in writer), None):
            raise ParameterError(
                f"the result of {piece.source} would lie in that of {writer[inner].source}; "
                "write them to two folders"
            )


def fingerprint(path: Path) -> str:
    """Hash of what a motion holds, and of what lies beside it.

    Of a folder its tables and descriptions by what they hold, the rest (films) by name and size.

    Raises:
        OSError: it cannot be read.
    """
    whole = hashlib.sha256()
    if not path.is_dir():
        for file in _with_side(path):
            if file == path or file.is_file():
                whole.update(_digest(file))
        return whole.hexdigest()
    for file in sorted(item for item in path.rglob("*") if item.is_file()):
        whole.update(file.relative_to(path).as_posix().encode() + b"\0")
        held = file.suffix.lower() in _READ
        whole.update(_digest(file) if held else str(file.stat().st_size).encode() + b"\0")
    return whole.hexdigest()


def _digest(path: Path) -> bytes:
    return bytes.fromhex(sidecar.digest(path))


def _with_side(path: Path) -> list[Path]:
    """A file, and of a CSV also what is said of it."""
    return [path, text.side_file(path)] if path.suffix.lower() == ".csv" else [path]
