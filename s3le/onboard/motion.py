"""What bodies cost in motion: poses as people move, and how much room capsules take there.

A piece is what stands for a link or a part of it: a convex hull, or a capsule or sphere that is
exactly itself. Two pieces may come within the margin only where they do themselves; where capsules
do and the pieces do not, capsules forbid what the robot could do.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from s3le.kernels import batch
from s3le.onboard.capsules import Capsule
from s3le.onboard.source import Shape
from s3le.robot import chain, sense
from s3le.robot.model import Geometry

POSES = 300  # as people move
BAND = 0.005  # [m] beyond the margin in which room counts already
_WISHED = 0.009  # [m] the same in named poses
OUT = 1  # of the named poses the one whose overlaps bodies may keep: arms held out
_AIMED = 0.001  # [m] beyond the margin that capsules are to keep in a named pose
TOUCH = 0.005  # [m], drawings nearer than this at a named pose touch
_TOUCH = 0.01  # [m] pieces as near in all named poses are built to each other
_DEEP = 0.02  # [m] of room that counts as one
_LEAN = np.radians(15.0)  # [rad] spread of trunk joints
_HANGING = 2.0  # concentration of the upper arms about straight down, as of the sampler `human`
_RARE = 0.05  # of the peak: arms straight up are rare, not impossible
_FACES, _BESIDE = 40, np.cos(np.radians(4.0))  # directions of others, at most, and how near alike
_DRAWN = 40  # draws for each pose wanted


class Shown(NamedTuple):
    """Poses and what each counts."""

    q: np.ndarray  # [rad], (n, n_dof)
    weight: np.ndarray  # (n,)
    named: int  # so many of them, the first, matter most


def poses(robot: Geometry, named: Sequence[np.ndarray], worth: float) -> Shown:
    """Poses as people move, the same each time, and named ones before them.

    Trunk near zero, each joint of the arms off its stops, upper arms hanging more than raised.

    Args:
        robot: the robot.
        named: poses that count `worth` each [rad], (n_dof,).
        worth: beside 1 for all others together.
    """
    rng = np.random.default_rng(0)
    n = POSES * _DRAWN
    share = 0.5 - np.sin(np.arcsin(1.0 - 2.0 * rng.random((n, robot.n_dof))) / 3.0)  # Beta(2, 2)
    q = robot.lower + (robot.upper - robot.lower) * share
    trunk = robot.path_to(robot.points["neck"].joint)
    q[:, trunk] = 0.0
    q = np.clip(q, robot.lower, robot.upper)
    at = sense.points(robot, q)
    keep = np.ones(n)
    for side in robot.arms:
        bone = at[f"{side}_elbow"] - at[f"{side}_shoulder"]
        up = bone[:, 2] / np.maximum(np.linalg.norm(bone, axis=1), 1e-9)
        keep *= np.maximum(np.exp(_HANGING * (-up - 1.0)), _RARE)
    q = q[np.argsort(rng.random(n) / keep, kind="stable")[:POSES]]
    q[:, trunk] = rng.normal(0.0, _LEAN, (len(q), len(trunk)))
    q = np.clip(q, robot.lower, robot.upper)
    first = np.reshape(named, (-1, robot.n_dof))
    weight = np.concatenate([np.full(len(first), worth), np.full(len(q), 1.0 / len(q))])
    return Shown(np.concatenate([first, q]), weight, len(first))


@dataclass
class Piece:
    """One shape of a link, in the frame of the joint that moves it."""

    link: str
    joint: int  # index into the moving joints; -1: the base
    at: pin.SE3  # of the link's frame in the joint's
    solid: coal.CollisionGeometry
    stands: pin.SE3  # of the solid in the joint's frame
    capsules: list[Capsule]  # that stand for it, in the joint's frame
    exact: bool  # it is its capsule


def piece(robot: Geometry, link: str, shape: Shape, held: Sequence[Capsule]) -> Piece | None:
    """A shape as a piece; None: it spans no volume.

    Args:
        robot: whose link it is.
        link: its name.
        shape: in the link's frame.
        held: capsules that stand for it, in the link's frame.
    """
    model, _ = robot.reduced()
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    at, stands = frame.placement, frame.placement
    exact = not len(shape.triangles)
    if exact:
        stands = at * pin.SE3(shape.rotation, shape.translation)
        length = shape.sizes[1] if len(shape.sizes) > 1 else 0.0
        solid = coal.Capsule(shape.sizes[0], length)
        half = shape.rotation[:, 2] * length / 2
        held = [Capsule(shape.translation - half, shape.translation + half, shape.sizes[0])]
    else:
        try:
            solid = convex(shape.triangles.reshape(-1, 3))
        except (RuntimeError, ValueError):
            return None
    return Piece(link, int(frame.parentJoint) - 1, at, solid, stands, moved(held, at), exact)


def moved(held: Sequence[Capsule], at: pin.SE3) -> list[Capsule]:
    """Capsules of a link's frame in the frame of the joint that moves it."""
    return [Capsule(at.act(np.asarray(a)), at.act(np.asarray(b)), r) for a, b, r in held]


def convex(points: np.ndarray) -> coal.CollisionGeometry:
    """The convex hull of points (n, 3) [m], for coal."""
    held = coal.StdVec_Vec3s()
    for point in np.unique(points, axis=0):
        held.append(point)
    return coal.Convex.convexHull(held, True, "Qt")


class Near(NamedTuple):
    """Poses at which the capsules of two pieces come near and the pieces keep the margin."""

    rows: np.ndarray  # int64 (k,), among those shown
    far: np.ndarray  # [m], (k,), how far the pieces are apart
    normal: np.ndarray  # (k, 3), unit, from the first piece to the second, in the base's frame
    tied: bool  # they touch, nearly, in all named poses: held against overlaps in OUT


@dataclass
class Room:
    """Pieces of a robot at poses: how far apart they are, and their capsules."""

    robot: Geometry
    pieces: list[Piece]
    shown: Shown
    margin: float  # [m]
    skip: frozenset[frozenset[str]] = frozenset()  # pairs of links that are not watched
    near: dict[tuple[int, int], "Near"] = field(default_factory=dict)  # by pieces
    turned: np.ndarray = field(default_factory=lambda: np.empty(0))  # (n, joints + 1, 3, 3)
    _plain: chain.Chain | None = None

    def measure(self) -> None:
        """Distances of the pieces, of every pair whose capsules come near where they do not.

        Neighbours whose capsules overlap where arms are held out are left out: so they are built.
        """
        model, _ = self.robot.reduced()
        data = model.createData()
        places = []
        for q in self.shown.q:
            pin.forwardKinematics(model, data, q)
            places.append([data.oMi[j].copy() for j in range(model.njoints)])
        self.turned = np.array([[place.rotation for place in row] for row in places])
        near = joined(self.robot, self.pieces)
        ask = coal.DistanceRequest()
        for i, one in enumerate(self.pieces):
            for j in range(i + 1, len(self.pieces)):
                two = self.pieces[j]
                if one.joint == two.joint or frozenset((one.link, two.link)) in self.skip:
                    continue
                apart = self.apart(one, two, np.arange(len(self.shown.q)))
                if (
                    frozenset((one.joint, two.joint)) in near
                    and apart[: self.shown.named].min() < 0.0
                ):
                    continue
                rows, far, normal, touch = [], [], [], 0
                free = np.full(len(apart), self.margin + BAND)
                free[: self.shown.named] = self.margin + _WISHED
                for k in np.flatnonzero(apart < free):
                    found = coal.DistanceResult()
                    at = [_transform(places[k][p.joint + 1] * p.stands) for p in (one, two)]
                    coal.distance(one.solid, at[0], two.solid, at[1], ask, found)
                    touch += int(k < self.shown.named and found.min_distance < _TOUCH)
                    if found.min_distance >= self.margin:
                        rows.append(k)
                        far.append(found.min_distance)
                        normal.append(found.normal)
                if rows:
                    tied = touch == self.shown.named
                    self.near[i, j] = Near(np.array(rows), np.array(far), np.array(normal), tied)

    def apart(self, one: Piece, two: Piece, rows: np.ndarray) -> np.ndarray:
        """Distance of the capsules of two pieces at some of the poses [m], (len(rows),)."""
        if self._plain is None:
            self._plain = chain.build(self.robot, np.empty((0, 2), np.int64), "midpoint")
        held = [*one.capsules, *two.capsules]
        k = len(one.capsules)
        frames = [one.joint + 1] * k + [two.joint + 1] * (len(held) - k)
        pair = np.array([(a, b) for a in range(k) for b in range(k, len(held))], np.int64)
        made = self._plain._replace(
            slack=np.zeros(len(pair)), floor=np.zeros(len(pair)),
            body_frame=np.array(frames, np.int64), body_a=np.array([c.a for c in held]),
            body_b=np.array([c.b for c in held]), body_radius=np.array([c.radius for c in held]),
            pair=pair,
        )  # fmt: skip
        return batch.pair_distances(made, self.shown.q[rows]).min(axis=1)

    def room(self, pair: tuple[int, int]) -> np.ndarray:
        """What capsules of two pieces take and they themselves do not, at the rows of `near`."""
        near = self.near[pair]
        two, least = [self.pieces[k] for k in pair], self.margin
        held = self.apart(two[0], two[1], near.rows)
        if near.tied:
            least = min(least, float(self.apart(two[0], two[1], np.array([OUT]))[0]))
        free = least + np.where(near.rows < self.shown.named, _WISHED, BAND)
        taken = [np.maximum(free - far, 0.0) / _DEEP for far in (held, near.far)]
        return self.shown.weight[near.rows] * np.maximum(taken[0] - taken[1], 0.0)

    def forbids(self, pair: tuple[int, int], first: int | None = None) -> bool:
        """Do capsules of two pieces forbid a named pose, or nearly, and they themselves do not?

        Those that touch in all named poses are not asked: they are built so.

        Args:
            pair: of pieces.
            first: so many of the named poses are asked; None: all.
        """
        near = self.near[pair]
        named = near.rows < (self.shown.named if first is None else first)
        if near.tied or not named.any():
            return False
        held = self.apart(self.pieces[pair[0]], self.pieces[pair[1]], near.rows[named])
        return bool((held < np.minimum(self.margin + _AIMED, near.far[named])).any())

    def overlap(self, pair: tuple[int, int]) -> bool:
        """Do capsules of two pieces overlap, grown, where arms are held out and they are apart?"""
        near = self.near[pair]
        if near.tied or not (near.far[near.rows == OUT] > TOUCH).any():
            return False
        grow = self.robot.pair_inflation
        one, two = (
            replace(self.pieces[k], capsules=[
                c._replace(radius=grow * c.radius) for c in self.pieces[k].capsules
            ]) for k in pair
        )  # fmt: skip
        return bool(self.apart(one, two, np.array([OUT]))[0] <= 0.0)

    def cost(self, pair: tuple[int, int]) -> float:
        """The room of a pair, over all poses."""
        return float(self.room(pair).sum())

    def blame(self, i: int) -> np.ndarray:
        """How much of the room of a piece's pairs each of its capsules takes, (k,)."""
        own = self.pieces[i]
        total = np.zeros(len(own.capsules))
        for pair in self.partners(i):
            count, rows = self.room(pair), self.near[pair].rows
            if not count.any():
                continue
            other = self.pieces[pair[0] if pair[1] == i else pair[1]]
            each = [self.apart(replace(own, capsules=[c]), other, rows) for c in own.capsules]
            total += np.bincount(np.argmin(each, axis=0), count, len(total))
        return total

    def partners(self, i: int) -> list[tuple[int, int]]:
        """Pairs of pieces that are measured and of which one is i."""
        return [pair for pair in self.near if i in pair]

    def sides(self, i: int, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions in which a piece's reach is asked, in its joint's frame, and how they count.

        Those given (k, 3), and those from which others come at poses of which capsules take room.
        Of the given ones such as lie near count more, and each counts a little. Weights: mean 1.
        """
        own = self.pieces[i]
        found, counts = [], []
        for pair in self.partners(i):
            count, near = self.room(pair), self.near[pair]
            normal = near.normal * (1.0 if pair[0] == i else -1.0)
            found.append(np.einsum("nji,nj->ni", self.turned[near.rows, own.joint + 1], normal))
            counts.append(count)
        local, count = np.concatenate([np.empty((0, 3)), *found]), np.concatenate([[], *counts])
        if not count.any():
            return ways, np.ones(len(ways))
        total = np.exp(20.0 * (ways @ local.T - 1.0)) @ count
        total = (total / total.mean() + 0.2) / 1.2
        faces, weight = _gathered(local, count)
        weight *= len(ways) / weight.sum()
        both = np.concatenate([total, weight])
        return np.concatenate([ways, faces]), both / both.mean()


def _gathered(ways: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The directions (n, 3) that count most, and each with the count of those beside it."""
    left = count.copy()
    chosen: list[np.ndarray] = []
    weight: list[float] = []
    while len(chosen) < _FACES and left.max() > 0.0:
        k = int(left.argmax())
        beside = ways @ ways[k] > _BESIDE
        chosen.append(ways[k])
        weight.append(float(left[beside].sum()))
        left[beside] = 0.0
    return np.array(chosen), np.array(weight)


def joined(robot: Geometry, pieces: Sequence[Piece]) -> set[frozenset[int]]:
    """Pairs of joints of which one carries the next pieces after the other's."""
    solid = {piece.joint for piece in pieces}
    found = set()
    for joint in solid - {-1}:
        path = robot.path_to(joint)[:-1]
        found.add(frozenset((joint, next((j for j in reversed(path) if j in solid), -1))))
    return found


def clearance(
    robot: Geometry, pieces: Sequence[Piece], out: np.ndarray, skip: frozenset[frozenset[str]]
) -> Callable[[np.ndarray], float]:
    """What measures how far pieces are apart at a pose [m], all that are clear at another.

    Args:
        robot: the robot.
        pieces: its pieces.
        out: a pose in which nothing touches but what is built to [rad], (n_dof,).
        skip: pairs of links that are not watched.
    """
    model, _ = robot.reduced()
    data, ask = model.createData(), coal.DistanceRequest()
    near = joined(robot, pieces)

    def apart(q: np.ndarray, pairs: Sequence[tuple[int, int]]) -> list[float]:
        pin.forwardKinematics(model, data, q)
        at = [_transform(data.oMi[p.joint + 1] * p.stands) for p in pieces]
        found = []
        for i, j in pairs:
            result = coal.DistanceResult()
            coal.distance(pieces[i].solid, at[i], pieces[j].solid, at[j], ask, result)
            found.append(float(result.min_distance))
        return found

    pairs = [
        (i, j) for i in range(len(pieces)) for j in range(i + 1, len(pieces))
        if pieces[i].joint != pieces[j].joint
        and frozenset((pieces[i].joint, pieces[j].joint)) not in near
        and frozenset((pieces[i].link, pieces[j].link)) not in skip
    ]  # fmt: skip
    kept = [pair for pair, far in zip(pairs, apart(out, pairs), strict=True) if far >= _TOUCH]
    return lambda q: min(apart(q, kept), default=np.inf)


def nearest(data: pin.Data, ones: Sequence[Piece], others: Sequence[Piece]) -> float:
    """Least signed distance of pieces to other pieces where a robot was placed [m]; inf: none."""
    ask, least = coal.DistanceRequest(), np.inf
    for one in ones:
        for other in others:
            at = [_transform(data.oMi[p.joint + 1] * p.stands) for p in (one, other)]
            found = coal.DistanceResult()
            coal.distance(one.solid, at[0], other.solid, at[1], ask, found)
            least = min(least, float(found.min_distance))
    return least


def _transform(at: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(at.rotation, at.translation)
