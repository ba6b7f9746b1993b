"""A robot in whole-body motion: joints that are decided here, and joints that others move.

Ours are the `joints` of the robot file. Given ones are moved by somebody else, who says how: legs
that walk, hands that grasp. All others stand at `hold`. Bodies of ours and of given joints are in
every pair; which pairs are watched is decided at the anchor, as ever, given joints at `hold`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from s3le.errors import RobotError
from s3le.robot import model
from s3le.robot.pairs import BASELINE, BOUNDED, FIXED, KEPT, NEIGHBOURS, WATCHED
from s3le.robot.robot import Robot

DESIGNED = "overlap at the anchor, and given joints alone move them"
OTHERS = "moved by given joints alone"  # and so looked at apart
OURS = "looked at with the joints that are decided here"


def with_joints(robot: Robot, names: Sequence[str]) -> Robot:
    """The same robot with further joints moving.

    All pairs that it watches it watches still. Of those that can move now, neighbours in the tree
    of the URDF (no other body lies between the two) are not watched: they touch by design.

    Args:
        robot: as its file says.
        names: further joints of its URDF, revolute and with limits.

    Raises:
        RobotError: a name is no such joint, or is among the robot's already; or at the anchor,
            these joints where the robot file holds them, the margin is not kept.
    """
    robot = robot.without_ranges(names)
    text = robot.description
    for name in names:
        if name in robot.joint_names:
            raise RobotError(f"{text.source}: '{name}' is among the joints that move already")
    stands = {name: text.hold.get(name, 0.0) for name in names}
    wider = replace(
        text,
        joints=(*text.joints, *names),
        hold={name: angle for name, angle in text.hold.items() if name not in stands},
        anchor=dict(zip(robot.joint_names, robot.anchor.tolist(), strict=True)) | stands,
        stand=None if text.stand is None else text.stand | stands,
        given=tuple(name for name in text.given if name not in stands),
    )
    made = Robot._settled(model.from_description(wider), text.source, robot.margin, robot.neck)
    near = _neighbours(made)
    decided = []
    for old, pair in zip(robot.pairs, made.pairs, strict=True):  # bodies are in the same order
        assert robot.bodies[old.a].name == made.bodies[pair.a].name
        assert robot.bodies[old.b].name == made.bodies[pair.b].name
        links = frozenset((made.bodies[pair.a].link, made.bodies[pair.b].link))
        if old.reason == FIXED and links in near and pair.reason in (WATCHED, BASELINE, BOUNDED):
            pair = pair._replace(reason=NEIGHBOURS, baseline=np.nan)
        elif old.reason == FIXED and pair.reason in (BASELINE, BOUNDED):
            pair = pair._replace(reason=DESIGNED, baseline=np.nan)
        decided.append(pair)
    return replace(made, pairs=tuple(decided))


def movable(robot: Robot) -> tuple[str, ...]:
    """Joints of the robot's URDF that others could move: revolute, not ours, of no other's turn."""
    return tuple(
        name
        for joint in robot.tree.findall("joint")
        if (name := joint.get("name", "")) not in robot.joint_names
        and joint.get("type") == "revolute"
        and joint.find("mimic") is None
    )


def _neighbours(robot: Robot) -> set[frozenset[str]]:
    """Pairs of links between which no other body lies, whatever joints are held still here."""
    above: dict[str, tuple[str, bool]] = {}  # link -> the one before it, and whether rigidly so
    for joint in robot.tree.findall("joint"):
        ends = [joint.find(end) for end in ("parent", "child")]
        before, after = ("" if end is None else end.get("link", "") for end in ends)
        above[after] = before, joint.get("type") == "fixed"

    def way(link: str) -> list[str]:
        """Rigid groups from a link's own to the root's, each by its first link."""
        groups = []
        while True:
            while link in above and above[link][1]:
                link = above[link][0]
            groups.append(link)
            if link not in above:
                return groups
            link = above[link][0]

    links = sorted({body.link for body in robot.bodies})
    ways = {link: way(link) for link in links}
    solid = {ways[link][0] for link in links}
    near = set()
    for a in links:
        for b in links:
            shared = next(group for group in ways[a] if group in ways[b])
            up, down = ways[a][: ways[a].index(shared)], ways[b][: ways[b].index(shared)]
            between = {*up[1:], *down[1:], *([shared] if up and down else [])}
            if a != b and not solid & between:
                near.add(frozenset((a, b)))
    return near


@dataclass(frozen=True, eq=False)
class WholeBody:
    """One robot, and which of its joints others move."""

    base: Robot  # of ours alone
    given: tuple[str, ...]
    every: Robot  # ours and given; watches all pairs
    robot: Robot  # the same; watches the pairs that a joint of ours can part
    rest: Robot | None  # the same; watches the pairs that given joints alone move; None: no such
    own: np.ndarray  # int64 (n,), columns of ours among the joints of `robot`
    others: np.ndarray  # int64 (k,), of the given ones

    def unwatched(self) -> list[tuple[str, str, str, str]]:
        """As Robot.unwatched, of both robots together."""
        return [pair for pair in self.robot.unwatched() if pair[3] != OTHERS]

    def poses(self, q: np.ndarray, given: np.ndarray) -> np.ndarray:
        """Poses of all joints [rad], (m, n + k), in the order of `robot`.

        Args:
            q: of ours [rad], (m, n).
            given: of the given ones [rad], (m, k).
        """
        whole = np.empty((len(q), self.robot.n_dof))
        whole[:, self.own], whole[:, self.others] = q, given
        return whole


def whole_body(robot: Robot, given: Sequence[str]) -> WholeBody:
    """A robot of which others move some joints.

    Raises:
        RobotError: see with_joints.
    """
    robot = robot.without_ranges(given)
    wider = with_joints(robot, given)
    names = wider.joint_names
    own = np.array([names.index(name) for name in robot.joint_names], np.int64)
    others = np.array([names.index(name) for name in given], np.int64)
    mine = set(own.tolist())
    paths = [set(wider.path_to(body.joint)) for body in wider.bodies]
    ours, rest = [], []
    for pair in wider.pairs:
        parted = bool((paths[pair.a] ^ paths[pair.b]) & mine)
        watched = pair.reason in KEPT
        ours.append(pair._replace(reason=OTHERS) if watched and not parted else pair)
        rest.append(pair._replace(reason=OURS) if watched and parted else pair)
    apart = any(pair.reason in KEPT for pair in rest)
    return WholeBody(
        base=robot,
        given=tuple(given),
        every=wider,
        robot=replace(wider, pairs=tuple(ours)),
        rest=replace(wider, pairs=tuple(rest)) if apart else None,
        own=own,
        others=others,
    )
