"""Which pairs of bodies are watched for collision, and why the others are not.

Anchor rule (the authors'): a pair is watched unless its capsules, grown by `pair_inflation`,
already overlap at the anchor pose. It needs no SRDF and works for any URDF. Bodies that cannot
move relative to each other are not watched either, nor are pairs of links that an SRDF takes off
where the robot file names one. Every pair is listed with its reason.
"""

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np

from s3le.errors import RobotError
from s3le.robot.certificate import placements
from s3le.robot.model import Geometry
from s3le.robot.ranges import origin

WATCHED = "watched"
FIXED = "cannot move relative to each other"
OVERLAP = "overlap at the anchor when grown"
DISABLED = "disabled by the SRDF"  # and, in brackets, the reason that it gives


class Pair(NamedTuple):
    """One pair of bodies and what was decided about it."""

    a: int  # index into robot.bodies
    b: int
    kind: str  # e.g. "limb-trunk": what kinds of body the pair joins
    reason: str  # WATCHED, FIXED, OVERLAP, or one that begins with DISABLED
    clearance: float  # [m] at the anchor, capsules not grown


def body_kinds(robot: Geometry) -> list[str]:
    """For each body: "trunk" (moves with the waist or not at all), "right" or "left" (an arm).

    An arm is whatever hangs on a joint of that side's hand chain that the neck does not ride on;
    what stands still and lies below the hip belongs to the trunk too, so the legs are "trunk".
    """
    trunk = set(robot.path_to(robot.points["neck"].joint))
    sides: dict[int, str] = {}
    for side in robot.arms:
        for joint in robot.path_to(robot.points[f"{side}_hand"].joint):
            if joint not in trunk:
                sides.setdefault(joint, {"r": "right", "l": "left"}[side])
    kinds = []
    for body in robot.bodies:
        path = robot.path_to(body.joint)
        kinds.append(next((sides[j] for j in path if j in sides), "trunk"))
    return kinds


def all_pairs(robot: Geometry) -> list[Pair]:
    """Every pair of bodies with its decision, in order of (a, b).

    Raises:
        RobotError: not one pair is left to watch.
    """
    at_anchor = placements(robot, robot.anchor)
    kinds = body_kinds(robot)
    pairs = []
    for a in range(len(robot.bodies)):
        for b in range(a + 1, len(robot.bodies)):
            sides = {kinds[a], kinds[b]}
            limbs = sides - {"trunk"}
            kind = (
                "trunk-trunk"
                if not limbs
                else "limb-trunk"
                if "trunk" in sides
                else "limb-limb"
                if len(limbs) == 2
                else "within a limb"
            )
            clearance = _distance(robot, at_anchor, a, b, 1.0)
            if robot.bodies[a].joint == robot.bodies[b].joint:
                reason = FIXED
            elif why := robot.disabled.get(frozenset((robot.bodies[a].link, robot.bodies[b].link))):
                reason = f"{DISABLED} ({why})"
            elif _distance(robot, at_anchor, a, b, robot.pair_inflation) <= 0.0:
                reason = OVERLAP
            else:
                reason = WATCHED
            pairs.append(Pair(a, b, kind, reason, clearance))
    if not any(pair.reason == WATCHED for pair in pairs):
        file = robot.description.source
        raise RobotError(f"{file}: no pair of bodies is left to watch at this anchor")
    return pairs


def alike(
    robot: Geometry, made: Sequence[Pair], plain: Geometry, known: Sequence[Pair], margin: float
) -> tuple[Pair, ...]:
    """The pairs of a robot of which some bodies are what they sweep, decided as for the bodies.

    Args:
        robot, made: the robot and its pairs.
        plain, known: the same robot whose joints stand where they are held, and its pairs.
        margin: clearance that is kept [m].

    Raises:
        RobotError: what a body sweeps comes too near to another one at the anchor.
    """
    names = [body.name for body in plain.bodies]
    reasons = {frozenset((names[pair.a], names[pair.b])): pair.reason for pair in known}
    decided = []
    for pair in made:
        two = [origin(robot.bodies[body].name) for body in (pair.a, pair.b)]
        reason = FIXED if two[0] == two[1] else reasons[frozenset(two)]
        if reason == WATCHED and not pair.clearance >= margin:
            raise RobotError(
                f"{robot.description.source}: at the anchor {two[0]} and {two[1]} are "
                f"{pair.clearance * 1e3:.2f} mm apart somewhere in the ranges of given joints, the "
                f"margin is {margin * 1e3:g} mm; give narrower ranges or another anchor"
            )
        decided.append(pair._replace(reason=reason))
    return tuple(decided)


def anchor_collision(robot: Geometry, pairs: list[Pair]) -> Pair | None:
    """A pair that collides at the anchor, which the anchor rule would otherwise stop watching.

    Neighbours in the tree overlap by design, and so may what follows them without a gap (a
    shoulder's links and the torso). A pair that overlaps although a body between the two keeps
    clear of one of them (a forearm in the torso, the upper arm not) is a collision.
    """
    joint = [body.joint for body in robot.bodies]
    near = {(joint[p.a], joint[p.b]) for p in pairs if p.reason == OVERLAP}
    near |= {(b, a) for a, b in near}
    for p in pairs:
        if p.reason == OVERLAP and p.clearance < 0.0:
            path = [j for j in _between(robot, joint[p.a], joint[p.b]) if j in joint]
            if len(path) > 2 and not {(path[1], path[-1]), (path[0], path[-2])} <= near:
                return p
    return None


def _between(robot: Geometry, a: int, b: int) -> list[int]:
    """The joints from a to b through the tree, both included; -1 is the base."""
    up, down = ([-1, *robot.path_to(joint)] for joint in (a, b))
    shared = sum(x == y for x, y in zip(up, down, strict=False))
    return up[: shared - 1 : -1] + down[shared - 1 :]


def watched(pairs: list[Pair]) -> np.ndarray:
    """Body indices of the watched pairs, int64 (n_pairs, 2)."""
    return np.array([(p.a, p.b) for p in pairs if p.reason == WATCHED], np.int64).reshape(-1, 2)


def _distance(robot: Geometry, at: list[coal.Transform3s], a: int, b: int, grow: float) -> float:
    shapes = []
    for index in (a, b):
        body = robot.bodies[index]
        shapes.append(
            coal.Capsule(body.radius * grow, float(np.linalg.norm(body.b - body.a)) * grow)
        )
    result = coal.DistanceResult()
    coal.distance(shapes[0], at[a], shapes[1], at[b], coal.DistanceRequest(), result)
    return float(result.min_distance)
