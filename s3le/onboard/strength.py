"""How hard joints may accelerate, from what a file says of their motors and of what they carry.

Of a joint: its effort, less the greatest torque that gravity asks of it, over the greatest inertia
about it (composite rigid body algorithm, its armature on the diagonal), over random poses of the
joints that move, the robot standing upright. Never more than the default, limits.ACCELERATION. One
joint at a time: what others ask of it while they accelerate too is looked at as well, and told.

What is no effort (none, 0, thousands, less than gravity asks) and what is no inertia gives nothing.
"""

import copy
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from s3le.onboard import source
from s3le.onboard.source import Source
from s3le.plan.limits import ACCELERATION
from s3le.robot import sense
from s3le.robot.model import Geometry

POSES = 500
STRONGEST = 1000.0  # [N m], an effort from here on is a placeholder
HEAVIEST = 1e3  # [kg], a link beyond is damage or another unit
LEAST = 1.0  # [rad/s^2], an acceleration below is no robot's: effort or inertia are others


class Found(NamedTuple):
    """What was found out."""

    acceleration: dict[str, float]  # [rad/s^2] of joints of which something is known
    sure: list[str]
    look: list[str]


def find(origin: Source, robot: Geometry) -> Found:
    """Limits of acceleration for the joints of a robot.

    Args:
        origin: the file that was read.
        robot: what became of it.
    """
    joints = robot.joint_names
    given = f"{ACCELERATION:g} rad/s^2 is their limit; give the robot's own"
    if why := _bare(origin):
        return Found({}, [], [f"acceleration: {why}; {given}"])
    model = _model(origin)
    at = [model.joints[model.getJointId(name)] for name in joints]
    columns = [joint.idx_v for joint in at]
    inertia, gravity = _asked(model, robot, [j.idx_q for j in at], columns)
    inertia[:, range(len(joints)), range(len(joints))] += [
        origin.armature.get(name, 0.0) for name in joints
    ]
    effort = np.array([float(model.effortLimit[i]) for i in columns])
    weight = np.abs(gravity).max(axis=0)
    about = np.diagonal(inertia, axis1=1, axis2=2).max(axis=0)
    found: dict[str, float] = {}
    unknown: dict[str, list[str]] = {}
    for name, strong, heavy, turned in zip(joints, effort, weight, about, strict=True):
        if not 0.0 < strong < STRONGEST:
            why = "no effort that can be one"
        elif not turned > 0.0:
            why = "no inertia"
        elif not strong > heavy:
            why = "an effort that does not hold what it carries"
        elif not (strong - heavy) / turned >= LEAST:
            why = "an effort that hardly moves what it carries"
        else:
            found[name] = _down(min((strong - heavy) / turned, ACCELERATION))
            continue
        unknown.setdefault(why, []).append(name)
    look = [
        f"acceleration: the file has {why} for {', '.join(names)}; {given}"
        for why, names in unknown.items()
    ]
    return Found(found, _sure(found), look + _together(found, joints, effort, inertia, gravity))


def _bare(origin: Source) -> str:
    """Why nothing can be said; empty: something may be."""
    if not origin.inertial:
        return "the file has no inertias"
    for link, item in origin.inertial.items():
        mass = item.find("mass")
        try:
            value = float("nan" if mass is None else mass.get("value", "nan"))
        except ValueError:
            value = np.nan
        if not 0.0 <= value < HEAVIEST:  # catches NaN
            return f"the mass of link '{link}' is none"
    return ""


def _model(origin: Source) -> pin.Model:
    """Pinocchio's model with what links weigh."""
    root = copy.deepcopy(origin.root)
    for link in root.findall("link"):
        if (item := origin.inertial.get(link.get("name", ""))) is not None:
            link.append(copy.deepcopy(item))
    return source.model_of(origin.path, root)


def _asked(
    model: pin.Model, robot: Geometry, at: Sequence[int], columns: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Inertia [kg m^2], (k, n, n), and torque of gravity [N m], (k, n), in random poses."""
    poses = sense.poses(robot, POSES)
    q, data = pin.neutral(model), model.createData()
    for name, angle in robot.description.hold.items():
        if model.existJointName(name) and model.joints[model.getJointId(name)].nq == 1:
            q[model.joints[model.getJointId(name)].idx_q] = angle
    # Upright: z of the turned base is up.
    model.gravity.linear = -9.81 * robot.base_rotation[2]
    inertia, gravity = [], []
    still = np.zeros(model.nv)
    for pose in poses:
        q[list(at)] = pose
        pin.crba(model, data, q)
        whole = np.triu(data.M) + np.triu(data.M, 1).T
        inertia.append(whole[np.ix_(columns, columns)])
        gravity.append(pin.rnea(model, data, q, still, still)[list(columns)])
    return np.array(inertia), np.array(gravity)


def _together(
    found: dict[str, float],
    joints: Sequence[str],
    effort: np.ndarray,
    inertia: np.ndarray,
    gravity: np.ndarray,
) -> list[str]:
    """A word on joints that all accelerate at once, in the worst of all directions."""
    hardest = np.array([found.get(name, 0.0) for name in joints])
    asked = (np.abs(inertia) @ hardest + np.abs(gravity)).max(axis=0)
    share = np.where(hardest > 0.0, asked / np.where(hardest > 0.0, effort, 1.0), 0.0)
    worst = int(share.argmax())
    if not share[worst] > 1.0:
        return []
    return [
        f"acceleration: all joints at once, each in the worst direction, ask up to "
        f"{share[worst]:.1f} times the effort of {joints[worst]}; the limits are of one at a time"
    ]


def _sure(found: dict[str, float]) -> list[str]:
    if not found:
        return []
    low, high = min(found, key=lambda k: found[k]), max(found, key=lambda k: found[k])
    return [
        f"acceleration: of {len(found)} joints from effort and inertia, {found[low]:g} ({low}) to "
        f"{found[high]:g} ({high}) rad/s^2, at most {ACCELERATION:g}"
    ]


def _down(value: float) -> float:
    """To three digits, never up."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.floor(value / unit + 1e-9) * unit:.3g}")


def lines(limits: Mapping[str, str]) -> list[str]:
    """What the robot file says of these limits, by joint; nothing where there are none."""
    if not limits:
        return []
    return [
        "# Limits [rad/s^2]: effort less the torque of gravity, over the inertia about the joint,",
        f"# worst of {POSES} random poses, upright, one joint at a time. Never more than",
        f"# {ACCELERATION:g}, which joints that are not named have.",
        "acceleration: {" + ", ".join(f"{name}: {limit}" for name, limit in limits.items()) + "}",
        "",
    ]
