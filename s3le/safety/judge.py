"""The second opinion on paths: coal at poses so dense that no body moves far between two of them.

It proves nothing, and shares no arithmetic with the proof that it judges: pinocchio's lengths,
not the kernels', say how dense is dense. Slow: a tenth of a second and more a path.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from s3le.robot.certificate import Certifier, placements
from s3le.robot.model import Geometry

_LARGEST = 1e3  # [rad], what is beyond is no angle of a robot, and too far to sample


class Verdict(NamedTuple):
    """The least clearance that was seen on a path."""

    clearance: float  # [m]; NaN: an end is not finite, or no angle
    t: float  # where on the path, 0 to 1
    pair: int  # row of the watched pair
    poses: int  # how many were looked at


class Judge:
    """Samples paths of one robot; holds a certifier, so one per thread."""

    def __init__(self, certifier: Certifier, step: float = 0.001) -> None:
        """Measure the robot.

        Args:
            certifier: what tells the clearance of a pose (Robot.certifier).
            step: most that a point of a body may move between two poses looked at [m].
        """
        self._certifier, self._step = certifier, step
        self._reach = reaches(certifier.robot)

    def path(self, q0: np.ndarray, q1: np.ndarray) -> Verdict:
        """Look at the straight path from q0 to q1 [rad], each (n_dof,), both ends included."""
        if not (np.abs([q0, q1]) <= _LARGEST).all():  # catches NaN
            return Verdict(np.nan, np.nan, -1, 0)
        q = self.poses(q0, q1)
        report = self._certifier.check(q)
        least = int(report.clearance.argmin())
        return Verdict(
            float(report.clearance[least]), least / (len(q) - 1), int(report.pair[least]), len(q)
        )

    def poses(self, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
        """Poses of the path [rad], (m, n_dof), evenly spread, both ends included.

        A point of a body moves by no more than the sum of |dq_j| times its distance from joint j.
        """
        q0, q1 = np.asarray(q0, float), np.asarray(q1, float)
        farthest = (self._reach @ np.abs(q1 - q0)).max()
        parts = max(1, int(np.ceil(farthest / self._step)))
        share = np.linspace(0.0, 1.0, parts + 1)[:, None]
        return (1.0 - share) * q0 + share * q1


def reaches(robot: Geometry) -> np.ndarray:
    """How far any point of a body can get from each joint that moves it [m], (bodies, n_dof).

    The lengths of the links between, by pinocchio, and the body's own size; 0: not moved by it.
    """
    model, geometry = robot.reduced()
    data = model.createData()
    pin.forwardKinematics(model, data, np.asarray(robot.anchor, float))
    out = np.zeros((len(robot.bodies), robot.n_dof))
    at_anchor = placements(robot, robot.anchor)
    for row, (item, body) in enumerate(zip(geometry.geometryObjects, robot.bodies, strict=True)):
        joint = item.parentJoint
        far = float(np.linalg.norm(at_anchor[row].getTranslation() - data.oMi[joint].translation))
        far += float(np.linalg.norm(body.b - body.a)) / 2 + body.radius
        while joint > 0:
            out[row, joint - 1] = far
            far += float(np.linalg.norm(model.jointPlacements[joint].translation))
            joint = model.parents[joint]
    return out
