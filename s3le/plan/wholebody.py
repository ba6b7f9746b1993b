"""Whole-body motions: ours to the nearest certified motion, among joints that others move.

Rows and what the given joints do in them are known, and between rows these joints too move
straight. Ours are planned as ever (s3le/plan/whole.py), all distances and proofs with all joints
moving. Where a plan does not hold, others are begun from, arms opened some way to the anchor; and
at last ours are driven past the place step by step (s3le/plan/giveway.py). Steps for which the
others leave no certified way are forced: they come out as such, and nothing is claimed of them.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.plan import limits, rounds
from s3le.plan.around import opened
from s3le.plan.giveway import GiveWay, Terms
from s3le.plan.limits import Limits
from s3le.plan.settings import Settings
from s3le.plan.whole import Planner, _Job
from s3le.robot.wholebody import WholeBody
from s3le.types import Progress

_FAR = 0.35  # [rad] from what is wanted, from which a plan is held against one begun elsewhere
_SHARES = (0.35, 1.0)  # of the way to the anchor by which arms are opened in a first guess
_GROUPS = (0, 1, 2)  # of which joints: all, the right arm's, the left arm's (around.opened)
_BACK = (0.0, 0.5, 1.0)  # of the horizon before what is broken, from which giving way may begin


class BodyPlan(NamedTuple):
    """A motion of ours among given joints, one entry a row."""

    q: np.ndarray  # [rad], (m, n)
    how: np.ndarray  # uint8 (m,): examine.WANTED, PLANNED or DRIVEN
    forced: np.ndarray  # bool (m,), the pose or the path that leads to it is not certified


class BodyPlanner(Planner):
    """Plans motions of one robot among joints that others move; holds scratch: one per thread."""

    def __init__(
        self, body: WholeBody, most: Limits | None = None, settings: Settings | None = None
    ) -> None:
        """Make what does not depend on the motion; see whole.Planner.

        Args:
            body: the robot; its base's margin is kept.
            most: what each joint of ours may do.
            settings: see there.
        """
        super().__init__(body.base, most, replace(settings or Settings(), curved=False))
        self.body = body
        self._moves(body.robot, body.own)
        self.terms = Terms(
            body.base, self.most, self._bounds, self._care, self._joints, self._own, self._chain,
            self._swept, self._scratch,
        )  # fmt: skip

    def among(
        self,
        times: np.ndarray,
        wanted: np.ndarray,
        given: np.ndarray,
        progress: Progress | None = None,
    ) -> BodyPlan:
        """The nearest motion of ours that holds wherever the given joints leave one.

        Args:
            times: of the rows [s], (m,), rising by 1e-6 s and more.
            wanted: of ours [rad], (m, n), finite.
            given: what the given joints do [rad], (m, k), finite.
            progress: called with numbers of rows done.

        Raises:
            ParameterError: an argument has another shape or is not finite.
            CertificateError: our limits, speeds or accelerations cannot be kept; says where.
        """
        times, wanted = limits.motion(times, wanted, self.robot.n_dof)
        given = np.ascontiguousarray(given, float)
        if given.shape != (len(times), len(self.body.given)) or not np.isfinite(given).all():
            raise ParameterError(
                f"given joints need finite angles ({len(times)}, {len(self.body.given)}), "
                f"got {given.shape}"
            )
        aim = self._aim(times, wanted, False, None, None)
        job = _BodyJob(self, times, wanted, given, aim, progress)
        job.settle()
        return BodyPlan(job.q, job.plan().how, job.close(0, len(times)))


class _BodyJob(_Job):
    """One motion of ours among given joints."""

    its: BodyPlanner

    def __init__(
        self,
        planner: BodyPlanner,
        times: np.ndarray,
        wanted: np.ndarray,
        given: np.ndarray,
        aim: rounds.Aim,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(planner, times, wanted, aim, False, progress)
        self._whole = planner.body.poses(wanted, given)
        self._bent: np.ndarray | None = None  # [rad], (m, n), what a first guess goes after instead

    def poses(self) -> np.ndarray:
        """Poses of all joints that move [rad], (m, N)."""
        self._whole[:, self.its.body.own] = self.q
        return self._whole

    def _guess(self, times, wanted, kept, before: int, after: int) -> np.ndarray:
        if self._bent is not None:
            wanted = self._bent
        return super()._guess(times, wanted, kept, before, after)

    def refused(self) -> np.ndarray:
        """Rows beyond our limits; where others leave no way a row comes out as forced."""
        return limits.broken(self.times, self.q, self.its.most)

    def why(self, row: int) -> str:
        return "limits, speed or acceleration are exceeded"

    def repair(self) -> None:
        """Plan from other first guesses what is far off or does not hold; then give way."""
        m = len(self.q)
        far = (np.abs(self.q - self.wanted) > _FAR).any(axis=1)
        for start, stop in limits.stretches(far | self.close(0, m), self.reach, m):
            self._otherwise(start, stop, opened=False)
        for start, stop in limits.stretches(self.close(0, m), self.reach, m):
            self._otherwise(start, stop, opened=True)
        done = 0
        while (bad := self.close(0, len(self.q))[done:]).any():
            done = self._give_way(done + int(np.argmax(bad))) + 1

    def _otherwise(self, start: int, stop: int, opened: bool) -> None:
        """Plan rows start to stop - 1 from other first guesses; what is best is kept.

        Args:
            start, stop: the rows.
            opened: from what is wanted with the arms opened, until all rows hold; else from each
                pose by itself brought clear.
        """
        m, (start, stop) = len(self.q), self.edges(start, stop)
        rows = slice(start, min(stop + 1, m))
        before, after = 2 if start else 0, 2 if stop < m else 0
        part = slice(start - before, stop + after)
        kept, least = self.q.copy(), self._worth(rows)
        begun = kept.copy()
        guesses: list[Callable[[], np.ndarray | None]] = [partial(self._cleared, part)]
        if opened:
            guesses = [
                partial(self._opened, part, rows, group, share)
                for share in _SHARES
                for group in _GROUPS
            ]
        for guess in guesses:
            if opened and not least[0]:
                break
            self.q[:] = kept
            self.measure(rows.start, rows.stop)
            self._bent = guess()
            if self._bent is None:
                continue
            self.q[:] = begun
            met = self._window(start, stop, joins=stop < m) or stop == m
            self._bent = None
            self.measure(rows.start, rows.stop)
            if met and (worth := self._worth(rows)) < least:
                kept, least = self.q.copy(), worth
        self.q[:] = kept
        self.measure(rows.start, rows.stop)

    def _cleared(self, part: slice) -> np.ndarray:
        """What is wanted, each pose that is too close brought clear by the least change found."""
        its, own = self.its, self.its.body.own
        whole = self.its.body.poses(self.wanted[part], self._whole[part][:, self.its.body.others])
        bent = self.wanted[part].copy()
        clear = batch.clearances(its._chain, whole)
        for row in np.flatnonzero(~(clear >= its._care.target)):
            pose, anchor = whole[row], whole[row].copy()
            low, high = pose.copy(), pose.copy()
            low[own], high[own], anchor[own] = its.most.lower, its.most.upper, its.robot.anchor
            still = its._chain._replace(lower=low, upper=high)  # given joints stay where they are
            found = batch.project(still, anchor, pose[None].copy(), its._care.target)
            if found.how[0] != batch.FALLBACK:
                bent[row] = found.q[0, own]
        return bent

    def _opened(
        self, part: slice, rows: slice, group: int, share: float
    ) -> np.ndarray | None:  # fmt: skip
        """What is wanted, opened some way to the anchor where rows are too close."""
        chain, anchor = self.its.robot.chain, self.its.robot.anchor
        bent = self.wanted[part].copy()
        out = np.empty(bent.shape[1])
        bad = np.flatnonzero(self.close(rows.start, rows.stop)) + rows.start
        near = max(self.reach // 3, 1)
        for row in range(part.start, part.stop):
            if len(bad) and np.abs(bad - row).min() <= near:
                if not opened(chain, bent[row - part.start].copy(), anchor, group, share, out):
                    return None
                bent[row - part.start] = out
        return bent

    def _worth(self, rows: slice) -> tuple[int, float, float]:
        """How many rows do not hold, how much they lack [m], and what they are off; less is good.

        That last is in radians, squared and weighted.
        """
        bad = self.close(rows.start, rows.stop)
        lack = np.maximum(self.its.robot.margin - self.clearance[rows], 0.0).sum()
        off = self.q[rows] - self.wanted[rows]
        return int(bad.sum()), float(lack), float(((off @ self.aim.W[0]) * off).sum())

    def _give_way(self, row: int) -> int:
        """Drive ours past a row step by step; the last row that was written."""
        m, planned, known = len(self.q), self.q.copy(), self._known()
        best: tuple[tuple[int, float, float], np.ndarray, list[np.ndarray], int] | None = None
        for back in _BACK:
            first = max(row - 1 - int(back * self.reach), 0)
            self.q[:] = planned
            way = GiveWay(self.its.terms, self.times, self.poses().copy(), planned)
            while first > 0 and not way.stops(first):
                first -= 1
            last = way.past(first, row)
            self.q[first : last + 1] = way.q[first : last + 1]
            self._know(known)
            self.measure(first, min(last + 2, m))
            worth = self._worth(slice(0, m))
            if best is None or worth < best[0]:
                best = worth, self.q.copy(), self._known(), last
            if not worth[0] or first == 0:
                break
        assert best is not None  # of three places one was tried
        _, self.q[:], known, last = best
        self._know(known)
        self.driven |= (self.q != planned).any(axis=1)
        return max(last, row)

    def _known(self) -> list[np.ndarray]:
        """What was measured and proven of the rows as they are, a copy."""
        return [part.copy() for part in (self.clearance, self.bound, self.proven, self.where)]

    def _know(self, known: list[np.ndarray]) -> None:
        parts = (self.clearance, self.bound, self.proven, self.where)
        for part, was in zip(parts, known, strict=True):
            part[:] = was
