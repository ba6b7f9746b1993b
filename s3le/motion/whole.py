"""Motions of a whole robot: a column for every joint that its URDF moves, held ones included.

A retargeter moves the joints of the robot file; the others stand at `hold`. A simulator or a
controller wants all of them, in the URDF's order. Joints that mimic another have no motor of their
own and are left out, as are floating and planar ones, which are no motors at all; both are named.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import RobotError
from s3le.motion.trajectory import METRES, WHOLE, Trajectory
from s3le.robot.model import Geometry

METRE, RADIAN = "m", "rad"
_UNITS = {"revolute": RADIAN, "continuous": RADIAN, "prismatic": METRE}
_SLACK = 1e-9  # share of a limit by which rounding may carry a held joint beyond it


class Actuated(NamedTuple):
    """One joint with a motor."""

    name: str
    unit: str  # of its column: rad, or m for a prismatic one
    moved: int  # which column of a motion it is, the robot's own first; -1: it is held
    held: float  # where it stands if it is held [unit]


class Whole(NamedTuple):
    """All joints of a robot's URDF."""

    joints: tuple[Actuated, ...]  # in the order of the URDF's text
    mimics: dict[str, dict[str, Any]]  # left out: joint -> joint that it mimics, where it stands
    others: dict[str, str]  # left out: joint -> floating or planar
    depth_first: tuple[str, ...]  # the same joints as MuJoCo numbers them


def joints(robot: Geometry) -> Whole:
    """Read which joints a robot has, in the order in which its URDF writes them.

    Raises:
        RobotError: a joint that is held stands outside its range, where no motor goes.
    """
    text, at = robot.description, {name: i for i, name in enumerate(robot.joint_names)}
    found, mimics, others = [], {}, {}
    items = robot.tree.findall("joint")
    for item in items:
        name, kind = item.get("name", ""), item.get("type", "")
        held = text.hold.get(name, 0.0)
        if kind == "fixed":
            continue
        if kind not in _UNITS:
            others[name] = kind
        elif (mimic := item.find("mimic")) is not None:
            mimics[name] = {"of": mimic.get("joint", ""), "at": held}
        else:
            if name not in at:
                _refuse_beyond(robot, item, held, _UNITS[kind])
            found.append(Actuated(name, _UNITS[kind], at.get(name, -1), held))
    names = {joint.name for joint in found}
    order = tuple(name for name in _depth_first(items) if name in names)
    return Whole(tuple(found), mimics, others, order)


def _depth_first(items: list[ElementTree.Element]) -> list[str]:
    """Joints from the root link, each with all that hangs on it before the next one beside it."""
    below: dict[str, list[ElementTree.Element]] = {}
    for item in items:
        below.setdefault(_link(item, "parent"), []).append(item)
    children = {_link(item, "child") for item in items}
    order: list[str] = []
    waiting = [item for link in below if link not in children for item in reversed(below[link])]
    while waiting:
        item = waiting.pop()
        order.append(item.get("name", ""))
        waiting += reversed(below.get(_link(item, "child"), []))
    return order


def _link(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _refuse_beyond(robot: Geometry, item: ElementTree.Element, held: float, unit: str) -> None:
    """Refuse a joint that stands beyond its limits only because nobody said where it stands."""
    limit = item.find("limit")
    if limit is None or item.get("type") == "continuous":
        return
    low, high = float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))
    slack = _SLACK * max(abs(low), abs(high))
    if not low - slack <= held <= high + slack:
        nearest = min(max(held, low), high)
        raise RobotError(
            f"{robot.description.source}: joint '{item.get('name')}' is held at {held:.6g} {unit}, "
            f"outside its range [{low:.6g}, {high:.6g}]; hold it where it can stand, say at "
            f"{nearest:.6g}, and run the pipeline again"
        )


def moved(whole: Whole, names: Sequence[str]) -> Whole:
    """The same joints, of a motion that has columns for more of them than the robot file moves.

    Args:
        whole: see joints.
        names: of the motion's columns, the robot's own first.
    """
    at = {name: i for i, name in enumerate(names)}
    found = (joint._replace(moved=at.get(joint.name, -1)) for joint in whole.joints)
    return whole._replace(joints=tuple(found))


def complete(trajectory: Trajectory, robot: Geometry, whole: Whole) -> Trajectory:
    """The same motion with a column for every joint of the URDF.

    Args:
        trajectory: of the robot's own joints, in the robot's order; others may follow.
        robot: whose it is.
        whole: its joints, see joints, or moved where others follow.

    Returns:
        The motion in the URDF's order; `about` says which joints move, and where the others stand.
    """
    assert trajectory.joints[: robot.n_dof] == tuple(robot.joint_names)
    q = np.empty((len(trajectory.q), len(whole.joints)))  # (n, all joints)
    for column, joint in enumerate(whole.joints):
        q[:, column] = joint.held if joint.moved < 0 else trajectory.q[:, joint.moved]
    q.setflags(write=False)
    v = None
    if trajectory.v is not None:
        v = np.zeros_like(q)
        for column, joint in enumerate(whole.joints):
            if joint.moved >= 0:
                v[:, column] = trajectory.v[:, joint.moved]
        v.setflags(write=False)
    about = {**trajectory.about, WHOLE: tree(whole)}
    names = tuple(joint.name for joint in whole.joints)
    return replace(trajectory, joints=names, q=q, v=v, about=about)


def numbered(trajectory: Trajectory, whole: Whole) -> Trajectory:
    """A motion that `complete` made, its columns in MuJoCo's order."""
    at = [trajectory.joints.index(name) for name in whole.depth_first]
    q = np.ascontiguousarray(trajectory.q[:, at])
    q.setflags(write=False)
    v = None if trajectory.v is None else np.ascontiguousarray(trajectory.v[:, at])
    return replace(trajectory, joints=whole.depth_first, q=q, v=v)


def tree(whole: Whole) -> dict[str, Any]:
    """What a file says of its joints, as JSON can hold it."""
    return {
        "moved": [joint.name for joint in whole.joints if joint.moved >= 0],
        "held": {joint.name: joint.held for joint in whole.joints if joint.moved < 0},
        "depth_first": list(whole.depth_first),
        METRES: [joint.name for joint in whole.joints if joint.unit == METRE],
        "left_out_mimics": whole.mimics,
        "left_out_others": whole.others,
    }
