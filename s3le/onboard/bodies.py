"""What stands for a link in the robot file's URDF: its own primitives, or capsules around it.

A capsule or sphere stays itself. A box or cylinder stays too where one capsule around it is as
good as several; it is the project's model that puts that capsule around it. Meshes, and what is
worth sharing, become capsules, written with six decimals and then made wide enough again.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.onboard.capsules import Capsule, Fitted, around, hull_volume, reach_beyond, share, volume
from s3le.onboard.source import Shape, Source
from s3le.robot.description import read_mapping
from s3le.robot.model import FARTHEST

DIGITS = 6  # decimals of lengths [m] and angles [rad] in the URDF
MOST = 4  # capsules that a mesh becomes, unless asked otherwise


class Made(NamedTuple):
    """What became of one piece of collision geometry."""

    link: str
    kind: str  # of the source: mesh, box, cylinder, capsule, sphere, or spheres (a list)
    elements: list[ElementTree.Element]  # <collision>, for the URDF
    capsules: list[Capsule]  # in the link's frame; none where the primitive stays
    points: list[np.ndarray]  # what each contains [m], (n, 3)
    hull: float  # volume of the source's convex hull [m^3]; 0 where the primitive stays
    adds: float  # how far the capsules reach beyond that hull [m]

    @property
    def grown(self) -> float:
        """Volume of the capsules together over that of the hull."""
        return volume(self.capsules) / self.hull if self.hull > 0.0 else math.nan


def make(source: Source, most: int, spheres: Mapping[str, np.ndarray] | None = None) -> list[Made]:
    """Bodies of every link, in the order of the URDF.

    Args:
        source: the URDF.
        most: capsules at most for a mesh.
        spheres: by link, centre and radius [m], (n, 4); these links have no other bodies.

    Raises:
        RobotError: spheres are given for a link that is not there.
    """
    spheres = spheres or {}
    names = [link.get("name", "") for link in source.root.findall("link")]
    if lost := [link for link in spheres if link not in names]:
        raise RobotError(f"spheres are given for '{lost[0]}', which is no link of {source.path}")
    made = []
    for link in names:
        if link in spheres:
            made.append(_list(link, spheres[link]))
        else:
            made += of_shapes(link, source.shapes.get(link, []), most)
    return made


def of_shapes(link: str, shapes: Sequence[Shape], most: int) -> list[Made]:
    """Bodies of a link, at most `most` capsules for each piece."""
    return [_piece(link, shape, most) for shape in shapes]


def read_spheres(path: Path) -> dict[str, np.ndarray]:
    """A list of spheres: YAML, link -> list of {center: [x, y, z], radius: r}, in metres.

    The mapping may stand below the key `collision_spheres`, as cuRobo's files have it.

    Returns:
        By link, centre and radius [m], (n, 4).

    Raises:
        RobotError: the file cannot be read, or an entry is no sphere.
    """
    tree = read_mapping(path, "links with lists of spheres", 4 * 2**20)
    tree = tree.get("collision_spheres", tree)
    out = {}
    listed: Any = tree.items() if isinstance(tree, dict) else [("", None)]
    for link, items in listed:
        try:
            spheres = [[*item["center"], item["radius"]] for item in items]
            rows: np.ndarray = np.array(spheres, float)
        except (TypeError, KeyError, ValueError):
            rows = np.empty((0, 0))
        good = rows.ndim == 2 and rows.shape[1:] == (4,) and np.abs(rows).max() <= FARTHEST
        if not good or not (rows[:, 3] > 0.0).all():
            raise RobotError(
                f"{path}: link '{link}' needs a list of spheres, {{center: [x, y, z], radius: r}} "
                "in metres, radius above 0"
            )
        out[str(link)] = rows
    return out


def element(capsule: Capsule, points: np.ndarray) -> tuple[ElementTree.Element, Capsule]:
    """A <collision> for a capsule, and the capsule that its rounded numbers mean.

    Args:
        capsule: what is wanted.
        points: what it must contain [m], (n, 3); the radius grows by what rounding takes away.
    """
    along = capsule.b - capsule.a
    length = round(float(np.linalg.norm(along)), DIGITS)
    middle = np.round((capsule.a + capsule.b) / 2, DIGITS) + 0.0
    rpy = np.zeros(3)
    if length > 0.0:
        rpy[1] = math.atan2(math.hypot(along[0], along[1]), along[2])
        rpy[2] = math.atan2(along[1], along[0])
    rpy = np.round(rpy, DIGITS) + 0.0
    half = pin.rpy.rpyToMatrix(*rpy)[:, 2] * length / 2
    tight = around(points, middle - half, middle + half)
    radius = math.ceil(tight.radius * 10**DIGITS) / 10**DIGITS
    item = ElementTree.Element("collision")
    ElementTree.SubElement(item, "origin", {"xyz": _words(middle), "rpy": _words(rpy)})
    geometry = ElementTree.SubElement(item, "geometry")
    if length > 0.0:
        shape = {"radius": f"{radius:.{DIGITS}f}", "length": f"{length:.{DIGITS}f}"}
        ElementTree.SubElement(geometry, "capsule", shape)
    else:
        ElementTree.SubElement(geometry, "sphere", {"radius": f"{radius:.{DIGITS}f}"})
    return item, tight._replace(radius=radius)


def _piece(link: str, shape: Shape, most: int) -> Made:
    if shape.kind in ("capsule", "sphere"):
        return Made(link, shape.kind, [_same(shape)], [], [], 0.0, 0.0)
    parts: list[Fitted] = share(shape.triangles, most)
    if shape.kind != "mesh" and len(parts) == 1:
        return Made(link, shape.kind, [_same(shape)], [], [], 0.0, 0.0)
    written = [element(part.capsule, part.points) for part in parts]
    return Made(
        link, shape.kind, [item for item, _ in written], [capsule for _, capsule in written],
        [part.points for part in parts], hull_volume(shape.triangles.reshape(-1, 3)),
        reach_beyond([capsule for _, capsule in written], shape.triangles.reshape(-1, 3)),
    )  # fmt: skip


def rebuilt(body: Made) -> ElementTree.Element:
    """A link of nothing but one piece's bodies."""
    item = ElementTree.Element("link")
    item.extend(body.elements)
    return item


def _list(link: str, rows: np.ndarray) -> Made:
    elements = []
    for x, y, z, radius in rows:
        item = ElementTree.Element("collision")
        ElementTree.SubElement(item, "origin", {"xyz": _exact((x, y, z)), "rpy": "0 0 0"})
        geometry = ElementTree.SubElement(item, "geometry")
        ElementTree.SubElement(geometry, "sphere", {"radius": _exact((radius,))})
        elements.append(item)
    return Made(link, "spheres", elements, [], [], 0.0, 0.0)


def _same(shape: Shape) -> ElementTree.Element:
    """A primitive as it was, to the last digit that a file can hold."""
    item = ElementTree.Element("collision")
    rpy = pin.rpy.matrixToRpy(shape.rotation)
    ElementTree.SubElement(item, "origin", {"xyz": _exact(shape.translation), "rpy": _exact(rpy)})
    geometry = ElementTree.SubElement(item, "geometry")
    if shape.kind == "box":
        size = {"size": _exact(shape.sizes)}
    elif shape.kind == "sphere":
        size = {"radius": _exact(shape.sizes)}
    else:
        size = {"radius": _exact(shape.sizes[:1]), "length": _exact(shape.sizes[1:])}
    ElementTree.SubElement(geometry, shape.kind, size)
    return item


def _words(values: np.ndarray) -> str:
    return " ".join(f"{value:.{DIGITS}f}" for value in values)


def _exact(values) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
