"""Links that would be locked if they were held to how their bodies overlap: taken off, and said.

A pair that overlaps at the anchor is held to its baseline (robot/pairs.py). Where the drawings
themselves touch there, as a waist's two axes in one housing do, that may forbid motion for which
the robot was built. Such pairs go into the SRDF, with what they would forbid and how deep the
drawings overlap, and every certificate lists them as not covered. Before anything else come those
whose bodies overlap although the links never meet at any angles (apart.py).
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from s3le.kernels import batch
from s3le.onboard import apart, motion
from s3le.onboard.apart import NEVER
from s3le.onboard.motion import Piece, Shown
from s3le.onboard.source import Source
from s3le.robot import chain, pairs
from s3le.robot.model import Geometry

LOCKED = 0.01  # of poses as people move that a pair may forbid before it counts as locked
LOST = 0.1  # likewise of poses in which the drawings of a pair that need not be watched are apart


class Locked(NamedTuple):
    """A pair of links that holds a robot still."""

    links: frozenset[str]
    share: float  # of the poses that it forbids
    lost: float  # of the poses that it forbids although the drawings keep the margin
    gap: tuple[float, float]  # [m], least distance of the drawings in named poses, and in any seen

    @property
    def touches(self) -> bool:
        """Do the drawings touch where the robot stands? Then it was built so."""
        return self.gap[0] < motion.TOUCH

    @property
    def off(self) -> bool:
        """Is it better not watched?"""
        return self.touches or self.lost > LOST

    def why(self) -> str:
        """What is wrong with it, in a few words."""
        deep = -self.gap[1] * 1e3
        drawn = f"overlap by up to {deep:.0f} mm" if deep > 0.0 else f"come within {-deep:.1f} mm"
        if self.touches:
            return (
                f"touch by design: hulls of the drawings {drawn}; watched, {self.share:.0%} of "
                "poses would be forbidden"
            )
        return (
            f"bodies overlap where drawings are {self.gap[0] * 1e3:.0f} mm apart (they {drawn}); "
            f"watched, {self.lost:.0%} of poses {'would be' if self.off else 'are'} forbidden for "
            "nothing"
        )


def never(
    robot: Geometry, source: Source, pieces: Sequence[Piece], shown: Shown, margin: float
) -> dict[frozenset[str], str]:
    """Pairs of links whose bodies overlap by design, though proven to be apart, and why.

    Args:
        robot: whose links these are; its anchor may be anything.
        source: it was made from.
        pieces: its parts with the bodies that stand for them.
        shown: poses as people move, named ones first.
        margin: clearance that poses keep [m].
    """
    room = motion.Room(robot, list(pieces), shown, margin)
    near = motion.joined(robot, pieces)
    asked: dict[frozenset[str], bool] = {}
    for i, one in enumerate(pieces):
        for two in pieces[i + 1 :]:
            links = frozenset((one.link, two.link))
            if one.joint == two.joint or links in robot.disabled:
                continue
            if frozenset((one.joint, two.joint)) in near or asked.get(links):
                continue
            far = room.apart(one, two, np.arange(len(shown.q)))
            many = float((far[shown.named :] < margin).mean()) > LOCKED
            asked[links] = many or bool((far[: shown.named] < margin).any())
    parts = apart.solids(robot, source)
    found = {}
    for links in sorted((pair for pair, wanted in asked.items() if wanted), key=sorted):
        a, b = sorted(links)
        if not {a, b} <= set(parts):
            continue
        moving = apart.between(source, a, b) <= set(robot.joint_names)
        if moving and apart.never_nearer(robot, parts[a], parts[b], NEVER):
            found[links] = f"proven by hulls of the drawings: never within {NEVER * 1e3:g} mm"
    return found


def locked(
    robot: Geometry,
    pieces: Sequence[Piece],
    shown: Shown,
    margin: float,
    usual: Collection[frozenset[str]],
) -> list[Locked]:
    """Pairs of links whose bodies overlap where the robot stands, and that forbid many poses.

    Args:
        robot: with its anchor.
        pieces: its parts as they are drawn.
        shown: poses as people move, named ones first.
        margin: what a pair that is not held to its baseline keeps [m].
        usual: pairs of links whose usual bodies overlap at the anchor.
    """

    def links(pair: pairs.Pair) -> frozenset[str]:
        return frozenset((robot.bodies[pair.a].link, robot.bodies[pair.b].link))

    def floor(pair: pairs.Pair) -> float:
        return pair.baseline - pairs.RESTING if pair.reason == pairs.BASELINE else margin

    listed = pairs.all_pairs(robot)
    spared = set(usual) - {links(pair) for pair in listed if pair.reason == pairs.NEIGHBOURS}
    held = [
        pair for pair in listed
        if pair.reason == pairs.BASELINE and pair.baseline < margin
        or pair.reason in pairs.KEPT and links(pair) in spared
    ]  # fmt: skip
    if not held:
        return []
    shape = chain.build(robot, np.array([(pair.a, pair.b) for pair in held]), "midpoint")
    apart = batch.pair_distances(shape, shown.q[shown.named :])
    under = apart < [min(floor(pair), margin) for pair in held]
    found = []
    for two in dict.fromkeys(map(links, held)):
        bad = under[:, [links(pair) == two for pair in held]].any(axis=1)
        if bad.mean() > LOCKED:
            far = _far(robot, pieces, two, shown.q)
            own, others = far[: shown.named], far[shown.named :]
            lost = float((bad & (others >= margin)).mean())
            gap = float(own.min()), float(far.min())
            found.append(Locked(two, float(bad.mean()), lost, gap))
    return found


def _far(
    robot: Geometry, pieces: Sequence[Piece], links: frozenset[str], q: np.ndarray
) -> np.ndarray:
    """Distance of the pieces of two links at poses (n, n_dof) [rad]: [m], (n,)."""
    model, _ = robot.reduced()
    data = model.createData()
    one, other = ([piece for piece in pieces if piece.link == link] for link in sorted(links))
    found = []
    for pose in q:
        pin.forwardKinematics(model, data, pose)
        found.append(motion.nearest(data, one, other))
    return np.array(found)
