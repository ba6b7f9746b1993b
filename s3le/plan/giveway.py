"""Step by step among joints that others move: along the best proven way, or forced.

What the others do is known. A step of ours is certified if its pose keeps the margin and the path
to it, others moving as they do, is proven. Tried are what is wanted, poses looked for downhill with
ever more room, braking, holding, ways towards the anchor, and, if none of these is proven, poses
drawn from all that speed and acceleration allow. Of those that are proven the one is made after
which ours could go on longest while they brake. If there is none, the step is forced: the one that
leaves bodies farthest apart is made, and is not certified.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels import batch
from s3le.kernels.distance import near_pairs, place_capsules
from s3le.kernels.kinematics import place
from s3le.kernels.poses import AGREEMENT
from s3le.kernels.solver import clearance_of
from s3le.plan import causal, chase
from s3le.plan.around import opened
from s3le.plan.limits import Limits
from s3le.robot.chain import Chain
from s3le.robot.robot import Robot
from s3le.safety.segment import CERTIFIED, Scratch, prove
from s3le.safety.swept import Swept
from s3le.skeleton import DIM

DRAWN = 1000  # poses that are drawn where nothing else is proven
_MOST = 20  # of these, those farthest from bodies, that are judged by how long they go on
_ROOM = (0.0, 0.01, 0.03)  # [m] beyond what is aimed at, that are looked for downhill
_SHARES = (0.1, 0.3, 1.0)  # of the way to the anchor
_ON = 0.25  # [s], for which a braking motion is looked at
_TIE = 1e-4  # [m/rad^2], what it costs a forced step to be off from what is planned
_ALONG = 4  # parts of a path at which it is measured where it is not proven
_EPS = 1e-7  # share of every limit that is not used, so that no rounding exceeds it


class Terms(NamedTuple):
    """Who gives way, among what, and what has to hold."""

    robot: Robot  # of ours
    most: Limits  # of ours
    bounds: causal.Bounds  # the same
    care: causal.Care
    joints: np.ndarray  # weights of ours, (n, n)
    own: np.ndarray  # int64 (n,), columns of ours among the joints of the chain
    chain: Chain  # of all joints that move, N
    swept: Swept
    scratch: Scratch


class GiveWay:
    """Ours on their way past a place, from one row to the next."""

    def __init__(
        self, terms: Terms, times: np.ndarray, whole: np.ndarray, planned: np.ndarray
    ) -> None:
        """Take note of the motion.

        Args:
            terms: see there.
            times: of the rows [s], (m,).
            whole: poses of all joints [rad], (m, N); ours are moved.
            planned: of ours [rad], (m, n), which are followed where that is certified.
        """
        self.its, self.times, self._whole, self._planned = terms, times, whole, planned
        self._chain, self._own = terms.chain, terms.own
        n = whole.shape[1]
        self._W = np.eye(n)
        self._W[np.ix_(self._own, self._own)] = terms.joints
        free = np.full(n, np.inf)
        hardest = free.copy()
        hardest[self._own] = terms.most.acceleration
        self._bounds = causal.Bounds(-free, free, free, hardest)
        self._balls = terms.swept.balls
        self._least = terms.care.margin + AGREEMENT  # [m], of a pose
        self._rng = np.random.default_rng(0)

    @property
    def q(self) -> np.ndarray:
        """Where ours are [rad], (m, n)."""
        return self._whole[:, self._own]

    def past(self, first: int, stop: int) -> int:
        """Drive from row first on until ours are as planned again, at row stop or later.

        Returns:
            The last row that was written.
        """
        if first == 0:
            self._begin()
        same = 0
        for t in range(first + 1, len(self.times)):
            self._whole[t, self._own] = self.step(t)
            same = same + 1 if (self._whole[t, self._own] == self._planned[t]).all() else 0
            if same >= 2 and t > stop:
                return t
        return len(self.times) - 1

    def stops(self, t: int) -> bool:
        """Could ours brake from row t on, as they come there, all of it certified?"""
        return self._goes_on(t, np.ascontiguousarray(self._whole[t, self._own])) >= _ON

    def _begin(self) -> None:
        """The first row: where it may be, else the nearest pose found that keeps the margin."""
        pose, own, care = self._whole[0].copy(), self._own, self.its.care
        if clearance_of(self._chain, self._balls, pose) >= care.margin + AGREEMENT:
            return
        low, high, anchor = pose.copy(), pose.copy(), pose.copy()
        low[own], high[own] = self.its.most.lower, self.its.most.upper
        anchor[own] = self.its.robot.anchor
        still = self._chain._replace(lower=low, upper=high)  # given joints stay where they are
        found = batch.project(still, anchor, pose[None].copy(), care.target).q[0]
        tried = np.repeat(pose[None], DRAWN + 2, axis=0)
        tried[0, own], tried[1, own] = found[own], anchor[own]
        tried[2:, own] = self._rng.uniform(low[own], high[own], (DRAWN, len(own)))
        clear = batch.clearances(self._chain, tried)
        good = np.flatnonzero(clear >= care.margin + AGREEMENT)
        off = self._off(tried[:, own], pose[own])
        self._whole[0] = tried[good[off[good].argmin()] if len(good) else int(clear.argmax())]

    def step(self, t: int) -> np.ndarray:
        """Where ours are at row t [rad], (n,)."""
        box, want = self._box(t), self._planned[t]
        first = [want] if self._allowed(box, want) else []
        if first and self._certified(t, want) and self._goes_on(t, want) >= _ON:
            return want
        tried = np.array([*first, *self._ways(t, box)])
        proven = [one for one in tried if self._certified(t, one)]
        if not proven and self._clear(self._whole[t - 1]):
            drawn = self._rng.uniform(box.low, box.high, (DRAWN, len(self._own)))
            clear = batch.clearances(self._chain, self._at(t, drawn))
            for row in np.argsort(-clear)[: int((clear >= self._least).sum())]:
                if self._certified(t, drawn[row]):
                    proven.append(drawn[row])
                if len(proven) == _MOST:
                    break
        if proven:
            return self._longest(t, np.array(proven), want)
        # Not of those drawn: they would move joints that have no part in it.
        return self._least_deep(t, tried, want)

    def _longest(self, t: int, proven: np.ndarray, want: np.ndarray) -> np.ndarray:
        """Of certified poses the nearest to what is wanted from which ours could go on long."""
        best, longest = proven[0], -1.0
        for row in np.argsort(self._off(proven, want), kind="stable"):
            on = self._goes_on(t, proven[row])
            if on > longest:
                best, longest = proven[row], on
            if on >= _ON:
                break
        return best

    def _ways(self, t: int, box: "_Box") -> list[np.ndarray]:
        """Poses of the box worth a look: downhill, braking, holding, towards the anchor."""
        its = self.its
        want = np.clip(self._planned[t], box.low, box.high)
        ways = [self._downhill(t, box, want, room) for room in _ROOM]
        ways += [self._away(t, box, want), box.rest, np.clip(box.here, box.low, box.high)]
        out = np.empty(len(self._own))
        for share in _SHARES:
            for group in range(3):
                if opened(its.robot.chain, box.here, its.robot.anchor, group, share, out):
                    ways.append(np.clip(out, box.low, box.high))
        return ways

    def _downhill(self, t: int, box: "_Box", want: np.ndarray, room: float) -> np.ndarray:
        """The pose of the box nearest to what is wanted, pairs kept apart by some more [m]."""
        last, goal, own = self._whole[t - 1], self._at(t, want[None])[0], self._own
        low, high, v = goal.copy(), goal.copy(), np.zeros(len(goal))
        low[own], high[own], v[own] = box.low, box.high, box.v
        care = self.its.care
        care = care._replace(target=care.target + room, steps=max(care.steps, 6))
        to = np.empty(len(goal))
        causal.search(
            self._chain, self._balls, last, v, low, high, box.dt, self._bounds, care, goal,
            np.empty(0), np.zeros(DIM), self._W, to,
        )  # fmt: skip
        return np.clip(to[own], box.low, box.high)

    def _away(self, t: int, box: "_Box", want: np.ndarray) -> np.ndarray:
        """What is wanted, but joints that can part the nearest two bodies as far as they may."""
        pose, chain = self._at(t, want[None])[0], self._chain
        n, pairs = len(pose), len(chain.pair)
        R, p, z = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
        ends, d, G = np.empty((len(chain.body_frame), 3, 3)), np.empty(pairs), np.empty((pairs, n))
        place(chain, pose, R, p, z)
        place_capsules(chain, R, p, ends)
        count = near_pairs(chain, ends, self._balls, p, z, self.its.care.target, d, G)
        if not count:
            return want
        along = G[int(d[:count].argmin()), self._own]
        return np.where(along > 0.0, box.high, np.where(along < 0.0, box.low, want))

    def _box(self, t: int) -> "_Box":
        """What limits, speed and acceleration allow at row t."""
        most, here = self.its.most, np.ascontiguousarray(self._whole[t - 1, self._own])
        dt = self.times[t] - self.times[t - 1]
        v, mean = np.zeros(len(here)), 1e9  # nothing went before: any speed
        if t > 1:
            before = self.times[t - 1] - self.times[t - 2]
            v, mean = (here - self._whole[t - 2, self._own]) / before, 0.5 * (before + dt)
        low, high, rest = np.empty_like(here), np.empty_like(here), np.empty_like(here)
        for i in range(len(here)):
            slow, fast, _ = chase.speeds(
                here[i], v[i], mean, dt, most.lower[i], most.upper[i],
                most.speed[i] * (1.0 - _EPS), most.acceleration[i] * (1.0 - _EPS),
            )  # fmt: skip
            low[i], high[i] = here[i] + slow * dt, here[i] + fast * dt
        low, high = (np.clip(end, most.lower, most.upper) for end in (low, high))
        causal.brake(here, v, mean, dt, self.its.bounds, rest)
        return _Box(here, v, mean, dt, low, high, np.clip(rest, low, high))

    def _allowed(self, box: "_Box", to: np.ndarray) -> bool:
        return bool(causal.within(box.here, box.v, box.mean, box.dt, self.its.bounds, to))

    def _at(self, t: int, q: np.ndarray) -> np.ndarray:
        """Poses of all joints at row t [rad], (c, N), ours as in q (c, n)."""
        poses = np.repeat(self._whole[t][None], len(q), axis=0)
        poses[:, self._own] = q
        return poses

    def _clear(self, pose: np.ndarray) -> bool:
        return bool(clearance_of(self._chain, self._balls, pose) >= self._least)

    def _proven(self, last: np.ndarray, pose: np.ndarray) -> bool:
        its, care = self.its, self.its.care
        found = prove(
            self._chain, its.swept, its.scratch, last, pose, care.between, care.budget
        )  # fmt: skip
        return bool(found[0] == CERTIFIED)

    def _certified(self, t: int, q: np.ndarray) -> bool:
        """Does ours at q keep the margin at row t, and the path to it?"""
        pose = self._at(t, q[None])[0]
        return self._clear(pose) and self._proven(self._whole[t - 1], pose)

    def _goes_on(self, t: int, q: np.ndarray) -> float:
        """How long ours could brake and hold from there on, all of it certified [s]."""
        most, own = self.its.bounds, self._own
        last, here, then = self._at(t, q[None])[0], q.copy(), np.empty_like(q)
        before, v = 1e9, np.zeros_like(q)  # before row 0 there was nothing
        if t > 0:
            before = self.times[t] - self.times[t - 1]
            v = (q - self._whole[t - 1, own]) / before
        for row in range(t + 1, len(self.times)):
            dt = self.times[row] - self.times[row - 1]
            causal.brake(here, v, 0.5 * (before + dt), dt, most, then)
            pose = self._at(row, then[None])[0]
            if not (self._clear(pose) and self._proven(last, pose)):
                return float(self.times[row - 1] - self.times[t])
            if self.times[row] - self.times[t] >= _ON:
                return _ON
            v, before, last = (then - here) / dt, dt, pose
            here[:] = then
        return _ON

    def _least_deep(self, t: int, tried: np.ndarray, want: np.ndarray) -> np.ndarray:
        """Of poses none of which is certified: that on whose path bodies stay farthest apart."""
        share = np.linspace(0.0, 1.0, _ALONG + 1)[1:, None]
        ends = self._at(t, tried)
        poses = np.concatenate([(1.0 - share) * self._whole[t - 1] + share * to for to in ends])
        clear = batch.clearances(self._chain, poses).reshape(len(tried), _ALONG)
        kept = np.minimum(clear, self.its.care.target).sum(axis=1)
        return tried[int((kept - _TIE * self._off(tried, want)).argmax())]

    def _off(self, q: np.ndarray, want: np.ndarray) -> np.ndarray:
        """How far poses (c, n) are from one (n,), squared and weighted [rad^2], (c,)."""
        off = q - want
        return ((off @ self.its.joints) * off).sum(axis=1)


class _Box(NamedTuple):
    """What ours may do in one step."""

    here: np.ndarray  # [rad], (n,), where they are
    v: np.ndarray  # [rad/s], (n,), the speed of their last step
    mean: float  # [s], of the last step's and this one's duration
    dt: float  # [s]
    low: np.ndarray  # [rad], (n,)
    high: np.ndarray
    rest: np.ndarray  # [rad], (n,), where they get if they brake
