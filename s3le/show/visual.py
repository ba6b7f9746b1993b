"""What a robot looks like: the meshes of its URDF, on the joints that carry them.

For the eye alone; nothing is computed with them. A robot whose URDF has none, or whose mesh files
are elsewhere, is shown by its bodies.
"""

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.errors import RobotError
from s3le.robot import urdf
from s3le.robot.model import Geometry

GREY = (0.72, 0.74, 0.76)  # of what has no colour
MOST_BYTES = 256 << 20  # of one mesh file


class Visual(NamedTuple):
    """One mesh, fixed to a joint."""

    link: str
    joint: int  # index into the moving joints; -1 for the base and all that stands still
    vertices: np.ndarray  # [m], (n, 3), in the joint's frame
    faces: np.ndarray  # int (m, 3)
    colour: tuple[float, float, float]


def visuals(robot: Geometry, file: Path | None = None) -> list[Visual]:
    """The meshes of a robot's URDF; none where it has none.

    Args:
        robot: whose.
        file: another URDF of the same robot, for `robot new` keeps no meshes; None: its own.

    Raises:
        RobotError: a mesh is not where the URDF says, or cannot be read; names it. Or `file` has
            none for the robot's links.
    """
    source = robot.description.urdf if file is None else Path(file)
    tree = robot.tree if file is None else urdf.elements(source)
    model, _ = robot.reduced()
    named = {m.get("name"): m for m in tree.findall("material")}
    found = []
    for link in tree.findall("link"):
        for item in link.findall("visual"):
            mesh = item.find("geometry/mesh")
            if mesh is None or not model.existBodyName(str(link.get("name"))):
                continue
            frame = model.frames[model.getBodyId(str(link.get("name")))]
            at = frame.placement * _origin(source, item)
            vertices, faces = _mesh(_resolve(source, str(mesh.get("filename"))), _scale(mesh))
            found.append(
                Visual(
                    str(link.get("name")),
                    int(frame.parentJoint) - 1,
                    vertices @ at.rotation.T + at.translation,
                    faces,
                    _colour(item, named),
                )
            )
    if file is not None and not found:
        raise RobotError(f"{file}: no mesh of a link that {robot.description.source} has")
    return found


def _origin(source: Path, item: ElementTree.Element) -> pin.SE3:
    at = item.find("origin")
    words = {} if at is None else at.attrib
    try:
        xyz, rpy = (np.array(words.get(k, "0 0 0").split(), float) for k in ("xyz", "rpy"))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)
    except (TypeError, ValueError):
        raise RobotError(f"{source}: the origin of a visual is no pose") from None


def _scale(mesh: ElementTree.Element) -> np.ndarray:
    try:
        return np.array((mesh.get("scale") or "1 1 1").split(), float) * np.ones(3)
    except ValueError:
        raise RobotError(f"the scale of mesh {mesh.get('filename')} is not three numbers") from None


def _resolve(source: Path, name: str) -> Path:
    """The file that a URDF means by a name: beside it, or in a package that lies around it."""
    here = source.resolve()
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        roots = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        places = [root / package / rest for root in (*roots, *here.parents)]
        places += [root / rest for root in (*roots, *here.parents) if root.name == package]
    else:
        places = [here.parent / name.removeprefix("file://")]
    for place in places:
        if place.is_file():
            return place
    raise RobotError(
        f"{source}: mesh {name} is not there; put it beside the URDF, or the "
        "folder that holds its package into ROS_PACKAGE_PATH"
    )


def _mesh(path: Path, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if path.stat().st_size > MOST_BYTES:
        raise RobotError(f"{path}: a mesh of more than {MOST_BYTES >> 20} MiB is not shown")
    printed: list[str] = []
    try:
        with urdf.quiet(printed):
            model = coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(path), scale)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:160]
        raise RobotError(f"{path}: no mesh that can be read ({reason})") from None
    corners = (model.tri_indices(i) for i in range(model.num_tris))
    faces = np.array([(c[0], c[1], c[2]) for c in corners], np.uint32)
    if not len(faces):
        raise RobotError(f"{path}: a mesh without triangles")
    return np.array(model.vertices(), float), faces.reshape(-1, 3)


def _colour(item: ElementTree.Element, named: dict) -> tuple[float, float, float]:
    material = item.find("material")
    for place in (material, named.get(None if material is None else material.get("name"))):
        rgba = None if place is None else place.find("color")
        if rgba is not None:
            try:
                red, green, blue = (float(word) for word in str(rgba.get("rgba")).split()[:3])
            except ValueError:
                continue
            return red, green, blue
    return GREY
