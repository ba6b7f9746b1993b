"""Whole motions: wanted joint positions over time to the nearest certified motion.

    planner = Planner(machine, limits(machine))
    made = planner.plan(times, wanted)                   # nearest in the joints
    made = planner.plan(times, wanted, skeleton=True)    # nearest in what a person sees

What holds already comes back to the bit. Else the rows around what does not are planned anew, all
of them at once, as near to what is wanted as limits, speeds, accelerations and clearances allow
(s3le/plan/rounds.py); then every pose is measured and every path proven. Where that fails, those
rows are planned again with more room; and at last the robot is driven past the place step by step,
each step proven (s3le/plan/drive.py), and the rows about it are planned once more from there. What
comes out holds, or nothing does.
"""

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.kernels.poses import AGREEMENT
from s3le.plan import causal, chase, drive, gentle, limits, rounds, weights
from s3le.plan.examine import Plan, examine, origin
from s3le.plan.interior import program
from s3le.plan.limits import Limits
from s3le.plan.settings import Settings, bounds
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.swept import swept
from s3le.skeleton import DIM
from s3le.types import Progress

SLOWEST = "interior.improve"  # of the kernels that a motion needs, to compile
_STRIDE = 0.1  # [rad], that a motion which holds is moved at most a round;
_BURST, _BURSTS = 8, 8  # so many rounds at a time, and so often
_WORTH = 0.01  # if they gained this share of the cost
_SPARE = 0.1  # share of speed and acceleration that the first guess leaves
_MORE = 0.001  # [m], that a pose or path which failed is asked to keep beyond what it lacked


class Planner:
    """Plans motions of one robot, one at a time; holds scratch: one per thread."""

    def __init__(
        self, robot: Robot, most: Limits | None = None, settings: Settings | None = None
    ) -> None:
        """Make what does not depend on the motion.

        Args:
            robot: the robot.
            most: what each joint may do; None: limits.limits(machine).
            settings: see there.

        Raises:
            ParameterError: the clearances of the settings do not fit the robot's margin.
        """
        self.robot, self.settings = robot, settings or Settings()
        self.most = limits.limits(robot) if most is None else most
        self._care = self.settings.care(robot)
        self._custom, self._bounds = self.settings.custom(), bounds(self.most)
        self._moves(robot, np.arange(robot.n_dof))
        self._program = program(0, robot.n_dof, 0)
        self._joints = weights.of_joints(robot)

    def _moves(self, every: Robot, own: np.ndarray) -> None:
        """Note what is measured and proven: all joints that move, and which of them are ours."""
        self._chain, self._own = every.chain, own
        self._swept, self._scratch = swept(every.chain), segment.scratch(every.chain)
        self._certifier = every.certifier()

    def plan(
        self,
        times: np.ndarray,
        wanted: np.ndarray,
        *,
        skeleton: bool = False,
        weight: np.ndarray | None = None,
        bone: np.ndarray | None = None,
        stands: bool = False,
        progress: Progress | None = None,
    ) -> Plan:
        """The nearest motion that holds.

        Args:
            times: of the rows [s], (m,), rising by 1e-6 s and more.
            wanted: [rad], (m, n), finite; it need not be feasible in any way.
            skeleton: near means near in the seven bones of the wanted pose; False: in the joints.
            weight: of the joints, (n, n) or one a row (m, n, n), positive definite. None:
                weights.of_joints, or, beside the skeleton, weights.RIDGE for each.
            bone: of the skeleton's components, (21,); None: weights.of_bones.
            stands: the robot stands where the first two rows, which are alike, say: they are not
                moved.
            progress: called with numbers of rows done.

        Raises:
            ParameterError: an argument has another shape or is not finite.
            CertificateError: no motion was found that holds; says which row does not.
        """
        times, wanted = limits.motion(times, wanted, self.robot.n_dof)
        job = self._job(times, wanted, skeleton, weight, bone, stands, progress)
        job.settle()
        made = job.plan()
        if self.settings.check:
            self._certifier.require(made.q, self.robot.margin)
        return made

    def _job(self, times, wanted, skeleton, weight, bone, stands, progress) -> "_Job":
        aim = self._aim(times, wanted, skeleton, weight, bone)
        return _Job(self, times, wanted, aim, stands, progress)

    def warm_up(self, everything: bool = False) -> None:
        """Compile what a motion needs, or read it from the store, so that none waits for it.

        Args:
            everything: what drives a robot past a place that no plan gets around, too. Few
                motions need it; the first that does waits for it.
        """
        anchor, times = self.robot.anchor, np.arange(24) / 30.0
        wanted = np.tile(anchor, (24, 1))
        wanted[12] += 0.5
        for skeleton in (False, True):
            job = _Job(self, times, wanted, self._aim(times, wanted, skeleton, None, None))
            job.around(0, 24)
            if everything:
                job.past(1)

    def _aim(self, times, wanted, skeleton, weight, bone) -> rounds.Aim:
        if weight is None:
            weight = weights.RIDGE * np.eye(wanted.shape[1]) if skeleton else self._joints
        weight = weights.of_rows(weight, *wanted.shape)
        bone = weights.of_bones(self.robot) if bone is None else np.asarray(bone, float)
        if bone.shape != (DIM,) or not (np.isfinite(bone) & (bone >= 0.0)).all():
            raise ParameterError(f"bones need {DIM} finite weights of at least 0")
        x = np.zeros((0, DIM))
        if skeleton:
            inside = np.clip(wanted, self.most.lower, self.most.upper)
            x = np.empty((len(wanted), DIM))
            batch._skeletons(self.robot.chain, inside, x)
        return rounds.Aim(wanted, x, bone, weight, wanted, self._own)


class _Job:
    """One motion on its way from what is wanted to what holds."""

    _after = 1  # rows after one that has changed whose paths have changed too

    def __init__(
        self,
        planner: Planner,
        times: np.ndarray,
        wanted: np.ndarray,
        aim: rounds.Aim,
        stands: bool = False,
        progress: Progress | None = None,
    ) -> None:
        self.its, self.times, self.wanted, self.aim = planner, times, wanted, aim
        self.given, self._progress, self._done = 2 if stands else 0, progress, 0
        m = len(times)
        self.lasts = limits.changing(times)  # [s], in which the speed changes at each row
        self.q = wanted.copy()
        self.clearance, self.bound = np.full(m, np.nan), np.full(m, np.nan)
        self.proven, self.where = np.zeros(m, np.bool_), np.zeros(m)
        self.driven = np.zeros(m, np.bool_)
        step = float(np.median(np.diff(times))) if m > 1 else 1.0
        self.reach = int(np.clip(np.ceil(planner.settings.horizon / step - 1e-6), 4, 10_000))

    def settle(self) -> None:
        """Bring what is wanted to what holds.

        Raises:
            CertificateError: see Planner.plan.
        """
        m = len(self.q)
        self.measure(0, m)
        if (first := self.broken()).any():
            for start, stop in limits.stretches(first, self.reach, m):
                self.around(start, stop)
            self.repair()
            if (left := self.refused()).any():
                row = int(np.argmax(left))
                raise CertificateError(
                    f"no motion was found that holds at row {row} ({self.times[row]:.4f} s): "
                    + self.why(row)
                )
        gentle.ease(self, self.its.settings.jerk)
        self.done(m)

    def plan(self) -> Plan:
        """What was found."""
        how = origin((self.q == self.wanted).all(axis=1), self.driven)
        return Plan(self.q, how, self.clearance, self.bound)

    def done(self, rows: int) -> None:
        """Say that so many rows are done, of all."""
        if self._progress and rows > self._done:
            self._progress(rows - self._done)
            self._done = rows

    def poses(self) -> np.ndarray:
        """Poses of all joints that move [rad], (m, N): ours, where nobody else moves any."""
        return self.q

    def measure(self, first: int, last: int) -> None:
        """Clearances of rows first to last - 1, and proofs of the paths that end there."""
        its = self.its
        self._examine(first, last)
        # As near to the margin as two engines may differ, the independent one has the word.
        part = slice(first, last)
        margin = its.robot.margin
        near = first + np.flatnonzero(np.abs(self.clearance[part] - margin) < AGREEMENT)
        for row in near:
            found = its._certifier.one(self._pose(int(row)))[0]
            self.clearance[row] = (
                max(found, margin) if found >= margin else min(found, np.nextafter(margin, 0.0))
            )

    def _examine(self, first: int, last: int) -> None:
        its = self.its
        examine(
            its._chain, its._swept, its._scratch, self.poses(), its._care, first, last,
            self.clearance, self.proven, self.where, self.bound,
        )  # fmt: skip

    def _pose(self, row: int) -> np.ndarray:
        """What is measured at a row [rad], (N,)."""
        return self.poses()[row]

    def close(self, first: int, last: int) -> np.ndarray:
        """Rows whose pose is too close or whose path is not proven, bool."""
        part = slice(first, last)
        return ~(self.clearance[part] >= self.its.robot.margin) | ~self.proven[part]

    def broken(self) -> np.ndarray:
        """Rows that do not hold; of a path both ends."""
        bad = self.close(0, len(self.q))
        bad[:-1] |= ~self.proven[1:]
        return bad | limits.broken(self.times, self.q, self.its.most, self.lasts)

    def refused(self) -> np.ndarray:
        """Rows for which there is no answer."""
        return self.broken()

    def why(self, row: int) -> str:
        if not self.clearance[row] >= self.its.robot.margin:
            return f"its pose keeps {self.clearance[row] * 1e3:.3f} mm"
        if not self.proven[row] or not self.proven[min(row + 1, len(self.q) - 1)]:
            return "a path there is not proven"
        return "limits, speed or acceleration are exceeded"

    def around(self, start: int, stop: int) -> None:
        """Plan rows start to stop - 1 anew; more of them where they cannot rejoin in time."""
        m, reach = len(self.q), self.reach
        window = max(self.its.settings.window, 4 * reach)
        while True:
            start, stop = self.edges(start, stop)
            if stop - start <= window:
                if self._window(start, stop, joins=stop < m) or stop == m:
                    self.done(stop)
                    return
                stop += 2 * reach
                continue
            self._window(start, start + window, joins=False)
            # What lies beyond is planned with the rows after it; until then it is as wanted.
            kept = start + window - 2 * reach
            self.q[kept : start + window] = self.wanted[kept : start + window]
            start = kept
            self.done(start)

    def edges(self, start: int, stop: int) -> tuple[int, int]:
        """A window, to an end of the motion where it is near: it joins two rows or none."""
        m = len(self.q)
        return start if start >= max(self.given, 2) else self.given, stop if stop <= m - 2 else m

    def _window(self, start: int, stop: int, joins: bool, price: float | None = None) -> bool:
        """Plan a window; True where its limits hold, and those where it joins the rows after.

        Args:
            start, stop: the window's rows.
            joins: it ends in two rows as they are.
            price: least of squared second differences, for small changes [1/rad^2]; None: anew.
        """
        its, anew = self.its, price is None
        before, after = 2 if start else 0, 2 if joins else 0
        rows = slice(start - before, stop + after)
        times, m = self.times[rows], stop - start + before + after
        if len(its._program.q) < m:
            n = its.robot.n_dof
            size = max(m, its.settings.window + 4)
            its._program = program(size, n, size * rounds.MORE)
        p = its._program
        p.fixed[:m] = False
        p.fixed[:before] = True
        p.fixed[m - after : m] = True
        kept = self.q[rows].copy()
        p.q[:m] = self._guess(times, self.wanted[rows], kept, before, after) if anew else kept
        most, lasts = its.most, self.lasts[rows]
        rounds.bound(p, m, times, lasts, most.lower, most.upper, most.speed, most.acceleration)
        x, W = self.aim.x, self.aim.W
        aim = rounds.Aim(
            self.wanted[rows], x[rows] if len(x) else x, self.aim.bone,
            W[rows] if len(W) > 1 else W, self.poses()[rows], its._own,
        )  # fmt: skip
        target = np.full(m, its.settings.target)
        between, rests, out = np.zeros(m), np.zeros(m), np.zeros(3)
        own = slice(start, min(stop + self._after, len(self.q)))
        chain, balls = its._chain, its._swept.balls
        custom, stride = its._custom, np.inf if price is None else _STRIDE
        if price is not None:
            steady = max(custom.steady, price)
            custom = custom._replace(soft=custom.stiff, rounds=_BURST, steady=steady)
        short = custom._replace(rounds=max(custom.rounds // 2, 1))
        for turn in range(its.settings.repairs + 1):
            good = rounds.settle_window(
                chain, balls, p, m, aim, target, between, rests, its._bounds.acceleration,
                short if turn else custom, turn == 0, out, stride,
            )  # fmt: skip
            if not good or limits.broken(times, p.q[:m], most, lasts).any():
                if turn or not anew:
                    return True  # what was found before stays
                self.q[rows] = (
                    kept if joins else self._guess(times, self.wanted[rows], kept, before, 0)
                )
                self.measure(own.start, own.stop)
                return not joins
            self.q[rows] = p.q[:m]
            self.measure(own.start, own.stop)
            bad = np.flatnonzero(self.close(own.start, own.stop))
            if not len(bad) or turn == its.settings.repairs:
                return True
            for row in bad + own.start:
                at = row - (start - before)
                lack = max(its.robot.margin - self.clearance[row], 0.0)
                target[max(at - 1, 0) : at + 2] += min(lack, 0.01) + _MORE
                if not self.proven[row] and at <= m:
                    between[at - 1] = min(max(self.where[row], 0.1), 0.9)
                    if self.where[row] == 1.0:  # of a curve: the way to rest
                        rests[max(at - 2, 0) : at + 3] = np.diff(times).min()
        return True

    def _guess(self, times, wanted, kept, before: int, after: int) -> np.ndarray:
        """A motion within the limits: the means of two chases, one told backwards, (m, n)."""
        most, spare = self.its.most, _SPARE
        arguments = most.lower, most.upper, most.speed, most.acceleration, spare
        ahead, back = kept.copy(), kept[::-1].copy()
        chase.chase(times, wanted, *arguments, before, ahead)
        if not before and not after:
            chase.chase(times[::-1].copy(), wanted[::-1].copy(), *arguments, 0, back)
            return 0.5 * (ahead + back[::-1])
        if not after:
            return ahead
        chase.chase(times[::-1].copy(), wanted[::-1].copy(), *arguments, 2, back)
        back = back[::-1]
        ramp = np.linspace(0.0, 1.0, len(times))[:, None] if before else 0.5
        guess = (1.0 - ramp) * ahead + ramp * back
        guess[:before] = kept[:before]
        guess[len(kept) - after :] = kept[len(kept) - after :]
        return guess

    def repair(self) -> None:
        """Drive the robot past what is not proven yet, each step proven."""
        done = 0
        while (bad := self.close(0, len(self.q))[done:]).any():
            last = self.past(done + int(np.argmax(bad)))
            if last < done:
                return  # no further
            done = last + 1

    def past(self, row: int) -> int:
        """Drive the robot past a row until a plan holds again; the last row that was driven."""
        its, m = self.its, len(self.q)
        chain = its.robot.chain
        first = max(row - 1, 0)
        while first > 0 and not self._stops(first):
            first -= 1
        if first == 0 and not self.clearance[0] >= its.robot.margin + AGREEMENT:
            anchor = its.robot.anchor
            self.q[0] = batch.project(chain, anchor, self.q[:1], its._care.target).q[0]
        planned = self.q.copy()
        ways = drive.ways(its, self.times, self.lasts, planned, self.aim, first, row)
        cut, far, end, found, least, last = row, self.reach, row, None, np.inf, first - 1
        while True:
            cut, far = min(cut + far, m - 1), 2 * far
            for way in ways:
                way.to(cut)
                self.q[:] = way.q
                self.measure(first, min(way.last + 1 + self._after, m))
                held = way.met or way.last == m - 1
                if not held:
                    self.around(way.last + 1, way.last + 1 + self.reach)
                    back = min(way.last + 2 * self.reach, m)
                    hard = limits.broken(self.times, self.q, its.most, self.lasts)[first:back]
                    held = not (hard.any() or self.close(first, back).any())
                changed = self._changed(planned, first)
                end = max(end, changed)
                if not held:
                    continue
                cost = self.cost(first, changed) - self.cost(first, changed, planned)
                if cost < least:
                    found, least, last = self.q.copy(), cost, way.last
            if found is not None or cut == m - 1:
                break
        self.q[:] = planned if found is None else found
        self.measure(first, min(end, m))
        if found is None:
            return last
        self.driven[first + (first > 0) : last + 1] = True
        self._polish(first, last)
        return last

    def _stops(self, row: int) -> bool:
        """May a robot that comes to this row as planned brake from there, all of it proven?"""
        its, q = self.its, self.q
        dt, lasts = self.times[row] - self.times[row - 1], self.lasts[row - 1]
        v = (q[row] - q[row - 1]) / dt
        before = v
        if row > 1:
            before = (q[row - 1] - q[row - 2]) / (self.times[row - 1] - self.times[row - 2])
        return causal.within(q[row - 1], v, dt, dt, its._bounds, q[row]) and causal.safe(
            its.robot.chain, its._swept, its._scratch, q[row - 1], before, q[row], lasts, dt,
            its._bounds, its._care, np.zeros(2),
        )  # fmt: skip

    def _changed(self, other: np.ndarray, first: int) -> int:
        """One beyond the last row, and the path after it, that is not as another motion has it."""
        rows = np.flatnonzero((self.q[first:] != other[first:]).any(axis=1))
        return min(first + (int(rows[-1]) + 1 + self._after if len(rows) else 1), len(self.q))

    def _polish(self, first: int, last: int) -> None:
        """Plan the rows about a stretch that was driven once more, from where they are."""
        start, stop = self.edges(first - self.reach, last + self.reach)
        rows = slice(start, min(stop + self._after, len(self.q)))
        if self.close(rows.start, rows.stop).any():
            return
        kept, least = self.q[rows].copy(), self.cost(rows.start, rows.stop)
        for _ in range(_BURSTS):
            self._window(start, stop, stop < len(self.q), price=0.0)
            cost = self.cost(rows.start, rows.stop)
            if self.close(rows.start, rows.stop).any() or not cost < least:
                self.q[rows] = kept
                self.measure(rows.start, rows.stop)
                return
            self.driven[rows] &= (self.q[rows] == kept).all(axis=1)
            gain = least - cost
            kept, least = self.q[rows].copy(), cost
            if gain < _WORTH * least:
                return

    def cost(self, first: int, last: int, q: np.ndarray | None = None) -> float:
        """What rows first to last - 1, of q or else the plan, are off from what is wanted."""
        part = slice(first, last)
        rows = np.ascontiguousarray((self.q if q is None else q)[part])
        return rounds.cost(self.its.robot.chain, self.aim, part, rows)
