"""Parquet, ours and other tools': the same schema, metadata, row groups and compression again."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from s3le.errors import TrajectoryError
from s3le.guard.layouts import arrays, claims, matched, roots
from s3le.guard.layouts.episode import Episode
from s3le.motion import parquet
from s3le.motion.columns import ANGLES, NAMES, RATES, SPEEDS, STEPS, clock
from s3le.motion.trajectory import CLEARANCE, MODE, SPEED, Placed, twice
from s3le.robot.model import Geometry
from s3le.store.atomic import replace

_ARROW = b"ARROW:schema"


class ParquetLayout:
    """A table of one motion."""

    def __init__(  # noqa: D107
        self, path: Path, episode: Episode, table: pa.Table, how: "Storage", place: arrays.Place
    ) -> None:
        self.path, self.episodes = path, [episode]
        self._table, self._how, self._place = table, how, place

    def root(self) -> Placed | None:
        """See Layout."""
        table, path = self._table, self.path
        some = roots.columns(table.column_names)
        if some is not None:
            names = [table.column_names[i] for i in some]
            return roots.of_columns([parquet.numbers(path, n, table[n]) for n in names])
        keys = [n for n in table.column_names if n.lower() in (*roots.NAMES, *ANGLES)]
        read = {key: parquet.numbers(path, key, table[key]) for key in keys}
        return roots.of_arrays(read, self._place)

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
        columns, told = one.numbers.encode(one.name, q[0]), claims.paced(one, v)
        old = {key: parquet.numbers(self.path, key, table[key]) for key in self._place.keys}
        new = arrays.put(self._place, old, columns)
        if _ours(table.schema.metadata):
            new |= _claims(self.path, one, table, one.numbers.changed(columns), told is None)
        if told is not None:
            here = {k: parquet.numbers(self.path, k, table[k]) for k in table.column_names
                    if k in (*self._place.keys, SPEEDS)}  # fmt: skip
            new |= arrays.put_speeds(self._place, here, told)
        table = renewed(table, new).replace_schema_metadata(_told(table.schema.metadata, about))
        replace(target, lambda part: store(table, part, self._how))


class Storage:
    """How a Parquet file is cut and packed."""

    def __init__(self, meta: pq.FileMetaData) -> None:  # noqa: D107
        groups = [meta.row_group(i) for i in range(meta.num_row_groups)]
        self.rows = [group.num_rows for group in groups]
        self.schema_kept = _ARROW in (meta.metadata or {})
        self.codecs: dict[str, str] = {}
        for group in groups[:1]:
            chunks = (group.column(j) for j in range(group.num_columns))
            self.codecs = {c.path_in_schema: _codec(c.compression) for c in chunks}


def is_other(path: Path) -> bool:
    """Whether a file says that it is of this project and no motion of a robot."""
    try:
        metadata = pq.read_schema(path).metadata or {}
    except (pa.ArrowException, OSError, UnicodeDecodeError):
        return False  # whoever opens it is told why not
    form = metadata.get(f"{parquet.PREFIX}format".encode(), parquet.FORMAT.encode())
    return form != parquet.FORMAT.encode() or b"s3le.table" in metadata


def load(path: Path) -> tuple[pa.Table, Storage]:
    """A file's table, and how it is stored.

    Raises:
        TrajectoryError: no Parquet, damaged, or too large.
    """
    table, how = _read(path, None)
    assert how is not None
    return table, how


def some(path: Path, columns: Sequence[str]) -> pa.Table:
    """Some columns of a file, those of them that it has.

    Raises:
        TrajectoryError: as load.
    """
    return _read(path, columns)[0]


def _read(path: Path, columns: Sequence[str] | None) -> tuple[pa.Table, Storage | None]:
    try:
        parquet.check_size(path)
        with pq.ParquetFile(path) as file:
            table = file.read(columns=columns, use_pandas_metadata=False)
            # Asked once all was read: pyarrow ends the process over some damaged footers.
            how = Storage(file.metadata) if columns is None else None
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = (str(error).splitlines() or ["damaged"])[0][:160]
        raise TrajectoryError(f"{path}: is no sound Parquet ({reason})") from None
    if (again := twice(table.column_names)) is not None:
        raise TrajectoryError(f"{path}: column '{again}' occurs twice")
    if not table.num_rows:
        raise TrajectoryError(f"{path}: holds no rows")
    return table, how


def store(table: pa.Table, part: Path, how: Storage) -> None:
    """Write a table as a file was."""
    codecs: Any = how.codecs or "snappy"
    with pq.ParquetWriter(
        part, table.schema, compression=codecs, store_schema=how.schema_kept
    ) as writer:
        at = 0
        for rows in how.rows:
            writer.write_table(table.slice(at, rows), row_group_size=rows or None)
            at += rows


def renewed(table: pa.Table, new: Mapping[str, np.ndarray]) -> pa.Table:
    """A table with other numbers in some columns, (n,) or (n, width), in their own types.

    A column that it does not have comes behind all others.
    """
    for key, values in new.items():
        at = table.schema.get_field_index(key)
        if at < 0:
            kind = pa.float64() if values.ndim == 1 else pa.list_(pa.float64())
            table = table.append_column(key, _column(kind, values))
            continue
        kind = table.schema.field(at).type
        table = table.set_column(at, table.schema.field(at), _column(kind, values))
    return table


def open_parquet(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> ParquetLayout:
    """Read a table of one motion.

    Raises:
        TrajectoryError: what `load` refuses, or no motion of this robot.
    """
    table, how = load(path)
    about = parquet.told(table.schema.metadata or {})
    name = str(path)
    lists = [n for n in table.column_names if n.lower() in ANGLES and _listed(table[n].type)]
    timed = matched.timed(table.column_names)
    told = [*lists, *([timed] if timed else [])]
    here = {key: parquet.numbers(path, key, table[key]) for key in told}
    for key in (*RATES, *STEPS):
        if isinstance(about.get(key), int | float) and key not in here:
            here[key] = np.array(about[key], float)
    for key in NAMES:
        if isinstance(about.get(key), list) and key not in table.column_names:
            here[key] = np.array([str(word) for word in about[key]])
    if MODE in table.column_names and _worded(table[MODE].type):
        here[MODE] = parquet.numbers(path, MODE, table[MODE])
    if lists and SPEEDS in table.column_names and _listed(table[SPEEDS].type):
        here[SPEEDS] = parquet.numbers(path, SPEEDS, table[SPEEDS])
    strangers = [n for n in table.column_names if n not in here and n.lower() not in matched.KNOWN]
    if lists:
        found = arrays.read(
            name, here, robot, fps=fps, joints=joints, degrees=degrees, given=given, about=about,
            paced=SPEEDS in here or SPEEDS not in table.column_names,
        )  # fmt: skip
        found.episode.notes.extend(matched.kept(strangers))
        return ParquetLayout(path, found.episode, table, how, found.place)
    if "action" in strangers and _listed(table["action"].type):
        raise TrajectoryError(
            f"{name}: is a file of a LeRobot data set, which says in meta/info.json what its "
            "columns are; give the folder that holds meta and data"
        )
    match = matched.match(name, strangers, robot)
    columns = {strangers[i]: parquet.numbers(path, strangers[i], table[strangers[i]])
               for i in match.joints}  # fmt: skip
    for key, values in columns.items():
        if values.ndim != 1:
            raise TrajectoryError(f"{name}: '{key}' holds lists; wanted one number a row")
    # Speeds are told, or taken away, where anything is changed.
    own = {strangers[i]: strangers[i] + SPEED for i in match.own}
    ours = claims.speeds(table.column_names) if _ours(table.schema.metadata) else ()
    others = [one for one in match.strangers if one not in (*own.values(), *ours)]
    speeds = {joint: parquet.numbers(path, one, table[one]) for joint, one in own.items()
              if one in table.column_names}  # fmt: skip
    one = matched.episode(
        name, columns, clock(name, here, table.num_rows, fps), robot, degrees=degrees, given=given,
        about=about, mode=here.get(MODE), notes=matched.kept(others), speeds=speeds,
    )  # fmt: skip
    keys = tuple(strangers[i] for i in match.own)
    return ParquetLayout(path, one, table, how, arrays.Place(keys, ()))


def _claims(
    path: Path, one: Episode, table: pa.Table, changed: np.ndarray, straight: bool
) -> dict[str, np.ndarray]:
    new: dict[str, np.ndarray] = {}
    if CLEARANCE in table.column_names and pa.types.is_floating(table[CLEARANCE].type):
        old = parquet.numbers(path, CLEARANCE, table[CLEARANCE])
        new[CLEARANCE] = claims.clearance(old, changed)
    if one.mode is not None:
        new[MODE] = claims.mode(one.mode, changed)
    if straight and changed.any():
        for name in claims.speeds(table.column_names):
            new[name] = np.full(table.num_rows, np.nan)
    return new


def _ours(metadata: Mapping[bytes, bytes] | None) -> bool:
    return f"{parquet.PREFIX}format".encode() in (metadata or {})


def _told(
    metadata: Mapping[bytes, bytes] | None, about: Mapping[str, Any] | None
) -> dict[bytes, bytes] | None:
    """The file's metadata without what is stale, and with what is new where it is ours."""
    if metadata is None:
        return None
    stale = {f"{parquet.PREFIX}{key}".encode() for key in claims.STALE}
    kept = {key: value for key, value in metadata.items() if key not in stale}
    if _ours(metadata):
        for key, value in (about or {}).items():
            kept[f"{parquet.PREFIX}{key}".encode()] = parquet.as_text(value).encode()
    return kept


def _listed(kind: pa.DataType) -> bool:
    return (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    )


def _worded(kind: pa.DataType) -> bool:
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _column(kind: pa.DataType, values: np.ndarray) -> pa.Array:
    if values.dtype.kind == "U":
        words = pa.array(values.tolist(), pa.string())
        return (
            words.dictionary_encode().cast(kind)
            if pa.types.is_dictionary(kind)
            else words.cast(kind)
        )
    if values.ndim == 1:
        return pa.array(values, kind)
    flat = pa.array(np.ascontiguousarray(values).ravel(), kind.value_type)
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(flat, type=kind)
    steps = np.arange(len(values) + 1) * values.shape[1]
    if pa.types.is_large_list(kind):
        return pa.LargeListArray.from_arrays(pa.array(steps, pa.int64()), flat, type=kind)
    return pa.ListArray.from_arrays(pa.array(steps, pa.int32()), flat, type=kind)


def _codec(name: str) -> str:
    return "NONE" if name == "UNCOMPRESSED" else name
