"""Links that never meet, whatever the angles: proven by the hulls of their parts, once.

Bodies are fatter than a robot, and two links of one limb may overlap by their bodies in every pose
although nothing brings the links themselves together. Held to that overlap (robot/pairs.py) they
would hold the robot still. Seen from the last frame C before both, the corners x and y of two hulls
depend on the joints between alone. About the middle of a box of angles |u_j - c_j| <= h_j, for a
unit vector n fixed in C (from the nearest points of the hulls at c),

    n . (y - x) >= n . (y - x) at c - sum_j |slope_j| h_j - (sum_jk rho_jk h_j h_k) / 2,

as in robot/bounded.py, with corners in the place of a core's two ends. The hulls are at least as
far apart as the least of it over y, less the greatest over x. A box is decided, or halved along the
joint that costs most.
"""

from collections.abc import Iterable
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.onboard.hulls import corners
from s3le.onboard.motion import convex
from s3le.onboard.source import Source
from s3le.robot.model import Geometry

NEVER = 0.0005  # [m], links that are never nearer never meet; paths between poses keep no more
JOINTS = 3  # between two links, at most
BOXES = 20_000  # of angles that are looked at for two solids before nothing is said
_ROUNDING = 1e-7  # [m], taken off what is proven


class Solid(NamedTuple):
    """A convex part of a link."""

    joint: int  # that moves it; -1: the base
    corners: np.ndarray  # [m], (n, 3), in the joint's frame
    shape: coal.CollisionGeometry  # their hull


class _Side(NamedTuple):
    """A solid on its way from C through its joints."""

    joints: list[int]  # from C outwards
    solid: Solid
    far: np.ndarray  # [m], (k,), no corner is ever farther from each joint's axis


def solids(robot: Geometry, source: Source) -> dict[str, list[Solid]]:
    """All parts of the links, as they collide and as they are drawn.

    Left out are links of which a part is no hull of corners: a sphere, a capsule, a flat picture.

    Args:
        robot: made from the source.
        source: its shapes are those that bodies were made around.
    """
    model, _ = robot.reduced()
    found: dict[str, list[Solid]] = {}
    for link in dict.fromkeys([*source.shapes, *source.drawn]):
        at = next((frame for frame in model.frames if frame.name == link), None)
        shapes = [*source.shapes.get(link, []), *source.drawn.get(link, [])]
        held = [corners(shape.triangles.reshape(-1, 3)) for shape in shapes]
        if at is None or link in source.unread or not all(map(len, held)):
            continue
        # What collides is often what is drawn.
        alone = [one for k, one in enumerate(held)
                 if not any(np.array_equal(one, other) for other in held[:k])]  # fmt: skip
        held = [one @ at.placement.rotation.T + at.placement.translation for one in alone]
        found[link] = [Solid(int(at.parentJoint) - 1, one, convex(one)) for one in held]
    return found


def between(source: Source, a: str, b: str) -> set[str]:
    """Names of all joints of the file between two links, those that stand still here too.

    What is proven holds for the joints that move; one that is held may be given later.
    """
    model = source.model
    paths = []
    for link in (a, b):
        joint = int(model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint)
        path = set()
        while joint > 0:
            path.add(str(model.names[joint]))
            joint = int(model.parents[joint])
        paths.append(path)
    return paths[0] ^ paths[1]


def never_nearer(
    robot: Geometry, ones: Iterable[Solid], others: Iterable[Solid], floor: float
) -> bool:
    """Are the parts of two links proven to be at least floor [m] apart at any angles?

    False says that some angles bring them nearer, that more than JOINTS joints lie between, or that
    BOXES boxes of angles did not tell.
    """
    others = list(others)
    return all(_apart(robot, one, other, floor) for one in ones for other in others)


def _apart(robot: Geometry, one: Solid, other: Solid, floor: float) -> bool:
    a, b = _sides(robot, one, other)
    joints, own = [*a.joints, *b.joints], len(a.joints)
    if not 0 < len(joints) <= JOINTS:
        return False
    low, high = robot.lower[joints], robot.upper[joints]
    bend = np.zeros((len(low), len(low)))
    for side, first in ((a, 0), (b, own)):
        for j in range(len(side.joints)):
            for k in range(len(side.joints)):
                bend[first + j, first + k] = side.far[max(j, k)]
    ask, found = coal.DistanceRequest(), coal.DistanceResult()
    left = [(0.5 * (low + high), 0.5 * (high - low))]
    for _ in range(BOXES):
        if not left:
            return True
        middle, half = left.pop()
        at = [_place(robot, side, u) for side, u in ((a, middle[:own]), (b, middle[own:]))]
        put = [coal.Transform3s(R, p) for R, p, _, _ in at]
        found.clear()
        gap = coal.distance(one.shape, put[0], other.shape, put[1], ask, found)
        if not gap >= floor:
            return False
        n = np.asarray(found.normal)
        near, fall = [], []
        for (R, p, axes, origins), side, sign in ((at[0], a, -1.0), (at[1], b, 1.0)):
            points = side.solid.corners @ R.T + p
            slopes = np.array([
                np.abs((points - origin) @ np.cross(n, axis))
                for axis, origin in zip(axes, origins, strict=True)
            ]).reshape(len(axes), len(points))  # fmt: skip
            lost = slopes * half[:own, None] if sign < 0.0 else slopes * half[own:, None]
            reach = sign * (points @ n) - lost.sum(axis=0)
            k = int(reach.argmin())
            near.append(float(reach[k]))
            fall.append(lost[:, k])
        curved = half @ bend
        if sum(near) - 0.5 * float(half @ curved) - _ROUNDING >= floor:
            continue
        j = int((np.concatenate(fall) + half * curved).argmax())
        half = half.copy()
        half[j] *= 0.5
        step = np.zeros_like(half)
        step[j] = half[j]
        left += [(middle - step, half), (middle + step, half)]
    return not left


def _sides(robot: Geometry, one: Solid, other: Solid) -> tuple[_Side, _Side]:
    paths = [robot.path_to(solid.joint) for solid in (one, other)]
    shared = sum(x == y for x, y in zip(*paths, strict=False))
    made = []
    for solid, path in zip((one, other), paths, strict=True):
        joints = path[shared:]
        far = np.zeros(len(joints))
        ball = float(np.linalg.norm(solid.corners, axis=1).max())
        for k in reversed(range(len(joints))):
            joint = robot.joints[joints[k]]
            far[k] = ball
            if k == len(joints) - 1:  # nothing turns in between: the distance itself
                along = (solid.corners @ joint.axis)[:, None] * joint.axis
                far[k] = float(np.linalg.norm(solid.corners - along, axis=1).max())
            ball += float(np.linalg.norm(joint.translation))
        made.append(_Side(joints, solid, far))
    return made[0], made[1]


def _place(
    robot: Geometry, side: _Side, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """The last joint's frame in C at angles (k,) [rad], and each joint's axis and origin there."""
    R, p = np.eye(3), np.zeros(3)
    axes, origins = [], []
    for j, angle in zip(side.joints, angles, strict=True):
        joint = robot.joints[j]
        p = p + R @ joint.translation
        R = R @ joint.rotation
        axes.append(R @ joint.axis)
        origins.append(p)
        R = R @ pin.exp3(joint.axis * angle)
    return R, p, axes, origins
