"""Where the base link of a robot is in the world, row by row, for files that want a free base.

World: z up; x is where a heading of 0 faces. The upper body alone is retargeted, so the base stands
still at [0, 0, height] and turns about z as the human did; unless another file says where it is
(Trajectory.root). Quaternions are x y z w.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.robot.description import FARTHEST
from s3le.robot.model import Geometry
from s3le.robot.posing import Poser

STANDING = "the lowest collision body touches z = 0 at the anchor"
GIVEN = "as asked for"


class Root(NamedTuple):
    """The base link of a robot."""

    link: str  # of the URDF
    height: float  # [m], of its origin above z = 0
    because: str  # where the height is from
    turn: np.ndarray  # (4,), unit quaternion x y z w: base link -> x forward, y left, z up


def find(robot: Geometry, height: float | None = None) -> Root:
    """The base link, and how high it stands.

    Args:
        robot: whose.
        height: [m]; None: so high that the robot stands on z = 0 with its lowest body.

    Raises:
        ParameterError: height is none, or beyond FARTHEST.
    """
    if height is not None and not abs(height) <= FARTHEST:
        raise ParameterError(f"root height must be within {FARTHEST:g} m, got {height!r}")
    tree = robot.tree
    children = {child.get("link") for child in tree.iterfind("joint/child")}
    link = next(str(one.get("name")) for one in tree.iterfind("link")
                if one.get("name") not in children)  # fmt: skip
    turn = _turns(robot.description.base_rpy)
    if height is not None:
        return Root(link, float(height), GIVEN, turn)
    return Root(link, -lowest(robot, robot.anchor), STANDING, turn)


def lowest(robot: Geometry, q: np.ndarray) -> float:
    """Height of the lowest point of the URDF's collision bodies at q [rad], over the base [m].

    Boxes and cylinders are taken as they are, not as the capsules that contain them, which
    would have a flat foot stand on air.
    """
    _, geometry = robot.reduced()
    at = Poser(robot).place(q)
    found = []
    for item in geometry.geometryObjects:
        frame = item.parentJoint
        up = _up(at.wxyz[frame])  # the world's z in the joint's frame
        place, shape = item.placement, item.geometry
        centre = at.position[frame][2] + up @ place.translation
        along = place.rotation.T @ up  # the world's z in the shape's frame, a unit vector
        if hasattr(shape, "halfSide"):
            reach = np.abs(along) @ np.array(shape.halfSide)
        elif not hasattr(shape, "halfLength"):
            reach = shape.radius  # a sphere
        elif type(shape).__name__ == "Cylinder":
            reach = abs(along[2]) * shape.halfLength
            reach += np.sqrt(max(1.0 - along[2] ** 2, 0.0)) * shape.radius
        else:
            reach = abs(along[2]) * shape.halfLength + shape.radius
        found.append(centre - reach)
    return float(min(found))


def _up(wxyz: np.ndarray) -> np.ndarray:
    """Third row of a quaternion's rotation matrix, (3,)."""
    w, x, y, z = wxyz
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def positions(root: Root, rows: int) -> np.ndarray:
    """Origin of the base link in the world [m], (rows, 3)."""
    return np.tile([0.0, 0.0, root.height], (rows, 1))


def turned(root: Root, heading: np.ndarray) -> np.ndarray:
    """Orientation of the base link in the world: heading about z after the base's own turn.

    Args:
        root: the base link.
        heading: unwrapped [rad], (n,), so that quaternions do not jump in sign.

    Returns:
        Unit quaternions x y z w, (n, 4).
    """
    about_z = np.zeros((len(heading), 4))
    about_z[:, 2], about_z[:, 3] = np.sin(heading / 2), np.cos(heading / 2)
    return _product(about_z, np.broadcast_to(root.turn, about_z.shape))


def _turns(rpy: tuple[float, float, float]) -> np.ndarray:
    """Quaternion x y z w of roll, pitch and yaw [rad], as URDFs mean them; w is not negative."""
    made = np.array([[0.0, 0.0, 0.0, 1.0]])
    for axis, angle in enumerate(rpy):
        one = np.zeros((1, 4))
        one[0, axis], one[0, 3] = np.sin(angle / 2), np.cos(angle / 2)
        made = _product(one, made)
    return made[0] if made[0, 3] >= 0.0 else -made[0]


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products of quaternions x y z w, (n, 4): first b's turn, then a's."""
    v, w, u, s = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = w * u + s * v + np.cross(v, u)
    return np.hstack([vector, w * s - (v * u).sum(axis=1, keepdims=True)])
