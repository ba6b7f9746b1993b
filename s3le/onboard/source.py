"""A URDF as somebody wrote it: its tree, its shapes as triangles, its meshes found.

Both kinds of shapes are read: the collision ones, which become bodies, and the visual ones, for
bodies are held against what is drawn.

Meshes are read by coal's loader (STL, DAE, OBJ and what else assimp knows), the one that
pinocchio places them with. `package://` is looked for in the folders given, in ROS_PACKAGE_PATH,
and in the folders above the URDF.
"""

import copy
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.onboard.expand import expanded
from s3le.robot import urdf
from s3le.robot.model import FARTHEST
from s3le.safety.covered import TAG

SHAPES = ("capsule", "sphere", "box", "cylinder", "mesh")
_RIM = 32  # corners of the polygon that stands around a cylinder's rim
WITHOUT = "; --collision-only does without what is drawn, and every certificate then says so"
_JOINT = ("parent", "child", "origin", "axis", "limit", "mimic")  # what a reduced joint keeps


class Shape(NamedTuple):
    """One piece of a link's geometry."""

    kind: str  # one of SHAPES
    rotation: np.ndarray  # (3, 3), in the link's frame
    translation: np.ndarray  # [m], (3,)
    sizes: tuple[float, ...]  # [m] capsule, cylinder: radius, length; sphere: radius; box: sides
    triangles: np.ndarray  # [m], (n, 3, 3), in the link's frame; none for a capsule or sphere
    file: str = ""  # of a mesh


@dataclass
class Source:
    """What `robot new` starts from."""

    path: Path
    root: ElementTree.Element  # joints and links alone: what the robot file's URDF will hold
    shapes: dict[str, list[Shape]]  # by link, what bodies are made around
    drawn: dict[str, list[Shape]]  # by link
    unread: dict[str, str]  # links whose drawing could not be read, and why
    model: pin.Model
    renamed: dict[str, str]  # links: the name they have in the URDF -> the one they have here
    notes: list[str] = field(default_factory=list)
    order: list[str] | None = None  # of joints that may move, where the file has one of its own
    apart: dict[frozenset[str], str] = field(default_factory=dict)  # links not to be watched, why
    inertial: dict[str, ElementTree.Element] = field(default_factory=dict)  # <inertial> by link
    armature: dict[str, float] = field(default_factory=dict)  # [kg m^2] by joint, of its motor
    poses: dict[str, dict[str, float]] = field(default_factory=dict)  # that the file holds, by name

    def settle(self, collision_only: bool) -> None:
        """Let what is drawn stand for collision geometry where a link has none, and say so."""
        for link, seen in self.drawn.items():
            if link not in self.shapes and not collision_only:
                self.shapes[link] = seen
                self.notes.append(
                    f"link '{link}': its visual shapes stand for the missing collision"
                )

    def joint(self, name: str) -> ElementTree.Element:
        """The joint of this name."""
        return next(item for item in self.root.findall("joint") if item.get("name") == name)


def read(path: Path, packages: Sequence[Path] = (), collision_only: bool = False) -> Source:
    """Read a URDF and the meshes of its collision and visual geometry.

    Args:
        path: the URDF.
        packages: folders that hold packages, or are one, for `package://`.
        collision_only: do without visual geometry that cannot be read, and never take it for
            collision geometry.

    Raises:
        RobotError: it is not a URDF, urdfdom or pinocchio refuse it, a mesh is missing or cannot
            be read; says what to do.
    """
    path = Path(path)
    if not path.is_file():
        raise RobotError(f"{path} does not exist; give the URDF of the robot")
    tree = urdf.elements(path, expanded(path) if path.suffix == ".xacro" else None)
    if any("xacro" in item.tag for item in tree.iter() if isinstance(item.tag, str)):
        tree = urdf.elements(path, expanded(path))
    notes: list[str] = []
    renamed = rename(tree)
    if renamed:
        notes.append(
            "links that share a joint's name are renamed in the robot file's URDF: "
            + ", ".join(f"{old} to {new}" for old, new in renamed.items())
        )
    root = bare_of(tree)
    model = model_of(path, root)
    finder = Finder(path, [Path(folder) for folder in packages])
    shapes: dict[str, list[Shape]] = {}
    drawn: dict[str, list[Shape]] = {}
    unread: dict[str, str] = {}
    for link in tree.findall("link"):
        name = link.get("name", "")
        capsules = {item.get("name") for item in link.findall("collision_checking/capsule")}
        usual = [item for item in link.findall("collision") if item.get("name") != urdf.FINE]
        if found := [_shape(path, name, item, capsules, finder) for item in usual]:
            shapes[name] = found
        try:
            seen = [_shape(path, name, item, set(), finder) for item in link.findall("visual")]
        except RobotError as refusal:
            if not collision_only:
                raise RobotError(f"{refusal}{WITHOUT}") from None
            unread[name], seen = str(refusal), []
        if seen:
            drawn[name] = seen
    inertial = {link.get("name", ""): item for link in tree.findall("link")
                if (item := link.find("inertial")) is not None}  # fmt: skip
    source = Source(path, root, shapes, drawn, unread, model, renamed, notes, inertial=inertial)
    source.settle(collision_only)
    return source


def text(root: ElementTree.Element) -> str:
    """A URDF as text, one element a line."""
    root = copy.deepcopy(root)
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def rename(tree: ElementTree.Element) -> dict[str, str]:
    """Give links that are called like a joint another name; pinocchio cannot reduce them."""
    joints = {joint.get("name") for joint in tree.findall("joint")}
    links = {link.get("name") for link in tree.findall("link")}
    renamed = {}
    for link in tree.findall("link"):
        old = link.get("name") or ""
        if old in joints:
            new = f"{old}_link"
            while new in joints | links:
                new += "_"
            renamed[old] = new
            link.set("name", new)
    for end in [*tree.findall("joint/parent"), *tree.findall("joint/child")]:
        end.set("link", renamed.get(end.get("link") or "", end.get("link") or ""))
    return renamed


def bare_of(tree: ElementTree.Element) -> ElementTree.Element:
    """Links without anything on them, and joints: kinematics alone; what was found before stays."""
    root = ElementTree.Element("robot", {"name": tree.get("name") or "robot", "version": "1.1"})
    root.extend(copy.deepcopy(item) for item in tree.findall(TAG))
    for link in tree.findall("link"):
        bare = ElementTree.SubElement(root, "link", {"name": link.get("name") or ""})
        bare.extend(copy.deepcopy(item) for item in link.findall(TAG))
    for joint in tree.findall("joint"):
        item = ElementTree.SubElement(root, "joint", dict(joint.attrib))
        item.extend(copy.deepcopy(child) for child in joint if child.tag in _JOINT)
    for item in root.iter():
        item.text = item.tail = None
    return root


def model_of(path: Path, root: ElementTree.Element) -> pin.Model:
    """Pinocchio's model of a URDF's joints.

    Raises:
        RobotError: urdfdom or pinocchio refuse it; passes their words on.
    """
    printed: list[str] = []
    try:
        with urdf.quiet(printed):
            return pin.buildModelFromXML(text(root))
    except (ValueError, RuntimeError) as error:
        reason = "; ".join([*printed[:2], " ".join(str(error).split())[:160]])
        raise RobotError(
            f"{path}: urdfdom or pinocchio refuse it ({reason}); correct that element, "
            "check_urdf shows the same"
        ) from None


@dataclass
class Finder:
    """Where a mesh's file is."""

    urdf: Path
    packages: list[Path]
    loaded: dict[tuple[str, tuple[float, ...]], np.ndarray] = field(default_factory=dict)

    def find(self, link: str, name: str) -> Path:
        """The file that a URDF's `filename` means."""
        for prefix in ("package://", "model://"):
            if name.startswith(prefix):
                inside = name[len(prefix) :].lstrip("/")
                for at in self._places(inside):
                    if at.is_file():
                        return at
                package = inside.split("/")[0]
                raise RobotError(
                    f"{self.urdf}: link '{link}' wants {name}, which is not found; say where "
                    f"package '{package}' lies with --package-path or ROS_PACKAGE_PATH"
                )
        at = Path(name.removeprefix("file://"))
        at = at if at.is_absolute() else self.urdf.parent / at
        if not at.is_file():
            raise RobotError(
                f"{self.urdf}: link '{link}' wants the mesh {at}, which does not exist; put it "
                "there, or correct the filename"
            )
        return at

    def _places(self, inside: str) -> list[Path]:
        package, _, rest = inside.partition("/")
        given = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
        places = []
        for folder in [*self.packages, *(Path(word) for word in given if word)]:
            places.append(folder / inside)
            if folder.name == package:
                places.append(folder / rest)
        for folder in self.urdf.resolve().parents:
            places.append(folder / rest if folder.name == package else folder / inside)
        return places

    def triangles(self, link: str, name: str, scale: tuple[float, ...]) -> np.ndarray:
        """Corners of a mesh's triangles [m], (n, 3, 3)."""
        file = self.find(link, name)
        key = (str(file), scale)
        if key not in self.loaded:
            self.loaded[key] = load_mesh(file, np.array(scale))
        return self.loaded[key]


def load_mesh(file: Path, scale: np.ndarray) -> np.ndarray:
    """Corners of a mesh's triangles [m], (n, 3, 3).

    Raises:
        RobotError: the file is no mesh, is empty, or reaches nowhere or beyond 10 m.
    """
    printed: list[str] = []
    try:
        with urdf.quiet(printed):
            mesh = coal.MeshLoader().load(str(file), scale)
        faces = (mesh.tri_indices(k) for k in range(mesh.num_tris))
        corners = np.array([(face[0], face[1], face[2]) for face in faces], int)
        vertices = np.array(mesh.vertices(), float)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:160]
        raise RobotError(
            f"{file}: not readable as a mesh ({reason}); give STL, DAE or OBJ"
        ) from None
    if not len(corners):
        raise RobotError(f"{file}: a mesh without triangles; give another one or leave it out")
    if not (np.abs(vertices) <= FARTHEST).all():
        raise RobotError(
            f"{file}: this mesh reaches beyond {FARTHEST:g} m, or nowhere; is it in millimetres? "
            'then scale="0.001 0.001 0.001" belongs in the URDF'
        )
    return vertices[corners]


def _shape(
    path: Path, link: str, item: ElementTree.Element, capsules: set, finder: Finder
) -> Shape:
    origin = item.find("origin")
    where = f"{path}: link '{link}'"
    xyz = _numbers(where, origin, "xyz", "0 0 0", 3)
    rpy = _numbers(where, origin, "rpy", "0 0 0", 3)
    rotation, at = pin.rpy.rpyToMatrix(*rpy), np.array(xyz)
    body = next((found for found in item.findall("geometry/*") if found.tag in SHAPES), None)
    if body is None:
        raise RobotError(f"{where}: a <{item.tag}> without geometry; give it a shape")
    if body.tag == "mesh":
        scale = tuple(_numbers(where, body, "scale", "1 1 1", 3))
        name = body.get("filename") or ""
        triangles = finder.triangles(link, name, scale)
        return Shape("mesh", rotation, at, (), triangles @ rotation.T + at, name)
    if body.tag == "box":
        sizes = _numbers(where, body, "size", None, 3)
        triangles = prism(*sizes)
    elif body.tag == "sphere":
        sizes, triangles = _numbers(where, body, "radius", None, 1), np.empty((0, 3, 3))
    else:
        sizes = [
            *_numbers(where, body, "radius", None, 1),
            *_numbers(where, body, "length", None, 1),
        ]
        triangles = rounded(*sizes) if body.tag == "cylinder" else np.empty((0, 3, 3))
    kind = body.tag
    if kind == "cylinder" and item.get("name") in capsules:
        kind, triangles = "capsule", np.empty((0, 3, 3))
    if not all(0.0 < size <= FARTHEST for size in sizes[: 1 if kind == "capsule" else 3]):
        raise RobotError(f"{where}: a {kind} of size {sizes}; sizes are in metres and above 0")
    return Shape(kind, rotation, at, tuple(sizes), triangles @ rotation.T + at)


def _numbers(
    where: str, item: ElementTree.Element | None, key: str, default: str | None, count: int
) -> list[float]:
    words = (item.get(key) if item is not None else None) or default or ""
    try:
        values = [float(word) for word in words.split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        tag = "an origin" if item is None else f"a <{item.tag}>"
        raise RobotError(f"{where}: {key} of {tag} must be {count} numbers, got {words!r}")
    return values


def prism(x: float, y: float, z: float) -> np.ndarray:
    """The twelve triangles of a box with these sides, (12, 3, 3)."""
    ring = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2
    return _between(ring, z)


def rounded(radius: float, length: float) -> np.ndarray:
    """Triangles of a prism around a cylinder along z: it contains the cylinder, (n, 3, 3)."""
    turn = 2.0 * np.pi * np.arange(_RIM) / _RIM
    ring = radius / np.cos(np.pi / _RIM) * np.column_stack([np.cos(turn), np.sin(turn)])
    return _between(ring, length)


def _between(ring: np.ndarray, height: float) -> np.ndarray:
    """Triangles of the prism over a convex ring (k, 2)."""
    low = np.column_stack([ring, np.full(len(ring), -height / 2)])
    high = np.column_stack([ring, np.full(len(ring), height / 2)])
    after = np.roll(np.arange(len(ring)), -1)
    sides = [np.stack([low, low[after], high], 1), np.stack([high, low[after], high[after]], 1)]
    lids = [np.stack([part[:1].repeat(len(ring) - 2, 0), part[1:-1], part[2:]], 1)
            for part in (low, high)]  # fmt: skip
    return np.concatenate(sides + lids)
