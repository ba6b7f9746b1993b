"""Ten points in time as Parquet: what `s3le video` writes and every command reads as a clip.

Columns: `time` [s] at a constant rate; `hip_x`, `hip_y`, `hip_z`, ... [m] for the ten points, z up,
NaN where a point is not known; `visibility`; `status`. The metadata holds `s3le.format`,
`s3le.fps` and `s3le.about` (JSON): where the points come from and what was done to them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from s3le.errors import ClipError
from s3le.human.clip import FARTHEST, Clip, check_rate, clip_name, make_clip
from s3le.human.keypoints import clocks
from s3le.skeleton import POINTS
from s3le.store.atomic import replace

FORMAT = "points 1"
COLUMNS = [f"{point}_{axis}" for point in POINTS for axis in "xyz"]
MOST_ROWS = 2_000_000  # nine hours at 60 Hz
_OFF = 1e-3  # frames by which a time may differ from the rate's


def write(
    path: Path,
    fps: float,
    time: np.ndarray,
    points: np.ndarray,
    visibility: np.ndarray,
    status: np.ndarray,
    about: Mapping[str, Any],
) -> None:
    """Write points, whole or not at all; the same points give the same bytes.

    Args:
        path: where; the folder is made if need be.
        fps: frames per second [Hz].
        time: [s], (n,).
        points: positions [m], (n, 10, 3), ordered as skeleton.POINTS, z up; NaN: not known.
        visibility: of the least visible point, in [0, 1], (n,); NaN: nobody there.
        status: words, str (n,).
        about: JSON-able.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    columns = [("time", time, "s", "since the first frame")]
    flat = np.asarray(points, float).reshape(len(time), -1)
    columns += [(name, flat[:, i], "m", "position, z up") for i, name in enumerate(COLUMNS)]
    columns += [("visibility", visibility, "-", "of the least visible point, as estimated")]
    fields = [pa.field(n, pa.float64(), metadata={"unit": u, "doc": d}) for n, _, u, d in columns]
    fields.append(pa.field("status", pa.string(), metadata={"unit": "-", "doc": "why, if NaN"}))
    notes = {"s3le.format": FORMAT, "s3le.fps": repr(float(fps))}
    notes["s3le.about"] = json.dumps(about, sort_keys=True, allow_nan=False)
    arrays = [pa.array(np.ascontiguousarray(c[1], float)) for c in columns]
    table = pa.table([*arrays, pa.array(status.tolist(), pa.string())], pa.schema(fields, notes))
    replace(
        Path(path),
        lambda part: pq.write_table(table, part, compression="zstd", write_page_checksum=True),
    )


def is_points(path: Path | str) -> bool:
    """Whether a file says that it is of this format; any other Parquet file is not."""
    try:
        return (pq.read_schema(path).metadata or {}).get(b"s3le.format") == FORMAT.encode()
    except (pa.ArrowException, OSError, ValueError):
        return False


def read_points(path: Path | str, fps: float | None = None) -> Clip:
    """Read points as a clip; frames that are not known are NaN.

    Args:
        path: file that `write` wrote.
        fps: frames per second [Hz], instead of the file's own.

    Raises:
        ClipError: not Parquet, of another format, damaged, with times that are not at its rate,
            or without one whole frame; of a rate at which nobody is recorded, where fps is None.
        ParameterError: fps is no sensible rate.
    """
    table = _table(Path(path))
    own = _rate(path, table)
    points = np.column_stack([_numbers(path, table, name) for name in COLUMNS])
    odd = np.isinf(points) | (np.abs(points) > FARTHEST)
    if odd.any():
        row, column = np.argwhere(odd)[0]
        raise ClipError(
            f"{path}: frame {row} (from 0) puts {COLUMNS[column]} at {points[row, column]:g} m; "
            "the file is damaged or in another unit"
        )
    time = _numbers(path, table, "time")
    late = ~(np.abs((time - time[0]) * own - np.arange(len(time))) <= _OFF)  # NaN: late
    if late.any():
        row = int(np.argmax(late))
        raise ClipError(
            f"{path}: frame {row} (from 0) is at {time[row]:g} s, which is not {own:g} frames a "
            "second from the first on"
        )
    points = points.reshape(-1, len(POINTS), 3)
    whole = np.isfinite(points).all(axis=(1, 2))
    if not whole.any():
        raise ClipError(f"{path}: in not one of {len(points)} frames are all ten points known")
    make_clip(path, own, points[whole])  # the known ones must be believable
    if fps is not None:
        check_rate(fps, "fps")
    else:
        clocks.usual(path, own)
    points.setflags(write=False)
    return Clip(clip_name(path), float(own if fps is None else fps), points)


def about(path: Path | str) -> dict[str, Any]:
    """What the file says of itself.

    Raises:
        ClipError: not Parquet, or it says nothing.
    """
    try:
        told = json.loads((pq.read_schema(path).metadata or {})[b"s3le.about"])
    except (pa.ArrowException, OSError, ValueError, KeyError, RecursionError):
        raise ClipError(f"{path}: says nothing of where its points come from") from None
    return told if isinstance(told, dict) else {}


def _table(path: Path) -> pa.Table:
    if not path.is_file():
        raise ClipError(f"{path}: no such file")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            known = file.schema_arrow.metadata or {}
            if known.get(b"s3le.format") != FORMAT.encode():
                raise ClipError(
                    f"{path}: is Parquet, but no skeletons of `s3le video` (format '{FORMAT}'); "
                    "a robot's motion is read by: s3le audit"
                )
            if not 0 < file.metadata.num_rows <= MOST_ROWS:
                raise ClipError(
                    f"{path}: {file.metadata.num_rows} frames, wanted from 1 to {MOST_ROWS}"
                )
            names = file.schema_arrow.names
            missing = [name for name in ("time", *COLUMNS) if names.count(name) != 1]
            if missing:
                raise ClipError(f"{path}: column '{missing[0]}' is missing or there twice")
            return file.read(["time", *COLUMNS], use_pandas_metadata=False)
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = (str(error).splitlines() or ["damaged"])[0][:160]
        raise ClipError(f"{path}: is no sound Parquet ({reason})") from None


def _numbers(path: Path | str, table: pa.Table, name: str) -> np.ndarray:
    column = table[name]
    if column.type != pa.float64() or column.null_count:
        raise ClipError(f"{path}: column '{name}' is not made of numbers alone (float64, no nulls)")
    return column.to_numpy()


def _rate(path: Path | str, table: pa.Table) -> float:
    raw = (table.schema.metadata or {}).get(b"s3le.fps", b"")
    try:
        rate = float(raw)
    except ValueError:
        rate = float("nan")
    if not np.isfinite(rate):
        raise ClipError(f"{path}: names no rate (s3le.fps)")
    check_rate(rate, f"{path}: s3le.fps")
    return rate
