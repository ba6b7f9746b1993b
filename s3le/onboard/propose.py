"""From a URDF to the text of a robot file: joints, hold, anchor, speeds; what to look at."""

import contextlib
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from s3le.errors import RobotError
from s3le.onboard import (
    anchor,
    bodies,
    covering,
    hulls,
    limbs,
    reading,
    source,
    stand,
    strength,
)
from s3le.onboard.plan import Plan
from s3le.onboard.tree import Tree
from s3le.onboard.watched import Asked, Settling
from s3le.robot import model, sense, srdf
from s3le.robot.robot import Robot, bones_of
from s3le.safety import covered
from s3le.store.atomic import replace

TURNED = 0.01  # chord of a unit vector; a joint that moves none farther drops out
SPEED = np.pi  # [rad/s] where the URDF names no limit that can be one
FASTEST = 60.0  # [rad/s] a limit beyond is a placeholder


@dataclass
class Proposal:
    """What `robot new` found out, and what is to be written."""

    name: str
    urdf: Path  # that was read
    made: list[bodies.Made]
    record: covered.Record  # how far links are drawn beyond their bodies
    found: anchor.Found
    sure: list[str]
    look: list[str]
    files: dict[str, bytes]  # relative to the folder of robot files -> content


def propose(
    urdf: Path,
    name: str,
    margin: float,
    neck: str,
    packages: Sequence[Path] = (),
    srdf_file: Path | None = None,
    spheres: Path | None = None,
    most: int = bodies.MOST,
    collision_only: bool = False,
    with_hulls: bool = False,
    allowance: float = covered.ALLOWANCE,
    finer: bool = False,
) -> Proposal:
    """Read a URDF and settle everything that a robot file says.

    Args:
        urdf: the URDF.
        name: of the robot and its file.
        margin: clearance that the anchor must keep [m].
        neck: skeleton.NECKS.
        packages: where packages lie.
        srdf_file: pairs that are not to be watched.
        spheres: a list of spheres instead of the collision geometry of the links it names.
        most: capsules at most for a mesh.
        collision_only: take collision geometry as it is, however far the drawing reaches beyond.
        with_hulls: keep the convex hulls of the meshes beside, for an independent check.
        allowance: how far a link's drawing may reach beyond its bodies [m].
        finer: make finer bodies for pairs of links that come near, and hold what overlaps by
            design to its baseline; takes minutes.

    Raises:
        RobotError: something in the files cannot be used; says what to do.
    """
    if not re.fullmatch(r"[A-Za-z0-9_.+-]{1,100}", name):
        raise RobotError(f"a robot's name is of letters, digits and _.+-, not {name!r}: --name")
    origin = reading.read(urdf, packages, collision_only)
    called = origin.renamed
    disabled = {
        frozenset(called.get(link, link) for link in pair): why
        for pair, why in (srdf.disabled(srdf_file) if srdf_file else {}).items()
    } | origin.apart
    given = bodies.read_spheres(spheres) if spheres else {}
    given = {called.get(link, link): rows for link, rows in given.items()}
    found = limbs.find(origin)
    sure, look = list(found.sure), [*found.look, *origin.notes]
    tree = Tree(origin.model)
    moving = _moving(tree, found, origin, look)
    _continuous(origin, moving, look)
    made, record, notes = covering.cover(origin, most, given, allowance, collision_only)
    look += notes
    _refuse_bare(tree, found, made, urdf)
    links = {link.get("name") for link in origin.root.findall("link")}
    text = source.text(origin.root)
    files = {f"urdf/{name}.urdf": text.encode()}
    if disabled:
        kept = {pair: why for pair, why in disabled.items() if pair <= links}
        files[f"urdf/{name}.srdf"] = srdf.text(name, kept).encode()
        by = "SRDF" if srdf_file else "MJCF's <exclude>"
        sure.append(f"{by}: {len(kept)} pairs of links taken off, all of them listed")
    hold = _hold(tree, origin, moving, look)
    speeds = _speeds(tree, moving, look)
    plan = Plan(name, found.points, found.base, moving, hold, {}, speeds, files)
    plan.anchor = {tree.name(j): float(tree.still[tree.model.joints[j].idx_q])
                   for j in map(tree.model.getJointId, moving)
                   if tree.model.joints[j].nq == 1
                   and tree.still[tree.model.joints[j].idx_q] != 0.0}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, _called(folder, name, urdf):
        robot = plan.load(Path(folder))
        turning = _that_turn(robot, look)
        plan.joints = [j for j in moving if j in turning] if origin.order else turning
        plan.anchor = {j: v for j, v in plan.anchor.items() if j in plan.joints}
        plan.velocity = {j: v for j, v in plan.velocity.items() if j in plan.joints}
        for joint in set(moving) - set(plan.joints):
            at = float(robot.anchor[robot.joint_names.index(joint)])
            if at:
                plan.hold[joint] = at
        robot = plan.load(Path(folder))
        sense.refuse_nonsense(robot)
        poses = origin.poses | (stand.named(srdf_file) if srdf_file else {})
        asked = Asked(Path(urdf), margin, neck, allowance, finer)
        settling = Settling(plan, Path(folder), origin, made, record, asked, sure, look)
        best = settling.settle(poses)
        if with_hulls:
            files[f"urdf/{name}.hulls.npz"] = hulls.pack(origin)
        strong = strength.find(origin, plan.load(Path(folder)))
        sure, look = sure + strong.sure, look + strong.look
        plan.acceleration = strong.acceleration
        plan.notes = [f"sure: {line}" for line in sure] + [f"look: {line}" for line in look]
        files[f"{name}.yaml"] = plan.text().encode()
        plan.load(Path(folder))
        Robot.adopt(Path(folder) / f"{name}.yaml", margin, neck)
    (sure if best.how != "search" else look).append(
        f"anchor: {best.how}, {best.clearance * 1e3:.0f} mm clear, "
        f"{best.overlaps} pairs overlap there and are not watched"
    )
    return Proposal(name, Path(urdf), made, settling.record, best, sure, look, files)


@contextlib.contextmanager
def _called(folder: str, name: str, urdf: Path) -> Iterator[None]:
    """Refusals name the files that people know, not the copies that are tried out."""
    try:
        yield
    except RobotError as refusal:
        said = str(refusal).replace(str(Path(folder) / "urdf" / f"{name}.urdf"), str(urdf))
        raise RobotError(said.replace(f"{folder}{os.sep}", "")) from None


def write(proposal: Proposal, folder: Path, force: bool, also: Sequence[Path] = ()) -> list[Path]:
    """Put the files in place, the robot file last; each appears whole or not at all.

    Args:
        proposal: what to write.
        folder: of robot files.
        force: replace what is there, but never the URDF that was read.
        also: what is going to be written beside, and must not be there either.

    Raises:
        RobotError: one of them is there and force is not given; nothing is written.
    """
    paths = {folder / name: data for name, data in proposal.files.items()}
    if any(path.resolve() == proposal.urdf.resolve() for path in paths):
        raise RobotError(
            f"{proposal.urdf} is the URDF that was read and would be replaced by what is left of "
            "it; give another --name or --out"
        )
    if not force and (there := [path for path in [*paths, *also] if path.exists()]):
        raise RobotError(f"{there[0]} exists; give another --name, or --force to replace it")
    for path, data in paths.items():
        replace(path, partial(Path.write_bytes, data=data))
    return list(paths)


def _refuse_bare(tree: Tree, found: limbs.Limbs, made: Sequence[bodies.Made], urdf: Path) -> None:
    """Refuse an arm of which a whole part has neither bodies nor a drawing to make them from."""
    solid = {body.link for body in made}
    for side, word in (("l", "left"), ("r", "right")):
        if side not in found.arms:
            continue
        elbow = tree.model.getJointId(str(found.points[f"{side}_elbow"]))
        upper = found.arms[side][: found.arms[side].index(elbow)]
        for part, joints in (("upper arm", upper), ("forearm", tree.below(elbow))):
            carried = [frame.name for frame in tree.frames(joints)]
            if not solid & set(carried):
                raise RobotError(
                    f"{urdf}: the {word} {part} has neither collision geometry nor anything that "
                    f"is drawn ({', '.join(carried[:4])}), so nothing would watch it; add "
                    "<collision> to it, or give spheres (--spheres)"
                )


def _moving(tree: Tree, found: limbs.Limbs, origin: source.Source, look: list[str]) -> list[str]:
    """Joints of the waist and of the arms, in the file's own order where it has one."""
    names = [tree.name(j) for j in found.waist]
    for side in ("l", "r"):
        names += [tree.name(j) for j in found.arms.get(side, []) if tree.turns(j)]
    if origin.order is not None:
        if still := [name for name in names if name not in origin.order]:
            look.append(f"held, for no actuator drives them: {', '.join(still)}")
        names = [name for name in origin.order if name in names]
    for name in names:
        joint = tree.model.joints[tree.model.getJointId(name)]
        if joint.nq == 1:
            low = tree.model.lowerPositionLimit[joint.idx_q]
            high = tree.model.upperPositionLimit[joint.idx_q]
            if low > high:
                raise RobotError(
                    f"{origin.path}: joint '{name}' has its limits reversed, lower {low:g} and "
                    f"upper {high:g}; swap them in the URDF"
                )
    return names


def _continuous(origin: source.Source, moving: list[str], look: list[str]) -> None:
    """A moving joint without limits gets a whole turn, in the robot file's URDF."""
    for name in moving:
        joint = origin.joint(name)
        if joint.get("type") != "continuous":
            continue
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = source.ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
        limit.set("lower", "-3.141593")
        limit.set("upper", "3.141593")
        look.append(f"'{name}' is continuous; in the robot file's URDF it has limits of 180 deg")


def _hold(
    tree: Tree, origin: source.Source, moving: list[str], look: list[str]
) -> dict[str, float]:
    """Joints whose range leaves zero out, and those that mimic one that does."""
    hold = {}
    for j in range(1, tree.model.njoints):
        joint = tree.model.joints[j]
        if joint.nq == 1 and tree.name(j) not in moving:
            angle = float(tree.still[joint.idx_q])
            if angle != 0.0:
                hold[tree.name(j)] = angle
    for item in origin.root.findall("joint"):
        mimic, name = item.find("mimic"), item.get("name", "")
        if mimic is None:
            continue
        master = mimic.get("joint", "")
        if name not in moving and master not in moving:
            angle = float(mimic.get("multiplier", 1)) * hold.get(master, 0.0)
            angle += float(mimic.get("offset", 0))
            hold.pop(name, None)
            if angle:
                hold[name] = angle
    if hold:
        look.append(f"hold: {', '.join(hold)} cannot stand at zero and stand as near as they can")
    return hold


def _speeds(tree: Tree, moving: list[str], look: list[str]) -> dict[str, float]:
    speeds = {}
    for name in moving:
        joint = tree.model.joints[tree.model.getJointId(name)]
        limit = float(tree.model.velocityLimit[joint.idx_v])
        if not 0.0 < limit <= FASTEST:
            speeds[name] = round(SPEED, 6)
    if speeds:
        look.append(
            f"velocity: the file has no limit that can be one for {', '.join(speeds)}; "
            f"{SPEED:.2f} rad/s are put down, give the robot's own"
        )
    return speeds


def _that_turn(robot: model.Geometry, look: list[str]) -> list[str]:
    """Moving joints without those that turn none of the vectors."""
    q = sense.poses(robot, 60)
    kept: list[str] = []
    lost: list[str] = []
    before = _unit(robot, q)
    for j, joint in enumerate(robot.joints):
        most = 0.0
        for end in (joint.lower, joint.upper):
            other = q.copy()
            other[:, j] = end
            most = max(most, float(np.linalg.norm(_unit(robot, other) - before, axis=2).max()))
        (kept if most > TURNED else lost).append(joint.name)
    if lost:
        look.append(f"held, for they turn none of the vectors: {', '.join(lost)}")
    return kept


def _unit(robot: model.Geometry, q: np.ndarray) -> np.ndarray:
    bones = bones_of(robot, sense.points(robot, q), "midpoint")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(bones / np.linalg.norm(bones, axis=2, keepdims=True))
