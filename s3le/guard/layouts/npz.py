"""NPZ and NPY, ours and other tools': everything but the joints is copied byte for byte."""

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from s3le.errors import TrajectoryError
from s3le.guard.layouts import arrays, claims, matched, roots
from s3le.guard.layouts.arrays import Found
from s3le.guard.layouts.matched import ABOUT
from s3le.motion.columns import ANGLES, SPEEDS
from s3le.motion.npz import MOST_BYTES, told
from s3le.motion.trajectory import CLEARANCE, MODE, Placed
from s3le.robot.model import Geometry
from s3le.store import npz
from s3le.store.atomic import replace


class NpzLayout:
    """An archive of arrays."""

    def __init__(  # noqa: D107
        self, path: Path, found: Found, table: Mapping[str, np.ndarray], data: bytes
    ) -> None:
        self.path, self.episodes = path, [found.episode]
        self._place, self._table, self._data = found.place, table, data

    def root(self) -> Placed | None:
        """See Layout."""
        return roots.of_arrays(self._table, self._place)

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """See Layout."""
        matched.check(self.episodes, q, self.path)
        one = self.episodes[0]
        columns = one.numbers.encode(one.name, q[0])
        new = arrays.put(self._place, self._table, columns)
        if ABOUT in self._table:
            said = claims.renewed(told(self._table[ABOUT]), about)
            new[ABOUT] = np.array(json.dumps(said, sort_keys=True, allow_nan=False))
            changed = one.numbers.changed(columns)
            if changed.any():
                new |= self._claims(changed)
        if (speeds := claims.paced(one, v)) is not None:
            new |= arrays.put_speeds(self._place, self._table, speeds)
        made = _copied(self._data, {key: _encoded(array) for key, array in new.items()})
        replace(target, lambda part: part.write_bytes(made))

    def _claims(self, changed: np.ndarray) -> dict[str, np.ndarray]:
        new = {}
        key = arrays.own(self._table, CLEARANCE)
        if key and self._table[key].dtype.kind == "f" and len(self._table[key]) == len(changed):
            new[key] = claims.clearance(self._table[key], changed)
        if self.episodes[0].mode is not None:
            key = arrays.own(self._table, MODE)
            assert key is not None
            new[key] = claims.mode(self.episodes[0].mode, changed)
        if SPEEDS in self._table and self._table[SPEEDS].dtype.kind == "f":
            new[SPEEDS] = np.full_like(self._table[SPEEDS], np.nan)
        return new


class NpyLayout:
    """One array (m, width); it has no place for speeds."""

    def __init__(self, path: Path, found: Found, array: np.ndarray) -> None:  # noqa: D107
        self.path, self.episodes = path, [found.episode]
        self._place, self._array = found.place, array

    def root(self) -> Placed | None:
        """See Layout."""
        return None  # nobody says which of four numbers is w

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """See Layout."""
        matched.check(self.episodes, q, self.path)
        one = self.episodes[0]
        columns = one.numbers.encode(one.name, q[0])
        new = arrays.put(self._place, {ANGLES[0]: self._array}, columns)[ANGLES[0]]
        data = _encoded(new)
        replace(target, lambda part: part.write_bytes(data))


def open_npz(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> NpzLayout:
    """Read an archive.

    Raises:
        TrajectoryError: what s3le.store.npz or arrays.read refuses.
    """
    data = path.read_bytes()
    table = npz.read_npz(path, TrajectoryError, MOST_BYTES, data=data)
    said = told(table.get(ABOUT))
    found = arrays.read(
        str(path), table, robot, fps=fps, joints=joints, degrees=degrees, given=given, about=said,
        paced=True,
    )  # fmt: skip
    return NpzLayout(path, found, table if said else _without(table, ABOUT), data)


def open_npy(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> NpyLayout:
    """Read one array.

    Raises:
        TrajectoryError: what s3le.store.npz or arrays.read refuses.
    """
    array = npz.read_npy(path, TrajectoryError, MOST_BYTES)
    if array.ndim != 2:
        raise TrajectoryError(f"{path}: has shape {array.shape}; wanted (rows, joints)")
    found = arrays.read(
        str(path), {ANGLES[0]: array}, robot, fps=fps, joints=joints, degrees=degrees, given=given
    )
    return NpyLayout(path, found, array)


def _without(table: Mapping[str, np.ndarray], key: str) -> dict[str, np.ndarray]:
    return {name: array for name, array in table.items() if name != key}


def _encoded(array: np.ndarray) -> bytes:
    sink = io.BytesIO()
    npy.write_array(sink, array, allow_pickle=False)
    return sink.getvalue()


def _copied(data: bytes, new: Mapping[str, bytes]) -> bytes:
    """The same archive: entries in their order and compression, some with other bytes, then new."""
    sink, left = io.BytesIO(), dict(new)
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(sink, "w") as to:
        for entry in old.infolist():
            key = entry.filename.removesuffix(".npy")
            info = zipfile.ZipInfo(entry.filename, entry.date_time)
            info.compress_type, info.external_attr = entry.compress_type, entry.external_attr
            info.create_system = entry.create_system
            to.writestr(info, left.pop(key) if key in left else old.read(entry))
        for key, held in left.items():  # packed as the last one is
            added = zipfile.ZipInfo(f"{key}.npy", info.date_time)
            added.compress_type, added.external_attr = info.compress_type, info.external_attr
            added.create_system = info.create_system
            to.writestr(added, held)
    return sink.getvalue()
