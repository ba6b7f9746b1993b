"""Trajectories as Parquet: time, joints, their speeds, heading, clearance, mode.

Columns `time` [s], one per joint [rad], `JOINT.vel` [rad/s], `heading` [rad], `clearance` [m],
`mode`. The file's metadata names the robot and its hash and holds the certificate (JSON).
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from s3le import __version__
from s3le.errors import TrajectoryError
from s3le.motion import footer
from s3le.motion.columns import NAMES, RATES, STEPS, interpret
from s3le.motion.trajectory import (
    CLEARANCE,
    HEADING,
    MODE,
    SPEED,
    TIME,
    Trajectory,
    twice,
    unit,
)

FORMAT = "trajectory 1"
MOST_VALUES = 500_000_000  # in one file; ten hours of ten joints at 1 kHz
PREFIX = "s3le."
JOINT = "position of the URDF's joint"


def write(trajectory: Trajectory, part: Path) -> None:
    """Write one file; the same trajectory gives the same bytes."""
    columns = [(TIME, trajectory.time, "s", "since the file's beginning")]
    columns += [
        (joint, np.ascontiguousarray(trajectory.q[:, i]), unit(trajectory, joint), JOINT)
        for i, joint in enumerate(trajectory.joints)
    ]
    if trajectory.v is not None:
        columns += [
            (joint + SPEED, np.ascontiguousarray(trajectory.v[:, i]),
             f"{unit(trajectory, joint)}/s", "its speed at that moment")
            for i, joint in enumerate(trajectory.joints)
        ]  # fmt: skip
    if trajectory.heading is not None:
        columns.append((HEADING, trajectory.heading, "rad", "yaw of the human about z, unwrapped"))
    if trajectory.clearance is not None:
        columns.append(
            (CLEARANCE, trajectory.clearance, "m", "least signed distance over the watched pairs")
        )
    if trajectory.mode is not None:
        columns.append((MODE, trajectory.mode, "-", "how the row was obtained"))
    fields = [
        pa.field(
            name,
            pa.string() if values.dtype.kind == "U" else pa.float64(),
            metadata={"unit": measure, "doc": doc},
        )
        for name, values, measure, doc in columns
    ]
    about = {f"{PREFIX}{key}": as_text(value) for key, value in trajectory.about.items()}
    about |= {f"{PREFIX}format": FORMAT, f"{PREFIX}version": __version__}
    table = pa.table(
        [pa.array(c[1], field.type) for c, field in zip(columns, fields, strict=True)],
        schema=pa.schema(fields, about),
    )
    pq.write_table(table, part, compression="zstd")


def read(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read ours or another tool's.

    Raises:
        TrajectoryError: no Parquet, damaged, more than MOST_VALUES, or what interpret refuses.
    """
    try:
        check_size(path)
        with pq.ParquetFile(path) as file:
            table = file.read(use_pandas_metadata=False)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = (str(error).splitlines() or ["damaged"])[0][:160]
        raise TrajectoryError(f"{path}: is no sound Parquet ({reason})") from None
    if (again := twice(table.column_names)) is not None:
        raise TrajectoryError(f"{path}: column '{again}' occurs twice")
    if not table.num_rows:
        raise TrajectoryError(f"{path}: holds no rows")
    about = told(table.schema.metadata or {})
    columns = {name: numbers(path, name, table[name]) for name in table.column_names}
    for key in (*RATES, *STEPS):
        if isinstance(about.get(key), int | float) and key not in columns:
            columns[key] = np.array(about[key], float)
    for key in NAMES:
        if isinstance(about.get(key), list) and key not in columns:
            columns[key] = np.array([str(word) for word in about[key]])
    return interpret(str(path), columns, fps, joints, about)


def check_size(path: Path) -> None:
    """Refuse a file of more than MOST_VALUES before it is read.

    Raises:
        TrajectoryError: it is one, or its footer does not tell.
    """
    try:
        values = footer.claimed(path)
    except footer.Damaged as damage:
        raise TrajectoryError(f"{path}: is no sound Parquet ({damage})") from None
    if values > MOST_VALUES:
        raise TrajectoryError(f"{path}: holds more than {MOST_VALUES} numbers")


def numbers(path: Path, name: str, column: pa.ChunkedArray) -> np.ndarray:
    """A column as an array in its own type, (n,), or (n, width) of one of lists.

    Raises:
        TrajectoryError: a value is missing, or it holds neither numbers nor words.
    """
    kind = column.type
    if column.null_count:
        row = next(i for i, item in enumerate(column) if not item.is_valid)
        raise TrajectoryError(f"{path}: row {row}: {name} is missing")
    if pa.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind):
        return column.to_numpy()
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return np.array(column.to_pylist(), str)
    if (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    ) and (pa.types.is_floating(kind.value_type) or pa.types.is_integer(kind.value_type)):
        column = column.combine_chunks()
        flat, rows = column.flatten(), len(column)
        even = len(flat) % rows == 0 and (np.diff(column.value_lengths()) == 0).all()
        if not even or flat.null_count:
            raise TrajectoryError(f"{path}: rows of '{name}' are of different lengths")
        return flat.to_numpy(zero_copy_only=False).reshape(rows, -1)
    raise TrajectoryError(f"{path}: column '{name}' holds {kind}, neither numbers nor words")


def as_text(value: Any) -> str:
    """A value as metadata holds it: words as they are, else JSON."""
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True)


def told(metadata: dict[bytes, bytes]) -> dict[str, Any]:
    """A file's metadata: values as JSON where they are JSON, our prefix taken off."""
    about = {}
    for key, raw in metadata.items():
        name, text = key.decode(errors="replace"), raw.decode(errors="replace")
        if name == "ARROW:schema" or name == "pandas":
            continue
        name = name.removeprefix(PREFIX)
        try:
            about[name] = json.loads(text, parse_constant=str) if text[:1] in "[{" else text
        except (ValueError, RecursionError):
            about[name] = text
        if name in (*RATES, *STEPS):
            try:
                about[name] = float(text)
            except ValueError:
                about[name] = text
    return about


def tells_speeds(path: Path) -> bool:
    """Is a sound file ours, and does it tell speeds?"""
    schema = pq.read_schema(path)
    ours = f"{PREFIX}format".encode() in (schema.metadata or {})
    return ours and any(name.endswith(SPEED) for name in schema.names)
