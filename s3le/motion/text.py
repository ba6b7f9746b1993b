"""Trajectories as CSV: a line of names, then numbers; what is said about them lies beside.

`walk.csv` holds no comments, so that any program reads it. `walk.csv.json` holds the robot, its
hash and the certificate, and the SHA-256 of the CSV that it speaks of; without it, or if it is
about another file, the CSV is read all the same and nothing is claimed.
"""

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.motion.columns import ANGLES, ROOT, interpret
from s3le.motion.trajectory import (
    CLEARANCE,
    HEADING,
    MODE,
    SPEED,
    TIME,
    Trajectory,
    twice,
    unrolled,
)

if TYPE_CHECKING:
    from _csv import Reader  # what csv.reader returns; csv itself does not name it

MOST_BYTES = 1 << 30
MOST_HEADER = 1 << 16  # [characters] in which a first line says something


def side_file(path: Path) -> Path:
    """Where what is said about a CSV lies."""
    return path.with_name(path.name + ".json")


def encode(trajectory: Trajectory) -> str:
    """The CSV: every number in as few digits as give it back to the bit."""
    header = [TIME, *trajectory.joints]
    columns = [trajectory.time.tolist(), *trajectory.q.T.tolist()]
    if trajectory.v is not None:
        header += [joint + SPEED for joint in trajectory.joints]
        columns += trajectory.v.T.tolist()
    for name, values in (
        (HEADING, trajectory.heading),
        (CLEARANCE, trajectory.clearance),
        (MODE, trajectory.mode),
    ):
        if values is not None:
            header.append(name)
            columns.append(values.tolist())
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(zip(*columns, strict=True))
    return sink.getvalue()


def encode_side(trajectory: Trajectory, text: str) -> str:
    """What lies beside the CSV `text`."""
    return side(trajectory.about, text)


def side(about: Mapping[str, Any], text: str) -> str:
    """What is said about the CSV `text`, bound to it by its SHA-256."""
    tree = {**about, "sha256": hashlib.sha256(text.encode()).hexdigest()}
    return json.dumps(tree, indent=2, sort_keys=True, allow_nan=False) + "\n"


def read(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read ours or another tool's; fields may be parted by commas, semicolons or tabs.

    Without a line of names, `joints` names the columns, or else the side file does; those of a
    free base may stand before.

    Raises:
        TrajectoryError: no text, lines of different lengths, a field that is no number, no names
            and none given, or what interpret refuses; names the line, counted from 1.
    """
    data, text = content(path)
    lines = text.splitlines()
    comma = comma_of(lines[0])
    rows = csv.reader(lines, delimiter=comma, strict=True)
    try:
        header = [field.strip() for field in next(rows, [])]
    except csv.Error as error:
        raise TrajectoryError(f"{path}: line 1: {error}") from None
    nameless = all(is_number(field) for field in header)
    about = read_side(side_file(path), data)
    if nameless:
        joints = listed(about) if joints is None else joints
        rows = csv.reader(lines, delimiter=comma, strict=True)
        header = _placeholders(path, len(header), joints)
    if (again := twice(header)) is not None:
        raise TrajectoryError(f"{path}: line 1: column {again!r} occurs twice")
    words = {i for i, name in enumerate(header) if name == MODE}
    columns = _columns(path, rows, header, words)
    table: dict[str, np.ndarray] = {
        name: np.array(column, str if i in words else float)
        for i, (name, column) in enumerate(zip(header, columns, strict=True))
    }
    if nameless:
        table = {ANGLES[0]: np.stack(list(table.values()), axis=1)} | told(about, len(columns[0]))
    else:
        joints = None  # a line of names says better which column is which
    return interpret(str(path), table, fps, joints, about, 1 if nameless else 2, "line")


def nameless(path: Path) -> bool:
    """Has a CSV no names for its columns, neither in its first line nor in what lies beside it?

    Raises:
        TrajectoryError: see content.
    """
    data, text = content(path)
    first = text.splitlines()[0]
    if not all(is_number(field.strip()) for field in first.split(comma_of(first))):
        return False
    return listed(read_side(side_file(path), data)) is None


def content(path: Path) -> tuple[bytes, str]:
    """The bytes of a CSV, and its text.

    Raises:
        TrajectoryError: more than MOST_BYTES, no text, or nothing in the first line.
    """
    if path.stat().st_size > MOST_BYTES:
        raise TrajectoryError(f"{path}: a CSV of more than {MOST_BYTES >> 30} GiB is not read")
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: is no text in UTF-8 (byte {error.start})") from None
    if "\0" in text:
        raise TrajectoryError(f"{path}: is no text (a zero byte)")
    if not next(iter(text[:MOST_HEADER].splitlines()), "").strip():
        raise TrajectoryError(f"{path}: is empty, or its first line is")
    return data, text


def comma_of(line: str) -> str:
    """What parts the fields of a line: a comma, a semicolon or a tab."""
    return max(",;\t", key=line.count)


def _columns(path: Path, rows: "Reader", header: list[str], words: set[int]) -> list[list]:
    columns: list[list] = [[] for _ in header]
    try:
        for fields in rows:
            if not fields:
                continue
            if len(fields) != len(header):
                raise TrajectoryError(
                    f"{path}: line {rows.line_num}: {len(fields)} fields for {len(header)} columns"
                )
            for i, field in enumerate(fields):
                if i in words:
                    columns[i].append(field)
                elif "_" in field:  # Python reads 1_0 as ten
                    raise ValueError(field)
                else:
                    columns[i].append(float(field))
    except csv.Error as error:
        raise TrajectoryError(f"{path}: line {rows.line_num}: {error}") from None
    except ValueError:
        raise TrajectoryError(
            f"{path}: line {rows.line_num}: {header[i]}: {field[:40]!r} is no number"
        ) from None
    return columns


def _placeholders(path: Path, width: int, joints: Sequence[str] | None) -> list[str]:
    if joints is None:
        raise TrajectoryError(
            f"{path}: line 1 holds numbers, not names; name the {width} columns, or those behind "
            f"the {ROOT} of a free base, with --joints"
        )
    return [str(i) for i in range(width)]


def listed(about: Mapping[str, Any]) -> list[str] | None:
    """Names of the joints' columns as a side file lists them; None: it does not."""
    names = about.get("joint_names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return None
    return names


def told(about: Mapping[str, Any], rows: int) -> dict[str, np.ndarray]:
    """What a side file tells of rows that have no columns for it: their rate and their modes."""
    told, fps = {}, about.get("fps")
    if isinstance(fps, int | float) and not isinstance(fps, bool):
        told["fps"] = np.array(fps, float)
    if (mode := unrolled(about.get("mode_runs"), rows)) is not None:
        told[MODE] = mode
    return told


def is_number(field: str) -> bool:
    """Is a field of a CSV one, or a name?"""
    try:
        float(field)
    except ValueError:
        return False
    return True


def read_side(path: Path, data: bytes) -> dict:
    """What lies beside, if it is about these bytes."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(tree, dict) or tree.pop("sha256", "") != hashlib.sha256(data).hexdigest():
        return {}
    return tree


def tells_speeds(path: Path) -> bool:
    """Is a sound file ours, with what lies beside it, and does it tell speeds?"""
    with path.open("rb") as stream:
        told = SPEED.encode() in stream.readline(MOST_HEADER)
    return told and bool(read_side(side_file(path), path.read_bytes()))
