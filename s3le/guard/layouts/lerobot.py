"""Data sets of LeRobot, v3: a folder of Parquet files in which many episodes follow each other.

    meta/info.json                            fps, and of each column its type and names
    meta/stats.json, meta/episodes/*/*        numbers that training scales by
    data/chunk-000/file-000.parquet           a row a frame: action, observation.state, ...
    videos/...                                pictures; copied

Only the joints of one column change, and the numbers in meta that were computed from them.
"""

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from s3le.errors import TrajectoryError
from s3le.guard.layouts import lerobot_stats, matched, parquet
from s3le.guard.layouts.episode import Episode
from s3le.motion.columns import placed
from s3le.motion.parquet import numbers
from s3le.motion.trajectory import Placed, times, twice
from s3le.robot.model import Geometry
from s3le.store.atomic import replace

INFO = Path("meta/info.json")
COLUMN = "action"
MOST_INFO = 64 << 20  # [bytes]
SAME_TIME = 1e-4  # [s] by which a time may differ from the rate's, as LeRobot itself has it
_EPISODE, _FRAME, _TIME = "episode_index", "frame_index", "timestamp"


class Rows(NamedTuple):
    """Where an episode lies."""

    number: int  # its episode_index
    file: Path  # from the folder
    first: int
    last: int  # the first row that is not of it


class Feature(NamedTuple):
    """The column that holds joints."""

    key: str
    names: list[str]
    skip: int  # columns of a free base before them
    match: matched.Matched  # of names

    def columns(self) -> list[int]:
        """Where the robot's own joints stand in a row."""
        return [self.skip + i for i in self.match.own]


class LeRobotLayout:
    """A data set of many episodes."""

    def __init__(  # noqa: D107
        self, path: Path, episodes: list[Episode], rows: list[Rows], feature: Feature
    ) -> None:
        self.path, self.episodes = path, episodes
        self._rows, self._feature = rows, feature

    def root(self) -> Placed | None:
        """See Layout."""
        return None

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """See Layout."""
        matched.check(self.episodes, q, self.path)
        target = Path(target)
        if target.exists() and not (target / INFO).is_file():
            raise TrajectoryError(f"{target}: is there and is no LeRobot data set; name another")
        if self.path.resolve() in target.resolve().parents:
            raise TrajectoryError(f"{target}: lies in the data set that it would be a copy of")
        new = [one.numbers.encode(one.name, it) for one, it in zip(self.episodes, q, strict=True)]
        touched = [bool(one.numbers.changed(columns).any())
                   for one, columns in zip(self.episodes, new, strict=True)]  # fmt: skip
        part = target.with_name(f".{target.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            _copy(self.path, part)
            dirty = {it.file for it, change in zip(self._rows, touched, strict=True) if change}
            for file in sorted(dirty):
                self._renew(part, file, new)
            if dirty:
                self._stats(part, new, touched)
            _exchange(part, target)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _renew(self, part: Path, file: Path, new: Sequence[list[np.ndarray]]) -> None:
        """Put new numbers into one file of the copy."""
        table, how = parquet.load(self.path / file)
        key = self._feature.key
        values = np.array(numbers(self.path / file, key, table[key]))
        for one, it, columns in zip(self.episodes, self._rows, new, strict=True):
            if it.file != file:
                continue
            rows = slice(it.first, it.last)
            old = one.numbers.raw
            for at, column, was in zip(self._feature.columns(), columns, old, strict=True):
                if not np.array_equal(values[rows, at], was):
                    raise TrajectoryError(f"{self.path / file}: has changed since it was read")
                values[rows, at] = column
        table = parquet.renewed(table, {key: values})
        replace(part / file, lambda to: parquet.store(table, to, how))

    def _stats(self, part: Path, new: Sequence[list[np.ndarray]], touched: Sequence[bool]) -> None:
        """What meta says of the numbers, where they are others now."""
        at, key = self._feature.columns(), self._feature.key
        whole = [np.concatenate([columns[j] for columns in new]) for j in range(len(at))]
        was = [np.concatenate([one.numbers.raw[j] for one in self.episodes])
               for j in range(len(at))]  # fmt: skip
        moved = {at[j]: whole[j] for j in range(len(at)) if not np.array_equal(whole[j], was[j])}
        lerobot_stats.renew_all(part, self.path, key, moved)
        episodes = {}
        for one, it, columns, change in zip(self.episodes, self._rows, new, touched, strict=True):
            if change:
                pairs = zip(at, columns, one.numbers.raw, strict=True)
                episodes[it.number] = {j: c for j, c, o in pairs if not np.array_equal(c, o)}
        lerobot_stats.renew_episodes(part, self.path, key, episodes)


def is_dataset(path: Path) -> bool:
    """Whether a folder is a data set of LeRobot's."""
    return (path / INFO).is_file()


def open_lerobot(
    path: Path,
    robot: Geometry,
    fps: float | None,
    joints: Sequence[str] | None,
    degrees: bool,
    given: Sequence[str],
    column: str | None,
) -> LeRobotLayout:
    """Read the joints of all episodes.

    Raises:
        TrajectoryError: another version, no such column, columns without names, or an episode
            that is refused as any motion would be.
    """
    info = _info(path / INFO)
    feature, fps = _feature(path, info, column or COLUMN, joints, robot), _rate(path, info, fps)
    files = sorted(file.relative_to(path) for file in path.glob("data/*/*.parquet"))
    if not files:
        raise TrajectoryError(f"{path}: has no data/chunk-000/file-000.parquet")
    episodes: list[Episode] = []
    rows: list[Rows] = []
    for file in files:
        wanted = [feature.key, _EPISODE, _FRAME, _TIME]
        table = parquet.some(path / file, wanted)
        if missing := [key for key in wanted if key not in table.column_names]:
            raise TrajectoryError(f"{path / file}: has no column '{missing[0]}'")
        values = numbers(path / file, feature.key, table[feature.key])
        width = feature.skip + len(feature.names)
        if values.ndim != 2 or values.shape[1] != width:
            raise TrajectoryError(
                f"{path / file}: rows of '{feature.key}' have shape {values.shape[1:]}, "
                f"{INFO} says {width}"
            )
        for it in _episodes(path, file, table):
            if any(it.number == other.number for other in rows):
                raise TrajectoryError(
                    f"{path / file}: row {it.first}: episode {it.number} begins a second time"
                )
            part = slice(it.first, it.last)
            name = f"{path}, episode {it.number}"
            time, told = _clock(name, table.slice(it.first, it.last - it.first), fps)
            chosen = {feature.names[i]: values[part, feature.skip + i]
                      for i in feature.match.joints}  # fmt: skip
            notes = [f"joints are those of '{feature.key}'", *told]
            notes += matched.kept(feature.match.strangers)
            episodes.append(
                matched.episode(
                    name, chosen, time, robot, degrees=degrees, given=given, notes=notes
                )
            )
            rows.append(it)
    return LeRobotLayout(path, episodes, rows, feature)


def _info(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MOST_INFO:
            raise TrajectoryError(f"{path}: holds more than {MOST_INFO >> 20} MiB")
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise TrajectoryError(f"{path}: is no JSON ({error})") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("features"), dict):
        raise TrajectoryError(f"{path}: has no 'features', as a LeRobot data set does")
    version = tree.get("codebase_version")
    if not isinstance(version, str) or not version.startswith("v3"):
        raise TrajectoryError(
            f"{path}: is of version {str(version)[:20]!r}, read is v3; with lerobot: python -m "
            "lerobot.datasets.v30.convert_dataset_v21_to_v30 --repo-id=..."
        )
    return tree


def _rate(path: Path, info: Mapping[str, Any], fps: float | None) -> float:
    rate = info.get("fps") if fps is None else fps
    if isinstance(rate, bool) or not isinstance(rate, int | float):
        raise TrajectoryError(f"{path / INFO}: fps is {rate!r}; give the rate with --fps")
    return float(rate)


def _feature(
    path: Path, info: Mapping[str, Any], key: str, joints: Sequence[str] | None, robot: Geometry
) -> Feature:
    where, features = path / INFO, info["features"]
    one = features.get(key)
    if not isinstance(one, dict):
        vectors = [k for k, v in features.items() if isinstance(v, dict) and v.get("names")]
        raise TrajectoryError(f"{where}: no column '{key}'; there are: {matched.few(vectors)}")
    shape, names = one.get("shape"), one.get("names")
    if isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}
        names = next(iter(names.values()))
    if not isinstance(shape, list) or len(shape) != 1 or type(shape[0]) is not int:
        raise TrajectoryError(f"{where}: '{key}' has shape {shape!r}; wanted [joints]")
    if joints is not None:
        names = list(joints)
    elif not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        names = None
    names, skip = placed(str(where), f"'{key}'", shape[0], names)
    if (again := twice(names)) is not None:
        raise TrajectoryError(f"{where}: two columns of '{key}' are called '{again}'")
    return Feature(key, names, skip, matched.match(str(where), names, robot))


def _episodes(path: Path, file: Path, table: pa.Table) -> list[Rows]:
    """Runs of rows of one episode."""
    number = numbers(path / file, _EPISODE, table[_EPISODE])
    if number.dtype.kind not in "iu" or number.ndim != 1:
        raise TrajectoryError(f"{path / file}: {_EPISODE} holds no whole numbers")
    first = np.flatnonzero(np.r_[True, number[1:] != number[:-1]]).tolist()
    return [
        Rows(int(number[a]), file, a, b)
        for a, b in zip(first, [*first[1:], len(number)], strict=True)
    ]


def _clock(name: str, table: pa.Table, fps: float) -> tuple[np.ndarray, list[str]]:
    """Times of an episode's rows [s]: the rate's, where its own are these but for rounding."""
    even = times(table.num_rows, fps, name)
    place = Path(name)
    own = np.asarray(numbers(place, _TIME, table[_TIME]), float)
    frame = numbers(place, _FRAME, table[_FRAME])
    steady = (np.diff(frame) == 1).all() and own.shape == even.shape
    if steady and np.abs(own - own[0] - even).max() <= SAME_TIME:
        return even, []
    return own, [f"its rows are not 1 / {fps:g} s apart; their own times are taken"]


def _copy(path: Path, part: Path) -> None:
    """Copy a folder; links, as in the cache of a hub, become what they point to."""
    seen: set[str] = set()

    def fail(error: OSError) -> None:
        raise error

    for place, folders, files in os.walk(path, onerror=fail, followlinks=True):
        real = os.path.realpath(place)
        if real in seen:
            raise TrajectoryError(f"{place}: is a link in a circle")
        seen.add(real)
        to = part / Path(place).relative_to(path)
        to.mkdir(parents=True)
        folders.sort()
        for file in sorted(files):
            shutil.copyfile(Path(place) / file, to / file)


def _exchange(part: Path, target: Path) -> None:
    """Put a folder in its place, whole; what stood there goes when the new one stands."""
    old = target.with_name(f".{target.name}.old")
    if old.exists() and not target.exists():  # somebody was stopped between the two steps below
        old.rename(target)
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        target.rename(old)
    try:
        part.rename(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)
