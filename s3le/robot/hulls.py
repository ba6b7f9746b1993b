"""The third opinion: convex hulls of a robot's own meshes, in coal, over every pair of neighbours.

It knows nothing of capsules nor of which pairs are watched. Only links that cannot move against
each other, and neighbours (no other hull lies between the two in the tree), are left out.
"""

from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.robot.description import FARTHEST, LARGEST
from s3le.robot.model import Geometry
from s3le.store import npz

MOST_BYTES = 1 << 28  # of all hulls, unpacked


class Depths(NamedTuple):
    """What was found, one entry a pose."""

    depth: np.ndarray  # [m], (n,), how deep the deepest pair of hulls overlaps; 0: none does
    pair: np.ndarray  # int64 (n,), row of that pair in HullCheck.pairs; -1: none overlaps


class HullCheck:
    """Measures how deep hulls overlap; holds scratch space, so one per thread."""

    def __init__(self, robot: Geometry, file: Path | None = None) -> None:
        """Read the hulls.

        Args:
            robot: whose poses are measured.
            file: as onboard.hulls packs them; None: the one that the robot file names.

        Raises:
            RobotError: there is no such file, it is damaged, or names a link that is not there.
        """
        own = robot.description.files.get("hulls") if file is None else None
        file = robot.description.hulls if file is None else file
        if file is None:
            raise RobotError(
                f"{robot.description.source} names no hulls; s3le robot new --hulls writes them"
            )
        self._model, _ = robot.reduced()
        self._geometry = pin.GeometryModel()
        self.links: list[str] = []
        self._corners: list[np.ndarray] = []
        for name, corners in _arrays(file, own).items():
            link = name.rpartition("/")[0]
            if not self._model.existFrame(link, pin.FrameType.BODY):
                raise RobotError(f"{file}: '{link}' is no link of {robot.description.urdf}")
            frame = self._model.frames[self._model.getFrameId(link, pin.FrameType.BODY)]
            item = pin.GeometryObject(
                name, frame.parentJoint, frame.placement, _convex(f"{file}: '{name}'", corners)
            )
            self._geometry.addGeometryObject(item)
            self.links.append(link)
            self._corners.append(corners)
        joints = [item.parentJoint for item in self._geometry.geometryObjects]
        solid = set(joints)
        self.pairs = [
            (a, b)
            for a in range(len(joints))
            for b in range(a + 1, len(joints))
            if joints[a] != joints[b] and solid & self._between(joints[a], joints[b])
        ]
        for a, b in self.pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._data, self._scratch = self._model.createData(), pin.GeometryData(self._geometry)

    def _between(self, a: int, b: int) -> set[int]:
        """Joints on the way from one to another through the tree, neither included."""
        up = [self._path(a), self._path(b)]
        shared = sum(x == y for x, y in zip(*up, strict=False))
        return {*up[0][shared - 1 :], *up[1][shared - 1 :]} - {a, b}

    def _path(self, joint: int) -> list[int]:
        path = [joint]
        while joint > 0:
            joint = self._model.parents[joint]
            path.append(joint)
        return path[::-1]

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Signed distance of every pair at poses q (n, n_dof) [rad]: (n, pairs) [m]."""
        found = np.empty((len(q), len(self.pairs)))
        for i, pose in enumerate(np.ascontiguousarray(q, float)):
            pin.computeDistances(self._model, self._data, self._geometry, self._scratch, pose)
            found[i] = [result.min_distance for result in self._scratch.distanceResults]
        return found

    def check(self, q: np.ndarray) -> Depths:
        """Measure poses (n, n_dof) [rad]."""
        depth, pair = np.zeros(len(q)), np.full(len(q), -1, np.int64)
        if not self.pairs:
            return Depths(depth, pair)
        found = self.distances(q)
        rows = np.flatnonzero(found.min(axis=1, initial=0.0) < 0.0)
        pair[rows] = found[rows].argmin(axis=1)
        depth[rows] = -found[rows, pair[rows]]
        return Depths(depth, pair)

    def placed(self, q: np.ndarray) -> list[np.ndarray]:
        """Corners of each hull at a pose (n_dof,) [rad]: (n, 3) [m], in the base's frame."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._scratch, q)
        return [corners @ at.rotation.T + at.translation
                for corners, at in zip(self._corners, self._scratch.oMg, strict=True)]  # fmt: skip

    def name(self, row: int) -> str:
        """The two links of a pair."""
        return " and ".join(self.links[k] for k in self.pairs[row])


def _arrays(file: Path, data: bytes | None) -> dict[str, np.ndarray]:
    try:
        if data is None:
            with file.open("rb") as stream:
                data = stream.read(LARGEST + 1)
    except OSError as error:
        raise RobotError(f"{file}: not readable as hulls ({error.strerror})") from None
    if len(data) > LARGEST:
        raise RobotError(f"{file}: longer than the {LARGEST / 2**20:g} MiB of a file of hulls")
    arrays = npz.read_npz(file, RobotError, MOST_BYTES, data=data)
    for name, corners in arrays.items():
        good = corners.ndim == 2 and corners.shape[1:] == (3,) and len(corners) > 3
        if not good or corners.dtype != np.float64 or not (np.abs(corners) <= FARTHEST).all():
            raise RobotError(f"{file}: '{name}' must be corners (n, 3) within {FARTHEST:g} m")
    return arrays


def _convex(where: str, corners: np.ndarray) -> coal.CollisionGeometry:
    points = coal.StdVec_Vec3s()
    for corner in corners:
        points.append(corner)
    try:
        return coal.Convex.convexHull(points, True, "Qt")
    except (RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())[:100]
        raise RobotError(f"{where}: no hull of its corners can be built ({reason})") from None
