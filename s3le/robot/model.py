"""A robot as this project uses it: moving joints, skeleton points, capsules, watched pairs.

The URDF is read by pinocchio and reduced to the joints that move. Bodies become capsules: a
capsule stays itself, a sphere is a capsule without length, and a box or cylinder is replaced by a
capsule that contains it.
"""

import hashlib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.robot import ranges, srdf, urdf
from s3le.robot.description import (
    ALL,
    ARMS,
    FARTHEST,
    WIDEST,
    Description,
    Place,
    read_description,
)


class Body(NamedTuple):
    """A capsule fixed to a joint: all points within radius of a segment."""

    name: str  # the link's name and the number of this body on it
    joint: int  # index into the moving joints; -1 for the base and all that stands still
    a: np.ndarray  # one end of the segment [m], (3,), in the joint's frame
    b: np.ndarray  # the other end [m]
    radius: float  # [m]
    shape: str  # what the URDF holds: capsule, sphere, box or cylinder
    fine: bool = False  # one of those that stand for the link where the robot file asks for them

    @property
    def link(self) -> str:
        """The link it is a body of."""
        return self.name.rpartition("_")[0]


class Joint(NamedTuple):
    """One revolute joint of the reduced tree."""

    name: str
    parent: int  # index of the moving joint before it; -1 for the base
    rotation: np.ndarray  # (3, 3), of the joint's frame in its parent's at angle zero
    translation: np.ndarray  # [m], (3,)
    axis: np.ndarray  # unit vector in the joint's frame, (3,)
    lower: float  # [rad]
    upper: float  # [rad]
    velocity: float  # [rad/s]
    acceleration: float | None = None  # [rad/s^2]; None: the robot file says nothing


class Point(NamedTuple):
    """A skeleton point: fixed to a moving joint (-1: base) at an offset [m]."""

    joint: int
    offset: np.ndarray  # (3,)


@dataclass(frozen=True, eq=False)
class Geometry:
    """What a robot's files say: joints, bodies, points; s3le.robot.robot.Robot decides the rest."""

    name: str
    description: Description  # the robot file it was built from
    digest: str  # of everything below that can change a result
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    points: dict[str, Point]  # by role, s3le.robot.description.MAPPED; a missing arm has none
    base_rotation: np.ndarray  # (3, 3): base frame -> x forward, y left, z up
    anchor: np.ndarray  # [rad], (n_dof,)
    stand: np.ndarray | None  # [rad], (n_dof,), how its maker stands it; None: the file is silent
    pair_inflation: float
    disabled: dict[frozenset[str], str]  # pairs of links that the SRDF takes off, and its reason
    parsed: tuple[pin.Model, pin.GeometryModel] = field(repr=False)  # never changed: see reduced
    tree: ElementTree.Element = field(repr=False)  # of the URDF

    @property
    def arms(self) -> tuple[str, ...]:
        """Sides on which it has an arm: "r", "l"."""
        return tuple(side for side, roles in ARMS.items() if roles[0] in self.points)

    @property
    def n_dof(self) -> int:
        """Number of moving joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> list[str]:
        """Names of the moving joints in the order of q."""
        return [joint.name for joint in self.joints]

    @property
    def lower(self) -> np.ndarray:
        """Joint minima l [rad], (n_dof,)."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> np.ndarray:
        """Joint maxima u [rad], (n_dof,)."""
        return np.array([joint.upper for joint in self.joints])

    def reduced(self) -> tuple[pin.Model, pin.GeometryModel]:
        """The URDF's pinocchio model with every joint locked but the moving ones; a copy."""
        model, geometry = self.parsed
        return model.copy(), geometry.copy()

    def path_to(self, joint: int) -> list[int]:
        """Moving joints from the base up to and including joint (-1: none)."""
        path = []
        while joint >= 0:
            path.append(joint)
            joint = self.joints[joint].parent
        return path[::-1]


def load(path: Path) -> Geometry:
    """Read a robot file and its URDF.

    Raises:
        RobotError: anything in either file that the project cannot use; says which and why.
    """
    return from_description(read_description(path))


def from_description(text: Description) -> Geometry:
    """Build what a checked robot file describes (see load)."""
    tree = urdf.elements(text.urdf, text.files["urdf"])
    model, geometry, names = _reduced(text)
    where = str(text.urdf)
    data = model.createData()
    home = pin.neutral(model)
    pin.framesForwardKinematics(model, data, home)

    urdf.refuse_mimicry(text, tree)
    joints = tuple(_joint(model, j, where, text) for j in range(1, model.njoints))
    for key, named in (("velocity", text.velocity), ("acceleration", text.acceleration)):
        if wrong := [name for name in named if name not in text.joints]:
            raise RobotError(f"{text.source}: {key} names '{wrong[0]}', which does not move")
    points = {role: _point(model, place, role, where) for role, place in text.points.items()}
    fine = urdf.finer(text, tree)
    bodies = tuple(
        body._replace(fine=ranges.origin(body.name) in fine)
        for body in (_body(model, item, where) for item in geometry.geometryObjects)
    )
    urdf.refuse_lost_geometry(where, tree, names)
    if not bodies:
        raise RobotError(
            f"{where}: no collision geometry, so nothing could be checked; s3le robot new puts "
            "capsules around meshes"
        )
    anchor = _pose(text, joints, "anchor", text.anchor)
    found = Geometry(
        name=text.name,
        description=text,
        digest="",
        joints=joints,
        bodies=bodies,
        points=points,
        base_rotation=pin.rpy.rpyToMatrix(*text.base_rpy),
        anchor=anchor,
        stand=None if text.stand is None else _pose(text, joints, "stand", text.stand),
        pair_inflation=text.pair_inflation,
        disabled=srdf.disabled(text.srdf, text.files["srdf"]) if text.srdf else {},
        parsed=(model, geometry),
        tree=tree,
    )
    return replace(found, digest=_digest(found))


def _reduced(text: Description) -> tuple[pin.Model, pin.GeometryModel, list[str]]:
    """The URDF's pinocchio model with every joint locked but the moving ones, and its shapes.

    Raises:
        RobotError: the URDF does not parse, or a joint named in the robot file is not in it.
    """
    printed: list[str] = []
    try:
        with urdf.quiet(printed):
            xml = text.files["urdf"].decode("utf-8", "replace")
            model = pin.buildModelFromXML(xml)
            geometry = pin.buildGeomFromUrdfString(
                model, xml, pin.GeometryType.COLLISION, package_dirs=str(text.urdf.parent)
            )
    except (ValueError, RuntimeError) as error:
        reason = "; ".join([*printed[:1], " ".join(str(error).split())[:200]])
        raise RobotError(f"{text.urdf}: pinocchio cannot read it ({reason})") from None
    named = list(model.names)[1:]
    named_by_others = tuple(name for name in text.given if name != ALL)
    for key, wanted in (
        ("joints", text.joints), ("hold", text.hold), ("given", named_by_others),
        ("given", tuple(text.ranges)),
    ):  # fmt: skip
        for name in wanted:
            if name not in named:
                raise RobotError(
                    f"{text.source}: {key} names '{name}', not in {text.urdf.name}; "
                    f"its movable joints: {', '.join(named)}"
                )
    still = pin.neutral(model)
    for name, angle in text.hold.items():
        joint = model.joints[model.getJointId(name)]
        at = slice(joint.idx_q, joint.idx_q + joint.nq)
        if name in text.joints:
            raise RobotError(f"{text.source}: '{name}' both moves (joints) and is held (hold)")
        if joint.nv != 1:
            raise RobotError(f"{text.source}: hold of {name}: a joint of {joint.nv} angles")
        # pinocchio keeps an angle without limits as its cosine and sine
        still[at] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        low, high = model.lowerPositionLimit[at][0], model.upperPositionLimit[at][0]
        if joint.nq == 1 and not low <= angle <= high:
            raise RobotError(
                f"{text.source}: hold of {name} is {angle:.4f}, outside its range "
                f"[{low:.4f}, {high:.4f}]"
            )
    names = [item.name for item in geometry.geometryObjects]
    if text.ranges:
        bodies = [_body(model, item, str(text.urdf)) for item in geometry.geometryObjects]
        capsules = [ranges.Capsule(body.a, body.b, body.radius) for body in bodies]
        geometry = ranges.sweep(text, model, geometry, capsules, still)
    locked = [j for j in range(1, model.njoints) if model.names[j] not in text.joints]
    return *pin.buildReducedModel(model, geometry, locked, still), names


def _pose(
    text: Description, joints: tuple[Joint, ...], key: str, named: dict[str, float]
) -> np.ndarray:
    """A pose of the robot file [rad], (n_dof,): zero where it names nothing."""
    angles = np.zeros(len(joints))
    moving = [joint.name for joint in joints]
    for name, angle in named.items():
        if name not in moving:
            raise RobotError(f"{text.source}: {key} names '{name}', which does not move")
        angles[moving.index(name)] = angle
    for joint, angle in zip(joints, angles, strict=True):
        if not joint.lower <= angle <= joint.upper:
            raise RobotError(
                f"{text.source}: {key} of {joint.name} is {angle:.4f} rad, outside its range "
                f"[{joint.lower:.4f}, {joint.upper:.4f}]"
            )
    return angles


def _joint(model: pin.Model, index: int, where: str, text: Description) -> Joint:
    kind = model.joints[index]
    name = model.names[index]
    if kind.nv == 1 and kind.nq == 2:
        raise RobotError(
            f"{where}: joint '{name}' is continuous; only joints with limits move: make it "
            'revolute with lower and upper, as "s3le robot new" does'
        )
    if kind.nq != 1 or kind.nv != 1 or "R" not in kind.shortname():
        raise RobotError(
            f"{where}: joint '{name}' is {kind.shortname()}; only revolute joints move"
        )
    lower = float(model.lowerPositionLimit[kind.idx_q])
    upper = float(model.upperPositionLimit[kind.idx_q])
    if not -WIDEST <= lower < upper <= WIDEST:
        raise RobotError(
            f"{where}: joint '{name}' needs lower < upper in [{-WIDEST:g}, {WIDEST:g}] rad, "
            f"got {lower} and {upper}" + ("; they are reversed" if lower > upper else "")
        )
    data = kind.createData()
    kind.calc(data, np.zeros(model.nq))
    placement = model.jointPlacements[index]
    axis = np.array(data.S).reshape(6)[3:]
    if not abs(np.linalg.norm(axis) - 1.0) < 1e-9:
        raise RobotError(f"{where}: the axis of joint '{name}' has no direction")
    _near(where, f"joint '{name}'", placement.translation, placement.rotation)
    return Joint(
        name=name,
        parent=int(model.parents[index]) - 1,
        rotation=np.array(placement.rotation),
        translation=np.array(placement.translation),
        axis=axis,
        lower=lower,
        upper=upper,
        velocity=text.velocity.get(name, float(model.velocityLimit[kind.idx_v])),
        acceleration=text.acceleration.get(name),
    )


def _point(model: pin.Model, place: Place, role: str, where: str) -> Point:
    name = place.frame
    if not model.existFrame(name):
        near = ", ".join(frame.name for frame in model.frames if name.lower() in frame.name.lower())
        raise RobotError(
            f"{where}: point {role} names '{name}', which is no joint, link or frame of it"
            + (f"; like it: {near}" if near else "")
        )
    # A joint and the link it carries may share a name; the first frame of it is the joint's.
    frame = next(frame for frame in model.frames if frame.name == name)
    at = np.array(frame.placement.translation)
    if any(place.offset):
        at = np.array(frame.placement.act(np.array(place.offset)))
    _near(where, f"point {role}", at)
    return Point(int(frame.parentJoint) - 1, at)


def _body(model: pin.Model, item: pin.GeometryObject, where: str) -> Body:
    shape = item.geometry
    link = model.frames[item.parentFrame].name if item.parentFrame < model.nframes else item.name
    _near(where, f"a body of link '{link}'", item.placement.translation,
          item.placement.rotation, _sizes(shape))  # fmt: skip
    if isinstance(shape, coal.Capsule):
        kind, half, radius, axis = "capsule", shape.halfLength, shape.radius, np.eye(3)[2]
    elif isinstance(shape, coal.Sphere):
        kind, half, radius, axis = "sphere", 0.0, shape.radius, np.eye(3)[2]
    elif isinstance(shape, coal.Cylinder):
        half, radius = containing_capsule_of_cylinder(shape.radius, shape.halfLength)
        kind, axis = "cylinder", np.eye(3)[2]
    elif isinstance(shape, coal.Box):
        kind = "box"
        half, radius, axis = containing_capsule_of_box(np.array(shape.halfSide))
    else:
        raise RobotError(
            f"{where}: link '{link}' has a {type(shape).__name__} for collision; "
            "use capsules, spheres, cylinders or boxes"
        )
    sizes = np.array(shape.halfSide) if kind == "box" else np.array([radius])
    if not (sizes > 0.0).all() or not half >= 0.0:
        raise RobotError(f"{where}: link '{link}' has a {kind} whose size is not positive")
    centre, turn = np.array(item.placement.translation), np.array(item.placement.rotation)
    along = turn @ axis * half
    return Body(item.name, int(item.parentJoint) - 1, centre - along, centre + along, radius, kind)


def _sizes(shape: coal.CollisionGeometry) -> list[float]:
    sizes = [getattr(shape, name, 0.0) for name in ("radius", "halfLength")]
    return [*sizes, *getattr(shape, "halfSide", [])]


def _near(where: str, what: str, *numbers: np.ndarray | list[float]) -> None:
    """Refuse lengths and places [m] that no robot has; NaN compares False."""
    for part in numbers:
        if not (np.abs(part) <= FARTHEST).all():
            raise RobotError(f"{where}: {what} lies or reaches beyond {FARTHEST:g} m, or nowhere")


def containing_capsule_of_cylinder(radius: float, half: float) -> tuple[float, float]:
    """Half segment length and radius [m] of a coaxial capsule that contains the cylinder.

    The cylinder's rim lies on the caps: (half - h)^2 + radius^2 = r^2, with the least volume.
    """
    h = np.linspace(0.0, half, 257)
    r = np.sqrt((half - h) ** 2 + radius**2)
    best = int(np.argmin(r**2 * (2 * h) + 4 / 3 * r**3))
    return float(h[best]), float(r[best] * (1 + 1e-12))


def containing_capsule_of_box(sides: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Half segment length, radius [m] and axis (3,) of a capsule that contains the box.

    Args:
        sides: half side lengths [m], (3,); the capsule lies along the longest.
    """
    longest = int(np.argmax(sides))
    across = float(np.linalg.norm(np.delete(sides, longest)))
    half, radius = containing_capsule_of_cylinder(across, float(sides[longest]))
    return half, radius, np.eye(3)[longest]


def _digest(robot: Geometry) -> str:
    parts = [robot.name.encode()]
    for joint in robot.joints:
        parts += [joint.name.encode(), str(joint.parent).encode()]
        parts += [np.ascontiguousarray(v).tobytes() for v in joint[2:5]]
        parts.append(np.array(joint[5:8]).tobytes())
        if joint.acceleration is not None:  # what files without it gave stays as it is
            parts.append(b"acceleration" + np.array([joint.acceleration]).tobytes())
    for body in robot.bodies:
        parts += [body.name.encode(), str(body.joint).encode()]
        parts.append(np.concatenate([body.a, body.b, [body.radius]]).tobytes())
        if body.fine:
            parts.append(b"fine")
    for role, point in robot.points.items():
        parts += [role.encode(), str(point.joint).encode(), point.offset.tobytes()]
    parts += [robot.base_rotation.tobytes(), robot.anchor.tobytes()]
    if robot.stand is not None:  # what files without it gave stays as it is
        parts.append(b"stand" + robot.stand.tobytes())
    parts.append(np.array([robot.pair_inflation]).tobytes())
    parts += [name.encode() for pair in sorted(map(sorted, robot.disabled)) for name in pair]
    finer = sorted(map(sorted, robot.description.finer))
    parts += [b"baselines"] if robot.description.baselines else []
    parts += [b"finer", *(name.encode() for pair in finer for name in pair)] if finer else []
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
