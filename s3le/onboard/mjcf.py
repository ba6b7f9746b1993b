"""An MJCF file (MuJoCo's) as elements: includes put in, classes of defaults resolved, angles told.

Pinocchio 4.1 has a reader of its own, which drops what lies in a `<frame>` and all but the first
joints of a body that has several, and gives up on files that MuJoCo reads (Booster's T1: an
`unordered_map::at`). So the elements are read here, and FK is held against MuJoCo's in the tests.
"""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from s3le.errors import RobotError

LARGEST = 16 * 2**20  # [bytes] of one file
_DEEPEST = 20  # includes within includes, elements within elements at 10 times that
_ROOTS = ("mujoco", "mujocoinclude")
_SAVED = "load it in MuJoCo, mj_saveLastXML, and give what that writes"


def is_mjcf(data: bytes) -> bool:
    """Does a text begin with <mujoco>?"""
    bare = re.sub(rb"<!--.*?-->|<\?.*?\?>", b"", data[:100_000], flags=re.S)
    return re.match(rb"\s*(\xef\xbb\xbf)?\s*<mujoco(include)?[\s/>]", bare) is not None


@dataclass
class Document:
    """A whole MJCF file."""

    path: Path
    root: ElementTree.Element  # without <include>
    radians: bool
    order: str  # of Euler angles: three of x, y, z (turning axes) or X, Y, Z (fixed ones)
    autolimits: bool
    assets: Path  # folder of meshes
    strips: bool  # of a mesh's file only the name counts
    defaults: dict[str, dict[str, dict[str, str]]]  # class -> tag -> attributes
    folders: dict[int, Path] = field(default_factory=dict)  # of <mesh>, by id: of its own file

    def attributes(
        self, item: ElementTree.Element, where: str, childclass: str | None
    ) -> dict[str, str]:
        """What an element says, and what its class says in its place."""
        name = item.get("class") or childclass or "main"
        if name not in self.defaults:
            raise RobotError(f"{where} is of class '{name}', which no <default> defines")
        return self.defaults[name].get(item.tag, {}) | dict(item.attrib)

    def angle(self, value: float) -> float:
        """An angle of the file in radians."""
        return value if self.radians else float(np.radians(value))

    def turn(self, said: dict[str, str], where: str) -> np.ndarray:
        """The rotation (3, 3) that an element's attributes say; none is none."""
        keys = [k for k in ("quat", "axisangle", "euler", "xyaxes", "zaxis") if k in said]
        if len(keys) > 1:
            raise RobotError(f"{where} has both {keys[0]} and {keys[1]}; one of them turns it")
        if not keys:
            return np.eye(3)
        size = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}[keys[0]]
        v = numbers(said, keys[0], where, size)
        if keys[0] == "quat":
            w, x, y, z = _unit(v, where, "quat")
            return np.array(pin.Quaternion(w, x, y, z).toRotationMatrix())
        if keys[0] == "axisangle":
            return np.array(pin.AngleAxis(self.angle(v[3]), _unit(v[:3], where, "axis")).matrix())
        if keys[0] == "euler":
            found = np.eye(3)
            for letter, angle in zip(self.order, v, strict=True):
                axis = np.eye(3)["xyz".index(letter.lower())]
                turn = pin.AngleAxis(self.angle(float(angle)), axis).matrix()
                found = found @ turn if letter.islower() else turn @ found
            return np.array(found)
        if keys[0] == "zaxis":
            return along(_unit(v, where, "zaxis"))
        x = _unit(v[:3], where, "xyaxes")
        y = _unit(v[3:] - (v[3:] @ x) * x, where, "xyaxes")
        return np.column_stack([x, y, np.cross(x, y)])

    def place(self, said: dict[str, str], where: str) -> pin.SE3:
        """The placement that an element's attributes say."""
        return pin.SE3(self.turn(said, where), numbers(said, "pos", where, 3, "0 0 0"))


def read(path: Path) -> Document:
    """Read a file and those that it includes.

    Raises:
        RobotError: not well-formed, too long, with a DOCTYPE, no MJCF, an include that is missing
            or goes round, or settings that are not read; names file and place.
    """
    folders: dict[int, Path] = {}
    root = _load(path, path, [], folders)
    compiler: dict[str, str] = {}
    for item in root.iter("compiler"):
        compiler |= item.attrib
    if compiler.get("coordinate", "local") != "local":
        raise RobotError(f"{path}: coordinate='global' of <compiler> is not read; {_SAVED}")
    order = compiler.get("eulerseq", "xyz")
    if not re.fullmatch("[xyzXYZ]{3}", order):
        raise RobotError(f"{path}: eulerseq of <compiler> must be three of xyzXYZ, got {order!r}")
    angle = compiler.get("angle", "degree")
    if angle not in ("degree", "radian"):
        raise RobotError(f"{path}: angle of <compiler> must be degree or radian, got {angle!r}")
    defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
    for item in root.findall("default"):
        _defaults(path, item, "main", defaults)
    return Document(
        path, root, angle == "radian", order, _yes(compiler, "autolimits", True),
        path.parent / (compiler.get("meshdir") or compiler.get("assetdir") or "."),
        _yes(compiler, "strippath", False), defaults, folders,
    )  # fmt: skip


def parts(
    body: ElementTree.Element, where: str, document: Document, childclass: str | None,
    at: pin.SE3,
) -> Iterator[tuple[ElementTree.Element, pin.SE3, str | None]]:  # fmt: skip
    """Children of a body, those of its frames too, with the frame they stand in and their class.

    Raises:
        RobotError: an element that makes bodies by rule and is not read.
    """
    for item in body:
        if item.tag in ("replicate", "composite", "flexcomp", "attach"):
            raise RobotError(f"{where}: <{item.tag}> is not read; {_SAVED}")
        if item.tag == "frame":
            inner = at * document.place(dict(item.attrib), f"{where}: a <frame>")
            kind = item.get("childclass") or childclass
            yield from parts(item, where, document, kind, inner)
        else:
            yield item, at, childclass


def numbers(
    said: dict[str, str], key: str, where: str, count: int, default: str | None = None
) -> np.ndarray:
    """So many numbers of an attribute.

    Raises:
        RobotError: it is not there, or they are fewer, or are none.
    """
    words = said.get(key, default)
    if words is None:
        raise RobotError(f"{where} needs {key}: {count} numbers")
    try:
        values = np.array([float(word) for word in words.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) < count or not np.isfinite(values).all() or len(values) > max(count, 3):
        raise RobotError(f"{where}: {key} must be {count} numbers, got {words!r}")
    return values[:count]


def along(z: np.ndarray) -> np.ndarray:
    """The least rotation (3, 3) that turns the z axis into a unit vector (3,)."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-10:
        return np.eye(3) if z[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return np.array(pin.AngleAxis(float(np.arctan2(sine, z[2])), axis / sine).matrix())


def _unit(vector: np.ndarray, where: str, key: str) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if not length > 1e-9:
        raise RobotError(f"{where}: {key} has no direction")
    return vector / length


def _yes(said: dict[str, str], key: str, default: bool) -> bool:
    return said.get(key, "true" if default else "false") == "true"


def _load(
    path: Path, main: Path, above: list[Path], folders: dict[int, Path]
) -> ElementTree.Element:
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except OSError as error:
        raise RobotError(f"{path}: not readable ({error.strerror})") from None
    if len(data) > LARGEST:
        raise RobotError(f"{path}: longer than the {LARGEST / 2**20:g} MiB of an MJCF file")
    if b"<!DOCTYPE" in data:
        raise RobotError(f"{path}: a DOCTYPE is not read; write its entities out")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotError(f"{path}: not well-formed XML ({error})") from None
    if root.tag not in _ROOTS:
        raise RobotError(f"{path}: its root is <{root.tag}>, wanted the <mujoco> of an MJCF file")
    for item in root.iter("mesh"):
        folders[id(item)] = path.parent
    _include(root, path, main, [*above, path.resolve()], folders, 0)
    return root


def _include(
    parent: ElementTree.Element, path: Path, main: Path, above: list[Path],
    folders: dict[int, Path], depth: int,
) -> None:  # fmt: skip
    """Put the content of included files in the place of each <include>."""
    if depth > 10 * _DEEPEST:
        raise RobotError(f"{path}: elements lie more than {10 * _DEEPEST} deep in each other")
    children: list[ElementTree.Element] = []
    for item in list(parent):
        if item.tag != "include":
            _include(item, path, main, above, folders, depth + 1)
            children.append(item)
            continue
        name = item.get("file") or ""
        places = [main.parent / name, path.parent / name]
        file = next((place for place in places if name and place.is_file()), None)
        if file is None:
            raise RobotError(f"{path}: <include file={name!r}>: {places[0]} does not exist")
        if file.resolve() in above or len(above) > _DEEPEST:
            raise RobotError(f"{path}: <include file={name!r}> includes itself")
        children += list(_load(file, main, above, folders))
    parent[:] = children


def _defaults(
    path: Path, item: ElementTree.Element, name: str, found: dict[str, dict[str, dict[str, str]]]
) -> None:
    for child in item:
        if child.tag != "default":
            own = found[name]
            own[child.tag] = own.get(child.tag, {}) | dict(child.attrib)
    for child in item.findall("default"):
        inner = child.get("class")
        if not inner:
            raise RobotError(f"{path}: a <default> within another needs class")
        found[inner] = {tag: dict(said) for tag, said in found[name].items()}
        _defaults(path, child, inner, found)
