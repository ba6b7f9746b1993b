"""What the columns or arrays of a file mean, whoever wrote it.

Ours are `time`, one per joint, one per joint's speed (`JOINT.vel`, or an array `v` beside `q`),
`heading`, `clearance`, `mode`. Others call the time `t` or give a
rate, and keep all joints in one array beside a list of names, behind a root's position and
quaternion.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.motion.trajectory import (
    CLEARANCE,
    HEADING,
    MODE,
    SPEED,
    TIME,
    Trajectory,
    make,
    times,
)

TIMES = (TIME, "times", "t", "timestamp", "timestamps", "time_s")
RATES = ("fps", "rate", "frame_rate", "framerate", "frequency", "hz", "mocap_framerate")
STEPS = ("dt", "timestep", "time_step")
ANGLES = ("q", "qpos", "dof_pos", "dof_position", "joint_pos", "joint_positions", "joint_position")
SPEEDS = "v"  # of the joints, (n, n_dof), beside the array that holds their angles
NAMES = ("joint_names", "dof_names", "joints", "names")
NUMBERING = ("", "frame", "index", "row", "unnamed: 0")
BASE = re.compile(r"(root|base|floating_base|pelvis|free_?joint)([_. ].*)?", re.IGNORECASE)
FREE = {*"xyz", "tx", "ty", "tz", "qw", "qx", "qy", "qz", "roll", "pitch", "yaw"}
ROOT = 7  # numbers of a free base in front of the joints: position and quaternion

Found = tuple[str, np.ndarray] | None


def interpret(
    name: str,
    table: Mapping[str, np.ndarray],
    fps: float | None = None,
    joints: Sequence[str] | None = None,
    about: Mapping[str, Any] | None = None,
    first: int = 0,
    row_is: str = "row",
) -> Trajectory:
    """A trajectory from named arrays.

    Args:
        name: of the file, for messages.
        table: scalars, strings and arrays by name; each column of joints (n,), or all of them in
            one array (n, width) under one of ANGLES.
        fps: rows per second [Hz], instead of what the file says.
        joints: names of the array's columns, instead of what the file says.
        about, first, row_is: see trajectory.make.

    Raises:
        TrajectoryError: no angles, no names for them, no time or rate, or what make refuses.
    """
    key, of_joints = angles(name, table), named(name, table, joints)
    v: np.ndarray | None = None
    if key is not None:
        names, q = _columns(name, key, _numbers(name, key, table[key]), of_joints)
        if np.shape(table.get(SPEEDS, 0.0)) == q.shape:
            v = _numbers(name, SPEEDS, table[SPEEDS])
    else:
        skip = {*TIMES, *RATES, *STEPS, *NUMBERING, *NAMES, HEADING, CLEARANCE, MODE}
        names = [key for key in table if key.lower() not in skip]
        fast = [one for one in names if one.endswith(SPEED) and one.removesuffix(SPEED) in names]
        names = [one for one in names if one not in fast]
        if not names:
            raise TrajectoryError(f"{name}: has no column of a joint; it has: {_list(table)}")
        for key in names:
            if np.ndim(table[key]) != 1:
                raise TrajectoryError(
                    f"{name}: '{key}' has shape {np.shape(table[key])}; wanted one number a row, "
                    f"or all joints in one array called {', '.join(ANGLES)}"
                )
        lengths = {key: len(table[key]) for key in names}
        if len(set(lengths.values())) > 1:
            raise TrajectoryError(f"{name}: columns are of different lengths, {lengths}"[:300])
        q = np.stack([_numbers(name, key, table[key]) for key in names], axis=1)
        if fast:
            v = np.stack([_speed(name, one, table) for one in names], axis=1)
    clearance, mode = find(table, (CLEARANCE,)), find(table, (MODE,))
    heading = find(table, (HEADING,))
    turned = None if heading is None else _numbers(name, *heading)
    clear = None if clearance is None else _numbers(name, *clearance)
    how = None if mode is None or mode[1].dtype.kind not in "UT" else mode[1].astype(str)
    if v is not None and np.isnan(v).any():
        v = None  # as of a clearance: somebody took the claim away
    time = clock(name, table, len(q), fps)
    return make(name, names, time, q, clear, how, about, first, row_is, turned, v)


def _speed(name: str, joint: str, table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Speeds of a joint in a file that tells some: 0 of one that stands, and of the base."""
    if joint + SPEED in table:
        return _numbers(name, joint + SPEED, table[joint + SPEED])
    q = _numbers(name, joint, table[joint])
    if not ((q == q[:1]).all() or BASE.fullmatch(joint) or joint.lower() in FREE):
        raise TrajectoryError(f"{name}: tells the speed of some joints, but not of '{joint}'")
    return np.zeros(len(q))


def angles(name: str, table: Mapping[str, np.ndarray]) -> str | None:
    """What the one array (n, width) that holds all joints is called, if there is one.

    Raises:
        TrajectoryError: there are two.
    """
    there = [key for key in table if key.lower() in ANGLES and np.ndim(table[key]) == 2]
    if len(there) > 1:
        raise TrajectoryError(
            f"{name}: which of {', '.join(there)} holds the joints? keep one of them"
        )
    return there[0] if there else None


def named(
    name: str, table: Mapping[str, np.ndarray], joints: Sequence[str] | None
) -> list[str] | None:
    """Names of the array's columns: those given, else those that the file lists.

    Raises:
        TrajectoryError: what lies under one of NAMES is no list of words.
    """
    if joints is not None:
        return list(joints)
    found = find(table, NAMES)
    if found is None:
        return None
    key, value = found
    if np.ndim(value) != 1 or value.dtype.kind not in "UT":
        raise TrajectoryError(f"{name}: {key} must be a list of words, not {value.dtype}")
    return [str(word) for word in value]


def _columns(
    name: str, key: str, q: np.ndarray, joints: list[str] | None
) -> tuple[list[str], np.ndarray]:
    """Names for the columns of an array, without those of a free base in front."""
    joints, first = placed(name, key, q.shape[1], joints)
    return joints, q[:, first:]


def placed(name: str, key: str, width: int, joints: list[str] | None) -> tuple[list[str], int]:
    """Names of the joints of an array, and the column of the first: a free base may stand before.

    Raises:
        TrajectoryError: there are no names, or another count than columns.
    """
    if joints is None:
        raise TrajectoryError(
            f"{name}: {key} has {width} columns without names; "
            "give them in order with --joints NAME,NAME,... or a file with one name a line"
        )
    if width == len(joints) + ROOT:
        return joints, ROOT
    if width == len(joints) + ROOT - 1:  # the base counts as one joint of seven numbers
        return joints[1:], ROOT
    if width != len(joints):
        raise TrajectoryError(f"{name}: {key} has {width} columns for {len(joints)} joints")
    return joints, 0


def clock(name: str, table: Mapping[str, np.ndarray], rows: int, fps: float | None) -> np.ndarray:
    """Times of rows [s], (rows,): at the rate given, else as the file tells time, rate or step.

    Raises:
        TrajectoryError: it tells none of them, or no positive number.
    """
    if fps is not None:
        return times(rows, fps, name)
    if found := find(table, TIMES):
        return _numbers(name, *found)
    for keys, power in ((RATES, 1), (STEPS, -1)):
        if found := find(table, keys):
            value = _numbers(name, *found).ravel()
            if not len(value) or not (value == value[0]).all() or not value[0] > 0:
                raise TrajectoryError(f"{name}: {found[0]} must be one positive number")
            return times(rows, float(value[0]) ** power, name)
    raise TrajectoryError(
        f"{name}: says neither time nor rate (a column {TIME} [s], or {RATES[0]}); "
        "give the rate with --fps"
    )


def find(table: Mapping[str, np.ndarray], keys: Sequence[str]) -> Found:
    """The first of some names, in any case, that the table has."""
    lower = {key.lower(): key for key in table}
    return next(((lower[key], table[lower[key]]) for key in keys if key in lower), None)


def _numbers(name: str, key: str, values: np.ndarray) -> np.ndarray:
    if np.asarray(values).dtype.kind not in "fiu":
        raise TrajectoryError(f"{name}: '{key}' holds no numbers but {np.asarray(values).dtype}")
    with np.errstate(invalid="ignore"):  # a signalling NaN is refused as any
        return np.asarray(values, float)


def _list(table: Mapping[str, np.ndarray]) -> str:
    return ", ".join(repr(key)[:40] for key in list(table)[:12]) or "nothing"
