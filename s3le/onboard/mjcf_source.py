"""The geoms of an MJCF file as shapes of links: those that collide, and those that are drawn.

A geom collides if its `contype` or `conaffinity` is not 0, or a `<pair>` names it. Which bits they
are is not asked: they say what a simulation leaves out, not what may touch. It is drawn if its
group is one that MuJoCo shows (0 to 2) and it is not transparent.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from s3le.errors import RobotError
from s3le.onboard import mjcf, mjcf_tree, source, stand
from s3le.onboard.capsules import directions
from s3le.onboard.source import Shape, Source
from s3le.robot.model import FARTHEST

_SHOWN = 3  # groups that MuJoCo draws unless asked
_ROUND = 200  # corners of what stands around an ellipsoid
_FLAT = ("plane", "hfield")


def read(path: Path, collision_only: bool = False) -> Source:
    """Read an MJCF file and its meshes.

    Args:
        path: the file.
        collision_only: as source.read.

    Raises:
        RobotError: the file or one that it includes is damaged, holds no robot or something that
            is not read, or a mesh is missing; names file and place.
    """
    path = Path(path)
    document = mjcf.read(path)
    robot = mjcf_tree.build(document)
    renamed = source.rename(robot.root)
    root = source.bare_of(robot.root)
    model = source.model_of(path, root)
    notes = list(robot.notes)
    if renamed:
        notes.append(
            "bodies that share a joint's name are renamed in the robot file's URDF: "
            + ", ".join(f"{old} to {new}" for old, new in renamed.items())
        )
    meshes = _Meshes(document)
    paired = {item.get(key) for group in document.root.findall("contact")
              for item in group.findall("pair") for key in ("geom1", "geom2")}  # fmt: skip
    shapes: dict[str, list[Shape]] = {}
    drawn: dict[str, list[Shape]] = {}
    unread: dict[str, str] = {}
    for geom in robot.geoms:
        link = renamed.get(geom.link, geom.link)
        solid = _collides(geom) or geom.said.get("name") in paired
        seen = _drawn(geom)
        if not solid and not seen:
            continue
        try:
            shape = _shape(document, geom, meshes)
        except RobotError as refusal:
            if solid:
                raise
            if not collision_only:
                raise RobotError(f"{refusal}{source.WITHOUT}") from None
            unread[link] = str(refusal)
            continue
        if shape is None:
            notes.append(f"{geom.where} is a {geom.said.get('type')}, and left out")
            continue
        if solid:
            shapes.setdefault(link, []).append(shape)
        if seen:
            drawn.setdefault(link, []).append(shape)
    drawn = {link: found for link, found in drawn.items() if link not in unread}
    apart = {frozenset(renamed.get(k, k) for k in pair): why for pair, why in robot.apart.items()}
    inertial = {renamed.get(link, link): item for link, item in robot.inertial.items()}
    found = Source(
        path, root, shapes, drawn, unread, model, renamed, notes, robot.joints, apart, inertial,
        robot.armature, stand.keys(document.root, robot.width),
    )  # fmt: skip
    found.settle(collision_only)
    return found


def _collides(geom: mjcf_tree.Geom) -> bool:
    bits = [mjcf.numbers(geom.said, key, geom.where, 1, "1")[0]
            for key in ("contype", "conaffinity")]  # fmt: skip
    return any(bits)


def _drawn(geom: mjcf_tree.Geom) -> bool:
    alpha = mjcf.numbers(geom.said, "rgba", geom.where, 4, "1 1 1 1")[3]
    return 0 <= mjcf.numbers(geom.said, "group", geom.where, 1, "0")[0] < _SHOWN and alpha > 0.0


def _shape(document: mjcf.Document, geom: mjcf_tree.Geom, meshes: "_Meshes") -> Shape | None:
    """A geom in its link's frame; None: it has no volume that a body could hold."""
    said, where = geom.said, geom.where
    kind = said.get("type", "sphere")
    if "mesh" in said and kind not in _FLAT:  # MuJoCo fits a primitive to it; the mesh is nearer
        at = geom.frame * document.place(said, where)
        triangles = meshes.triangles(said["mesh"], where)
        moved = triangles @ at.rotation.T + at.translation
        return Shape("mesh", at.rotation, at.translation, (), moved, said["mesh"])
    if kind in _FLAT:
        return None
    counts = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
    if kind not in counts:
        raise RobotError(f"{where} is of type {kind!r}, which is not read; leave it out")
    at, count = document.place(said, where), counts[kind]
    if "fromto" in said and kind != "sphere":
        ends = mjcf.numbers(said, "fromto", where, 6).reshape(2, 3)
        way = ends[0] - ends[1]
        length = float(np.linalg.norm(way))
        if not length > 0.0:
            raise RobotError(f"{where}: fromto has no length")
        at = pin.SE3(mjcf.along(way / length), ends.mean(axis=0))
        thick = mjcf.numbers(said, "size", where, 1)  # of a box too, on all four sides
        size = np.array([thick[0]] * (count - 1) + [length / 2])
    else:
        size = mjcf.numbers(said, "size", where, count)
    if not ((size > 0.0) & (size <= FARTHEST)).all():
        raise RobotError(f"{where}: a {kind} of size {said.get('size')}; sizes are in metres")
    at = geom.frame * at
    sizes: tuple[float, ...] = tuple(map(float, size))
    triangles = np.empty((0, 3, 3))
    if kind in ("capsule", "cylinder"):
        sizes = (sizes[0], 2.0 * sizes[1])
        triangles = source.rounded(*sizes) if kind == "cylinder" else triangles
    elif kind == "box":
        sizes = (2.0 * sizes[0], 2.0 * sizes[1], 2.0 * sizes[2])
        triangles = source.prism(*sizes)
    elif kind == "ellipsoid":
        kind, triangles, sizes = "mesh", _ball() * size, ()
    return Shape(kind, at.rotation, at.translation, sizes,
                 triangles @ at.rotation.T + at.translation)  # fmt: skip


def _ball() -> np.ndarray:
    """Triangles around the unit ball: they contain it, (n, 3, 3)."""
    hull = ConvexHull(directions(_ROUND))
    return hull.points[hull.simplices] / -hull.equations[:, 3].max()


class _Meshes:
    """The meshes that a file's assets name, read once."""

    def __init__(self, document: mjcf.Document) -> None:
        self.document = document
        self.assets = {}
        for group in document.root.findall("asset"):
            for item in group.findall("mesh"):
                name = item.get("name") or Path(item.get("file") or "").stem
                self.assets[name] = item
        self.loaded: dict[str, np.ndarray] = {}

    def triangles(self, name: str, where: str) -> np.ndarray:
        """Corners of a mesh's triangles in its geom's frame [m], (n, 3, 3)."""
        if name not in self.assets:
            raise RobotError(f"{where} is of the mesh '{name}', which no <asset> names")
        if name not in self.loaded:
            self.loaded[name] = self._load(name)
        return self.loaded[name]

    def _load(self, name: str) -> np.ndarray:
        document, item = self.document, self.assets[name]
        where = f"{document.path}: mesh '{name}'"
        said = document.attributes(item, where, None)
        scale = mjcf.numbers(said, "scale", where, 3, "1 1 1")
        moves = pin.SE3(
            document.turn({"quat": said["refquat"]} if "refquat" in said else {}, where),
            mjcf.numbers(said, "refpos", where, 3, "0 0 0"),
        )  # fmt: skip
        if "builtin" in said:
            raise RobotError(f"{where} is made by rule (builtin), which is not read")
        if "vertex" in said:
            triangles = _inline(said, where)
        else:
            file = self._file(said, where, item)
            if np.any(moves.translation) or not np.allclose(moves.rotation, np.eye(3)):
                triangles = source.load_mesh(file, np.ones(3))
            else:
                return source.load_mesh(file, scale)
        # MuJoCo takes refpos off, turns refquat back, and scales what is left
        return ((triangles - moves.translation) @ moves.rotation) * scale

    def _file(self, said: dict[str, str], where: str, item) -> Path:
        name = said.get("file") or ""
        name = Path(name).name if self.document.strips else name
        places = [self.document.assets / name, self.document.folders[id(item)] / name]
        file = next((place for place in places if name and place.is_file()), None)
        if file is None:
            raise RobotError(f"{where} wants {places[0]}, which does not exist; put it there")
        return file


def _inline(said: dict[str, str], where: str) -> np.ndarray:
    """Triangles of a mesh that is written out; the hull of its vertices without faces."""
    try:
        vertices = np.array(said["vertex"].split(), float).reshape(-1, 3)
        if "face" in said:
            return vertices[np.array(said["face"].split(), int).reshape(-1, 3)]
        return vertices[ConvexHull(vertices).simplices]
    except (ValueError, IndexError, QhullError) as error:
        reason = " ".join(str(error).split())[:80]
        raise RobotError(f"{where}: its vertices and faces make no mesh ({reason})") from None
