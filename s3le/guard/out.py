"""The way out for a robot that stands where it may not: in collision, too near, beyond limits.

A way is a row of poses, straight between each two, from where the robot stands to a certified one.
On it no two bodies that are too near come nearer, those that have come apart stay apart, no other
two come nearer than `between`, which is proven, and no joint goes farther beyond its limits.
The shortest one that is found is taken: going downhill from collision, or straight to one of many
poses near by. A way out is not certified: it begins where nothing can be.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import CertificateError
from s3le.kernels import batch
from s3le.kernels.distance import near_pairs, place_capsules, reach
from s3le.kernels.kinematics import place
from s3le.kernels.qp import SOLVED, inverse_factor, solve
from s3le.robot.chain import watching
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.swept import swept

_STEP = 0.02  # [rad], longest step of a joint downhill
_STEPS = 400  # most of them
_RISE = 0.002  # [m], by which a step downhill is to part two bodies
_SAMPLE = 0.005  # [rad], between two poses of a way that are looked at
_SLACK = 1e-6  # [m], by which rounding may bring two bodies nearer
_NOISE = (0.1, 0.3, 0.6, 1.0)  # [rad], how far around the pose others are tried,
_TRIES = 16  # so many each
_SHARES = (0.25, 0.5, 1.0)  # of the way to the anchor
_BUDGET = 2000  # poses that a proof of a leg may look at


class Need(NamedTuple):
    """What an end of a way must keep, and the paths."""

    margin: float  # [m]
    target: float  # [m], what is aimed at
    between: float  # [m]


def find(robot: Robot, q: np.ndarray, need: Need) -> np.ndarray:
    """The shortest way found from q to a certified pose, (k, n) [rad], q first.

    Raises:
        CertificateError: there is none.
    """
    it = _Search(robot, q, need)
    ways = []
    if (downhill := it.downhill()) is not None:
        ways.append(it.shortcut(downhill))
    ways += [np.stack([q, end]) for end in it.ends()]
    for way in sorted(ways, key=length):
        if it.leads(way):
            return way
    raise CertificateError(f"no way out was found: {it.complaint()}; start from another pose")


def leads(robot: Robot, way: np.ndarray, need: Need) -> bool:
    """Whether a way, (k, n) [rad], keeps all that a way out must."""
    return _Search(robot, way[0], need).leads(way)


def length(way: np.ndarray) -> float:
    """Length of a way in the space of joints [rad]."""
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


class _Search:
    """One pose that is not certified, and what is wrong with it."""

    def __init__(self, robot: Robot, q: np.ndarray, need: Need) -> None:
        self.robot, self.q, self.need = robot, q, need
        self.chain = robot.chain
        self.d = batch.pair_distances(self.chain, q[None])[0]
        self.close = ~(self.d >= need.margin + _SLACK)
        rest = watching(self.chain, ~self.close)
        self._others = rest, swept(rest), segment.scratch(rest)
        self._between = min(need.between, float(self.d[~self.close].min(initial=np.inf)))
        self._closed = watching(self.chain, self.close)
        self._certifier = robot.certifier()

    def complaint(self) -> str:
        """What is wrong, in words."""
        return self._certifier.why(self.q, 0, self.need.margin).removeprefix("row 0: ")

    def downhill(self) -> np.ndarray | None:
        """Small steps, each the least that parts what is too near; None: they lead nowhere."""
        chain, n = self.chain, len(self.q)
        balls, pairs = reach(chain), len(chain.pair)
        R, p, z = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
        ends = np.empty((len(chain.body_frame), 3, 3))
        d, G, step, most = np.empty(pairs), np.empty((pairs, n)), np.empty(n), np.zeros(1)
        factor = np.empty((n, n))
        inverse_factor(np.eye(n), factor)
        lower, upper = self.robot.lower, self.robot.upper
        way = [self.q]
        for _ in range(_STEPS):
            here = way[-1]
            if self._good(here):
                return np.array(way)
            place(chain, here, R, p, z)
            place_capsules(chain, R, p, ends)
            count = near_pairs(chain, ends, balls, p, z, self.need.target + 0.03, d, G)
            back = np.clip(np.clip(here, lower, upper) - here, -_STEP, _STEP)
            inside = back == 0.0
            low = np.where(inside, np.maximum(lower - here, -_STEP), back)
            high = np.where(inside, np.minimum(upper - here, _STEP), back)
            gap = np.minimum(self.need.target - d[:count], _RISE)
            status, share = -1, 1.0
            while status != SOLVED and share > 0.1:
                h = np.where(gap > 0.0, gap * share, gap)
                status = solve(
                    factor, np.zeros(n), low, high, G[:count].copy(), h, count, step, most
                )  # fmt: skip
                share *= 0.5
            if status != SOLVED or not np.abs(step).max() > 1e-7:
                return None
            way.append(here + step)
        return None

    def ends(self) -> list[np.ndarray]:
        """Certified poses near by."""
        q, anchor, chain = self.q, self.robot.anchor, self.chain
        rng = np.random.default_rng(0)
        inside = np.clip(q, self.robot.lower, self.robot.upper)
        moves = chain.moves[chain.body_frame[chain.pair[self.close].ravel()]].any(axis=0)
        tried = [inside]
        for share in _SHARES:
            tried += [
                inside + share * (anchor - inside) * moves,
                inside + share * (anchor - inside),
            ]
        for far in _NOISE:
            tried += list(inside + far * rng.uniform(-1.0, 1.0, (_TRIES, len(q))) * moves)
        found = batch.project(chain, anchor, np.array(tried), self.need.target).q
        return [end for end in found if self._good(end)] + [anchor]

    def leads(self, way: np.ndarray) -> bool:
        """Does the way keep all that a way out must?"""
        if not self._good(way[-1]):
            return False
        return all(self._leg(a, b) for a, b in zip(way[:-1], way[1:], strict=True))

    def shortcut(self, way: np.ndarray) -> np.ndarray:
        """The same way with fewer corners, where the straight one leads too."""
        kept, at, last = [0], 0, len(way) - 1
        while at < last:
            to = last
            while to > at + 1 and not self._leg(way[at], way[to]):
                to = at + max((to - at) // 2, 1)
            kept.append(to)
            at = to
        return way[kept]

    def _leg(self, a: np.ndarray, b: np.ndarray) -> bool:
        ends = np.stack([a, b])
        beyond = np.maximum(np.maximum(self.robot.lower - ends, ends - self.robot.upper), 0.0)
        if not (beyond[1] <= beyond[0] + 1e-12).all():
            return False
        count = max(int(np.ceil(np.abs(b - a).max() / _SAMPLE)), 1)
        poses = a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a)
        near = batch.pair_distances(self._closed, poses)
        if not (np.diff(np.minimum(near, self.need.margin), axis=0) >= -_SLACK).all():
            return False
        chain, bound, scratch = self._others
        return not len(chain.pair) or (
            segment.prove(chain, bound, scratch, a, b, self._between, _BUDGET)[0]
            == segment.CERTIFIED
        )

    def _good(self, q: np.ndarray) -> bool:
        clearance, room = self._certifier.one(q)
        return bool(clearance >= self.need.margin + _SLACK and room >= 0.0)
