"""Finer bodies for a pair of links whose capsules overlap although the links themselves do not.

    python benchmarks/robots/finer.py coman SOURCES/iit-coman-ros-pkg/coman.urdf \
        --packages SOURCES/iit-coman-ros-pkg DWYTorso Waist

prints, for each of the two links, `<collision name="fine">` elements for the robot's URDF, and the
line for its robot file. Each link's convex hull, of what is drawn and what collides, is cut by
planes; a capsule holds each part, and sticks out of the whole hull as little as a search finds. The
part that loses most of the distance to the other link's hull, over poses of the joints between
them, is halved again, until none loses more than --loss or there are --most.
"""

from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import typer
from scipy.spatial import ConvexHull

from s3le.onboard import capsules
from s3le.onboard.bodies import element
from s3le.onboard.capsules import Capsule
from s3le.onboard.motion import convex
from s3le.onboard.source import Source, read
from s3le.onboard.splitting import Splitter
from s3le.robot.robot import Robot
from s3le.robot.urdf import FINE

POSES = 250  # of the joints between, beside the anchor
CLEAR, NEAR = 0.002, 0.03  # [m], hulls this far apart matter
THIN = 0.02  # [m], parts are cut no thinner
STARTS = 4  # of the search for a capsule


def main(
    name: Annotated[str, typer.Argument(metavar="ROBOT")],
    urdf: Annotated[Path, typer.Argument(help="URDF with meshes, as its maker has it")],
    links: Annotated[list[str], typer.Argument(metavar="LINK LINK")],
    packages: Annotated[list[Path] | None, typer.Option(help="folders of packages")] = None,
    loss: Annotated[float, typer.Option(help="of distance to the other link's hull [m]")] = 0.008,
    most: Annotated[list[int] | None, typer.Option(help="capsules of each link")] = None,
) -> None:
    """Print finer bodies of two links."""
    robot, source = Robot.load(name), read(urdf, packages or [])
    first, second = links
    one, other = (_solid(source, link) for link in links)
    between = _placements(robot, first, second)
    hulls = tuple(convex(solid.reshape(-1, 3)) for solid in (one, other))
    apart = np.array([_distance(hulls[0], at, hulls[1]) for at in between])
    matter = np.concatenate([[0], np.flatnonzero((apart > CLEAR) & (apart < NEAR))])
    between, apart = [between[k] for k in matter], np.minimum(apart[matter], NEAR)
    print(f"hulls {apart[0] * 1e3:.1f} mm apart at the anchor; {len(matter)} poses bring them near")
    back = [at.inverse() for at in between]
    for link, solid, ways, hull, count in (
        (first, one, between, hulls[1], (most or [16, 16])[0]),
        (second, other, back, hulls[0], (most or [16, 16])[-1]),
    ):
        made, lost = _cover(solid, ways, hull, apart, loss, count)
        print(f"{link}: {len(made)} capsules, which lose up to {lost * 1e3:.1f} mm")
        print("".join(f"    {_fine(*one)}\n" for one in made), end="")
    print(f"finer: [[{first}, {second}]]")


def _solid(source: Source, link: str) -> np.ndarray:
    """Triangles of the convex hull of a link's shapes [m], (n, 3, 3), in its frame."""
    shapes = [*source.drawn.get(link, []), *source.shapes.get(link, [])]
    points = np.concatenate([shape.triangles.reshape(-1, 3) for shape in shapes])
    return points[ConvexHull(points).simplices]


def _placements(robot: Robot, first: str, second: str) -> list[pin.SE3]:
    """The first link in the second one's frame, at the anchor and at poses between their limits."""
    model, _ = robot.reduced()
    data = model.createData()
    frames = [model.getFrameId(link, pin.FrameType.BODY) for link in (first, second)]
    rng = np.random.default_rng(3)
    found = []
    for q in [robot.anchor, *rng.uniform(robot.lower, robot.upper, (POSES, robot.n_dof))]:
        pin.framesForwardKinematics(model, data, q)
        one, other = (data.oMf[frame] for frame in frames)
        found.append(other.actInv(one))
    return found


def _cover(
    solid: np.ndarray, ways: list[pin.SE3], other: coal.CollisionGeometry, apart: np.ndarray,
    loss: float, most: int,
) -> tuple[list[tuple[Capsule, np.ndarray]], float]:  # fmt: skip
    """Capsules that together hold a hull, each with what it holds, and the most that one loses.

    What is lost is distance to the other hull [m].
    """
    whole = Splitter(solid.reshape(-1, 3))

    def holding(part: np.ndarray) -> Capsule:
        return whole.fit(part.reshape(-1, 3), STARTS)

    parts = [solid]
    made = [holding(solid)]
    lost = [_lost(made[0], ways, other, apart)]
    while len(parts) < most and max(lost) > loss:
        k = int(np.argmax(lost))
        points, best = parts[k].reshape(-1, 3), None
        for way in np.eye(3):
            height = points @ way
            if np.ptp(height) < THIN:
                continue
            halves = capsules.cut(parts[k], way, 0.5 * (height.min() + height.max()))
            fitted = [holding(half) for half in halves]
            cost = [_lost(capsule, ways, other, apart) for capsule in fitted]
            if best is None or max(cost) < max(best[2]):
                best = halves, fitted, cost
        if best is None:
            break
        for held, new in zip((parts, made, lost), best, strict=True):
            held[k : k + 1] = new
    return [(c, part.reshape(-1, 3)) for c, part in zip(made, parts, strict=True)], max(lost)


def _lost(capsule: Capsule, ways: list[pin.SE3], other: coal.Convex, apart: np.ndarray) -> float:
    """The most by which a capsule is nearer to the other hull than the hulls are [m]."""
    along = capsule.b - capsule.a
    length = float(np.linalg.norm(along))
    turn = pin.Quaternion.FromTwoVectors(np.eye(3)[2], along if length else np.eye(3)[2])
    stands = pin.SE3(turn.toRotationMatrix(), (capsule.a + capsule.b) / 2)
    shape = coal.Capsule(capsule.radius, length)
    return float(max(
        least - _distance(shape, at * stands, other)
        for at, least in zip(ways, apart, strict=True)
    ))  # fmt: skip


def _distance(one: coal.CollisionGeometry, at: pin.SE3, other: coal.CollisionGeometry) -> float:
    """Signed distance of a shape to another one at the origin [m]."""
    result = coal.DistanceResult()
    placed = coal.Transform3s(at.rotation, at.translation)
    coal.distance(one, placed, other, coal.Transform3s(), coal.DistanceRequest(), result)
    return float(result.min_distance)


def _fine(capsule: Capsule, points: np.ndarray) -> str:
    """A finer body as it stands in a URDF; it holds the points, whatever was rounded."""
    item, _ = element(capsule, points)
    item.set("name", FINE)
    return ElementTree.tostring(item, encoding="unicode")


if __name__ == "__main__":
    typer.run(main)
