"""Bodies that contain whatever joints that others move do within their ranges.

A body rides on ranged joints j, each anywhere in its range. Seen from the last frame before them,
it sweeps a region. That is covered by capsules, each for a box of angles and a part of the body's
core, thick enough to contain that part at every angle of the box:

- of a point, turning joint j by up to u_j about where it stands moves it by no more than u_j times
  its distance from the axis. Joints are turned one after the other, those farthest out first, so
  that each later axis still stands where it stood, and the distance from it has grown by no more
  than what the point was moved before. The sum bounds where the point can get to.
- of one joint the way may be followed instead: the middle of the part runs along an arc, which lies
  within its sagitta, rho (1 - cos u_j), of its chord; the capsule lies along the chord.

A rigid motion moves the points between two ends no farther than the farther one of these. Boxes are
halved, and cores too, where a body is made thickest, until a body has its share of capsules.
"""

import heapq
import re
from itertools import count
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.robot.description import Description

MOST = 8  # capsules that a body is covered by, at most
FINE = 0.02  # [m], by which a body may be thicker without being divided on
PART = "~"  # between a body's name and the number of a part of what it sweeps


class Capsule(NamedTuple):
    """All points within radius of a segment."""

    a: np.ndarray  # [m], (3,)
    b: np.ndarray
    radius: float  # [m]


class _Cell(NamedTuple):
    """A box of angles and a part of a core."""

    middle: np.ndarray  # [rad], (m,), of the box
    half: np.ndarray  # [rad], (m,)
    start: float  # of the core, 0 to 1
    stop: float


class Turning:
    """A core on its way through ranged joints, from the frame before them."""

    def __init__(self, placements: list[pin.SE3], axes: list[np.ndarray], a, b) -> None:
        """Take note of the chain.

        Args:
            placements: m + 1; of each joint in the frame of the one before it, then of the core.
            axes: m, of the joints, in their own frames, (3,).
            a, b: ends of the core, where it is placed [m], (3,).
        """
        self._placements, self._axes, self._a, self._b = placements, axes, a, b

    def at(self, angles: np.ndarray, share: float) -> np.ndarray:
        """A point of the core [m], (3,)."""
        point = self._placements[-1].act((1.0 - share) * self._a + share * self._b)
        for j in reversed(range(len(self._axes))):
            turned = pin.exp3(self._axes[j] * angles[j]) @ point
            point = self._placements[j].act(turned)
        return point

    def around(self, cell: _Cell) -> Capsule:
        """A capsule, its radius that of the core alone, which contains all of a cell."""
        ends = [cell.start, cell.stop]
        a, b = (self.at(cell.middle, share) for share in ends)
        best = Capsule(a, b, max(self._moved(cell, share, -1) for share in ends))
        middle = 0.5 * (cell.start + cell.stop)
        length = (cell.stop - cell.start) * float(np.linalg.norm(self._b - self._a))
        for j, half in enumerate(cell.half):
            if not 0.0 < half < np.pi / 2:
                continue
            radius = 0.5 * length + self._moved(cell, middle, j)
            if radius < best.radius:
                tips = []
                for sign in (-1.0, 1.0):
                    angles = cell.middle.copy()
                    angles[j] += sign * half
                    tips.append(self.at(angles, middle))
                best = Capsule(tips[0], tips[1], radius)
        return best

    def _moved(self, cell: _Cell, share: float, along: int) -> float:
        """How far a point can get from where it is in the middle, or from a chord of joint `along`.

        Within a box of angles; [m].
        """
        point = self._placements[-1].act((1.0 - share) * self._a + share * self._b)
        total = arc = sagitta = 0.0
        for j in reversed(range(len(self._axes))):
            axis = self._axes[j]
            away = float(np.linalg.norm(point - (point @ axis) * axis))
            if j == along:
                sagitta, arc = away * (1.0 - np.cos(cell.half[j])), away * cell.half[j]
            else:
                total += cell.half[j] * (away + total + arc)
            point = self._placements[j].act(pin.exp3(axis * cell.middle[j]) @ point)
        return total + sagitta


def cover(turning: Turning, low: np.ndarray, high: np.ndarray, most: int = MOST) -> list[Capsule]:
    """Capsules that contain a core wherever it can be; radii are those beyond the core's own.

    Args:
        turning: the core and its joints.
        low, high: ranges of the joints [rad], (m,).
        most: how many capsules.
    """
    order = count()
    whole = _Cell(0.5 * (low + high), 0.5 * (high - low), 0.0, 1.0)
    heap = [(-turning.around(whole).radius, next(order), whole)]
    while len(heap) < most and -heap[0][0] > FINE:
        cell = heapq.heappop(heap)[2]
        choices = [_halves(cell, j) for j in range(-1, len(low)) if j < 0 or cell.half[j] > 0.0]
        worst = [max(turning.around(part).radius for part in parts) for parts in choices]
        for part in choices[int(np.argmin(worst))]:
            heapq.heappush(heap, (-turning.around(part).radius, next(order), part))
    return [turning.around(cell) for _, _, cell in sorted(heap, key=lambda one: one[1])]


def _halves(cell: _Cell, joint: int) -> tuple[_Cell, _Cell]:
    """Both halves of a cell, by a joint or, -1, by the core."""
    if joint < 0:
        middle = 0.5 * (cell.start + cell.stop)
        return cell._replace(stop=middle), cell._replace(start=middle)
    half, parts = cell.half.copy(), []
    half[joint] *= 0.5
    for sign in (-1.0, 1.0):
        at = cell.middle.copy()
        at[joint] += sign * half[joint]
        parts.append(cell._replace(middle=at, half=half))
    return parts[0], parts[1]


def sweep(
    text: Description,
    model: pin.Model,
    geometry: pin.GeometryModel,
    capsules: list[Capsule],
    still: np.ndarray,
) -> pin.GeometryModel:
    """Geometry in which bodies on ranged joints are replaced by what contains all they sweep.

    Args:
        text: says which ranges.
        model, geometry: of the whole URDF.
        capsules: of its shapes, in the frames of the joints that carry them.
        still: angles of all its joints where those that do not move are held, (nq,).

    Raises:
        RobotError: a ranged joint is not revolute, or a range leaves its limits or its hold.
    """
    ranged = _ranged(text, model, still)
    made = pin.GeometryModel()
    data = model.createData()
    pin.forwardKinematics(model, data, still)
    for item, body in zip(geometry.geometryObjects, capsules, strict=True):
        path, j = [], int(item.parentJoint)
        while j:
            path.append(j)
            j = int(model.parents[j])
        path = path[::-1]
        on = [j for j in path if j in ranged]
        if not on:
            made.addGeometryObject(item.copy())
            continue
        moving = [i for i, j in enumerate(path) if model.names[j] in text.joints]
        if any(i > path.index(on[0]) for i in moving):
            raise RobotError(
                f"{text.source}: given.{model.names[on[0]]} carries joints that are decided here; "
                "a range is for joints that carry none of ours"
            )
        low, high = np.array([ranged[j] for j in on]).T
        turning = _turning(model, data, still, on, int(item.parentJoint), body)
        base = int(model.parents[on[0]])
        for number, one in enumerate(cover(turning, low, high)):
            name = f"{item.name}{PART}{number}"
            made.addGeometryObject(_object(name, item, base, one, body.radius))
    return made


def _ranged(
    text: Description, model: pin.Model, still: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Joints of the model that have ranges [rad].

    Raises:
        RobotError: one is not revolute, or its range leaves its limits or its hold.
    """
    ranged: dict[int, tuple[float, float]] = {}
    for name, (low, high) in text.ranges.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq != 1 or "R" not in joint.shortname():
            raise RobotError(f"{text.source}: given.{name}: only revolute joints have ranges")
        least, top = (float(end[joint.idx_q]) for end in (
            model.lowerPositionLimit, model.upperPositionLimit))  # fmt: skip
        if not least - 1e-9 <= low <= high <= top + 1e-9:
            raise RobotError(
                f"{text.source}: given.{name}: [{low:g}, {high:g}] is not within its limits "
                f"[{least:.4f}, {top:.4f}]"
            )
        hold = float(still[joint.idx_q])
        if not low <= hold <= high:
            raise RobotError(
                f"{text.source}: {name} is held at {hold:g} rad, outside its range "
                f"[{low:g}, {high:g}]; give a hold within it"
            )
        ranged[model.getJointId(name)] = (low, high)
    return ranged


def _turning(
    model: pin.Model, data: pin.Data, still: np.ndarray, on: list[int], joint: int, core: Capsule
) -> Turning:
    """A core on `joint`, on its way through ranged joints `on`; others stand as they are held."""
    placements, axes = [], []
    last = data.oMi[int(model.parents[on[0]])]
    for j in on:
        kind = model.joints[j]
        before = data.oMi[int(model.parents[j])] * model.jointPlacements[j]
        placements.append(last.actInv(before))
        frame = kind.createData()
        kind.calc(frame, np.zeros(model.nq))
        axes.append(np.array(frame.S).reshape(6)[3:])
        turned = pin.exp3(axes[-1] * float(still[kind.idx_q]))
        last = before * pin.SE3(turned, np.zeros(3))
    placements.append(last.actInv(data.oMi[joint]))
    return Turning(placements, axes, core.a, core.b)


def origin(body: str) -> str:
    """The body of the URDF that a body is, or is a part of what it sweeps."""
    return re.sub(rf"{PART}\d+$", "", body)  # names in a URDF may hold the sign too


def _object(
    name: str, like: pin.GeometryObject, joint: int, capsule: Capsule, radius: float
) -> pin.GeometryObject:
    """A capsule as pinocchio has it, fixed to a joint."""
    along = capsule.b - capsule.a
    length = float(np.linalg.norm(along))
    turn = np.eye(3)
    if length > 0.0:
        along = along if along[2] >= 0.0 else -along
        turn = pin.Quaternion.FromTwoVectors(np.eye(3)[2], along).toRotationMatrix()
    thick = capsule.radius + radius
    at = pin.SE3(turn, 0.5 * (capsule.a + capsule.b))
    shape = coal.Capsule(thick, length) if length > 1e-9 else coal.Sphere(thick)
    return pin.GeometryObject(name, joint, int(like.parentFrame), at, shape)
