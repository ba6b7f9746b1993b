"""The independent check: pinocchio places the robot's capsules, coal measures them.

It shares no arithmetic with the batched kernels, which is the point: what a kernel computes is
certified here before any table stores it. A pose that is not finite is never safe.
"""

from collections.abc import Callable
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import CertificateError, RobotError
from s3le.robot.model import Geometry

# coal compares squared lengths, and length^2 length^2 sine^2 of two axes, with 2e-14. In metres
# that takes limbs 1e-5 rad apart for parallel (1e-6 m off) and, at worst, costs a limb's length
# beside a segment of a micrometre. In a unit of 2^-20 m nothing real is that small, and a power
# of two changes no digit of any other distance.
PER_METRE = 2.0**20


class Report(NamedTuple):
    """What the check found, one entry a pose."""

    clearance: np.ndarray  # [m], (n,), least signed distance over the watched pairs; NaN: no pose
    pair: np.ndarray  # int64 (n,), row of the watched pair that is closest; -1: no pose
    limit_margin: np.ndarray  # [rad], (n,), least distance to a joint limit; negative: outside


class Certifier:
    """Measures poses of one robot; holds pinocchio's scratch space, so one per thread."""

    def __init__(
        self, robot: Geometry, watched: np.ndarray, slack: np.ndarray | None = None
    ) -> None:
        """Build the collision model.

        Args:
            robot: whose poses are checked.
            watched: body indices of the pairs to measure, int (n_pairs, 2).
            slack: what is added to each pair's distance [m], (n_pairs,); None: nothing.
        """
        self.robot = robot
        self._model, self._geometry = _models(robot, PER_METRE)
        self._names = [body.name for body in robot.bodies]  # of every object of the geometry
        for row, (a, b) in enumerate(watched):
            two = int(a), int(b)
            if slack is not None and slack[row] != 0.0:
                two = self._thinned(two, float(slack[row]))
            self._geometry.addCollisionPair(pin.CollisionPair(*two))
        self._data = self._model.createData()
        self._scratch = pin.GeometryData(self._geometry)
        self._lower, self._upper = robot.lower, robot.upper
        self.nearest = -1  # row of the watched pair that is closest at the pose `one` saw last

    def _thinned(self, pair: tuple[int, int], slack: float) -> tuple[int, int]:
        """Copies of two capsules, thinner so that they are farther apart by slack [m]."""
        items = [self._geometry.geometryObjects[index] for index in pair]
        radii = [item.geometry.radius for item in items]
        share = 1.0 - slack * PER_METRE / sum(radii)
        if not share > 0.0:
            raise RobotError(f"{items[0].name} and {items[1].name} overlap up to their cores")
        made = []
        for index, item, radius in zip(pair, items, radii, strict=True):
            half = getattr(item.geometry, "halfLength", 0.0)
            thin = coal.Capsule(radius * share, 2.0 * half)
            name = f"{item.name} {len(self._geometry.geometryObjects)}"
            added = pin.GeometryObject(name, item.parentJoint, item.placement, thin)
            made.append(int(self._geometry.addGeometryObject(added)))
            self._names.append(self._names[index])
        return made[0], made[1]

    def check(self, q: np.ndarray, progress: Callable[[int], object] | None = None) -> Report:
        """Measure limits and clearance of each pose.

        Args:
            q: poses [rad], shape (n, n_dof).
            progress: called with a number of further poses done, now and then.

        Returns:
            Report; see its fields.
        """
        q = np.ascontiguousarray(q, float)
        clearance = np.full(len(q), np.nan)
        pair = np.full(len(q), -1, np.int64)
        finite = np.isfinite(q).all(axis=1)
        # coal is called pose by pose: it is the second opinion, and has no batched distance.
        results = self._scratch.distanceResults
        for i in np.flatnonzero(finite):
            nearest = pin.computeDistances(
                self._model, self._data, self._geometry, self._scratch, q[i]
            )
            pair[i] = nearest
            clearance[i] = results[nearest].min_distance / PER_METRE
            if progress and i % 1000 == 999:
                progress(1000)
        if progress:
            progress(len(q) % 1000)
        with np.errstate(invalid="ignore"):
            margin = np.minimum(q - self._lower, self._upper - q).min(axis=1, initial=np.inf)
        return Report(clearance, pair, np.where(finite, margin, np.nan))

    def one(self, q: np.ndarray) -> tuple[float, float]:
        """Clearance [m] and least distance to a joint limit [rad] of one pose (n_dof,), as check.

        Both are NaN for a pose that is not finite.
        """
        margin = float(np.minimum(q - self._lower, self._upper - q).min(initial=np.inf))
        self.nearest = -1
        if not margin > -np.inf:  # catches NaN
            return np.nan, np.nan
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._scratch, q)
        self.nearest = int(nearest)
        found = self._scratch.distanceResults[nearest].min_distance / PER_METRE
        return found, margin

    def require(
        self, q: np.ndarray, margin: float, progress: Callable[[int], object] | None = None
    ) -> Report:
        """Check poses that must be feasible: within limits, and margin apart everywhere.

        Raises:
            CertificateError: some pose is not; names the first, the pair or joint, and how much.
        """
        report = self.check(q, progress)
        bad = ~((report.clearance >= margin) & (report.limit_margin >= 0.0))  # catches NaN
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            why = self.why(q[row], row, margin)
            raise CertificateError(f"{bad.sum()} of {len(q)} poses are not feasible; {why}")
        return report

    def why(self, q: np.ndarray, row: int, margin: float) -> str:
        """One line on what is wrong with a pose."""
        if not np.isfinite(q).all():
            return f"row {row} is not finite"
        for joint, angle in zip(self.robot.joints, q, strict=True):
            if not joint.lower <= angle <= joint.upper:
                return (
                    f"row {row}: {joint.name} at {angle:.6f} rad is outside "
                    f"[{joint.lower:.4f}, {joint.upper:.4f}]"
                )
        report = self.check(q[None])
        item = self._geometry.collisionPairs[int(report.pair[0])]
        names = [self._names[index] for index in (item.first, item.second)]
        return (
            f"row {row}: {names[0]} and {names[1]} are {report.clearance[0] * 1e3:.4f} mm apart, "
            f"wanted at least {margin * 1e3:.4f} mm"
        )


def placements(robot: Geometry, q: np.ndarray) -> list[coal.Transform3s]:
    """World placement of every body's capsule (its axis along local z) at q [rad], (n_dof,)."""
    model, geometry = _models(robot)
    data, scratch = model.createData(), pin.GeometryData(geometry)
    pin.updateGeometryPlacements(model, data, geometry, scratch, np.asarray(q, float))
    return [coal.Transform3s(at.rotation, at.translation) for at in scratch.oMg]


def point_positions(robot: Geometry, q: np.ndarray) -> np.ndarray:
    """Positions [m] of the mapped skeleton points by pinocchio, (len(robot.points), 3).

    In the frame x forward, y left, z up. One pose; the kernels have the batched version.
    """
    model, _ = _models(robot)
    data = model.createData()
    pin.forwardKinematics(model, data, np.asarray(q, float))
    return np.array(
        [
            robot.base_rotation @ data.oMi[point.joint + 1].act(point.offset)
            for point in robot.points.values()
        ]
    )


def _models(robot: Geometry, scale: float = 1.0) -> tuple[pin.Model, pin.GeometryModel]:
    """The URDF's own kinematics, with capsules where the URDF has boxes or cylinders.

    All lengths are multiplied by scale.
    """
    model, geometry = robot.reduced()
    for at in model.jointPlacements:
        at.translation = at.translation * scale
    for item, body in zip(geometry.geometryObjects, robot.bodies, strict=True):
        at, shape = item.placement, item.geometry
        if isinstance(shape, coal.Capsule):
            shape = coal.Capsule(shape.radius * scale, 2.0 * shape.halfLength * scale)
        elif isinstance(shape, coal.Sphere):
            shape = coal.Sphere(shape.radius * scale)
        else:
            # A capsule has no front, and FromTwoVectors loses four digits short of a half turn.
            along = body.b - body.a if body.b[2] >= body.a[2] else body.a - body.b
            turn = pin.Quaternion.FromTwoVectors(np.eye(3)[2], along)
            at = pin.SE3(turn.toRotationMatrix(), (body.a + body.b) / 2)
            shape = coal.Capsule(body.radius * scale, float(np.linalg.norm(along)) * scale)
        item.placement = pin.SE3(at.rotation, at.translation * scale)
        item.geometry = shape
    return model, geometry
