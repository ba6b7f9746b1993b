"""Read and write tables: the only room beside artifact and the engine that touches data on disk.

A file appears whole or not at all, explains itself (units and sentences in its schema), and is
refused when it breaks its contract or belongs to another robot. A table is one Parquet file, or a
folder of them with a manifest (s3le/engine makes those); `read` takes either.
"""

import hashlib
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from s3le.errors import TableError
from s3le.store import documents
from s3le.store.atomic import replace
from s3le.store.schema import Table

MANIFEST = "manifest.json"
_ROBOT = b"s3le.robot"
_HOW = {"compression": "zstd", "write_page_checksum": True}  # else a flipped bit is another number


def write(
    columns: Mapping[str, np.ndarray],
    table: Table,
    path: Path,
    robot: str | None = None,
    note: Mapping[str, str] | None = None,
) -> None:
    """Check columns against their contract and write them as one Parquet file.

    Args:
        columns: arrays of shape (n,) or (n, width), or a polars frame, in the contract's order.
        table: the contract.
        path: where; the folder is made if need be.
        robot: tag of the robot that the rows were made for (Robot.tag); wanted if table.robot.
        note: further words for the file's metadata, see read_note.

    Raises:
        TableError: the rows break the contract (nothing is written).
    """
    rows = _checked(columns, table, robot, note)
    replace(path, lambda part: pq.write_table(rows, part, **_HOW))


def encode(columns: Mapping[str, np.ndarray], table: Table, robot: str | None = None) -> bytes:
    """The bytes of the file that `write` would write; otherwise as `write`."""
    sink = io.BytesIO()
    pq.write_table(_checked(columns, table, robot, None), sink, **_HOW)
    return sink.getvalue()


def _checked(
    columns: Mapping[str, np.ndarray],
    table: Table,
    robot: str | None,
    note: Mapping[str, str] | None,
) -> pa.Table:
    frame = columns if isinstance(columns, pl.DataFrame) else _frame(columns, table)
    table.check(frame)
    rows = frame.to_arrow()
    fields = [
        field.with_metadata({"unit": column.unit, "doc": column.doc})
        for field, column in zip(rows.schema, table.columns.values(), strict=True)
    ]
    about = {"s3le.table": table.name, "s3le.stage": table.stage, "s3le.grain": table.grain}
    about["s3le.key"] = ",".join(table.key)
    if table.robot:
        if not robot:
            raise TableError(f"{table.name}: cannot be written without naming its robot")
        about[_ROBOT.decode()] = robot
    about |= {f"s3le.{key}": value for key, value in (note or {}).items()}
    return rows.cast(pa.schema(fields, about))


def _frame(columns: Mapping[str, np.ndarray], table: Table) -> pl.DataFrame:
    wrong = list(columns) if list(columns) != list(table.columns) else []
    if wrong:
        raise TableError(
            f"{table.name}: columns {', '.join(wrong)} given, {', '.join(table.columns)} wanted"
        )
    series = []
    for name, column in table.columns.items():
        values = np.asarray(columns[name])
        width = getattr(column.dtype, "size", None)
        if width is not None and values.shape[1:] != (width,):
            raise TableError(f"{table.name}: '{name}' has rows of {values.shape[1:]}, not {width}")
        series.append(pl.Series(name, values).cast(column.dtype))
    return pl.DataFrame(series)


def read(
    table: Table, path: Path, robot: str | None = None, columns: Sequence[str] | None = None
) -> dict[str, np.ndarray]:
    """Read a table, hold it to its contract, and hand out its columns as arrays.

    Args:
        table: the contract.
        path: the file, or the folder of a table in shards.
        robot: tag of the robot at hand (Robot.tag); compared if given and table.robot.
        columns: those wanted, all if None. All are checked; of a table in shards no more than
            the wanted ones and one shard are in memory at once.

    Returns:
        Column name -> array of shape (n,), or (n, width) for vectors; strings as objects.

    Raises:
        TableError: missing, not Parquet, another table, another robot, or breaking a rule; in
            shards also: not what its manifest says.
    """
    wanted = list(columns or table.columns)
    if not Path(path).is_dir():
        frame = read_frame(table, path, robot)
        return {name: frame[name].to_numpy() for name in wanted}
    manifest = read_manifest(table, path, robot)
    out: dict[str, np.ndarray] = {}
    at = 0
    for frame in _shards(table, path, robot, manifest):
        for name in wanted:
            rows = frame[name].to_numpy()
            if name not in out:
                try:
                    out[name] = np.empty((manifest["rows"], *rows.shape[1:]), rows.dtype)
                except (MemoryError, ValueError):  # more than can be, or than fits
                    raise TableError(
                        f"{Path(path) / MANIFEST} promises {manifest['rows']} rows, which do not "
                        f"fit into memory; {_again(table)}"
                    ) from None
            out[name][at : at + len(rows)] = rows
        at += len(frame)
    return out


def name_of(path: Path) -> str | None:
    """Which table a Parquet file says that it is; None of any other file."""
    if Path(path).suffix.lower() != ".parquet" or not Path(path).is_file():
        return None
    try:
        told = pq.read_schema(path).metadata or {}
    except (pa.ArrowException, OSError):
        return None
    return told.get(b"s3le.table", b"").decode("utf-8", "replace") or None


def read_frame(table: Table, path: Path, robot: str | None = None) -> pl.DataFrame:
    """Read a table of one file as a polars frame; otherwise as `read`."""
    path = Path(path)
    if not path.is_file():
        raise TableError(f"{path} is missing; {_again(table)}")
    return _frame_of(table, path, path, robot)


def read_manifest(table: Table, folder: Path, robot: str | None = None) -> dict:
    """The manifest of a table in shards.

    Raises:
        TableError: missing, damaged, of another table or robot, or not about these files.
    """
    path = Path(folder) / MANIFEST
    manifest = documents.read_json(path, table.stage)
    try:
        shards = [(s["file"], s["rows"], s["sha256"]) for s in manifest["shards"]]
        typed = all(tuple(map(type, shard)) == (str, int, str) for shard in shards)
        rows = [rows for _, rows, _ in shards]
        whole = typed and min(rows) > 0 and manifest["rows"] == sum(rows)
        whole = whole and type(manifest["rows"]) is int
    except (KeyError, TypeError, ValueError):
        whole = False
    if not whole or any(Path(file).name != file for file, _, _ in shards):
        raise TableError(f"{path} is no manifest of shards; {_again(table)}")
    if manifest.get("table") != table.name:
        raise TableError(f"{path} is not about a '{table.name}' table; {_again(table)}")
    if table.robot and robot and manifest.get("robot") != robot:
        raise TableError(
            f"{path} was made for robot '{manifest.get('robot', 'none')}', this is '{robot}'; "
            f"{_again(table)}"
        )
    listed = {file for file, _, _ in shards}
    there = {found.name for found in Path(folder).glob("*.parquet")}
    for file in sorted(listed ^ there):
        what = "is missing" if file in listed else "is not in the manifest"
        raise TableError(f"{Path(folder) / file} {what}; {_again(table)}")
    return manifest


def _shards(
    table: Table, folder: Path, robot: str | None, manifest: dict
) -> Iterator[pl.DataFrame]:
    """Every shard's rows, checked; row numbers must go on from shard to shard."""
    first = 0
    for shard in manifest["shards"]:
        path = Path(folder) / shard["file"]
        try:
            data = path.read_bytes()
        except OSError as error:
            raise TableError(f"{path} cannot be read ({error.strerror}); {_again(table)}") from None
        if hashlib.sha256(data).hexdigest() != shard["sha256"]:
            raise TableError(
                f"{path} is not what its manifest says (edited or damaged); {_again(table)}"
            )
        frame = _frame_of(table, path, pa.BufferReader(data), robot)
        rows = frame["row"]
        if len(frame) != shard["rows"] or rows[0] != first or rows[-1] != first + len(frame) - 1:
            raise TableError(f"{path} holds other rows than its manifest says; {_again(table)}")
        first += len(frame)
        yield frame


def _frame_of(table: Table, path: Path, source: object, robot: str | None) -> pl.DataFrame:
    """Rows of one Parquet file, held to the contract."""
    try:
        rows = pq.read_table(source, page_checksum_verification=True)
        # polars takes only text in a field's metadata, and panics at other bytes
        bare = rows.cast(pa.schema([field.remove_metadata() for field in rows.schema]))
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0][:160]
        raise TableError(f"{path} is not readable as Parquet ({reason}); {_again(table)}") from None
    about = rows.schema.metadata or {}
    if about.get(b"s3le.table", b"").decode("utf-8", "replace") != table.name:
        raise TableError(f"{path} is not a '{table.name}' table; {_again(table)}")
    if table.robot and robot:
        made_for = about.get(_ROBOT, b"none").decode("utf-8", "replace")
        if made_for != robot:
            raise TableError(
                f"{path} was made for robot '{made_for}', this is '{robot}'; {_again(table)}"
            )
    frame = pl.from_arrow(bare)
    try:
        table.check(frame)
    except TableError as error:
        raise TableError(f"{path}: {error}; {_again(table)}") from None
    return frame


def _again(table: Table) -> str:
    return f"write it with: dvc repro {table.stage}"


def read_note(path: Path, key: str, stage: str) -> str:
    """A word that `write` was given for the file's metadata.

    Raises:
        TableError: the file is missing, not Parquet, or has no such note.
    """
    again = f"write it with: dvc repro {stage}"
    if not Path(path).is_file():
        raise TableError(f"{path} is missing; {again}")
    try:
        return (pq.read_schema(path).metadata or {})[f"s3le.{key}".encode()].decode()
    except (pa.ArrowException, OSError, KeyError, ValueError, MemoryError) as error:
        raise TableError(f"{path} has no note '{key}' ({error}); {again}") from None
