"""Which pairs of bodies are watched for collision, and why the others are not.

A pair is watched unless its capsules, grown by `pair_inflation`, overlap at the anchor pose (the
rule of the paper's authors; it needs no SRDF and works for any URDF). Those that do are not
watched, or, where the robot file says `baselines: true`,

- neighbours, joined by a joint, touch by design and are not watched (those that do so at `stand`
  neither); their distance depends on that joint alone, and how they overlap over it is told;
- others are held to their *baseline*, the deepest that they overlap at the anchor, at zero and at
  `stand`: nowhere more than DEEPER beyond it. Where no angles can bring them deeper that is proven
  once (robot/bounded.py); the rest are watched, their distance counted from the baseline.

A link may have finer bodies beside its own, each kind containing all of it: where the robot file
says so (`finer`), a pair of links is watched by these, otherwise by the others.

Bodies that cannot move relative to each other are not watched either, nor are pairs of links that
an SRDF takes off where the robot file names one. Every pair is listed with its reason.
"""

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np

from s3le.errors import RobotError
from s3le.robot.bounded import never_deeper, over_range
from s3le.robot.certificate import placements
from s3le.robot.model import Geometry
from s3le.robot.ranges import origin

WATCHED = "watched"
BASELINE = "watched against its baseline"
BOUNDED = "overlap by design, proven never deeper than the baseline at any angles"
FIXED = "cannot move relative to each other"
NEIGHBOURS = "neighbours on both sides of a joint"
OTHERWISE = "watched by other bodies of the same links"
OVERLAP = "overlap at the anchor when grown"
MEETING = "overlap at the anchor up to their cores"
DISABLED = "disabled by the SRDF"  # and, in brackets, the reason that it gives
KEPT = (WATCHED, BASELINE)  # that every pose and every path is held to
BY_DESIGN = (OVERLAP, BASELINE, BOUNDED, NEIGHBOURS, MEETING)  # overlap at the anchor, grown
SURE = (*KEPT, BOUNDED, FIXED, OTHERWISE)  # of which nothing is left open

DEEPER = 0.001  # [m] beyond its baseline that a pair comes nowhere
RESTING = 0.0005  # [m], the same for the poses of rows: what is left is for the paths between
_CORES = 0.002  # [m], cores nearer than this at the baseline leave no distance to watch


class Pair(NamedTuple):
    """One pair of bodies and what was decided about it."""

    a: int  # index into robot.bodies
    b: int
    kind: str  # e.g. "limb-trunk": what kinds of body the pair joins
    reason: str  # WATCHED, BASELINE, ...; or one that begins with DISABLED
    clearance: float  # [m] at the anchor, capsules not grown
    baseline: float = np.nan  # [m], signed distance; of BASELINE and BOUNDED
    seen: tuple[float, float] = (np.nan, np.nan)  # [m] over the joint's range; of NEIGHBOURS


def told(pair: Pair) -> str:
    """Why a pair is watched or not, with its numbers."""
    if pair.reason == NEIGHBOURS and pair.seen[0] < 0.0:
        least, most = (-depth * 1e3 for depth in pair.seen[::-1])
        over = f"{max(least, 0.0):.0f} to {most:.0f}"
        return f"{pair.reason}, seen to overlap by {over} mm over its range"
    if np.isfinite(pair.baseline):
        depth = -pair.baseline * 1e3
        return f"{pair.reason}, {abs(depth):.1f} mm {'deep' if depth > 0.0 else 'apart'}"
    return pair.reason


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


def all_pairs(robot: Geometry, proven: bool = True) -> list[Pair]:
    """Every pair of bodies with its decision, in order of (a, b).

    Args:
        robot: whose pairs they are.
        proven: look for proofs that pairs never get deeper; without, none is BOUNDED, and how
            neighbours lie is not looked at.

    Raises:
        RobotError: not one pair is left to watch.
    """
    at_anchor = placements(robot, robot.anchor)
    others = [placements(robot, pose) for pose in _standing(robot)]
    solid = {body.joint for body in robot.bodies}
    kinds = body_kinds(robot)
    finer = {body.link for body in robot.bodies if body.fine}
    pairs = []
    for a in range(len(robot.bodies)):
        for b in range(a + 1, len(robot.bodies)):
            clearance = _distance(robot, at_anchor, a, b, 1.0)
            pair = Pair(a, b, _kind(kinds[a], kinds[b]), WATCHED, clearance)
            links = frozenset((robot.bodies[a].link, robot.bodies[b].link))
            if robot.bodies[a].joint == robot.bodies[b].joint:
                pair = pair._replace(reason=FIXED)
            elif why := robot.disabled.get(links):
                pair = pair._replace(reason=f"{DISABLED} ({why})")
            elif any(
                body.fine != (body.link in finer and links in robot.description.finer)
                for body in (robot.bodies[a], robot.bodies[b])
            ):
                pair = pair._replace(reason=OTHERWISE)
            elif _distance(robot, at_anchor, a, b, robot.pair_inflation) <= 0.0 or (
                # Neighbours that touch where the robot stands touch by design too.
                robot.description.baselines
                and robot.stand is not None
                and not solid & set(_between(robot, *(robot.bodies[k].joint for k in (a, b)))[1:-1])
                and _distance(robot, others[1], a, b, robot.pair_inflation) <= 0.0
            ):
                if robot.description.baselines:
                    deepest = min(_distance(robot, at, a, b, 1.0) for at in (at_anchor, *others))
                    pair = _by_design(robot, pair, deepest, proven)
                else:
                    pair = pair._replace(reason=OVERLAP)
            pairs.append(pair)
    if not any(pair.reason in KEPT for pair in pairs):
        file = robot.description.source
        raise RobotError(f"{file}: no pair of bodies is left to watch at this anchor")
    return pairs


def _standing(robot: Geometry) -> list[np.ndarray]:
    """Poses beside the anchor in which bodies may overlap by design [rad]."""
    zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
    return [zero] if robot.stand is None else [zero, robot.stand]


def _by_design(robot: Geometry, pair: Pair, baseline: float, proven: bool) -> Pair:
    """What is decided of a pair that overlaps at the anchor, grown.

    Args:
        robot: whose pair it is.
        pair: as far as it is known.
        baseline: signed distance [m] where it overlaps deepest.
        proven: see all_pairs.
    """
    one, other = robot.bodies[pair.a], robot.bodies[pair.b]
    solid = {body.joint for body in robot.bodies}
    if not solid & set(_between(robot, one.joint, other.joint)[1:-1]):
        pair = pair._replace(reason=NEIGHBOURS)
        return pair._replace(seen=over_range(robot, one, other)) if proven else pair
    if one.radius + other.radius + baseline < _CORES:
        return pair._replace(reason=MEETING)
    sure = proven and never_deeper(robot, one, other, baseline - DEEPER)
    return pair._replace(reason=BOUNDED if sure else BASELINE, baseline=baseline)


def _kind(one: str, other: str) -> str:
    """What kinds of body a pair joins."""
    sides = {one, other}
    limbs = sides - {"trunk"}
    if not limbs:
        return "trunk-trunk"
    if "trunk" in sides:
        return "limb-trunk"
    return "limb-limb" if len(limbs) == 2 else "within a limb"


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
        if reason in (BASELINE, BOUNDED):
            # What was proven of the body does not hold of what it sweeps: watched, to be sure.
            deepest = pair.clearance if np.isnan(pair.baseline) else pair.baseline
            pair, reason = pair._replace(baseline=deepest), BASELINE
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
    shoulder's links and the torso), and what is of one limb or of the trunk and overlaps at zero
    too. Another pair that overlaps although a body between the two keeps clear of one of them (a
    forearm in the torso, the upper arm not) is a collision.
    """
    joint = [body.joint for body in robot.bodies]
    zero = placements(robot, _standing(robot)[0])
    near = {(joint[p.a], joint[p.b]) for p in pairs if p.reason in BY_DESIGN}
    near |= {(b, a) for a, b in near}
    for p in pairs:
        if p.reason in BY_DESIGN and p.clearance < 0.0:
            path = [j for j in _between(robot, joint[p.a], joint[p.b]) if j in joint]
            if len(path) <= 2 or {(path[1], path[-1]), (path[0], path[-2])} <= near:
                continue
            alike = p.kind in ("trunk-trunk", "within a limb")
            if not (alike and _distance(robot, zero, p.a, p.b, 1.0) < 0.0):
                return p
    return None


def _between(robot: Geometry, a: int, b: int) -> list[int]:
    """The joints from a to b through the tree, both included; -1 is the base."""
    up, down = ([-1, *robot.path_to(joint)] for joint in (a, b))
    shared = sum(x == y for x, y in zip(up, down, strict=False))
    return up[: shared - 1 : -1] + down[shared - 1 :]


def watched(pairs: list[Pair]) -> np.ndarray:
    """Body indices of the watched pairs, int64 (n_pairs, 2)."""
    return np.array([(p.a, p.b) for p in pairs if p.reason in KEPT], np.int64).reshape(-1, 2)


def baselines(pairs: Sequence[Pair]) -> np.ndarray:
    """Baselines [m] of the watched pairs, (n_pairs,); NaN of those that are simply kept apart."""
    return np.array([p.baseline for p in pairs if p.reason in KEPT], float)


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
