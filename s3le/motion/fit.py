"""A trajectory held against a robot: its joints in the robot's order, nothing silently dropped."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from difflib import get_close_matches
from math import radians
from typing import NamedTuple

import numpy as np

from s3le.errors import TrajectoryError
from s3le.motion.columns import BASE, FREE
from s3le.motion.trajectory import Trajectory
from s3le.robot.description import ALL
from s3le.robot.model import Geometry

MOVING = "moving"  # as the only one given: those that do not stand where the robot file has them
ENDINGS = ("_pos", ".pos", "_position", "_dof", ".dof", "_rad")  # that other tools add to names
HELD_WITHIN = 1e-6  # [rad] or [m], how exactly a joint must stand where the robot holds it
WILD = 5.0  # so many times as far from zero as a range goes is no angle in radians


class Others(NamedTuple):
    """What a motion says of joints that others move."""

    joints: tuple[str, ...]
    q: np.ndarray  # [rad], (m, k)


class Fitted(NamedTuple):
    """A trajectory of the robot's own joints, and what a person should know about it."""

    trajectory: Trajectory
    notes: list[str]
    others: Others | None = None  # None: every other joint stands where the robot file holds it


def fit(
    trajectory: Trajectory, robot: Geometry, degrees: bool = False, given: Sequence[str] = ()
) -> Fitted:
    """Bring a trajectory's joints into the order of the robot's.

    Columns of a free base do not move the bodies against each other and are left out. A joint of
    the URDF that this robot holds still may be there if it stands where the robot holds it.

    Args:
        trajectory: from any file.
        robot: whose it is said to be.
        degrees: its angles are in degrees.
        given: joints that others move; MOVING: those that do not stand where the robot file holds
            them; ALL: whatever the file has.

    Raises:
        TrajectoryError: a joint of the robot is missing, one that it holds still moves, a given
            one is missing or no joint, or a column is neither a joint nor a base.
    """
    name, notes = trajectory.name, []
    kinds = urdf_joints(robot)
    known = {*robot.joint_names, *kinds}
    at: dict[str, int] = {}
    for i, column in enumerate(trajectory.joints):
        joint = joint_of(column, known)
        if joint is None:
            continue
        if joint in at:
            raise TrajectoryError(f"{name}: '{column}' and another column are both '{joint}'")
        at[joint] = i
    lengths = [at[joint] for joint in at if kinds.get(joint) == "prismatic"]
    q, v = np.array(trajectory.q), None if trajectory.v is None else np.array(trajectory.v)
    if degrees:
        turns = np.setdiff1d(np.arange(q.shape[1]), lengths)  # metres are never degrees
        for angles in (q, v):
            if angles is not None:
                angles[:, turns] = np.deg2rad(angles[:, turns])
    missing = [joint for joint in robot.joint_names if joint not in at]
    extra = [c for c in trajectory.joints if joint_of(c, known) is None]
    foreign = [c for c in extra if not (BASE.fullmatch(c) or c.lower() in FREE)]
    if missing:
        near = get_close_matches(missing[0], foreign[:1000], n=1)
        hint = f"; is it '{near[0]}'?" if near else f"; the file has: {_few(trajectory.joints)}"
        raise TrajectoryError(f"{name}: joint '{missing[0]}' of {robot.name} is missing" + hint)
    if foreign:
        near = get_close_matches(foreign[0], known, n=1)
        hint = f"; is it '{near[0]}'?" if near else ""
        raise TrajectoryError(
            f"{name}: column '{foreign[0]}' is no joint of {robot.description.urdf.name}{hint}"
        )
    moved = _given(name, at, q, robot, given)
    others = Others(moved, np.ascontiguousarray(q[:, [at[joint] for joint in moved]]))
    for joint in at.keys() - {*robot.joint_names, *moved}:
        held = robot.description.hold.get(joint, 0.0)
        off = np.abs(q[:, at[joint]] - held)
        if not (off <= HELD_WITHIN).all():
            row = int(np.argmax(off))
            raise TrajectoryError(
                f"{name}: row {row}: {joint} is {q[row, at[joint]]:.6g} "
                f"{'m' if at[joint] in lengths else 'rad'}, but the robot file "
                f"holds it at {held:.6g}; what it moves is not modelled"
            )
    if extra:
        notes.append(f"columns of the base are left out: {_few(extra)}")
    order = [at[joint] for joint in robot.joint_names]
    q = np.ascontiguousarray(q[:, order])
    # Among joints that others move the claim is about straight paths.
    v = None if v is None or moved else np.ascontiguousarray(v[:, order])
    if wild := _wild(q, robot):
        notes.append(wild + ("" if degrees else "; are these degrees? --degrees reads them so"))
    made_for = trajectory.about.get("robot_hash")
    if made_for is not None and made_for != robot.digest:
        notes.append(
            f"it says it was made for robot {trajectory.about.get('robot')} {made_for}, "
            f"this is {robot.name} {robot.digest}"
        )
    q.setflags(write=False)
    own = replace(trajectory, joints=tuple(robot.joint_names), q=q, v=v)
    return Fitted(own, notes, others if moved else None)


def _given(
    name: str, at: dict[str, int], q: np.ndarray, robot: Geometry, given: Sequence[str]
) -> tuple[str, ...]:
    """The joints that others move, in the file's order."""
    rest = [joint for joint in at if joint not in robot.joint_names]
    if list(given) == [ALL]:
        return tuple(rest)
    if list(given) == [MOVING]:
        hold = robot.description.hold
        return tuple(
            joint
            for joint in rest
            if not (np.abs(q[:, at[joint]] - hold.get(joint, 0.0)) <= HELD_WITHIN).all()
        )
    for joint in given:
        if joint in robot.joint_names:
            raise TrajectoryError(f"{name}: '{joint}' is {robot.name}'s own and is not given")
        if joint not in at:
            near = get_close_matches(joint, rest, n=1)
            hint = f"; is it '{near[0]}'?" if near else ""
            raise TrajectoryError(f"{name}: has no column of the given joint '{joint}'{hint}")
    return tuple(joint for joint in rest if joint in given)


def urdf_joints(robot: Geometry) -> dict[str, str]:
    """Joints of the robot's URDF that are not fixed -> their types."""
    found = {str(j.get("name")): str(j.get("type")) for j in robot.tree.findall("joint")}
    return {name: kind for name, kind in found.items() if kind != "fixed"}


def joint_of(column: str, known: Collection[str]) -> str | None:
    """The joint that a column is named after, of those that are known."""
    names = [column, *(column.removesuffix(end) for end in ENDINGS if column.endswith(end))]
    return next((name for name in names if name in known), None)


def _wild(q: np.ndarray, robot: Geometry) -> str:
    """A word on angles so far off that they must be something else."""
    if not robot.joints:
        return ""
    reach = np.maximum(np.maximum(np.abs(robot.lower), np.abs(robot.upper)), radians(5.0))
    with np.errstate(over="ignore"):  # what is that far off is found all the same
        times = np.abs(q) / reach
    row, joint = np.unravel_index(int(np.argmax(times)), times.shape)
    if not times[row, joint] > WILD:
        return ""
    own = robot.joints[joint]
    return (
        f"row {row}: {own.name} is {q[row, joint]:.6g} rad, {times[row, joint]:.0f} times as far "
        f"from zero as its range [{own.lower:.4g}, {own.upper:.4g}] goes"
    )


def _few(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
