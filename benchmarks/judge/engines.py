"""Two engines that know the robot from its URDF and measure it, each by its own arithmetic.

coal on pinocchio's model, and MuJoCo, which parses the URDF, places the bodies and measures them
without any of the other's code. Neither uses a line of s3le/kernels. What they share is what is
promised: which links are watched, which joints move, and that a box is replaced by the capsule
that contains it.
"""

from pathlib import Path
from typing import Protocol

import coal
import numpy as np
import pinocchio as pin

from s3le.robot.model import containing_capsule_of_box, containing_capsule_of_cylinder
from s3le.robot.robot import Robot

try:
    import mujoco
except ModuleNotFoundError:  # only those who judge with it need it
    mujoco = None

UNIT = 2.0**20  # per metre: coal takes axes 1e-5 rad apart for parallel unless lengths are large
KERNELS_AGREE = 1e-7  # [m], to which engine and kernels agree on any two (tests/test_distance.py)


class Engine(Protocol):
    """Measures one robot; holds scratch, so one per thread."""

    name: str
    agrees: float  # [m], with coal, which is what the margin of a pose is promised by

    def pairs(self, q: np.ndarray) -> np.ndarray:
        """Signed distance of every watched pair at one pose q (n_dof,) [m], (n_pairs,).

        Of a pair that overlaps by design it counts as on paths (Robot.slack).
        """

    def nearest(self, q: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least signed distance [m] (m,) at poses q (m, n_dof) over watched pairs `rows`; whose."""


class Coal:
    """coal's distances on pinocchio's kinematics."""

    name = "coal"
    agrees = 1e-12  # where a box is turned into a capsule, the last digit may differ

    def __init__(self, robot: Robot, between: float) -> None:
        """Build the model from the URDF; paths keep `between` [m]."""
        self._model, self._geometry = robot.reduced()
        for at in self._model.jointPlacements:
            at.translation = at.translation * UNIT
        for item in self._geometry.geometryObjects:
            _to_capsule(item)
        number = {item.name: i for i, item in enumerate(self._geometry.geometryObjects)}
        for (a, b), slack in zip(robot.watched, robot.slack(between), strict=True):
            two = [number[robot.bodies[body].name] for body in (a, b)]
            if slack != 0.0:
                two = [self._geometry.addGeometryObject(item) for item in self._thin(two, slack)]
            self._geometry.addCollisionPair(pin.CollisionPair(*two))
        self._data = self._model.createData()
        self._whole, self._scratch = (pin.GeometryData(self._geometry) for _ in range(2))
        # These are views: what is measured next is seen in them.
        self._every = list(self._whole.distanceResults)
        self._on = np.ones(len(robot.watched), bool)  # which pairs scratch measures

    def _thin(self, two: list[int], slack: float) -> list[pin.GeometryObject]:
        """Two bodies whose radii are smaller by half of it each, at least as far as one goes."""
        items = [self._geometry.geometryObjects[index] for index in two]
        radii = np.array([item.geometry.radius for item in items])
        less = np.minimum(0.5 * slack * UNIT, radii - 1.0)
        less += (slack * UNIT - less.sum()) * np.array([less[1] > less[0], less[0] >= less[1]])
        return [
            pin.GeometryObject(
                f"{item.name} {len(self._geometry.geometryObjects) + k}", item.parentJoint,
                item.placement, coal.Capsule(radii[k] - less[k], 2.0 * item.geometry.halfLength),
            )
            for k, item in enumerate(items)
        ]  # fmt: skip

    def pairs(self, q: np.ndarray) -> np.ndarray:
        """See Engine."""
        pin.computeDistances(self._model, self._data, self._geometry, self._whole, q)
        return np.array([found.min_distance for found in self._every]) / UNIT

    def nearest(self, q: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See Engine."""
        self._watch(rows)
        results = self._scratch.distanceResults
        least, pair = np.empty(len(q)), np.empty(len(q), np.int64)
        for i, pose in enumerate(q):
            pair[i] = pin.computeDistances(
                self._model, self._data, self._geometry, self._scratch, pose
            )
            least[i] = results[int(pair[i])].min_distance
        return least / UNIT, pair

    def _watch(self, rows: np.ndarray) -> None:
        on = np.zeros(len(self._on), bool)
        on[rows] = True
        for row in np.flatnonzero(on & ~self._on):
            self._scratch.activateCollisionPair(int(row))
        for row in np.flatnonzero(self._on & ~on):
            self._scratch.deactivateCollisionPair(int(row))
        self._on = on


class Mujoco:
    """MuJoCo's reading of the URDF, its kinematics and its distances."""

    name = "mujoco"
    agrees = 1e-7

    def __init__(self, robot: Robot, between: float) -> None:
        """Let MuJoCo read the URDF; paths keep `between` [m].

        Raises:
            ImportError: mujoco is not installed.
        """
        if mujoco is None:
            raise ImportError("mujoco is not installed: pip install mujoco")
        text = robot.description
        self._model = spec_of(robot).compile()
        self._data = mujoco.MjData(self._model)
        for joint, angle in text.hold.items():
            self._data.qpos[self._model.joint(joint).qposadr[0]] = angle
        names = robot.joint_names
        self._at = np.array([self._model.joint(name).qposadr[0] for name in names])
        geom = [self._model.geom(body.name).id for body in robot.bodies]
        self._pair = [(geom[a], geom[b]) for a, b in robot.watched]
        self._slack = robot.slack(between)

    def pairs(self, q: np.ndarray) -> np.ndarray:
        """See Engine."""
        return self._distances(q, range(len(self._pair)))

    def nearest(self, q: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See Engine."""
        found = np.array([self._distances(pose, rows) for pose in q])  # (m, rows)
        which = found.argmin(axis=1)
        return found[np.arange(len(q)), which], np.asarray(rows)[which]

    def _distances(self, q: np.ndarray, rows) -> np.ndarray:
        self._data.qpos[self._at] = q
        mujoco.mj_kinematics(self._model, self._data)
        return (
            np.array(
                [
                    mujoco.mj_geomDistance(self._model, self._data, *self._pair[row], 10.0, None)
                    for row in rows
                ]
            )
            + self._slack[list(rows)]
        )


def spec_of(robot: Robot) -> "mujoco.MjSpec":
    """MuJoCo's reading of a robot's URDF, its boxes replaced by the capsules that contain them."""
    text = robot.description
    spec = mujoco.MjSpec.from_string(Path(text.urdf).read_text(encoding="utf-8"))
    spec.compiler.fusestatic = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 1.0  # only places are asked for
    for body in spec.bodies:
        for i, geom in enumerate(body.geoms):
            geom.name = f"{body.name}_{i}"
            if geom.type == mujoco.mjtGeom.mjGEOM_BOX:
                half, radius, axis = containing_capsule_of_box(np.array(geom.size))
                turn = np.zeros(4)
                mujoco.mju_quatZ2Vec(turn, axis)  # from z to the capsule's axis
                mujoco.mju_mulQuat(turn, geom.quat.copy(), turn.copy())
                geom.type, geom.quat = mujoco.mjtGeom.mjGEOM_CAPSULE, turn
                geom.size = [radius, half, 0.0]
    return spec


def _to_capsule(item: pin.GeometryObject) -> None:
    """Make a geometry the capsule that contains it, in the larger unit."""
    at, shape = capsule_of(item)
    item.placement = pin.SE3(at.rotation, np.array(at.translation) * UNIT)
    item.geometry = coal.Capsule(shape.radius * UNIT, 2.0 * shape.halfLength * UNIT)


def capsule_of(item: pin.GeometryObject) -> tuple[pin.SE3, coal.Capsule]:
    """The capsule that contains a geometry, and where it is [m].

    Raises:
        TypeError: it is another shape.
    """
    at, shape = item.placement, item.geometry
    turn = np.array(at.rotation)
    if isinstance(shape, coal.Box):
        half, radius, axis = containing_capsule_of_box(np.array(shape.halfSide))
        turn = turn @ np.roll(np.eye(3), 2 - int(np.argmax(axis)), axis=1)  # its z along the axis
        shape = coal.Capsule(radius, 2.0 * half)
    elif isinstance(shape, coal.Sphere):
        shape = coal.Capsule(shape.radius, 0.0)
    elif isinstance(shape, coal.Cylinder):
        half, radius = containing_capsule_of_cylinder(shape.radius, shape.halfLength)
        shape = coal.Capsule(radius, 2.0 * half)
    elif not isinstance(shape, coal.Capsule):
        raise TypeError(
            f"{item.name} is a {type(shape).__name__}; judged are capsules, spheres, cylinders "
            "and boxes"
        )
    return pin.SE3(turn, np.array(at.translation)), shape
