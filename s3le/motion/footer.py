"""How many numbers a Parquet file claims to hold, asked before any is read.

A footer is a struct of Thrift's compact protocol. pyarrow's own answer ends the process where a
footer is damaged in its statistics, so the few bytes are walked here; what is wrong is an error.
"""

from pathlib import Path
from typing import Any

MOST_BYTES = 32 << 20  # of a footer; a row group of a hundred columns has some 10 kB
_DEEPEST = 32
_GROUPS, _CHUNKS, _META, _VALUES, _ROWS = 4, 1, 3, 5, 3  # numbers of fields in parquet.thrift
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)


class Damaged(ValueError):  # noqa: N818
    """The footer is none."""


def claimed(path: Path) -> int:
    """Numbers that a file claims to hold: those of its column chunks, or rows times columns.

    Raises:
        Damaged: it has no footer that can be walked.
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        if size < 12:
            raise Damaged("too short")
        stream.seek(size - 8)
        tail = stream.read(8)
        length = int.from_bytes(tail[:4], "little")
        if tail[4:] != b"PAR1" or not 0 < length <= min(size - 12, MOST_BYTES):
            raise Damaged("its end is not Parquet's")
        stream.seek(size - 8 - length)
        data = stream.read(length)
    tree = _Walk(data).struct()
    groups = tree.get(_GROUPS, [])
    chunks = [chunk for group in _structs(groups) for chunk in _structs(group.get(_CHUNKS, []))]
    values = [meta.get(_VALUES, 0) for chunk in chunks for meta in _structs([chunk.get(_META, {})])]
    most = max((len(_structs(group.get(_CHUNKS, []))) for group in _structs(groups)), default=0)
    rows = tree.get(_ROWS, 0)
    if not all(type(count) is int and count >= 0 for count in (*values, rows)):
        raise Damaged("its counts are none")
    return max(sum(values), rows * most)


def _structs(items: Any) -> list[dict[int, Any]]:
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise Damaged("its parts are not in their places")
    return items


class _Walk:
    """Steps over the bytes; words and numbers other than whole ones come out as None."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at, self.depth = data, 0, 0

    def struct(self) -> dict[int, Any]:
        """Field number -> value."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise Damaged("it is nested too deep")
        found: dict[int, Any] = {}
        number = 0
        while (head := self.byte()) != 0:
            kind = head & 15
            number = number + (head >> 4) if head >> 4 else self.whole()
            found[number] = kind == _TRUE if kind in (_TRUE, _FALSE) else self.value(kind)
        self.depth -= 1
        return found

    def value(self, kind: int) -> Any:
        """A value that is not a field of truth."""
        if kind in (_I16, _I32, _I64):
            return self.whole()
        if kind == _STRUCT:
            return self.struct()
        if kind in (_TRUE, _FALSE, _BYTE):  # in a list truth takes a byte
            self.skip(1)
        elif kind == _DOUBLE:
            self.skip(8)
        elif kind == _BINARY:
            self.skip(self.count())
        elif kind in (_LIST, _SET):
            head = self.byte()
            size = head >> 4 if head >> 4 < 15 else self.count()
            self.fits(size)
            return [self.value(head & 15) for _ in range(size)]
        elif kind == _MAP:
            if size := self.count():
                self.fits(size)
                kinds = self.byte()
                for _ in range(size):
                    self.value(kinds >> 4), self.value(kinds & 15)
        else:
            raise Damaged("it holds what Thrift does not know")
        return None

    def byte(self) -> int:
        """The next byte."""
        if self.at >= len(self.data):
            raise Damaged("it ends too early")
        self.at += 1
        return self.data[self.at - 1]

    def count(self) -> int:
        """A whole number that is not negative."""
        value, shift = 0, 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 70:
                raise Damaged("a number of it does not end")

    def whole(self) -> int:
        """A whole number, in zigzag."""
        value = self.count()
        return (value >> 1) ^ -(value & 1)

    def skip(self, size: int) -> None:
        """Step over bytes."""
        self.at += size
        if self.at > len(self.data):
            raise Damaged("it ends too early")

    def fits(self, size: int) -> None:
        """Refuse a list of more values than there are bytes."""
        if size > len(self.data) - self.at:
            raise Damaged("a list of it is longer than it")
