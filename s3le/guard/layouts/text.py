"""CSV, ours and other tools': only the fields of joints that were moved are written anew.

Every other character stays: what parts the fields and the lines, quotes, spaces, digits. A new
number has as few digits as give it back to the bit.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard.layouts import arrays, claims, matched, roots
from s3le.guard.layouts.episode import Episode
from s3le.motion import text
from s3le.motion.columns import ANGLES, clock
from s3le.motion.trajectory import CLEARANCE, MODE, SPEED, Placed, runs, twice
from s3le.robot.model import Geometry
from s3le.store import documents
from s3le.store.atomic import replace

_QUOTED = r'"(?:[^"]|"")*"'


class TextLayout:
    """A CSV, and what lies beside it."""

    def __init__(  # noqa: D107
        self, path: Path, episode: Episode, table: "_Table", own: Sequence[int], skip: int = 0
    ) -> None:
        self.path, self.episodes = path, [episode]
        self._table, self._own, self._skip = table, own, skip

    def root(self) -> Placed | None:
        """See Layout."""
        table = self._table
        some = roots.columns(table.header) if table.header else list(range(self._skip))
        if not some:
            return None
        found = table.columns({at: str(at) for at in some})
        return roots.of_columns([found[at] for at in some])

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """See Layout."""
        matched.check(self.episodes, q, self.path)
        one, table = self.episodes[0], self._table
        columns = one.numbers.encode(one.name, q[0])
        changed = one.numbers.changed(columns)
        told = claims.paced(one, v)
        new: dict[int, list[str | None]] = {}  # column -> its field in each row; None: as it was
        for at, column, old in zip(self._own, columns, one.numbers.raw, strict=True):
            other = (column != old).tolist()
            new[at] = [repr(v) if o else None for v, o in zip(column.tolist(), other, strict=True)]
        if table.about:
            for name, word in ((CLEARANCE, "nan"), (MODE, claims.GUARDED)):
                if name in table.header:
                    at = table.header.index(name)
                    new[at] = [word if row else None for row in changed.tolist()]
            if changed.any() and told is None:
                for name in claims.speeds(table.header):
                    new[table.header.index(name)] = ["nan"] * len(table.rows)
        added: dict[str, list[str]] = {}
        for at, column in zip(self._own, told or (), strict=False):
            name, fields = table.header[at] + SPEED, [repr(value) for value in column.tolist()]
            if name in table.header:
                new[table.header.index(name)] = list(fields)
            else:
                added[name] = fields
        made = table.text(new, added)
        data = made.encode()
        replace(target, lambda part: part.write_bytes(data))
        if table.about:  # last: until it lies there nothing is claimed about the CSV
            said = claims.renewed(table.about, about)
            if MODE not in table.header and one.mode is not None:
                said["mode_runs"] = runs(claims.mode(one.mode, changed))
            documents.write_text(text.side(said, made), text.side_file(target))


class _Table:
    """Lines of a CSV as their fields, character for character."""

    def __init__(self, path: Path) -> None:
        data, whole = text.content(path)
        self.mark = "\ufeff" if data.startswith(b"\xef\xbb\xbf") else ""
        self.about = text.read_side(text.side_file(path), data)
        lines = whole.splitlines(keepends=True)
        self.bare = [line.splitlines()[0] for line in lines]
        self.ends = [line[len(bare) :] for line, bare in zip(lines, self.bare, strict=True)]
        self.comma = text.comma_of(self.bare[0])
        self._one = re.compile(f'{_QUOTED}|[^{self.comma}"]*')
        self.path = path
        first = [field.strip() for field in self.values(0)]
        self.nameless = all(text.is_number(field) for field in first)
        self.header = [] if self.nameless else first
        self.width = len(first)
        begin = 0 if self.nameless else 1
        self.rows = [i for i in range(begin, len(self.bare)) if self.bare[i]]
        self.first = 1 if self.nameless else 2

    def fields(self, line: int) -> list[str]:
        """Fields of a line as they stand there, with their quotes and spaces."""
        bare = self.bare[line]
        if '"' not in bare:
            return bare.split(self.comma)
        found, at = [], 0
        while True:
            field = self._one.match(bare, at)
            assert field is not None  # it may be empty
            found.append(field[0])
            at = field.end()
            if at == len(bare):
                return found
            if bare[at] != self.comma:
                raise TrajectoryError(
                    f"{self.path}: line {line + 1}: a quote within a field, or one without its end"
                )
            at += 1

    def values(self, line: int) -> list[str]:
        """Fields of a line without their quotes."""
        bare = self.bare[line]
        if '"' not in bare:
            return bare.split(self.comma)
        return [
            field[1:-1].replace('""', '"') if field.startswith('"') else field
            for field in self.fields(line)
        ]

    def columns(self, wanted: Mapping[int, str]) -> dict[int, np.ndarray]:
        """Numbers of some columns, float64 (rows,).

        Args:
            wanted: which, and what they are called in messages.
        """
        found: dict[int, list[float]] = {at: [] for at in wanted}
        for line in self.rows:
            fields = self.values(line)
            if len(fields) != self.width:
                raise TrajectoryError(
                    f"{self.path}: line {line + 1}: {len(fields)} fields for {self.width} columns"
                )
            for at, numbers in found.items():
                try:
                    if "_" in fields[at]:  # Python reads 1_0 as ten
                        raise ValueError
                    numbers.append(float(fields[at]))
                except ValueError:
                    raise TrajectoryError(
                        f"{self.path}: line {line + 1}: {wanted[at]}: {fields[at][:40]!r} is no "
                        "number"
                    ) from None
        return {at: np.array(numbers) for at, numbers in found.items()}

    def words(self, at: int) -> np.ndarray:
        """Words of a column, str (rows,)."""
        return np.array([self.values(line)[at] for line in self.rows], str)

    def text(
        self, new: Mapping[int, Sequence[str | None]], added: Mapping[str, Sequence[str]]
    ) -> str:
        """The whole text, some fields of some rows other than they were, and columns behind all."""
        lines = list(self.bare)
        for row, line in enumerate(self.rows):
            change = {at: column[row] for at, column in new.items() if column[row] is not None}
            if change:
                fields = self.fields(line)
                for at, word in change.items():
                    assert word is not None
                    fields[at] = _instead(fields[at], word)
                lines[line] = self.comma.join(fields)
            if added:
                lines[line] = self.comma.join([lines[line], *(one[row] for one in added.values())])
        if added:
            lines[0] = self.comma.join([lines[0], *added])
        return self.mark + "".join(map(str.__add__, lines, self.ends))


def open_csv(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> TextLayout:
    """Read a CSV; without a line of names, `joints` or the side file names its columns.

    Raises:
        TrajectoryError: what s3le.motion.text refuses, of the columns that matter here.
    """
    table = _Table(path)
    if table.nameless:
        names = {i: str(i) for i in range(table.width)}
        columns = table.columns(names)
        about = table.about
        arrays_ = {ANGLES[0]: np.stack([columns[i] for i in names], axis=1)}
        found = arrays.read(
            str(path), arrays_ | text.told(about, len(table.rows)), robot, fps=fps,
            joints=text.listed(about) if joints is None else joints, degrees=degrees,
            given=given, about=about, numbered=True, first=1, row_is="line",
        )  # fmt: skip
        return TextLayout(path, found.episode, table, found.place.columns, found.place.skip)
    return _with_names(path, table, robot, fps, degrees, given)


def _with_names(
    path: Path,
    table: _Table,
    robot: Geometry,
    fps: float | None,
    degrees: bool,
    given: Sequence[str],
) -> TextLayout:
    header = table.header
    if (again := twice(header)) is not None:
        raise TrajectoryError(f"{path}: line 1: column {again!r} occurs twice")
    some = matched.match(str(path), header, robot)
    timed = matched.timed(header)
    wanted = {at: header[at] for at in some.joints}
    if timed is not None and fps is None:
        wanted[header.index(timed)] = timed
    own = {header[at]: header[at] + SPEED for at in some.own}
    wanted |= {header.index(one): one for one in own.values() if one in header}
    columns = table.columns(wanted)
    # Told or taken away where anything is changed.
    told = [*own.values(), *(claims.speeds(header) if table.about else ())]
    strangers = [n for n in some.strangers if n.lower() not in matched.KNOWN and n not in told]
    time = {} if timed is None else {timed: columns.get(header.index(timed), np.zeros(0))}
    one = matched.episode(
        str(path), {header[at]: columns[at] for at in some.joints},
        clock(str(path), time, len(table.rows), fps), robot, degrees=degrees, given=given,
        about=table.about, mode=table.words(header.index(MODE)) if MODE in header else None,
        notes=matched.kept(strangers),
        speeds={joint: columns[header.index(v)] for joint, v in own.items() if v in header},
        first=table.first, row_is="line",
    )  # fmt: skip
    return TextLayout(path, one, table, some.own)


def _instead(old: str, word: str) -> str:
    """A field with another word in it; its quotes and spaces stay."""
    inner = old.strip()
    quoted = inner.startswith('"')
    begin = len(old) - len(old.lstrip())
    return old[:begin] + (f'"{word}"' if quoted else word) + old[begin + len(inner) :]
