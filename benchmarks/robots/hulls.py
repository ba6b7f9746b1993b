"""The judge of the table of robots: convex hulls of what a maker drew, and no capsule.

Two engines measure them, each with its own kinematics: coal on pinocchio's reading of the robot
file's URDF, MuJoCo on its own. Watched or not does not matter: measured is every pair of links that
can move against each other, but neighbours (no other drawn link lies between the two in the tree).
Pairs whose spheres are farther apart than FAR are passed over; that is a bound, not a guess.

A pair may overlap as it was drawn: a shoulder in its socket. How deep it does at the anchor, and at
the stand pose and zero where these are certified, is its own baseline; what counts is deeper by
`SAME`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import coal
import mujoco
import numpy as np
import pinocchio as pin

from s3le.robot.pairs import BASELINE, BOUNDED
from s3le.robot.robot import Robot
from s3le.safety import covered

FAR = 0.02  # [m], what is farther apart is not measured more exactly
SAME = 1e-3  # [m] that a pair may overlap deeper than where it stands
AGREE = 1e-3  # [m] to which the two engines agree on a pair


class Verdict(NamedTuple):
    """What was found of a motion, one entry a pair."""

    least: np.ndarray  # [m] signed, at least FAR where nothing was nearer
    deeper: np.ndarray  # int, poses at which it overlaps SAME deeper than its baseline


class Hulls:
    """The pieces of a robot and the pairs of them that are judged."""

    def __init__(self, robot: Robot, corners: Mapping[str, np.ndarray]) -> None:
        """Settle which pairs are judged.

        Args:
            robot: whose links these are.
            corners: of each piece, LINK/K -> (n, 3) [m] in the link's frame.
        """
        self.robot, self.names = robot, list(corners)
        model, _ = robot.reduced()
        frames = [
            model.frames[model.getFrameId(name.rpartition("/")[0], pin.FrameType.BODY)]
            for name in self.names
        ]
        self.joint = np.array([frame.parentJoint for frame in frames])
        self.corners = list(corners.values())
        middles = [(c.min(axis=0) + c.max(axis=0)) / 2 for c in self.corners]
        self.radius = np.array(
            [np.linalg.norm(c - m, axis=1).max()
             for c, m in zip(self.corners, middles, strict=True)]
        )  # fmt: skip
        self.middle = np.array(middles)  # in the links' frames, (k, 3)
        solid = set(self.joint.tolist())
        paths = {int(j): _path(model, int(j)) for j in solid}
        self.pairs = np.array(
            [(a, b) for a in range(len(self.names)) for b in range(a + 1, len(self.names))
             if self.joint[a] != self.joint[b]
             and solid & _between(paths[int(self.joint[a])], paths[int(self.joint[b])])]
        ).reshape(-1, 2)  # fmt: skip

    def near(self, centres: np.ndarray) -> np.ndarray:
        """Rows of pairs whose spheres are within FAR, of pieces at centres (k, 3) [m]."""
        a, b = self.pairs.T
        apart = np.linalg.norm(centres[a] - centres[b], axis=1) - self.radius[a] - self.radius[b]
        return np.flatnonzero(~(apart >= FAR))

    def links(self, row: int) -> tuple[str, str]:
        """The two links of a pair."""
        a, b = (self.names[k].rpartition("/")[0] for k in self.pairs[row])
        return a, b


class Coal:
    """coal's distances on pinocchio's kinematics."""

    name = "coal"

    def __init__(self, hulls: Hulls) -> None:
        """Build the hulls."""
        self.hulls = hulls
        self._model, _ = hulls.robot.reduced()
        self._data = self._model.createData()
        self._at = [
            self._model.frames[
                self._model.getFrameId(name.rpartition("/")[0], pin.FrameType.BODY)
            ].placement
            for name in hulls.names
        ]
        self._shapes = [_convex(corners) for corners in hulls.corners]
        self._how, self._found = coal.DistanceRequest(), coal.DistanceResult()
        self._how.enable_signed_distance = True

    def measure(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows of near pairs at one pose q (n_dof,) [rad], and their signed distances [m]."""
        pin.forwardKinematics(self._model, self._data, q)
        placed = [self._data.oMi[int(j)] * at
                  for j, at in zip(self.hulls.joint, self._at, strict=True)]  # fmt: skip
        rows = self.hulls.near(
            np.array([at.act(m) for at, m in zip(placed, self.hulls.middle, strict=True)])
        )
        put = [coal.Transform3s(at.rotation, at.translation) for at in placed]
        apart = np.empty(len(rows))
        for i, (a, b) in enumerate(self.hulls.pairs[rows]):
            self._found.clear()
            apart[i] = coal.distance(
                self._shapes[a], put[a], self._shapes[b], put[b], self._how, self._found
            )
        return rows, apart


class Mujoco:
    """MuJoCo's own reading of the robot file's URDF, its hulls and its distances."""

    name = "mujoco"

    def __init__(self, hulls: Hulls) -> None:
        """Let MuJoCo read the URDF, and put the hulls in the place of its bodies."""
        self.hulls, robot = hulls, hulls.robot
        text = robot.description.files["urdf"].decode("utf-8")
        spec = mujoco.MjSpec.from_string(text)
        spec.compiler.fusestatic = False
        spec.compiler.boundmass = spec.compiler.boundinertia = 1.0  # only places are asked for
        bodies = {body.name: body for body in spec.bodies}
        for body in bodies.values():
            for geom in list(body.geoms):
                spec.delete(geom)
        for k, (name, corners) in enumerate(zip(hulls.names, hulls.corners, strict=True)):
            spec.add_mesh(name=f"hull{k}", uservert=corners.ravel())
            bodies[name.rpartition("/")[0]].add_geom(
                name=f"hull{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"hull{k}"
            )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        for joint, angle in robot.description.hold.items():
            self._data.qpos[self._model.joint(joint).qposadr[0]] = angle
        self._at = np.array([self._model.joint(name).qposadr[0] for name in robot.joint_names])
        self._geom = [self._model.geom(f"hull{k}").id for k in range(len(hulls.names))]
        self._body = self._model.geom_bodyid[self._geom]

    def measure(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See Coal.measure."""
        self._data.qpos[self._at] = q
        mujoco.mj_kinematics(self._model, self._data)
        turn = self._data.xmat[self._body].reshape(-1, 3, 3)
        rows = self.hulls.near(
            self._data.xpos[self._body] + np.einsum("kij,kj->ki", turn, self.hulls.middle)
        )
        apart = np.array(
            [mujoco.mj_geomDistance(
                self._model, self._data, self._geom[a], self._geom[b], 10.0, None
            ) for a, b in self.hulls.pairs[rows]]
        )  # fmt: skip
        return rows, apart


def baseline(engine: Coal | Mujoco) -> np.ndarray:
    """How deep each pair overlaps as drawn: its least distance [m], at most 0."""
    robot = engine.hulls.robot
    zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
    certifier = robot.certifier()
    others = [zero, *([] if robot.stand is None else [robot.stand])]
    poses = [robot.anchor, *(q for q in others if certifier.one(q)[0] >= robot.margin)]
    least = np.full(len(engine.hulls.pairs), FAR)
    for q in poses:
        rows, apart = engine.measure(q)
        least[rows] = np.minimum(least[rows], apart)
    return np.minimum(least, 0.0)


def judge(engine: Coal | Mujoco, q: np.ndarray) -> Verdict:
    """Measure poses q (n, n_dof) [rad]. What cannot be measured counts as an overlap."""
    allowed = baseline(engine) - SAME
    least = np.full(len(engine.hulls.pairs), FAR)
    deeper = np.zeros(len(least), int)
    for pose in q:
        rows, apart = engine.measure(pose)
        apart = np.where(np.isfinite(apart), apart, -np.inf)
        least[rows] = np.minimum(least[rows], apart)
        deeper[rows] += ~((apart >= 0.0) | (apart >= allowed[rows]))
    return Verdict(least, deeper)


def claimed(hulls: Hulls, rows: np.ndarray) -> list[str]:
    """Which of these pairs a certificate says are apart: watched, of links that bodies cover.

    Of pairs that overlap by design it says how deep their bodies do, and not their drawings.
    """
    robot = hulls.robot
    bare = {frozenset(body.rpartition("_")[0] for body in pair[:2]) for pair in robot.unwatched()}
    bare |= {
        frozenset((robot.bodies[pair.a].link, robot.bodies[pair.b].link))
        for pair in robot.pairs if pair.reason in (BASELINE, BOUNDED)
    }  # fmt: skip
    record = covered.read(robot)
    beyond = {item.link for item in record.beyond} if record else set()
    pairs = [hulls.links(int(row)) for row in rows]
    return sorted(
        {
            " and ".join(pair)
            for pair in pairs
            if frozenset(pair) not in bare and not beyond & {*pair}
        }
    )


def between(q: np.ndarray, v: np.ndarray, dt: np.ndarray, count: int) -> np.ndarray:
    """All rows and `count` poses between any two, on the curve: even acceleration from v to v'.

    Args:
        q: rows [rad], (n, k).
        v: their speeds [rad/s], (n, k).
        dt: times between them [s], (n - 1,).
        count: poses within a step.
    """
    share = np.arange(1, count + 2)[:, None] / (count + 1)
    parts = [q[:1]]
    for i, step in enumerate(dt):
        t = share * step
        parts.append(q[i] + v[i] * t + (v[i + 1] - v[i]) * t**2 / (2.0 * step))
    return np.concatenate(parts)


def _convex(corners: np.ndarray) -> coal.CollisionGeometry:
    points = coal.StdVec_Vec3s()
    for corner in corners:
        points.append(corner)
    return coal.Convex.convexHull(points, True, "Qt")


def _path(model: pin.Model, joint: int) -> list[int]:
    path = [joint]
    while path[-1] > 0:
        path.append(int(model.parents[path[-1]]))
    return path[::-1]


def _between(one: list[int], two: list[int]) -> set[int]:
    """Joints on the way from the end of one path to the end of the other, the ends left out."""
    shared = sum(a == b for a, b in zip(one, two, strict=False))
    return {*one[shared - 1 :], *two[shared - 1 :]} - {one[-1], two[-1]}
