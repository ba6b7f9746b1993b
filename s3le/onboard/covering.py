"""How far each link's drawing reaches beyond the bodies that stand for it, and what then does.

Reach is a maximum over vertices, and over points between them where a triangle is larger than
20 mm: a large flat face has none of its own. The share of the volume outside is taken over the
convex hull of each piece.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from s3le.errors import RobotError
from s3le.onboard.bodies import Made, make, of_shapes
from s3le.onboard.capsules import Capsule, directions, extreme, spread, to_segment, volume
from s3le.onboard.source import Shape, Source
from s3le.robot.model import containing_capsule_of_box, containing_capsule_of_cylinder
from s3le.robot.urdf import FINE
from s3le.safety.covered import TAG, Drawn, Record, mark, say

_FINE = 0.02  # [m], longest edge of a triangle that has no points but its corners
_MOST = 64  # parts of an edge
_PROBES = 4000  # points that a piece's volume is asked at
_DIRECTIONS = 400  # points on a sphere or on each end of a capsule that is drawn

Capsules = list[tuple[np.ndarray, np.ndarray, float]]  # ends [m] and radius [m]


class Covered(NamedTuple):
    """Bodies of a robot, and what is drawn beyond them."""

    made: list[Made]
    record: Record
    notes: list[str]  # for a person, one a link that got other bodies


def cover(
    source: Source, most: int, spheres: Mapping[str, np.ndarray], allowance: float,
    collision_only: bool,
) -> Covered:  # fmt: skip
    """Make bodies, put them into the URDF's elements, and hold what is drawn against them.

    A link that is drawn farther beyond its bodies than is allowed gets bodies around what is
    drawn. Its own pieces stay where they reach as far beyond those. What `--hulls` keeps follows.

    Args:
        source: the URDF; its elements and shapes are changed.
        most: capsules at most for a mesh.
        spheres: by link, centre and radius [m], (n, 4); these links keep them, whatever is drawn.
        allowance: how far a drawing may reach beyond bodies [m].
        collision_only: leave bodies as they are.

    Raises:
        RobotError: a link is drawn, has no body, and must not get one; or there is none at all.
    """
    seen = [*source.drawn, *source.unread]
    if bare := [link for link in seen if link not in source.shapes and link not in spheres]:
        named = ", ".join(bare[:8]) + (" ..." if len(bare) > 8 else "")
        raise RobotError(
            f"{source.path}: {len(bare)} links are drawn but have no collision geometry, so "
            f"nothing would watch them: {named}; leave out --collision-only, or give spheres "
            "(--spheres)"
        )
    made = make(source, most, spheres)
    if not made:
        raise RobotError(
            f"{source.path}: no collision geometry at all and nothing is drawn, so nothing could "
            "be checked; add <collision> to its links, or give spheres (--spheres)"
        )
    links = {link.get("name"): link for link in source.root.findall("link")}
    for body in made:
        links[body.link].extend(body.elements)
    return settle(source, made, most, spheres, allowance, collision_only)


def settle(
    source: Source, made: list[Made], most: int, spheres: Mapping[str, np.ndarray],
    allowance: float, collision_only: bool,
) -> Covered:  # fmt: skip
    """Hold what is drawn against bodies that are in the URDF's elements (see cover)."""
    links = {link.get("name"): link for link in source.root.findall("link")}
    found = measure(source.model, source.root, source.drawn, list(source.unread))
    notes = []
    for link, item in found.items():
        if collision_only or link in spheres or item.reach <= allowance:
            continue
        notes.append(
            f"link '{link}': drawn up to {item.reach * 1e3:.0f} mm beyond the bodies of its "
            f"collision shapes ({item.share:.0%} outside); it gets bodies around what is drawn"
        )
        source.shapes[link], own = _drawn_bodies(source, link, most, allowance)
        for old in links[link].findall("collision"):
            links[link].remove(old)
        links[link].extend(element for body in own for element in body.elements)
        at = next(k for k, body in enumerate(made) if body.link == link)
        made = [body for body in made if body.link != link]
        made[at:at] = own
    if notes:
        found = measure(source.model, source.root, source.drawn, list(source.unread))
    record = Record(allowance, tuple(found.values()))
    if found or source.root.find(TAG) is None:  # a robot file's own URDF says what was found then
        mark(source.root, record)
    if collision_only:
        notes += [
            f"link {say(item)} is drawn beyond its bodies, and nothing watches it there"
            for item in record.beyond
        ]
    return Covered(made, record, notes)


def _drawn_bodies(
    source: Source, link: str, most: int, allowance: float
) -> tuple[list[Shape], list[Made]]:
    """What stands for a link that its own shapes do not cover, and bodies around it."""
    seen = source.drawn[link]
    ways = [(merged(seen), most)]
    if 1 < len(seen) <= most:
        ways.append((list(seen), max(1, most // len(seen))))
    tried = [(shapes, of_shapes(link, shapes, each)) for shapes, each in ways]
    shapes, made = min(tried, key=lambda one: volume([Capsule(*c) for c in _solid(one[1])]))
    held = _solid(made)
    more = [
        shape for shape in source.shapes[link]
        if outside(surface(shape), held).max() > allowance
    ]  # fmt: skip
    return [*shapes, *more], [*made, *of_shapes(link, more, most)]


def _solid(made: Sequence[Made]) -> Capsules:
    item = ElementTree.Element("link")
    item.extend(element for body in made for element in body.elements)
    return bodies_of(item)


def measure(
    model: pin.Model, root: ElementTree.Element, drawn: Mapping[str, Sequence[Shape]],
    unknown: Sequence[str] = (),
) -> dict[str, Drawn]:  # fmt: skip
    """Hold every drawn link against the bodies of all links that are fixed to it.

    Args:
        model: of the whole URDF, no joint locked.
        root: the URDF with its bodies: capsules, spheres, boxes and cylinders.
        drawn: by link, what is drawn.
        unknown: links whose drawing could not be read.
    """
    frames = {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}
    solids: list[dict[int, Capsules]] = [{}, {}]  # with usual bodies; with finer ones, where any
    finer = set()  # joints that carry some
    for link in root.findall("link"):
        frame = frames[link.get("name") or ""]
        if any(item.get("name") == FINE for item in link.findall("collision")):
            finer.add(frame.parentJoint)
        at = frame.placement
        for fine, solid in enumerate(solids):
            solid.setdefault(frame.parentJoint, []).extend(
                (at.act(a), at.act(b), radius) for a, b, radius in bodies_of(link, bool(fine))
            )
    found = {}
    for link in (name for name in frames if name in drawn or name in unknown):
        if link in unknown:
            found[link] = Drawn(link, np.nan, np.nan)
            continue
        frame = frames[link]
        kinds = solids[: 2 if frame.parentJoint in finer else 1]
        ways = [
            _one(link, drawn[link], frame.placement, solid.get(frame.parentJoint, []))
            for solid in kinds
        ]
        found[link] = Drawn(link, max(w.reach for w in ways), max(w.share for w in ways))
    return found


def bodies_of(link: ElementTree.Element, fine: bool = False) -> Capsules:
    """What the model makes of a link's bodies, in the link's frame: usual, or finer if it has any.

    Each kind contains the link.
    """
    found = []
    every = link.findall("collision")
    fine = fine and any(item.get("name") == FINE for item in every)
    for item in every:
        if (item.get("name") == FINE) != fine:
            continue
        origin = item.find("origin")
        words = {} if origin is None else dict(origin.items())
        xyz, rpy = (np.array(words.get(k, "0 0 0").split(), float) for k in ("xyz", "rpy"))
        shape = next(iter(item.find("geometry") or ()))
        numbers = {key: [float(word) for word in text.split()] for key, text in shape.items()}
        half, axis = 0.0, np.eye(3)[2]
        if shape.tag == "box":
            half, radius, axis = containing_capsule_of_box(np.array(numbers["size"]) / 2)
        else:
            radius, length = numbers["radius"][0], numbers.get("length", [0.0])[0]
            half = length / 2
            if shape.tag == "cylinder":
                half, radius = containing_capsule_of_cylinder(radius, half)
        along = pin.rpy.rpyToMatrix(*rpy) @ axis * half
        found.append((xyz - along, xyz + along, radius))
    return found


def outside(points: np.ndarray, bodies: Capsules) -> np.ndarray:
    """How far each point (n, 3) lies outside all bodies [m], (n,); 0: inside; inf: no body."""
    far = np.full(len(points), np.inf)
    for a, b, radius in bodies:
        far = np.minimum(far, to_segment(points, a, b) - radius)
    return np.where(far <= 1e-9, 0.0, far)


def merged(shapes: Sequence[Shape]) -> list[Shape]:
    """What is drawn of a link as pieces that bodies are made around: at most one of triangles."""
    flat = [shape for shape in shapes if len(shape.triangles)]
    if len(flat) < 2:
        return list(shapes)
    triangles = np.concatenate([shape.triangles for shape in flat])
    one = Shape("mesh", np.eye(3), np.zeros(3), (), triangles, flat[0].file)
    return [one, *(shape for shape in shapes if not len(shape.triangles))]


def surface(shape: Shape) -> np.ndarray:
    """Points on a piece [m], (n, 3), in the link's frame: its corners, and between them."""
    if not len(shape.triangles):
        radius, half = shape.sizes[0], (shape.sizes[1] / 2 if len(shape.sizes) > 1 else 0.0)
        ends = shape.translation + np.array([[-half], [half]]) * shape.rotation[:, 2]
        return (ends[:, None] + radius * directions(_DIRECTIONS)).reshape(-1, 3)
    triangles = shape.triangles
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(edges / _FINE).astype(int), 1, _MOST)
    found = [np.unique(triangles.reshape(-1, 3), axis=0)]
    for n in np.unique(parts[parts > 1]):
        i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
        weights = np.stack([i, j, n - i - j], axis=1)[i + j <= n] / n
        found.append(np.einsum("kc,ncx->nkx", weights, triangles[parts == n]).reshape(-1, 3))
    return np.concatenate(found)


def _one(link: str, shapes: Sequence[Shape], at: pin.SE3, bodies: Capsules) -> Drawn:
    pieces = [surface(shape) @ at.rotation.T + at.translation for shape in shapes]
    points = np.concatenate(pieces)
    if not bodies:
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        return Drawn(link, size, 1.0)  # nothing is there: all of it, from end to end
    inner = _inside(pieces)
    inner = inner if len(inner) else points  # flat: of what is seen of it
    reach = float(outside(points, bodies).max())
    return Drawn(link, reach, float((outside(inner, bodies) > 0.0).mean()))


def _inside(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Points spread evenly in the convex hulls of the pieces together, (n, 3)."""
    points = np.concatenate(pieces)
    low, high = points.min(axis=0), points.max(axis=0)
    probes = low + spread(_PROBES) * (high - low)
    inside = np.zeros(len(probes), bool)
    for piece in pieces:
        try:
            faces = ConvexHull(extreme(piece)).equations
        except (QhullError, ValueError):
            continue  # flat
        inside |= (probes @ faces[:, :3].T + faces[:, 3] <= 0.0).all(axis=1)
    return probes[inside]
