"""One pose at a time, for those who look: where every joint is, and which two bodies are closest.

By pinocchio and coal, as the certificate; frames are x forward, y left, z up.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from s3le.robot.certificate import PER_METRE, Certifier
from s3le.robot.model import Geometry


class Places(NamedTuple):
    """Frames of the base and of the moving joints, the base first."""

    wxyz: np.ndarray  # unit quaternions, (n_dof + 1, 4)
    position: np.ndarray  # [m], (n_dof + 1, 3)


class Closest(NamedTuple):
    """The two watched bodies that are closest to each other."""

    clearance: float  # [m], signed
    pair: int  # row of the watched pairs
    points: np.ndarray  # [m], (2, 3), on the surface of the one and of the other


class Poser:
    """Places one robot; holds scratch: one per thread."""

    def __init__(self, robot: Geometry) -> None:
        """Make everything that does not depend on the pose."""
        self._model, _ = robot.reduced()
        self._data = self._model.createData()
        self._base = pin.SE3(np.array(robot.base_rotation), np.zeros(3))

    def place(self, q: np.ndarray) -> Places:
        """Frames at q [rad], (n_dof,)."""
        pin.forwardKinematics(self._model, self._data, np.asarray(q, float))
        at = [self._base.act(frame) for frame in self._data.oMi]
        turns = np.array([pin.Quaternion(frame.rotation).coeffs() for frame in at])  # x y z w
        return Places(turns[:, [3, 0, 1, 2]], np.array([frame.translation for frame in at]))


class Nearness(Certifier):
    """A certifier that also says where two bodies are closest."""

    def closest(self, q: np.ndarray) -> Closest:
        """The closest watched pair at q [rad], (n_dof,), finite."""
        pair = pin.computeDistances(
            self._model, self._data, self._geometry, self._scratch, np.asarray(q, float)
        )
        found = self._scratch.distanceResults[pair]
        points = np.array([found.getNearestPoint1(), found.getNearestPoint2()]) / PER_METRE
        return Closest(
            found.min_distance / PER_METRE, int(pair), points @ self.robot.base_rotation.T
        )
