"""Joints in named arrays, whatever container they lie in: NPZ, a pickle, HDF5.

Either one array (m, width) holds all joints beside a list of their names, perhaps behind a free
base, or each joint has an array (m,) of its own.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import RobotError, TrajectoryError
from s3le.guard.layouts import matched
from s3le.guard.layouts.episode import Episode
from s3le.motion import whole
from s3le.motion.columns import ANGLES, ROOT, SPEEDS, angles, clock, find, named, placed
from s3le.motion.trajectory import MODE, SPEED
from s3le.robot.model import Geometry


class Place(NamedTuple):
    """Where the numbers of an episode's joints lie."""

    keys: tuple[str, ...]  # one array of all joints, or one for each of the robot's
    columns: tuple[int, ...]  # of the one array; none: each joint has its own
    skip: int = 0  # columns of a free base before all joints of the one array


class Found(NamedTuple):
    """An episode, and where its numbers lie."""

    episode: Episode
    place: Place


def read(
    name: str,
    table: Mapping[str, np.ndarray],
    robot: Geometry,
    *,
    fps: float | None = None,
    joints: Sequence[str] | None = None,
    degrees: bool = False,
    given: Sequence[str] = (),
    about: Mapping[str, Any] | None = None,
    numbered: bool = False,
    paced: bool = False,
    first: int = 0,
    row_is: str = "row",
) -> Found:
    """The motion in named arrays.

    Args:
        name: of the motion, for messages.
        table: arrays in the file's own types.
        robot: whose motion it is said to be.
        fps: rows per second [Hz], instead of what the arrays say.
        joints: names of the columns, instead of those that the arrays say.
        degrees: angles are in degrees.
        given: joints that others move, see motion.fit.
        about: what the file says about itself.
        numbered: who writes this layout without names writes joints as MuJoCo numbers them.
        paced: the layout has a place for speeds.
        first, row_is: see trajectory.make.

    Raises:
        TrajectoryError: no joints, no names for them, no time or rate, or what episode refuses.
    """
    notes: list[str] = []
    key, names = angles(name, table), named(name, table, joints)
    mode, speeds = _words(table), None
    if key is None:
        keys = [key for key in table if key.lower() not in matched.KNOWN]
        some = matched.match(name, keys, robot)
        own_speeds = {keys[i]: keys[i] + SPEED for i in some.own}
        speeds = {joint: table[one] for joint, one in own_speeds.items() if one in table}
        columns = {keys[i]: table[keys[i]] for i in some.joints}
        for one_of, values in columns.items():
            if values.ndim != 1 or len(values) != len(columns[keys[some.joints[0]]]):
                raise TrajectoryError(
                    f"{name}: '{one_of}' has shape {values.shape}; wanted one number a row, or all "
                    f"joints in one array called {', '.join(ANGLES)}"
                )
        place = Place(tuple(keys[i] for i in some.own), ())
        strangers = [one for one in some.strangers if one not in own_speeds.values()]
        notes += matched.kept(strangers, "arrays")
    else:
        raw = table[key]
        if names is None and numbered:
            names, told = _numbered(name, key, raw.shape[1], robot)
            notes += told
        names, skip = placed(name, key, raw.shape[1], names)
        some = matched.match(name, names, robot)
        columns = {names[i]: raw[:, skip + i] for i in some.joints}
        place = Place((key,), tuple(skip + i for i in some.own), skip)
        if skip:
            notes.append(f"the first {skip} columns of {key} are a free base and stay as they are")
        notes += matched.kept(some.strangers)
        here, fits = table.get(SPEEDS), (len(raw), len(names))
        if here is not None and here.shape == fits and here.dtype.kind == "f":
            speeds = {joint: here[:, i] for i, joint in enumerate(names)}
        elif here is None:
            speeds = {}
        others = [
            k
            for k in table
            if not (k == key or k == SPEEDS and (about or speeds))
            and k.lower() not in matched.KNOWN
            and _rows(table[k])
        ]
        notes += matched.kept(others, "arrays")
    rows = len(next(iter(columns.values())))
    one = matched.episode(
        name, columns, clock(name, table, rows, fps), robot, degrees=degrees, given=given,
        about=about, mode=mode if mode is not None and mode.shape == (rows,) else None, notes=notes,
        speeds=speeds if paced else None, first=first, row_is=row_is,
    )  # fmt: skip
    return Found(one, place)


def put_speeds(
    place: Place, table: Mapping[str, np.ndarray], columns: Sequence[np.ndarray]
) -> dict[str, np.ndarray]:
    """The arrays that hold speeds, with new numbers; those of joints that nobody tells are 0."""
    if not place.columns:
        return {key + SPEED: new for key, new in zip(place.keys, columns, strict=True)}
    joints = table[place.keys[0]]
    shape = (len(joints), joints.shape[1] - place.skip)
    told = np.array(table[SPEEDS]) if SPEEDS in table else np.zeros(shape)
    told[np.isnan(told)] = 0.0
    for at, new in zip(place.columns, columns, strict=True):
        told[:, at - place.skip] = new
    return {SPEEDS: told}


def put(
    place: Place, table: Mapping[str, np.ndarray], columns: Sequence[np.ndarray]
) -> dict[str, np.ndarray]:
    """The arrays that hold joints, with new numbers; types and order in memory as they were."""
    if not place.columns:
        return {key: _copy(table[key], new) for key, new in zip(place.keys, columns, strict=True)}
    whole_array = np.array(table[place.keys[0]])
    for at, new in zip(place.columns, columns, strict=True):
        whole_array[:, at] = new
    return {place.keys[0]: whole_array}


def own(table: Mapping[str, np.ndarray], key: str) -> str | None:
    """What the table calls one of the columns that this project writes."""
    found = find(table, (key,))
    return None if found is None else found[0]


def _copy(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    out = np.array(old)
    out[:] = new
    return out


def _rows(values: np.ndarray) -> bool:
    return values.ndim > 0 and values.dtype.kind in "fiu"


def _words(table: Mapping[str, np.ndarray]) -> np.ndarray | None:
    found = find(table, (MODE,))
    return None if found is None or found[1].dtype.kind != "U" else found[1]


def _numbered(
    name: str, key: str, width: int, robot: Geometry
) -> tuple[list[str] | None, list[str]]:
    """Names of an array that has none, if it is as wide as all joints of the robot."""
    try:
        order = list(whole.joints(robot).depth_first)
    except RobotError as error:
        raise TrajectoryError(
            f"{name}: {key} has no names, and the order of joints is not known ({error}); give "
            "them with --joints"
        ) from None
    if width not in (len(order), len(order) + ROOT):
        raise TrajectoryError(
            f"{name}: {key} has {width} columns without names, {robot.name} has {len(order)} "
            "joints; give the names in order with --joints NAME,NAME,... or a file with one a line"
        )
    return order, [
        f"{key} has no names: its {len(order)} joints are taken as MuJoCo numbers them "
        f"({matched.few(order)}); --joints names others"
    ]
