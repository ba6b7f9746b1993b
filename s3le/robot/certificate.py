"""The independent check: pinocchio places the robot's capsules, coal measures them.

It shares no arithmetic with the batched kernels, which is the point: what a kernel computes is
certified here before any table stores it. A pose that is not finite is never safe.
"""

from collections.abc import Callable
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import CertificateError
from s3le.robot.model import Robot, reduced


class Report(NamedTuple):
    """What the check found, one entry a pose."""

    clearance: np.ndarray  # [m], (n,), least signed distance over the watched pairs; NaN: no pose
    pair: np.ndarray  # int64 (n,), row of the watched pair that is closest; -1: no pose
    limit_margin: np.ndarray  # [rad], (n,), least distance to a joint limit; negative: outside


class Certifier:
    """Measures poses of one robot; holds pinocchio's scratch space, so one per thread."""

    def __init__(self, robot: Robot, watched: np.ndarray) -> None:
        """Build the collision model.

        Args:
            robot: whose poses are checked.
            watched: body indices of the pairs to measure, int (n_pairs, 2).
        """
        self.robot = robot
        self._model, self._geometry = _models(robot)
        for a, b in watched:
            self._geometry.addCollisionPair(pin.CollisionPair(int(a), int(b)))
        self._data = self._model.createData()
        self._scratch = pin.GeometryData(self._geometry)
        self._lower, self._upper = robot.lower, robot.upper

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
            clearance[i] = results[nearest].min_distance
            if progress and i % 1000 == 999:
                progress(1000)
        if progress:
            progress(len(q) % 1000)
        with np.errstate(invalid="ignore"):
            margin = np.minimum(q - self._lower, self._upper - q).min(axis=1, initial=np.inf)
        return Report(clearance, pair, np.where(finite, margin, np.nan))

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
        names = [self.robot.bodies[index].name for index in (item.first, item.second)]
        return (
            f"row {row}: {names[0]} and {names[1]} are {report.clearance[0] * 1e3:.4f} mm apart, "
            f"wanted at least {margin * 1e3:.4f} mm"
        )


def placements(robot: Robot, q: np.ndarray) -> list[coal.Transform3s]:
    """World placement of every body's capsule (its axis along local z) at q [rad], (n_dof,)."""
    model, geometry = _models(robot)
    data, scratch = model.createData(), pin.GeometryData(geometry)
    pin.updateGeometryPlacements(model, data, geometry, scratch, np.asarray(q, float))
    return [coal.Transform3s(at.rotation, at.translation) for at in scratch.oMg]


def point_positions(robot: Robot, q: np.ndarray) -> np.ndarray:
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


def _models(robot: Robot) -> tuple[pin.Model, pin.GeometryModel]:
    """The URDF's own kinematics, with capsules where the URDF has boxes or cylinders."""
    model, geometry = reduced(robot.description)
    for item, body in zip(geometry.geometryObjects, robot.bodies, strict=True):
        if isinstance(item.geometry, coal.Capsule | coal.Sphere):
            continue
        along = body.b - body.a
        turn = pin.Quaternion.FromTwoVectors(np.eye(3)[2], along)
        item.placement = pin.SE3(turn.toRotationMatrix(), (body.a + body.b) / 2)
        item.geometry = coal.Capsule(body.radius, float(np.linalg.norm(along)))
    return model, geometry
