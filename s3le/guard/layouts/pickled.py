"""GMR's pickles: read as data, never run, and written back with other joints in the same bytes.

A pickle of GMR is a dict: fps, root_pos (m, 3), root_rot x y z w (m, 4), dof_pos (m, joints) as
MuJoCo numbers them, local_body_pos, link_body_list. New joints go where the old ones lie, in as
many bytes, so that every other byte of the file is as it was.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard.layouts import arrays, matched, roots
from s3le.guard.layouts.arrays import Found
from s3le.inert import pickles
from s3le.motion.columns import ANGLES, NAMES, RATES, STEPS, TIMES
from s3le.motion.trajectory import Placed
from s3le.robot.model import Geometry
from s3le.store.atomic import replace

MOST_BYTES = 1 << 30
ROUTE = (
    "save its numbers where it was made: np.savez('motion.npz', dof_pos=..., joint_names=[...], "
    "fps=...) (docs/files.md)"
)


class PickleLayout:
    """A pickled dict of one motion."""

    def __init__(  # noqa: D107
        self, path: Path, found: Found, table: Mapping[str, np.ndarray], data: bytes, at: int
    ) -> None:
        self.path, self.episodes = path, [found.episode]
        self._place, self._table, self._data, self._at = found.place, table, data, at

    def root(self) -> Placed | None:
        """See Layout."""
        return roots.of_arrays(self._table, self._place, xyzw=True)

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
        (new,) = arrays.put(self._place, self._table, columns).values()
        lies = new.tobytes("F" if _by_columns(self._table[self._place.keys[0]]) else "C")
        made = self._data[: self._at] + lies + self._data[self._at + len(lies) :]
        replace(target, lambda part: part.write_bytes(made))


def open_pickle(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
) -> PickleLayout:
    """Read a pickle of GMR's.

    Raises:
        TrajectoryError: anything in it is not data, it is no dict of one motion, or its joints
            do not lie in it as plain bytes.
    """
    if path.stat().st_size > MOST_BYTES:
        raise TrajectoryError(f"{path}: a pickle of more than {MOST_BYTES >> 30} GiB is not read")
    data = path.read_bytes()
    if not data:
        raise TrajectoryError(f"{path}: is empty")
    places: dict[int, pickles.Place] = {}
    tree = pickles.load(path, data, error=TrajectoryError, places=places)
    if not isinstance(tree, dict):
        kind = type(tree).__name__
        raise TrajectoryError(f"{path}: holds a {kind}, no dict of arrays as GMR's do; {ROUTE}")
    table = _table(tree)
    if not any(key.lower() in ANGLES and table[key].ndim == 2 for key in table):
        has = matched.few([repr(key)[:40] for key in tree])
        raise TrajectoryError(f"{path}: has no dof_pos (rows, joints); it has {has}; {ROUTE}")
    found = arrays.read(
        str(path), table, robot, fps=fps, joints=joints, degrees=degrees, given=given, numbered=True
    )
    key = found.place.keys[0]
    lies = places.get(id(_owner(table[key])))
    if lies is None or len(lies.data) != table[key].nbytes:
        raise TrajectoryError(
            f"{path}: '{key}' does not lie in it as plain bytes, as in pickles of Python 3 by "
            f"protocol 3 and up; write it again: pickle.dump(motion, file), or {ROUTE}"
        )
    if other := _shares(tree, key, lies.data):
        raise TrajectoryError(
            f"{path}: '{other}' and '{key}' are one array, and only '{key}' may change; give it "
            f"a copy: motion['{other}'] = motion['{other}'].copy()"
        )
    return PickleLayout(path, found, table, data, lies.at)


def _table(tree: Mapping[Any, Any]) -> dict[str, np.ndarray]:
    """What of a dict says something about a motion: arrays, its rate, names of joints."""
    table: dict[str, np.ndarray] = {}
    for key, value in tree.items():
        if not isinstance(key, str):
            continue
        if isinstance(value, np.ndarray):
            table[key] = value
        elif isinstance(value, int | float) and key.lower() in (*RATES, *STEPS):
            table[key] = np.array(float(value))
        elif isinstance(value, list | tuple) and value:
            if key.lower() in NAMES and all(isinstance(word, str) for word in value):
                table[key] = np.array(value)
            elif key.lower() in TIMES and all(isinstance(v, int | float) for v in value):
                table[key] = np.array(value, float)
    return table


def _owner(value: Any) -> Any:
    """What an array's numbers lie in."""
    while isinstance(value, np.ndarray):
        value = value.base
    return value.obj if isinstance(value, memoryview) else value


def _shares(tree: Mapping[Any, Any], key: str, data: bytes | bytearray) -> str | None:
    """Another key of a dict under which the same bytes lie, at any depth."""
    for other, value in tree.items():
        waiting, seen = [] if other == key else [value], set()
        while waiting:
            one = waiting.pop()
            if isinstance(one, np.ndarray) and _owner(one) is data:
                return str(other)
            if isinstance(one, dict | list | tuple) and id(one) not in seen:
                seen.add(id(one))
                waiting.extend(one.values() if isinstance(one, dict) else one)
    return None


def _by_columns(array: np.ndarray) -> bool:
    return array.flags.f_contiguous and not array.flags.c_contiguous
