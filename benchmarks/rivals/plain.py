"""A robot, and what it is to follow, in plain numbers: what every entrant is told.

Only numpy is needed, so this is read in the project's environment and in that of the rivals. A
robot is its moving joints, capsules on them, the pairs of capsules that are watched, and the points
that the human's skeleton is read from; all that stands still is merged into what carries it. A
library that wants a URDF gets one written from these numbers: one link a joint, one a capsule, one
a point, so all see the same robot.
"""

import json
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

POINTS = ("r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand")
HANDS = (2, 5)  # rows of POINTS
FOLLOWS = {  # point -> the point that its bone starts at, and the bone's row in a skeleton
    "r_shoulder": ("neck", 1), "r_elbow": ("r_shoulder", 2), "r_hand": ("r_elbow", 3),
    "l_shoulder": ("neck", 4), "l_elbow": ("l_shoulder", 5), "l_hand": ("l_elbow", 6),
}  # fmt: skip


class Joint(NamedTuple):
    """A revolute joint."""

    name: str
    parent: int  # the moving joint before it; -1: the base
    rotation: np.ndarray  # (3, 3), of its frame in its parent's at angle zero
    translation: np.ndarray  # [m], (3,)
    axis: np.ndarray  # unit vector in its frame, (3,)
    lower: float  # [rad]
    upper: float  # [rad]
    speed: float  # [rad/s]


class Capsule(NamedTuple):
    """All points within a radius of a segment, fixed to a joint."""

    joint: int  # -1: the base
    a: np.ndarray  # one end of the segment in the joint's frame [m], (3,)
    b: np.ndarray  # the other
    radius: float  # [m]


class Place(NamedTuple):
    """A point fixed to a joint."""

    joint: int
    offset: np.ndarray  # [m], (3,)


class Goal(NamedTuple):
    """What one frame wants, in the robot's base frame."""

    points: np.ndarray  # [m], (6, 3), where POINTS are to be
    turns: np.ndarray  # (2, 3, 3), how the frames of the right and left hand are to be turned
    skeleton: np.ndarray  # (21,), the human's seven unit vectors: x forward, y left, z up


class Plain(NamedTuple):
    """See the top of this file."""

    name: str
    digest: str
    joints: tuple[Joint, ...]
    bodies: tuple[Capsule, ...]
    watched: tuple[tuple[int, int], ...]
    points: dict[str, Place]
    base_rotation: np.ndarray  # (3, 3): base frame -> x forward, y left, z up
    anchor: np.ndarray  # [rad], (n,), a pose that is known to be clear
    margin: float  # [m], clearance asked for
    acceleration: np.ndarray  # [rad/s^2], (n,)

    @property
    def names(self) -> list[str]:
        """Of the joints, in the order of q."""
        return [joint.name for joint in self.joints]

    @property
    def lower(self) -> np.ndarray:
        """[rad], (n,)."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> np.ndarray:
        """[rad], (n,)."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def speed(self) -> np.ndarray:
        """[rad/s], (n,)."""
        return np.array([joint.speed for joint in self.joints])

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (n, 3, 3) and origins [m] (n, 3) of all joints in the base frame at q (n,)."""
        turn, at = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        for i, joint in enumerate(self.joints):
            up, origin = (np.eye(3), np.zeros(3)) if joint.parent < 0 else (
                turn[joint.parent], at[joint.parent]
            )  # fmt: skip
            at[i] = origin + up @ joint.translation
            turn[i] = up @ joint.rotation @ about(joint.axis, q[i])
        return turn, at

    def where(self, q: np.ndarray) -> dict[str, np.ndarray]:
        """Points by role [m], (3,) each, in the base frame."""
        turn, at = self.frames(q)
        return {
            role: place.offset if place.joint < 0
            else at[place.joint] + turn[place.joint] @ place.offset
            for role, place in self.points.items()
        }  # fmt: skip

    def goals(self, x: np.ndarray) -> list[Goal]:
        """Goals of skeletons (m, 21).

        Each point lies along the human's bone at the robot's own length of it. A hand's frame is
        that of the anchor pose, turned the shortest way that brings its forearm along the human's.
        """
        at, (turn, _) = self.where(self.anchor), self.frames(self.anchor)
        at["neck"] = 0.5 * (at["r_shoulder"] + at["l_shoulder"])
        u = x.reshape(-1, 7, 3) @ self.base_rotation  # into the base frame
        found = {"neck": at["hip"] + np.linalg.norm(at["neck"] - at["hip"]) * u[:, 0]}
        turns = []
        for name, (before, bone) in FOLLOWS.items():
            length = np.linalg.norm(at[name] - at[before])
            found[name] = found[before] + length * u[:, bone]
            if name.endswith("hand"):
                own = (at[name] - at[before]) / length
                held = turn[self.points[name].joint]
                turns.append([shortest(own, to) @ held for to in u[:, bone]])
        points = np.stack([found[name] for name in POINTS], axis=1)
        turned = np.swapaxes(np.array(turns), 0, 1)
        return [Goal(*one) for one in zip(points, turned, x, strict=True)]


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation about a unit vector by an angle [rad], (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def shortest(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The shortest rotation from one unit vector to another, (3, 3)."""
    across, along = np.cross(a, b), float(a @ b)
    size = np.linalg.norm(across)
    if size > 1e-9:
        return about(across / size, float(np.arctan2(size, along)))
    if along > 0.0:
        return np.eye(3)
    aside = np.cross(a, np.eye(3)[np.abs(a).argmin()])
    return about(aside / np.linalg.norm(aside), np.pi)


def dump(robot: Plain) -> dict[str, Any]:
    """As JSON holds it."""
    return {
        "name": robot.name,
        "digest": robot.digest,
        "joints": [[_listed(part) for part in joint] for joint in robot.joints],
        "bodies": [[_listed(part) for part in body] for body in robot.bodies],
        "watched": [list(pair) for pair in robot.watched],
        "points": {role: [place.joint, _listed(place.offset)] for role, place in
                   robot.points.items()},
        "base_rotation": _listed(robot.base_rotation),
        "anchor": _listed(robot.anchor),
        "margin": robot.margin,
        "acceleration": _listed(robot.acceleration),
    }  # fmt: skip


def load(file: Path) -> Plain:
    """What `dump` gave, from a file."""
    tree = json.loads(Path(file).read_text(encoding="utf-8"))
    return Plain(
        tree["name"], tree["digest"],
        tuple(Joint(n, p, np.array(r), np.array(t), np.array(a), *rest)
              for n, p, r, t, a, *rest in tree["joints"]),
        tuple(Capsule(j, np.array(a), np.array(b), r) for j, a, b, r in tree["bodies"]),
        tuple((a, b) for a, b in tree["watched"]),
        {role: Place(j, np.array(at)) for role, (j, at) in tree["points"].items()},
        np.array(tree["base_rotation"]), np.array(tree["anchor"]), tree["margin"],
        np.array(tree["acceleration"]),
    )  # fmt: skip


def _listed(part: Any) -> Any:
    return part.tolist() if isinstance(part, np.ndarray) else part


class Written(NamedTuple):
    """A robot as a URDF, and what its links are called."""

    text: str
    bodies: tuple[str, ...]  # link of each capsule
    points: dict[str, str]  # role -> link
    joints: tuple[str, ...]  # link that each joint carries


class Writer:
    """Writes a robot as a URDF."""

    def __init__(self, robot: Plain, speed: np.ndarray | None = None) -> None:
        """Of a robot; speed [rad/s], (n,): instead of its own."""
        self._robot = robot
        self._speed = robot.speed if speed is None else speed

    @cached_property
    def bare(self) -> Written:
        """Without anything to collide."""
        return self._written("")

    @cached_property
    def pieces(self) -> Written:
        """Each capsule as a cylinder and two spheres, which every reader of URDF knows."""
        return self._written("pieces")

    @cached_property
    def capsules(self) -> Written:
        """Capsules as they are: URDF 1.2, which urdfdom 6 reads."""
        return self._written("capsules")

    def _written(self, shapes: str) -> Written:
        robot = self._robot
        joints = tuple(f"link_{i}" for i in range(len(robot.joints)))
        parts, lines = [_link("base")], []
        for i, joint in enumerate(robot.joints):
            parts.append(_link(joints[i]))
            origin = _origin(joint.translation, joint.rotation)
            lines.append(
                f'<joint name="{joint.name}" type="revolute"><parent link='
                f'"{_parent(joints, joint.parent)}"/><child link="{joints[i]}"/>{origin}'
                f'<axis xyz="{_three(joint.axis)}"/><limit lower="{joint.lower!r}" '
                f'upper="{joint.upper!r}" effort="1000" velocity="{float(self._speed[i])!r}"/>'
                "</joint>"
            )
        bodies = tuple(f"body_{i}" for i in range(len(robot.bodies)))
        for name, body in zip(bodies, robot.bodies, strict=True):
            parts.append(_link(name, _shapes(body, shapes == "capsules") if shapes else ""))
            lines.append(_fixed(name, _parent(joints, body.joint), _middle(body), _turn(body)))
        points = {role: f"point_{role}" for role in POINTS}
        for role, name in points.items():
            place = robot.points[role]
            parts.append(_link(name))
            lines.append(_fixed(name, _parent(joints, place.joint), place.offset, np.eye(3)))
        version = ' version="1.2"' if shapes == "capsules" else ""
        text = "\n".join([f'<robot name="{robot.name}"{version}>', *parts, *lines, "</robot>", ""])
        return Written(text, bodies, points, joints)


def capsule_places(robot: Plain) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Of each capsule its middle [m], how its z lies along it (3, 3), and half its segment [m]."""
    return [(_middle(b), _turn(b), _half(b)) for b in robot.bodies]


def _middle(body: Capsule) -> np.ndarray:
    return 0.5 * (body.a + body.b)


def _half(body: Capsule) -> float:
    return float(0.5 * np.linalg.norm(body.b - body.a))


def _turn(body: Capsule) -> np.ndarray:
    half = _half(body)
    return np.eye(3) if half < 1e-9 else shortest(np.eye(3)[2], (body.b - body.a) / (2.0 * half))


def _parent(joints: tuple[str, ...], joint: int) -> str:
    return "base" if joint < 0 else joints[joint]


def _link(name: str, shapes: str = "") -> str:
    inertia = 'ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"'
    return (
        f'<link name="{name}"><inertial><mass value="0.1"/><inertia {inertia}/></inertial>'
        f"{shapes}</link>"
    )


def _shapes(body: Capsule, whole: bool) -> str:
    half, radius = _half(body), body.radius
    sphere = f'<geometry><sphere radius="{radius!r}"/></geometry></collision>'
    if half < 1e-9:
        return f"<collision>{sphere}"
    if whole:
        capsule = f'<capsule radius="{radius!r}" length="{2.0 * half!r}"/>'
        return f"<collision><geometry>{capsule}</geometry></collision>"
    return (
        f'<collision><geometry><cylinder radius="{radius!r}" length="{2.0 * half!r}"/></geometry>'
        f'</collision><collision><origin xyz="0 0 {half!r}"/>{sphere}'
        f'<collision><origin xyz="0 0 {-half!r}"/>{sphere}'
    )


def _fixed(name: str, parent: str, at: np.ndarray, turn: np.ndarray) -> str:
    return (
        f'<joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f"{_origin(at, turn)}</joint>"
    )


def _origin(at: np.ndarray, turn: np.ndarray) -> str:
    pitch = -np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))
    if abs(turn[2, 0]) < 1.0 - 1e-12:
        roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = 0.0, np.arctan2(-turn[0, 1], turn[1, 1])
    return f'<origin xyz="{_three(at)}" rpy="{_three(np.array([roll, pitch, yaw]))}"/>'


def _three(v: np.ndarray) -> str:
    return " ".join(repr(float(one)) for one in v)
