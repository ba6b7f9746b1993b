"""HDF5: a copy of the file in which only the joints are written over. Wants h5py (extra `hdf5`).

A motion is a group, the file's root or one below it, with a data set that holds all joints (q,
dof_pos, joint_pos, ...). Names and rate are data sets or attributes of that group or of one above.
Nothing outside the file is opened: links and data sets that point out of it are not followed.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard.layouts import arrays, matched, roots
from s3le.guard.layouts.episode import Episode
from s3le.motion.columns import ANGLES, NAMES, RATES, STEPS, TIMES
from s3le.motion.trajectory import Placed
from s3le.robot.model import Geometry
from s3le.store.atomic import replace

MOST_BYTES = 4 << 30  # of the arrays of one motion
MOST_GROUPS = 100_000
_SAID = {*NAMES, *RATES, *STEPS}  # also of groups above, and in attributes


class _Motion(NamedTuple):
    """A motion of the file."""

    group: str  # its name in the file
    found: arrays.Found
    table: Mapping[str, np.ndarray]


class Hdf5Layout:
    """A file of one motion or many."""

    def __init__(self, path: Path, motions: list[_Motion]) -> None:  # noqa: D107
        self.path = path
        self.episodes: list[Episode] = [it.found.episode for it in motions]
        self._motions = motions

    def root(self) -> Placed | None:
        """See Layout."""
        motion = self._motions[0]
        with _opened(self.path, self.path, "r") as file:
            group = file[motion.group or "/"]
            said = {key: _read(self.path, key, group[key]) for key in _own(group)
                    if key.lower() in roots.NAMES}  # fmt: skip
        return roots.of_arrays(dict(motion.table) | said, motion.found.place)

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """See Layout."""
        matched.check(self.episodes, q, self.path)
        new: dict[str, np.ndarray] = {}
        old: dict[str, np.ndarray] = {}
        for it, one in zip(self._motions, q, strict=True):
            place, table = it.found.place, it.table
            columns = it.found.episode.numbers.encode(it.found.episode.name, one)
            for key, values in arrays.put(place, table, columns).items():
                if not np.array_equal(values, table[key], equal_nan=True):
                    new[f"{it.group}/{key}"], old[f"{it.group}/{key}"] = values, table[key]
        replace(target, lambda part: self._fill(part, new, old))

    def _fill(
        self, part: Path, new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]
    ) -> None:
        shutil.copyfile(self.path, part)
        if not new:
            return
        with _opened(self.path, part, "r+") as file:
            for key, values in new.items():
                if not np.array_equal(file[key][()], old[key], equal_nan=True):
                    raise TrajectoryError(f"{self.path}: '{key}' has changed since it was read")
                file[key][...] = values
                if not np.array_equal(file[key][()], values, equal_nan=True):
                    raise TrajectoryError(
                        f"{self.path}: '{key}' is stored by a filter that rounds; save it without"
                    )


def open_hdf5(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> Hdf5Layout:
    """Read the motions of a file.

    Raises:
        TrajectoryError: h5py is missing, no HDF5, no data set of joints, or a motion that is
            refused as any would be.
    """
    with _opened(path, path, "r") as file:
        groups = [group for group in _groups(path, file) if _keys(group)]
        if not groups:
            raise TrajectoryError(
                f"{path}: no group of it has a data set (rows, joints) called {', '.join(ANGLES)}"
            )
        motions = []
        for group in groups:
            table = _table(path, group)
            name = str(path) if group.name == "/" else f"{path}, {group.name[1:200]}"
            found = arrays.read(
                name, table, robot, fps=fps, joints=joints, degrees=degrees, given=given
            )
            motions.append(_Motion(group.name.rstrip("/"), found, table))
    return Hdf5Layout(path, motions)


@contextmanager
def _opened(path: Path, file: Path, how: str) -> Iterator[Any]:
    try:
        import h5py
    except ImportError:
        raise TrajectoryError(
            f"{path}: HDF5 is read with h5py, which is not here: pip install 's3le[hdf5]'"
        ) from None
    try:
        with h5py.File(file, how) as opened:
            yield opened
    except TrajectoryError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        reason = (str(error).splitlines() or ["damaged"])[0][:160]
        raise TrajectoryError(f"{path}: is no sound HDF5 ({reason})") from None


def _groups(path: Path, file: Any) -> list[Any]:
    """The root and all groups below it that lie in this file, in order of their names."""
    import h5py

    found, waiting, seen = [], [file["/"]], set()
    while waiting:
        group = waiting.pop(0)
        place = h5py.h5o.get_info(group.id).addr
        if place in seen:  # a group may lie in two places, even in itself
            continue
        seen.add(place)
        found.append(group)
        if len(found) > MOST_GROUPS:
            raise TrajectoryError(f"{path}: has more than {MOST_GROUPS} groups")
        inside = [
            group[name]
            for name in sorted(group)
            if isinstance(group.get(name, getlink=True), h5py.HardLink)
        ]
        waiting += [one for one in inside if isinstance(one, h5py.Group)]
    return found


def _keys(group: Any) -> list[str]:
    """Data sets of all joints in a group."""
    return [k for k in _own(group) if k.lower() in ANGLES and len(group[k].shape) == 2]


def _own(group: Any) -> list[str]:
    """Data sets of a group whose numbers lie in this file."""
    import h5py

    return [
        name
        for name in sorted(group)
        if isinstance(group.get(name, getlink=True), h5py.HardLink)
        and isinstance(group[name], h5py.Dataset)
        and not group[name].is_virtual
        and group[name].external is None
        and group[name].shape is not None
    ]


def _table(path: Path, group: Any) -> dict[str, np.ndarray]:
    """What a group says: its numbers; names and rate also from groups above and attributes."""
    table: dict[str, np.ndarray] = {}
    rows = next(group[key].shape[0] for key in _keys(group))
    for key in _own(group):
        shape = group[key].shape
        if key.lower() in {*ANGLES, *TIMES, *_SAID}:
            table[key] = _read(path, key, group[key])
        elif len(shape) and shape[0] == rows:
            table[key] = np.broadcast_to(np.zeros(()), (rows,))  # is there, and is left alone
    while True:
        for own, keys in ((group.attrs, group.attrs.keys()), (group, _own(group))):
            for key in keys:
                if key.lower() in _SAID and key.lower() not in {k.lower() for k in table}:
                    table[key] = _read(path, key, own[key])
        if group.name == "/":
            return table
        group = group.parent


def _read(path: Path, key: str, data: Any) -> np.ndarray:
    """A data set or an attribute as an array; words as str."""
    size = getattr(data, "size", 1) * max(getattr(data, "dtype", np.dtype("u1")).itemsize, 1)
    if size > MOST_BYTES:
        raise TrajectoryError(f"{path}: '{key}' is larger than {MOST_BYTES >> 30} GiB")
    value = data[()] if hasattr(data, "shape") else data
    return _words(value) if key.lower() in NAMES else np.asarray(value)


def _words(value: Any) -> np.ndarray:
    """Words as HDF5 holds them: bytes or str, of one length or of many."""
    flat = np.atleast_1d(np.asarray(value)).tolist()
    words = [word.decode(errors="replace") if isinstance(word, bytes) else word for word in flat]
    return np.array(words) if all(isinstance(word, str) for word in words) else np.asarray(value)
