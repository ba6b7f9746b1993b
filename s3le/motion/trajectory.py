"""A robot's motion in time: joint angles by name, and how each row came about."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import TrajectoryError

TIME, HEADING, CLEARANCE, MODE = "time", "heading", "clearance", "mode"
BETWEEN = "between"  # mode of a row on the path between two poses
RESERVED = (TIME, HEADING, CLEARANCE, MODE)  # columns that are no joints
WHOLE, METRES = "whole", "in_metres"  # what a file of the whole robot says of its joints
UNIFORM = 1e-6  # two steps are alike if they differ by no more than this share
SPEED = ".vel"  # what the column of a joint's speed is called, behind the joint's name
LONGEST_NAME = 256  # [characters] of a joint or a mode; what is longer is damage


class Placed(NamedTuple):
    """Where the base link of a robot that moves about is, row by row."""

    position: np.ndarray  # [m], (m, 3), of its origin in the world
    turn: np.ndarray  # (m, 4), quaternion x y z w: base link -> world


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion of a robot, one row a moment.

    Between rows the joints move straight; or, if it has speeds, on the cubics that meet both.
    """

    name: str  # in messages: the file, or the clip that it was made from
    joints: tuple[str, ...]  # as in the URDF
    time: np.ndarray  # [s], (n,), rising
    q: np.ndarray  # [rad], [m] of a prismatic joint, (n, len(joints)), finite
    clearance: np.ndarray | None = None  # [m], (n,), as claimed by who made it; NaN: no claim
    mode: np.ndarray | None = None  # str (n,), how a row was obtained
    about: Mapping[str, Any] = field(default_factory=dict)  # robot, certificate, ...: what JSON can
    heading: np.ndarray | None = None  # [rad], (n,), yaw of the base about z, unwrapped
    root: Placed | None = None  # as another file says it, for tools' layouts (motion.layouts)
    v: np.ndarray | None = None  # [rad/s], [m/s], (n, len(joints)), finite; None: not told

    @property
    def rate(self) -> float | None:
        """Rows per second [Hz], or None where the steps in time differ."""
        if len(self.time) < 2:
            return None
        step = (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        slack = UNIFORM * step + 4 * np.spacing(np.abs(self.time).max())
        return float(1.0 / step) if np.abs(np.diff(self.time) - step).max() <= slack else None


def make(
    name: str,
    joints: Sequence[str],
    time: np.ndarray,
    q: np.ndarray,
    clearance: np.ndarray | None = None,
    mode: np.ndarray | None = None,
    about: Mapping[str, Any] | None = None,
    first: int = 0,
    row_is: str = "row",
    heading: np.ndarray | None = None,
    v: np.ndarray | None = None,
) -> Trajectory:
    """A trajectory once its numbers can be believed; its arrays are read-only.

    Args:
        name: what it is called in messages.
        joints: names of the columns of q.
        time: [s], (n,).
        q: [rad], (n, n_dof).
        clearance: [m], (n,), or None.
        mode: words, (n,), or None.
        about: what else is known, as JSON can hold it.
        first: number of the first row in messages.
        row_is: what a row is called in messages.
        heading: [rad], (n,), or None.
        v: [rad/s], (n, n_dof), or None.

    Raises:
        TrajectoryError: no rows or joints, shapes that do not fit, joint names that repeat or
            are reserved, angles, headings or times that are not finite, time that does not
            rise, or about that JSON cannot hold; names the row and the joint.
    """
    joints = tuple(str(joint) for joint in joints)
    _check_names(name, joints)
    time, q = np.array(time, float), np.array(q, float)
    if q.ndim != 2 or q.shape[1] != len(joints) or not len(joints):
        raise TrajectoryError(
            f"{name}: angles of shape {q.shape} do not fit {len(joints)} joint names"
        )
    if time.shape != (len(q),):
        raise TrajectoryError(f"{name}: {time.size} times for {len(q)} rows of angles")
    if not len(q):
        raise TrajectoryError(f"{name}: holds no rows")
    for row in np.flatnonzero(~np.isfinite(time))[:1]:
        raise TrajectoryError(f"{name}: {row_is} {first + row}: time is {time[row]}")
    for row, joint in np.argwhere(~np.isfinite(q))[:1]:
        raise TrajectoryError(f"{name}: {row_is} {first + row}: {joints[joint]} is {q[row, joint]}")
    for row in np.flatnonzero(~(np.diff(time) > 0.0))[:1] + 1:
        raise TrajectoryError(
            f"{name}: {row_is} {first + row}: time {time[row]:.9g} s comes after "
            f"{time[row - 1]:.9g} s; it must rise from row to row"
        )
    v = None if v is None else np.array(v, float)
    if v is not None:
        if v.shape != q.shape:
            raise TrajectoryError(f"{name}: speeds of shape {v.shape} for angles {q.shape}")
        for row, joint in np.argwhere(~np.isfinite(v))[:1]:
            raise TrajectoryError(
                f"{name}: {row_is} {first + row}: {joints[joint]}{SPEED} is {v[row, joint]}"
            )
    clearance = None if clearance is None else np.array(clearance, float)
    mode = None if mode is None else np.array(mode, str)
    heading = None if heading is None else np.array(heading, float)
    for what, column in ((HEADING, heading), (CLEARANCE, clearance), (MODE, mode)):
        if column is not None and column.shape != (len(q),):
            raise TrajectoryError(f"{name}: {what} of shape {column.shape} for {len(q)} rows")
    if heading is not None:
        for row in np.flatnonzero(~np.isfinite(heading))[:1]:
            raise TrajectoryError(f"{name}: {row_is} {first + row}: heading is {heading[row]}")
    for array in (time, q, heading, clearance, mode, v):
        if array is not None:
            array.setflags(write=False)
    try:
        about = json.loads(json.dumps(dict(about or {}), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise TrajectoryError(f"{name}: what is said about it is no JSON ({error})") from None
    return Trajectory(name, joints, time, q, clearance, mode, about, heading, v=v)


def unit(trajectory: Trajectory, joint: str) -> str:
    """Unit of a joint's column: rad, or m where the file says that the joint is prismatic."""
    whole = trajectory.about.get(WHOLE)
    metres = whole.get(METRES) if isinstance(whole, dict) else None
    return "m" if isinstance(metres, list) and joint in metres else "rad"


def runs(mode: np.ndarray) -> list[list[Any]]:
    """Modes of rows as pairs: the first row of each run of one mode, and the mode."""
    first = np.flatnonzero(np.r_[True, mode[1:] != mode[:-1]])
    return [[int(row), str(mode[row])] for row in first]


def unrolled(pairs: Any, rows: int) -> np.ndarray | None:
    """The modes that `runs` told, str (rows,); None where they are nothing that it tells."""
    if not isinstance(pairs, list) or not all(isinstance(p, list) and len(p) == 2 for p in pairs):
        return None
    first, words = [p[0] for p in pairs], [p[1] for p in pairs]
    if not all(type(row) is int and 0 <= row < rows for row in first) or first[:1] != [0]:
        return None
    length = np.diff([*first, rows])
    if not (length > 0).all():
        return None
    good = all(isinstance(word, str) and len(word) <= LONGEST_NAME for word in words)
    return np.repeat(np.array(words, str), length) if good else None


def times(rows: int, rate: float, name: str) -> np.ndarray:
    """Times of rows at a constant rate [Hz], from 0 [s].

    Raises:
        TrajectoryError: the rate is no positive number.
    """
    if not 1e-3 <= rate <= 1e6:  # catches NaN
        raise TrajectoryError(f"{name}: a rate of {rate!r} Hz is none; give one with --fps")
    return np.arange(rows) / rate


def twice(names: Iterable[str]) -> str | None:
    """The first name that occurs a second time."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _check_names(name: str, joints: tuple[str, ...]) -> None:
    for joint in joints:
        if not joint.strip() or len(joint) > LONGEST_NAME or not joint.isprintable():
            raise TrajectoryError(f"{name}: {joint[:40]!r} is no name of a joint")
        if joint in RESERVED:
            raise TrajectoryError(f"{name}: '{joint}' is no joint but a column of its own")
    if (again := twice(joints)) is not None:
        raise TrajectoryError(f"{name}: joint '{again}' occurs twice")
