"""What `robot check` finds out about a robot: ranges, reach, pairs, random poses, time."""

import time
from collections import Counter
from typing import NamedTuple

import numpy as np

from s3le.kernels import batch
from s3le.robot import hulls, pairs, sense
from s3le.robot.ranges import PART, origin
from s3le.robot.robot import Robot
from s3le.safety import covered
from s3le.skeleton import BONES

ALWAYS = 0.95  # share of random poses from which on a pair counts as nearly always colliding
NEVER = 0.05  # [m], a pair that no random pose brings nearer counts as never near
_BY_COAL = 300  # poses that coal measures too
_BY_HULL = 200  # feasible poses whose hulls are measured


class Survey(NamedTuple):
    """Figures over random poses, uniform in the joint limits."""

    poses: int
    colliding: float  # share of poses in which a watched pair overlaps
    below_margin: float  # share of poses in which one comes closer than the margin
    always: list[tuple[int, float]]  # watched pair, share of poses in which it overlaps
    never: list[tuple[int, float]]  # watched pair, its least distance over all poses [m]
    kernel: float  # [s] for one pose's clearance by the kernels
    coal: float  # [s] the same by coal
    apart: float  # largest difference of the two [m]
    reach: dict[str, float]  # side -> largest distance of hand from shoulder [m]
    turning: list[str]  # bones that are followed
    hulls: hulls.Depths | None  # of feasible poses
    hull_pairs: list[tuple[str, int, float]]  # links, poses in which they overlap, deepest [m]
    standing: "Standing | None"  # None: the robot file does not say how it stands


class Standing(NamedTuple):
    """What there is to know of the pose in which a robot stands."""

    clearance: float  # [m] over the watched pairs
    forbid: list[tuple[int, float, float | None]]  # watched pair, [m] by bodies, by hulls if known


def survey(robot: Robot, poses: int) -> Survey:
    """Look at random poses; the same ones each time.

    Args:
        robot: the robot.
        poses: how many.
    """
    q = sense.poses(robot, poses)
    apart = batch.pair_distances(robot.chain, q)
    batch.clearances(robot.chain, q[:2])  # compiles
    begun = time.perf_counter()
    clearance = batch.clearances(robot.chain, q)
    kernel = (time.perf_counter() - begun) / len(q)
    some = q[:_BY_COAL]
    certifier = robot.certifier()
    begun = time.perf_counter()
    report = certifier.check(some)
    coal = (time.perf_counter() - begun) / len(some)
    share, least = (apart < 0.0).mean(axis=0), apart.min(axis=0)
    at = sense.points(robot, q)
    found, listed = None, []
    if robot.description.hulls:
        check = hulls.HullCheck(robot)
        good = q[clearance >= robot.margin][:_BY_HULL]
        found = check.check(good)
        for row, count in Counter(found.pair[found.pair >= 0].tolist()).most_common():
            deepest = float(found.depth[found.pair == row].max())
            listed.append((check.name(row), count, deepest))
    return Survey(
        len(q), float((clearance < 0.0).mean()), float((clearance < robot.margin).mean()),
        [(int(k), float(share[k])) for k in np.flatnonzero(share >= ALWAYS)],
        [(int(k), float(least[k])) for k in np.flatnonzero(least >= NEVER)],
        kernel, coal, float(np.abs(report.clearance - clearance[: len(some)]).max()),
        {s: float(np.linalg.norm(at[f"{s}_hand"] - at[f"{s}_shoulder"], axis=1).max())
         for s in robot.arms},
        list(robot.vectors), found, listed, standing(robot),
    )  # fmt: skip


def standing(robot: Robot) -> Standing | None:
    """Which pairs of bodies keep a robot from its stand pose, and what its hulls say of them."""
    if robot.stand is None:
        return None
    q = robot.stand[None]
    apart = batch.pair_distances(robot.chain, q)[0]
    rows = np.flatnonzero(~(apart >= robot.margin))
    known: dict[frozenset[str], float] = {}
    if len(rows) and robot.description.hulls:
        check = hulls.HullCheck(robot)
        for (a, b), far in zip(check.pairs, check.distances(q)[0], strict=True):
            two = frozenset((check.links[a], check.links[b]))
            known[two] = min(known.get(two, np.inf), float(far))
    forbid = []
    for row in rows[np.argsort(apart[rows], kind="stable")]:
        two = frozenset(robot.bodies[body].link for body in robot.watched[row])
        forbid.append((int(row), float(apart[row]), known.get(two)))
    return Standing(float(apart.min()), forbid)


def stands(robot: Robot, found: Standing | None, every: bool = True) -> list[str]:
    """What a person is told of the stand pose."""
    if found is None:
        return ["stand: the robot file does not say how it stands (key stand)"]
    if not found.forbid:
        return [f"stand: its bodies let it stand, {found.clearance * 1e3:.0f} mm clear"]
    said = []
    for row, far, hull in found.forbid:
        more = "" if hull is None else f", {hull * 1e3:.0f} mm by hulls of the meshes"
        said.append(f"{robot.pair_name(row)} ({far * 1e3:.0f} mm by bodies{more})")
    return [
        f"stand: {len(found.forbid)} pairs of bodies forbid it, below the margin of "
        f"{robot.margin * 1e3:g} mm:",
        *_some(said, every),
    ]


def _given(robot: Robot) -> list[str]:
    """Joints that others move, and by how much what bodies sweep is thicker than these."""
    text, out = robot.description, []
    if text.given:
        out.append(f"given, in motions that say how: {', '.join(text.given)}")
    if not text.ranges:
        return out
    out.append("given, anywhere in [deg]:")
    for name, ends in text.ranges.items():
        low, high = np.degrees(ends)
        out.append(f"  {name:<28} {low:8.1f} to {high:7.1f}")
    parts: dict[str, list[float]] = {}
    for body in robot.bodies:
        if PART in body.name:
            parts.setdefault(origin(body.name), []).append(body.radius)
    plain = {body.name: body.radius for body in robot.without_ranges(text.ranges).bodies}
    out.append("bodies that contain what these sweep:")
    for name, radii in parts.items():
        out.append(
            f"  {name:<28} {len(radii)} of {min(radii) * 1e3:.0f} to {max(radii) * 1e3:.0f} mm, "
            f"itself {plain[name] * 1e3:.0f} mm"
        )
    return out


def lines(robot: Robot, found: Survey, every: bool) -> list[str]:
    """The report as text.

    Args:
        robot: the robot.
        found: what survey found.
        every: list pairs by name even where there are many.
    """
    out = [f"robot {robot.name} {robot.digest}: {robot.n_dof} joints, {len(robot.bodies)} bodies"]
    out.append("joints [deg, deg/s]:")
    for joint, at in zip(robot.joints, robot.anchor, strict=True):
        low, high, here = np.degrees([joint.lower, joint.upper, at])
        speed = np.degrees(joint.velocity)
        about = f"{low:8.1f} to {high:7.1f}, anchor {here:7.1f}, {speed:6.0f}"
        out.append(f"  {joint.name:<28} {about}")
        if not 0.0 < joint.velocity < np.inf:
            out.append("      look: this is no speed limit; give one under velocity")
    out += _given(robot)
    out.append(
        f"vectors: {len(found.turning)} of {len(BONES)} are followed"
        + ("" if len(found.turning) == len(BONES) else f": {', '.join(found.turning)}")
    )
    names = {"r": "right", "l": "left"}
    for side, far in found.reach.items():
        out.append(f"reach: {names[side]} hand up to {far * 1e3:.0f} mm from its shoulder")
    out += stands(robot, found.standing, every)
    out += _drawn(robot)
    reasons = Counter(pair.reason for pair in robot.pairs)
    kept = sum(reasons[reason] for reason in pairs.KEPT)
    out.append(f"pairs of bodies: {len(robot.pairs)}, watched {kept}")
    del reasons[pairs.WATCHED]
    for reason, count in sorted(reasons.items()):
        out.append(f"  {'' if reason in pairs.SURE else 'not watched, '}{reason}: {count}")
        if reason != pairs.FIXED:
            out += _some([
                f"{robot.bodies[p.a].name} and {robot.bodies[p.b].name} "
                f"({p.clearance * 1e3:.1f} mm at the anchor{_numbers(p)})"
                for p in robot.pairs if p.reason == reason
            ], every)  # fmt: skip
    out.append(
        f"random poses: {found.poses}, {found.colliding:.1%} in collision, "
        f"{found.below_margin:.1%} below the margin of {robot.margin * 1e3:g} mm"
    )
    if found.always:
        out.append(f"  watched, and overlap in {ALWAYS:.0%} of them and more: {len(found.always)}")
        often = [f"{robot.pair_name(k)} ({share:.1%})" for k, share in found.always]
        out += _some(often, every)
    if found.never:
        out.append(
            f"  watched, though no pose brought them within {NEVER * 1e3:g} mm: {len(found.never)}"
        )
        out += _some([
            f"{robot.pair_name(k)} ({least * 1e3:.0f} mm)" for k, least in found.never
        ], every)  # fmt: skip
    out.append(
        f"one check: {found.kernel * 1e6:.1f} us by kernels, {found.coal * 1e6:.0f} us by coal; "
        f"they differ by {found.apart:.1e} m at most"
    )
    if found.hulls is not None:
        n = len(found.hulls.depth)
        hit = int((found.hulls.pair >= 0).sum())
        out.append(
            f"hulls of the meshes at {n} feasible poses, all pairs but neighbours: {hit} overlap"
            + (f", {found.hulls.depth.max() * 1e3:.1f} mm at most" if hit else "")
        )
        out += [f"      {name}: {count} poses, {deep * 1e3:.1f} mm"
                for name, count, deep in found.hull_pairs]  # fmt: skip
    return out


def _numbers(pair: pairs.Pair) -> str:
    """The baseline of a pair, or how neighbours lie over their joint."""
    if np.isfinite(pair.baseline):
        return f", baseline {pair.baseline * 1e3:.1f}"
    if np.isfinite(pair.seen[0]):
        return f", {pair.seen[0] * 1e3:.1f} to {pair.seen[1] * 1e3:.1f} over its range"
    return ""


def _drawn(robot: Robot) -> list[str]:
    """The table of links: bodies, how far the drawing reaches beyond them, and its share."""
    record, many = covered.read(robot), covered.counts(robot)
    out = ["links: bodies, drawn beyond those of all that is fixed to it [mm], share outside:"]
    found = {item.link: item for item in record.links} if record else {}
    for link in (item.get("name", "") for item in robot.tree.findall("link")):
        item = found.get(link)
        if item is None and not many[link]:
            continue
        words = "not drawn" if item is None else f"{item.reach * 1e3:9.1f} {item.share:7.1%}"
        if record is None or (item is not None and not item.reach >= 0.0):
            words = "not measured"
        out.append(f"  {link:<28} {many[link]:3d} {words}")
    return out + ([f"  look: {said}"] if (said := covered.warning(robot)) else [])


def _some(items: list[str], every: bool, most: int = 12) -> list[str]:
    shown = items if every or len(items) <= most else items[:most]
    rest = len(items) - len(shown)
    tail = [f"      and {rest} more (--all)"] if rest else []
    return [f"      {item}" for item in shown] + tail
