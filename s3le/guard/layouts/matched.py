"""Whose columns are whose: those of the robot's joints are found, all others stay strangers.

`s3le audit` refuses a column that it does not know, for it could be a joint in disguise. Here a
stranger is kept as it is and named in a note, and a joint that is missing is refused all the same.
"""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard.layouts.episode import Episode
from s3le.guard.layouts.numbers import Numbers, decode
from s3le.motion.columns import NAMES, NUMBERING, RATES, STEPS, TIMES
from s3le.motion.fit import fit, joint_of, urdf_joints
from s3le.motion.trajectory import CLEARANCE, HEADING, MODE, make
from s3le.robot.model import Geometry

ABOUT = "about"
MOST_NEAR = 1000  # columns among which a misspelt one is looked for
# Names of columns and arrays that are not joints and need no note.
KNOWN = {*TIMES, *RATES, *STEPS, *NUMBERING, *NAMES, HEADING, CLEARANCE, MODE, ABOUT}


class Matched(NamedTuple):
    """Columns of a file by what they are."""

    joints: list[int]  # all that are joints of the URDF, as the file orders them
    own: list[int]  # those of the robot's own joints, in the robot's order
    strangers: list[str]  # all others


def match(name: str, columns: Sequence[str], robot: Geometry) -> Matched:
    """Find the robot's joints among columns.

    Args:
        name: of the file, for messages.
        columns: their names; endings such as `_pos` are understood.
        robot: whose joints.

    Raises:
        TrajectoryError: a joint of the robot is missing, or there twice.
    """
    known = set(urdf_joints(robot)) | set(robot.joint_names)
    found = [joint_of(column, known) for column in columns]
    at: dict[str, int] = {}
    for i, joint in enumerate(found):
        if joint is not None and at.setdefault(joint, i) != i:
            raise TrajectoryError(
                f"{name}: '{columns[i]}' and '{columns[at[joint]]}' are both '{joint}'"
            )
    strangers = [column for column, joint in zip(columns, found, strict=True) if joint is None]
    for joint in robot.joint_names:
        if joint not in at:
            near = get_close_matches(joint, strangers[:MOST_NEAR], n=1)
            hint = f"is it '{near[0]}'?" if near else f"the file has: {few(columns)}"
            raise TrajectoryError(f"{name}: joint '{joint}' of {robot.name} is missing; {hint}")
    if not at:
        raise TrajectoryError(f"{name}: has no joint of {robot.name}; it has: {few(columns)}")
    return Matched(sorted(at.values()), [at[joint] for joint in robot.joint_names], strangers)


def episode(
    name: str,
    columns: Mapping[str, np.ndarray],
    time: np.ndarray,
    robot: Geometry,
    *,
    degrees: bool = False,
    given: Sequence[str] = (),
    about: Mapping[str, Any] | None = None,
    mode: np.ndarray | None = None,
    notes: Sequence[str] = (),
    speeds: Mapping[str, np.ndarray] | None = None,
    first: int = 0,
    row_is: str = "row",
) -> Episode:
    """One motion, from the columns that are joints.

    Args:
        name: of the motion.
        columns: (m,) each, of all joints of the URDF that the file has, in the file's types.
        time: [s], (m,).
        robot: whose motion.
        degrees: angles are in degrees.
        given: joints that others move, see motion.fit.
        about: what the file says about itself.
        mode: str (m,), or None.
        notes: what was assumed so far.
        speeds: (m,) each, by the name of the joint's column; none of one: the file has a place for
            them and does not tell them. None: it has no place.
        first, row_is: see trajectory.make.

    Raises:
        TrajectoryError: a column of a type that no angle can be written into, or what make and
            fit refuse: not finite, time that does not rise, a held joint that moves.
    """
    for column, values in columns.items():
        if values.dtype.kind != "f":
            raise TrajectoryError(
                f"{name}: '{column}' holds {values.dtype}, into which no angle can be written "
                "back; save it as float64"
            )
    q = np.stack([decode(values, False) for values in columns.values()], axis=1)
    read = make(name, list(columns), time, q, None, mode, about, first, row_is)
    trajectory, told, others = fit(read, robot, degrees, given)
    matched = match(name, list(columns), robot)
    kinds, names = urdf_joints(robot), list(columns)
    turned = tuple(degrees and kinds.get(joint) != "prismatic" for joint in robot.joint_names)
    raw = tuple(columns[names[i]] for i in matched.own)
    numbers = Numbers(raw, turned, trajectory.q, robot.lower, robot.upper)
    for i, values in enumerate(raw):  # what is written is found by what was read
        assert np.array_equal(decode(values, turned[i]), trajectory.q[:, i])
    notes = [*notes, *told]
    v, pace = None, None
    # Among joints that others move rows go straight.
    if speeds is not None and others is None and all(s.dtype.kind == "f" for s in speeds.values()):
        pace = _pace([speeds.get(names[i]) for i in matched.own], turned, trajectory.q.shape)
        for row, i in np.argwhere(np.isinf(pace.q))[:1]:
            raise TrajectoryError(
                f"{name}: {row_is} {first + row}: the speed of {robot.joint_names[i]} is "
                f"{pace.q[row, i]}"
            )
        v = pace.q if np.isfinite(pace.q).all() else None  # NaN: somebody took the claim away
    return Episode(name, read.time, trajectory.q, notes, numbers, read.mode, others, v, pace)


def _pace(
    told: Sequence[np.ndarray | None], turned: tuple[bool, ...], shape: tuple[int, ...]
) -> Numbers:
    """How a file writes speeds of the robot's joints; q of it is NaN where they are not told."""
    raw = tuple(np.full(shape[0], np.nan) if one is None else one for one in told)
    q = np.stack([decode(one, turn) for one, turn in zip(raw, turned, strict=True)], axis=1)
    free = np.full(shape[1], np.inf)
    return Numbers(raw, turned, q, -free, free)


def timed(columns: Sequence[str]) -> str | None:
    """The column that tells the time or the rate of rows, as s3le.motion.columns chooses it."""
    lower = {column.lower(): column for column in columns}
    return next((lower[key] for key in (*TIMES, *RATES, *STEPS) if key in lower), None)


def kept(strangers: Sequence[str], what: str = "columns") -> list[str]:
    """A note on what stays as it is, if anything does."""
    if not strangers:
        return []
    return [
        f"{what} that are no joints here stay as they are, also where they were computed from "
        f"joints: {few(strangers)}"
    ]


def check(episodes: Sequence[Episode], q: Sequence[np.ndarray], path: Path) -> None:
    """Refuse another count of motions than were read.

    Raises:
        TrajectoryError: it is another.
    """
    if len(q) != len(episodes):
        raise TrajectoryError(f"{path}: {len(q)} motions for its {len(episodes)}")


def few(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
