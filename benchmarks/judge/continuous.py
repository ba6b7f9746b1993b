"""A judge that proves: the continuous validation of HPP, the Humanoid Path Planner of LAAS-CNRS.

It is the theory that s3le/safety/segment.py rests on (a distance at a pose, and a bound on how
fast two bodies can near each other, clear a part of the path around it), in other code: HPP's own
bounds on velocities, its own intervals, coal's distances, pinocchio's kinematics. It has the first
order bound alone.

The robot is handed over as a URDF written here: the joints that move, and for every body a
capsule on a link of its own, thicker by half the clearance that a path must keep, so that bodies
which touch there are as near as they may be. Which pairs are looked at is said by an SRDF.
Lengths are in a unit of 2^-20 m, as for coal (engines.py).
"""

import ctypes
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from engines import KERNELS_AGREE, UNIT, capsule_of

from s3le.robot.robot import Robot

_LIBRARIES = ("libboost_*.so.*", "libqpOASES.so*", "libhpp-*.so*")


def installed() -> bool:
    """Whether HPP is here at all; that it cannot be loaded although it is, load says."""
    return find_spec("pyhpp") is not None


class Proof(NamedTuple):
    """What HPP says of one path."""

    free: bool
    t: float  # share of the path where a pose was found that is too close; NaN: none


def load():
    """HPP's modules (core, pinocchio, urdf), its libraries found beside pinocchio's.

    The wheels hold libraries that look for each other where only the loader's own variable would
    find them; loaded by their full names before, nothing has to be looked for.

    Raises:
        ImportError: HPP is not installed, or not as these versions are.
    """
    if not installed():
        raise ImportError("HPP is not installed: make hpp")
    folder = Path(pin.__file__).parents[3]
    left = sorted({path for name in _LIBRARIES for path in folder.glob(name)})
    while left:
        missing, last = [], None
        for path in left:
            try:
                ctypes.CDLL(str(path))
            except OSError as error:
                missing.append(path)
                last = error
        if len(missing) == len(left):  # some are of no use here; what is of use says so itself
            break
        left = missing
    try:
        with warnings.catch_warnings():  # its parts make the same converters known twice
            warnings.filterwarnings("ignore", "to-Python converter", RuntimeWarning)
            from pyhpp import core
            from pyhpp import pinocchio as device
            from pyhpp.pinocchio import urdf
    except ImportError as error:
        more = f"; {last}" if left else ""
        raise ImportError(f"HPP cannot be loaded: {error}{more}") from None
    return core, device, urdf


class Heard:
    """What it said of many paths, beside what coal saw in samples of the same ones."""

    def __init__(self) -> None:
        """Nothing yet."""
        self.steps = self.refused = self.unexplained = self.missed = 0

    def add(self, said: Proof, seen: float, there: float, between: float) -> bool:
        """Count a path; True where it is refused.

        Args:
            said: of the path.
            seen: least clearance that coal saw on it [m].
            there: clearance by coal at the pose that the refusal names [m]; NaN: none is named.
            between: clearance that the path must keep [m].
        """
        self.steps += 1
        self.refused += not said.free
        # A refusal is explained by a pose that coal finds too close as well.
        self.unexplained += not said.free and not there < between
        self.missed += said.free and not seen >= between - KERNELS_AGREE
        return not said.free

    def record(self) -> dict[str, int]:
        """As JSON holds it."""
        return dict(vars(self))


class Continuous:
    """Proves straight joint paths of one robot; holds scratch, so one per thread."""

    name = "hpp"

    def __init__(self, robot: Robot, between: float) -> None:
        """Write the robot as HPP reads it.

        Args:
            robot: the robot; of it are used the URDF and what is watched.
            between: clearance that a path must keep [m].

        Raises:
            ImportError: see load.
            RuntimeError: HPP understood another robot than was meant.
        """
        core, device, urdf = load()
        text, rules = written(robot, between - KERNELS_AGREE)
        self._robot = device.Device(robot.name)
        urdf.loadModelFromString(self._robot, 0, "", "anchor", text, rules, pin.SE3.Identity())
        names = list(self._robot.model().names)[1:]
        pairs = {
            frozenset(self._body(index) for index in (pair.first, pair.second))
            for pair in self._robot.geomModel().collisionPairs
        }
        wanted = {frozenset(two) for two in _watched(robot)}
        if names != robot.joint_names or pairs != wanted:
            raise RuntimeError(f"HPP reads {robot.name} as another robot; it cannot judge")
        self._proof = core.Dichotomy(self._robot, 0.0)
        self._path, self._space = core.StraightPath, self._robot.configSpace()
        self._whole = core.interval()
        self._whole.first, self._whole.second = 0.0, 1.0

    def path(self, q0: np.ndarray, q1: np.ndarray) -> Proof:
        """Prove the straight path from q0 to q1 [rad], finite, or name a pose that is too close."""
        if (q0 == q1).all():  # a path of no length has no speed to divide by
            free, _ = self._proof.validateConfiguration(q0)
            return Proof(bool(free), np.nan if free else 0.0)
        path = self._path(self._space, q0, q1, self._whole, None)
        free, _, report = self._proof.validate(path, False)
        return Proof(bool(free), np.nan if free else float(report.parameter))

    def _body(self, index: int) -> int:
        return int(self._robot.geomModel().geometryObjects[index].name[1:].rpartition("_")[0])


def _watched(robot: Robot) -> list[tuple[int, int]]:
    """Pairs of bodies as they are written: of one that overlaps by design, its own copies."""
    pairs, count = [], len(robot.bodies)
    for (a, b), slack in zip(robot.watched.tolist(), robot.slack(), strict=True):
        pairs.append((a, b) if slack == 0.0 else (count, count + 1))
        count += 0 if slack == 0.0 else 2
    return pairs


def written(robot: Robot, between: float) -> tuple[str, str]:
    """URDF and SRDF of a robot whose bodies touch where they are `between` [m] apart."""
    model, geometry = robot.reduced()
    lines = [f'<link name="l{i}"/>' for i in range(model.njoints)]
    for j, joint in enumerate(robot.joints, start=1):
        data = model.joints[j].createData()
        model.joints[j].calc(data, np.zeros(model.nq))
        axis = np.array(data.S).reshape(6)[3:]
        lines.append(
            f'<joint name="{joint.name}" type="revolute"><parent link="l{model.parents[j]}"/>'
            f'<child link="l{j}"/>{_origin(model.jointPlacements[j])}<axis xyz="{_row(axis)}"/>'
            f'<limit lower="{joint.lower!r}" upper="{joint.upper!r}" velocity="1" effort="1"/>'
            "</joint>"
        )
    parts = [(k, 0.0) for k in range(len(robot.bodies))]
    for (a, b), slack in zip(robot.watched, robot.slack(between), strict=True):
        if slack != 0.0:  # a pair that overlaps by design: thinner copies of its own
            share = slack / (robot.bodies[a].radius + robot.bodies[b].radius)
            parts += [(int(k), float(share * robot.bodies[k].radius)) for k in (a, b)]
    for k, (source, less) in enumerate(parts):
        item = geometry.geometryObjects[source]
        placement, capsule = capsule_of(item)
        lines.append(
            f'<link name="b{k}"><collision><geometry><capsule '
            f'radius="{(capsule.radius - less + between / 2) * UNIT!r}" '
            f'length="{2.0 * capsule.halfLength * UNIT!r}"/></geometry></collision></link>'
            f'<joint name="to_b{k}" type="fixed"><parent link="l{item.parentJoint}"/>'
            f'<child link="b{k}"/>{_origin(placement)}</joint>'
        )
    watched = {frozenset(two) for two in _watched(robot)}
    rules = [
        f'<disable_collisions link1="b{a}" link2="b{b}" reason="not watched"/>'
        for a in range(len(parts))
        for b in range(a)
        if frozenset((a, b)) not in watched
    ]
    head, tail = f'<?xml version="1.0"?><robot name="{robot.name}" version="1.1">', "</robot>"
    return "\n".join([head, *lines, tail]), "\n".join([head, *rules, tail])


def _origin(at: pin.SE3) -> str:
    turn = pin.rpy.matrixToRpy(at.rotation)
    return f'<origin xyz="{_row(np.array(at.translation) * UNIT)}" rpy="{_row(turn)}"/>'


def _row(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
