"""The robot of an MJCF file as a URDF's elements: links, joints in MuJoCo's order, couplings.

The world's geometry is dropped, and so are things that float beside the robot. A body keeps its
name and its frame. A body with several joints becomes several links; a joint that does not pass
through its body's origin gets a link of its own before the body.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.onboard import mjcf
from s3le.robot.model import FARTHEST

WORLD = "world"
_LINE = {"hinge": "revolute", "slide": "prismatic"}


@dataclass
class Geom:
    """A geom of a body."""

    link: str
    said: dict[str, str]  # its attributes and those of its class
    frame: pin.SE3  # of the <frame> elements around it, in the body's frame
    where: str  # file and place, for a refusal


@dataclass
class Robot:
    """What is read of it."""

    root: ElementTree.Element  # <robot> with <link> and <joint>
    geoms: list[Geom]
    joints: list[str]  # that an actuator drives, all where there is no actuator; MuJoCo's order
    passive: list[str]  # that none drives although others are driven
    apart: dict[frozenset[str], str]  # pairs of links that <exclude> takes off, and why
    inertial: dict[str, ElementTree.Element]  # a URDF's, of links; empty: some body tells none
    armature: dict[str, float]  # [kg m^2] by joint
    notes: list[str] = field(default_factory=list)
    width: dict[str, int] = field(default_factory=dict)  # numbers in qpos of each joint, in order


def build(document: mjcf.Document) -> Robot:
    """Find the robot and turn it into links and joints.

    Raises:
        RobotError: there is none, or something of it is not read; names file and place.
    """
    builder = _Builder(document)
    builder.find()
    builder.couple()
    builder.strengthen()
    driven = {item.get("joint") or item.get("jointinparent")
              for group in document.root.findall("actuator") for item in group}  # fmt: skip
    some = driven & set(builder.order)
    joints = [name for name in builder.order if name in driven or not some]
    passive = [name for name in builder.order if name not in joints]
    return Robot(
        builder.root, builder.geoms, joints, passive, builder.apart(),
        {} if builder.weightless else builder.inertial, builder.armature, builder.notes,
        builder.width,
    )  # fmt: skip


class _Builder:
    def __init__(self, document: mjcf.Document) -> None:
        self.document, self.path = document, document.path
        name = document.root.get("model") or "robot"
        self.root = ElementTree.Element("robot", {"name": name, "version": "1.1"})
        self.geoms: list[Geom] = []
        self.order: list[str] = []  # joints that move, in MuJoCo's order
        self.refs: dict[str, float] = {}  # of them: position in the file's own pose [rad], [m]
        self.width: dict[str, int] = {}  # of all joints that MuJoCo has, numbers in its qpos
        self.notes: list[str] = []
        self.links: set[str] = set()  # names that are taken
        self.built: set[str] = set()
        self.joints: set[str] = set()
        self.inertial: dict[str, ElementTree.Element] = {}
        # A body says no <inertial>, or what it says is not asked, and MuJoCo weighs its geoms.
        self.weightless = any(item.get("inertiafromgeom") == "true"
                              for item in document.root.iter("compiler"))  # fmt: skip
        self.armature: dict[str, float] = {}
        self.fixed = self._held()

    def find(self) -> None:
        """Take what has joints of the world's bodies; of several that float the largest."""
        world = ElementTree.Element("worldbody")
        for item in self.document.root.findall("worldbody"):
            world.extend(item)
        where = f"{self.path}: the world"
        bodies, dropped = [], 0
        kinds = [item.get("childclass") for item in self.document.root.findall("worldbody")]
        kind = next((name for name in kinds if name), None)
        for item, at, inner in mjcf.parts(world, where, self.document, kind, pin.SE3.Identity()):
            if item.tag == "body":
                bodies.append((item, at, inner, _joints(item), _floats(item)))
            dropped += item.tag == "geom"
        floating = [entry for entry in bodies if entry[4] and entry[3]]
        kept = [max(floating, key=lambda entry: entry[3])] if floating else [
            entry for entry in bodies if entry[3]
        ]  # fmt: skip
        if not kept:
            raise RobotError(f"{self.path}: no body of the world has a joint; this is no robot")
        if lost := [entry[0].get("name") or "?" for entry in bodies if entry not in kept]:
            self.notes.append(f"beside the robot, and left out: {', '.join(lost[:8])}")
        if dropped:
            self.notes.append(f"geoms of the world that are left out: {dropped}")
        if floating:
            self._body(*kept[0][:3], parent=None)
            return
        self._link(WORLD)
        for item, at, inner, _, _ in kept:
            self._body(item, at, inner, parent=WORLD)

    def couple(self) -> None:
        """Joints that <equality> ties to others become mimics; other ties are told."""
        named = {item.get("name"): item for item in self.root.findall("joint")}
        for item in (tie for group in self.document.root.findall("equality") for tie in group):
            said = self.document.attributes(item, f"{self.path}: an <equality>", None)
            if said.get("active", "true") != "true":
                continue
            if item.tag in ("connect", "weld"):
                ends = " and ".join(
                    said[k] for k in ("body1", "body2", "site1", "site2") if k in said
                )
                self.notes.append(
                    f"a closed loop ({item.tag} of {ends}) is not modelled: joints in it stand "
                    "still where they are held, or move as if it were open"
                )
            one, two = said.get("joint1"), said.get("joint2")
            if item.tag != "joint" or one not in self.refs or two is None:
                continue  # of something beside the robot, or held: see _held
            where = f"{self.path}: the <equality> of '{one}'"
            if two not in self.refs:
                raise RobotError(f"{where} names '{two}', which is no joint that moves")
            curve = _curve(said, where)
            if np.any(curve[2:]):
                self.notes.append(f"'{one}' follows '{two}' on a curve; its straight part is kept")
            offset = self.refs[one] + curve[0] - curve[1] * self.refs[two]
            mimic = {
                "joint": two,
                "multiplier": repr(float(curve[1])),
                "offset": repr(float(offset)),
            }
            ElementTree.SubElement(named[one], "mimic", mimic)

    def strengthen(self) -> None:
        """What a motor's forcerange says of a joint that names no effort itself."""
        limits = {item.get("name"): item.find("limit") for item in self.root.findall("joint")}
        for item in (one for group in self.document.root.findall("actuator") for one in group):
            name = item.get("joint")
            where = f"{self.path}: the actuator of '{name}'"
            said = self.document.attributes(item, where, None)
            limit = limits.get(name)
            if limit is not None and "forcerange" in said and not float(limit.get("effort", "0")):
                force = np.abs(mjcf.numbers(said, "forcerange", where, 2)).min()
                limit.set("effort", repr(float(force)))

    def _weigh(self, link: str, item: ElementTree.Element, where: str) -> None:
        """What a body's <inertial> says."""
        told = item.find("inertial")
        if told is None:
            self.weightless |= item.find("geom") is not None
            return
        said, where = dict(told.attrib), f"{where}: its inertial"
        mass = float(mjcf.numbers(said, "mass", where, 1)[0])
        if "fullinertia" in said:
            xx, yy, zz, xy, xz, yz = mjcf.numbers(said, "fullinertia", where, 6)
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            moments = np.diag(mjcf.numbers(said, "diaginertia", where, 3, "0 0 0"))
        self.inertial[link] = inertial(mass, self.document.place(said, where), moments)

    def apart(self) -> dict[frozenset[str], str]:
        """Pairs of bodies that <exclude> names."""
        found = {}
        for group in self.document.root.findall("contact"):
            for item in group.findall("exclude"):
                pair = frozenset((item.get("body1") or "", item.get("body2") or ""))
                if pair <= self.links:
                    found[pair] = "excluded by the MJCF"
        return found

    def _held(self) -> dict[str, float]:
        """Joints that <equality> holds at a constant, less where they stand at first."""
        found = {}
        for item in (tie for group in self.document.root.findall("equality") for tie in group):
            if item.tag == "joint" and not item.get("joint2") and item.get("active") != "false":
                said = self.document.attributes(item, f"{self.path}: an <equality>", None)
                name = said.get("joint1") or ""
                found[name] = float(_curve(said, f"{self.path}: the <equality> of '{name}'")[0])
        return found

    def _body(
        self, item: ElementTree.Element, at: pin.SE3, childclass: str | None, parent: str | None
    ) -> None:
        name = self._name(item.get("name"), "body", self.links)
        where = f"{self.path}: body '{name}'"
        if item.get("mocap") == "true":
            raise RobotError(f"{where} is moved from outside (mocap), not read within a robot")
        at = at * self.document.place(dict(item.attrib), where)
        kind = item.get("childclass") or childclass
        children = list(mjcf.parts(item, where, self.document, kind, pin.SE3.Identity()))
        joints = [c for c in children if c[0].tag == "joint" and self._kind(c, where) != "free"]
        if parent is not None and _floats(item):
            raise RobotError(f"{where} floats although it hangs on '{parent}', which is not read")
        if parent is None:
            at, parent = pin.SE3.Identity(), name
            self.width["<freejoint>"] = 7
            self._link(name)
            if joints:
                raise RobotError(f"{where} floats and has further joints, which is not read")
        else:
            self._chain(name, parent, at, joints, where)
        self._weigh(name, item, where)
        for child, frame, inner in children:
            if child.tag == "geom":
                place = f"{where}: geom '{child.get('name') or len(self.geoms)}'"
                said = self.document.attributes(child, place, inner)
                self.geoms.append(Geom(name, said, frame, place))
        for child, frame, inner in children:
            if child.tag == "body":
                self._body(child, frame, inner, name)

    def _kind(self, child: tuple, where: str) -> str:
        item, _, inner = child
        said = self.document.attributes(item, f"{where}: a joint", inner)
        kind = said.get("type", "hinge")
        if kind not in ("free", "ball", "slide", "hinge"):
            raise RobotError(f"{where}: a joint of type {kind!r}; MuJoCo knows no such one")
        return kind

    def _chain(self, name: str, parent: str, at: pin.SE3, joints: list, where: str) -> None:
        """The links and joints from a body's parent to the body."""
        offset, before = at, parent
        for k, child in enumerate(joints):
            item, frame, inner = child
            joint = self._name(item.get("name"), f"{name}_joint", self.joints)
            place = f"{where}: joint '{joint}'"
            said = self.document.attributes(item, place, inner)
            spot = frame.act(mjcf.numbers(said, "pos", place, 3, "0 0 0"))
            last = k == len(joints) - 1 and not np.abs(spot).max() > 0.0
            link = name if last else self._name(None, f"{name}_at_{joint}", self.links)
            here = offset * pin.SE3(np.eye(3), spot)
            self._joint(joint, before, link, here, said, frame, place)
            offset, before = pin.SE3(np.eye(3), -spot), link
        if before != name:
            fixed = self._name(None, f"{name}_fixed", self.joints)
            self._write(fixed, "fixed", before, name, offset if joints else at)
        self._link(name)

    def _joint(
        self, name: str, parent: str, child: str, at: pin.SE3, said: dict[str, str],
        frame: pin.SE3, where: str,
    ) -> None:  # fmt: skip
        kind = said.get("type", "hinge")
        self.width[name] = 4 if kind == "ball" else 1
        self._link(child)
        if kind == "ball":
            self.notes.append(f"'{name}' is a ball joint, which is not read; it stands still")
            self._write(name, "fixed", parent, child, at)
            return
        axis = frame.rotation @ mjcf.numbers(said, "axis", where, 3, "0 0 1")
        length = float(np.linalg.norm(axis))
        if not length > 1e-9:
            raise RobotError(f"{where}: axis has no direction")
        axis = axis / length
        turns = kind == "hinge"
        ref = float(mjcf.numbers(said, "ref", where, 1, "0")[0])
        ref = self.document.angle(ref) if turns else ref
        shift = self.fixed.get(name, -ref)  # a fixed joint stands there, others begin at zero
        at = at * (
            pin.SE3(np.array(pin.AngleAxis(shift, axis).matrix()), np.zeros(3)) if turns
            else pin.SE3(np.eye(3), shift * axis)
        )  # fmt: skip
        if name in self.fixed:
            self.notes.append(f"'{name}' is held by an <equality>, and stands still")
            self._write(name, "fixed", parent, child, at)
            return
        limits = self._range(said, turns, where)
        word = _LINE[kind]
        if limits is None and turns:
            word = "continuous"
        item = self._write(name, word, parent, child, at)
        ElementTree.SubElement(item, "axis", {"xyz": _words(axis)})
        force = np.abs(mjcf.numbers(said, "actuatorfrcrange", where, 2, "0 0")).max()
        low, high = limits or (-FARTHEST, FARTHEST)
        if word != "continuous":
            ends = {"lower": repr(low), "upper": repr(high), "velocity": "0"}
            ElementTree.SubElement(item, "limit", ends | {"effort": repr(float(force))})
        self.order.append(name)
        self.refs[name] = ref
        self.armature[name] = float(mjcf.numbers(said, "armature", where, 1, "0")[0])

    def _range(
        self, said: dict[str, str], turns: bool, where: str
    ) -> tuple[float, float] | None:  # fmt: skip
        limited = said.get("limited", "auto")
        if limited == "auto":
            limited = "true" if self.document.autolimits and "range" in said else "false"
        if limited != "true":
            return None
        low, high = map(float, mjcf.numbers(said, "range", where, 2))
        if not low < high:
            raise RobotError(f"{where}: range must rise, got {low:g} and {high:g}")
        angle = self.document.angle if turns else float
        return angle(low), angle(high)

    def _link(self, name: str) -> None:
        self.links.add(name)
        if name not in self.built:
            self.built.add(name)
            ElementTree.SubElement(self.root, "link", {"name": name})

    def _write(
        self, name: str, kind: str, parent: str, child: str, at: pin.SE3
    ) -> ElementTree.Element:
        item = ElementTree.SubElement(self.root, "joint", {"name": name, "type": kind})
        ElementTree.SubElement(item, "parent", {"link": parent})
        ElementTree.SubElement(item, "child", {"link": child})
        rpy = pin.rpy.matrixToRpy(at.rotation)
        place = {"xyz": _words(at.translation), "rpy": _words(rpy)}
        ElementTree.SubElement(item, "origin", place)
        return item

    def _name(self, given: str | None, otherwise: str, taken: set[str]) -> str:
        """A name of its own; what has one keeps it, if nothing else has."""
        name = given or otherwise
        if given and given in taken:
            raise RobotError(f"{self.path}: two bodies or two joints are called '{given}'")
        while name in taken:
            name += "_"
        taken.add(name)
        return name


def _joints(body: ElementTree.Element) -> int:
    """How many joints lie in and below a body, but for what lets it float."""
    return sum(item.get("type") != "free" for item in body.iter("joint"))


def _floats(body: ElementTree.Element) -> bool:
    own = [*body.findall("joint"), *body.findall("frame/joint")]
    return body.find("freejoint") is not None or any(j.get("type") == "free" for j in own)


def _curve(said: dict[str, str], where: str) -> np.ndarray:
    """The five coefficients of a coupling; those that are left out are MuJoCo's."""
    words = said.get("polycoef", "").split()
    whole = {"polycoef": " ".join([*words, *"0 1 0 0 0".split()[len(words) :]])}
    return mjcf.numbers(whole, "polycoef", where, 5)


def inertial(mass: float, at: pin.SE3, moments: np.ndarray) -> ElementTree.Element:
    """A URDF's <inertial>.

    Args:
        mass: [kg].
        at: where its centre is and how its frame is turned, in the link's frame.
        moments: [kg m^2], (3, 3), about the centre, in that frame.
    """
    item = ElementTree.Element("inertial")
    place = {"xyz": _words(at.translation), "rpy": _words(pin.rpy.matrixToRpy(at.rotation))}
    ElementTree.SubElement(item, "origin", place)
    ElementTree.SubElement(item, "mass", {"value": repr(float(mass))})
    at_rows = zip("xyz", moments, strict=True)
    values = {f"i{a}{b}": repr(float(v)) for a, row in at_rows
              for b, v in zip("xyz", row, strict=True) if a <= b}  # fmt: skip
    ElementTree.SubElement(item, "inertia", values)
    return item


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
