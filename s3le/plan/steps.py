"""Streams: one wanted pose after another to certified steps, without looking ahead.

    walker = Walker(robot, limits(robot), q=where_the_robot_is)
    step = walker.step(wanted, dt)

Every step is within limits, speed and acceleration, its pose keeps the margin, and its path is
proven; so is the motion on which the robot would brake from there. A step that cannot be proven is
not made: then the robot brakes, along what was proven with the step before.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.kernels.solver import clearance_of
from s3le.plan import causal, direct, ends, limits, pursue, weights
from s3le.plan.causal import Bounds
from s3le.plan.limits import SHORTEST, Limits
from s3le.plan.settings import Settings, bounds
from s3le.plan.state import LONGEST, State, checked, pose
from s3le.robot.chain import Chain
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.swept import Swept, swept
from s3le.skeleton import DIM

SLOWEST = "pursue.pursue"  # of the kernels that a step needs, to compile
EVEN = 1e-6  # share by which steps of a stream may differ and count as even
_ROWS = 60  # of a braking motion, so that the kernels look at all of it (causal.safe)
_RESTS = 1e-9  # [rad], by which a joint may come to rest beyond its limit: of floats
_LONG = 10_000  # most rows of a braking motion
_FAR = 0.15  # [rad] from what is wanted, from which on a robot that is blocked is to go around
_STILL = 0.3  # [rad/s], and it is blocked if no joint is faster
_OFTEN = 100  # [ms], so often at most a way around is looked for
_NEARER = 3e-6  # [m], more than what a measured clearance and the kernels' differ by and ask for
HOW = {
    causal.WANTED: "wanted",
    causal.LIMITED: "limited",
    causal.SHORTENED: "shortened",
    causal.BRAKED: "braked",
    causal.HELD: "held",
    pursue.AROUND: "around",
}


class Via(NamedTuple):
    """A row within a step."""

    after: float  # [s] since the step began
    q: np.ndarray  # [rad], (n,)
    v: np.ndarray  # [rad/s], (n,)


class Step(NamedTuple):
    """One answer."""

    q: np.ndarray  # [rad], (n,), where to be when the step is over
    how: str  # how it came about, one of HOW
    clearance: float  # [m], of the pose
    bound: float  # [m], proven clearance of the path that leads there
    certified: bool  # within all limits and proven; False only where it had to stand still at once
    via: tuple[Via, ...] = ()  # rows within it, where joints begin to be accelerated otherwise


class Walker:
    """One robot in motion, from rest; holds scratch, so one per thread."""

    _words = HOW

    def __init__(
        self,
        robot: Robot,
        most: Limits | None = None,
        settings: Settings | None = None,
        *,
        q: np.ndarray,
        skeleton: bool = False,
        weight: np.ndarray | None = None,
        bone: np.ndarray | None = None,
    ) -> None:
        """Put the robot where it is.

        Args:
            robot, most, settings: see whole.Planner.
            q: where the robot stands [rad], (n,).
            skeleton: see whole.Planner.plan.
            weight: of the joints, (n, n). None: weights.of_joints, or, beside the skeleton,
                weights.STREAM_RIDGE for each.
            bone: of the skeleton's components, (21,); None: weights.of_bones with STREAM_TRUNK.

        Raises:
            ParameterError: an argument has another shape or is not finite.
            CertificateError: q is not within limits, or nearer than the margin.
        """
        self.robot, self.settings = robot, settings or Settings()
        self.most = limits.limits(robot) if most is None else most
        n = robot.n_dof
        self._care = self.settings.care(robot)
        self._bounds = bounds(self.most)
        self._chain, self._swept = self._bodies()
        self._scratch = segment.scratch(self._chain)
        joints = weights.of_joints(robot)
        if weight is None:
            weight = weights.STREAM_RIDGE * np.eye(n) if skeleton else joints
        self._W = np.ascontiguousarray(weight, float)
        if bone is None:
            bone = weights.of_bones(robot, weights.STREAM_TRUNK)
        bone = np.ascontiguousarray(bone, float)
        if self._W.shape != (n, n) or not np.isfinite(self._W).all():
            raise ParameterError(f"weights must be finite, ({n}, {n}), got {self._W.shape}")
        if bone.shape != (DIM,) or not (np.isfinite(bone) & (bone >= 0.0)).all():
            raise ParameterError(f"bones need {DIM} finite weights of at least 0")
        self._bone, self._skeleton = bone, skeleton
        self._memory = pursue.memory(joints)
        self._none, self._nothing = np.zeros((0, n)), np.empty(0)
        self._q = self._at = pose(q, n, "the pose of the robot")
        self._clearance = self._found()
        self._v, self._before, self._even = np.zeros(n), np.nan, True
        self._asked, self._pace = np.full(n, np.nan), np.full(n, np.nan)

    def _bodies(self) -> tuple[Chain, Swept]:
        """Chain of what has to be kept apart, and how far each body can move."""
        return self.robot.chain, swept(self.robot.chain)

    @property
    def bodies(self) -> tuple[Chain, Swept]:
        """What is kept apart in each step, and how far it can move."""
        return self._chain, self._swept

    def _found(self) -> float:
        """Clearance [m] of the pose that the robot is found in.

        Raises:
            CertificateError: it is not feasible.
        """
        self._certifier = self.robot.certifier()
        return float(self._certifier.require(self._q[None], self.robot.margin).clearance[0])

    @property
    def q(self) -> np.ndarray:
        """Where the robot is [rad], (n,)."""
        return self._q.copy()

    @property
    def clearance(self) -> float:
        """Clearance of the pose where it is [m]."""
        return self._clearance

    @property
    def v(self) -> np.ndarray:
        """The speed of its last step [rad/s], (n,)."""
        return self._v.copy()

    def rest(self) -> tuple[Via, ...]:
        """The proven motion to a standstill, of a walker whose speed is continuous; else none."""
        return ()

    def state(self) -> State:
        """Where the robot is and what it is about; a copy."""
        memory = self._memory
        return State(
            self.q, self.v, self._before, self._clearance, self._even, self._asked, self._pace,
            memory.flag.copy(), memory.way.copy(),
        )  # fmt: skip

    def restore(self, state: State) -> None:
        """Go on from a state of a walker of the same robot, limits and settings.

        Raises:
            ParameterError: it has other shapes, or holds what is no number.
            CertificateError: the pose is not feasible, or from there it is not proven that the
                robot can brake within its limits. Nothing has changed.
        """
        state = checked(state, len(self._q))
        report = self._certifier.require(state.q[None], self.robot.margin)
        slow = (np.abs(state.v) <= self.most.speed * (1.0 + limits.ROUNDING)).all()
        if state.v.any() and not (slow and self._may_brake(state)):
            raise CertificateError("from this state it is not proven that the robot can brake")
        self.put(state._replace(clearance=float(report.clearance[0])))

    def _may_brake(self, state: State) -> bool:
        """Is a motion to rest within limits proven from a state?"""
        q, v, dt, a = state.q, state.v, state.before, self.most.acceleration
        far = np.maximum(np.abs(v) - 0.5 * a * dt, 0.0) ** 2 / (2.0 * a)
        room = np.where(v > 0.0, self.most.upper - q, q - self.most.lower)
        self._at = q
        good = (np.isinf(a) | (far <= room + _RESTS)).all() and self._rests(q, v, dt, np.zeros(2))
        self._at = self._q
        return bool(good)

    def put(self, state: State) -> None:
        """Go back to a state of this very walker; it is not looked at again."""
        self._q[:], self._v[:] = state.q, state.v
        self._before, self._even, self._clearance = state.before, state.even, state.clearance
        self._asked, self._pace = state.asked, state.pace
        self._memory.flag[:], self._memory.way[:] = state.flag, state.way

    def warm_up(self) -> None:
        """Compile what a step needs, or read it from the store, so that no step waits for it."""
        kept, out = self.state(), np.zeros(2)
        for wanted in (self.robot.anchor, self.most.upper + 1.0, None):
            self.step(wanted, 0.02)
        self._rests(self._q, self._v, 0.02, out)
        self._otherwise(0.02, 0.02, self.q, out)
        self.put(kept)

    def step(self, wanted: np.ndarray | None, dt: float, starts: np.ndarray | None = None) -> Step:
        """Where the robot is to be dt later.

        Args:
            wanted: [rad], (n,); it need not be feasible. None: the robot brakes.
            dt: time since the step before [s]; what is not finite or below 1e-6 s is no time, and
                nothing moves.
            starts: poses by which a way around may lead [rad], (k, n).

        Raises:
            ParameterError: wanted has another shape or is not finite. Nothing has changed.
        """
        n = len(self._q)
        if wanted is not None:
            wanted = pose(wanted, n, "a wanted pose")
        starts = self._none if starts is None else np.ascontiguousarray(starts, float)
        if starts.ndim != 2 or starts.shape[1] != n:
            raise ParameterError(f"starts must have shape (k, {n}), got {starts.shape}")
        try:
            dt = min(float(dt), LONGEST)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"dt must be a number, got {dt!r}") from None
        if not dt >= SHORTEST:  # catches NaN
            return Step(self.q, "held", self._clearance, self._clearance, True)
        before = dt if np.isnan(self._before) else self._before
        to, out = np.empty(n), np.zeros(2)
        self._even = self._even and abs(dt - before) <= EVEN * before
        before = self._begin(before, dt)
        near = self._ends(dt)
        aim = None if wanted is None else self._aim(wanted, dt)
        if aim is None or wanted is None:
            how = self._brake(before, dt, to, out)
        elif self._as_wanted(aim, before, dt, self._bounds if self._even else near, to, out):
            how = causal.WANTED
        elif self._skeleton or self._memory.flag[pursue.LEFT]:
            how = self._pursue(aim, before, dt, near, starts, to, out)
        else:
            how = self._direct(aim, self._rate_of(wanted, dt), before, dt, near, to, out)
            if self._blocked(aim, to, dt):  # does not move it, but may find a way around
                self._pursue(aim, before, dt, near, starts, np.empty(n), np.zeros(2))
        how, certified = self._settled(how, before, dt, to, out)
        if wanted is not None:
            self._note(wanted, dt)
        via = self._end(to, dt)
        self._before = dt
        return Step(self.q, self._words[how], self._clearance, float(out[0]), certified, via)

    def _begin(self, before: float, dt: float) -> float:
        """Note from where a step is looked for, into _at; the time in which speed may change."""
        self._at = self._q
        return before

    def _aim(self, wanted: np.ndarray, dt: float) -> np.ndarray:
        """Where a step is to lead for the robot to be where it is wanted."""
        return wanted

    def _end(self, to: np.ndarray, dt: float) -> tuple[Via, ...]:
        """Be where a step leads; rows on the way there."""
        self._v[:] = (to - self._q) / dt
        self._q[:] = to
        return ()

    def _settled(
        self, how: int, before: float, dt: float, to: np.ndarray, out: np.ndarray
    ) -> tuple[int, bool]:
        """The step that is made, checked once more; how it came about, and is it certified?"""
        mean, moving = 0.5 * (before + dt), bool(self._v.any())
        if moving if how == causal.HELD else not self._holds(to, mean, dt):
            # Nothing is proven, or the engines disagree: what was proven before is driven.
            how = self._brake(before, dt, to, out)
            if how != causal.HELD and not self._holds(to, mean, dt):
                how = self._stand(to, out)
        return how, how != causal.HELD or not moving

    def _holds(self, to: np.ndarray, mean: float, dt: float) -> bool:
        """Is the step within limits, speed and acceleration, and its pose good?"""
        within = ends.allowed(self._at, self._v, to, mean, dt, self._bounds)
        return bool(within) and self._measured(to)

    def _measured(self, to: np.ndarray) -> bool:
        """Does a pose hold by the independent check, if it is asked? Notes its clearance."""
        if not self.settings.check:
            self._clearance = float(clearance_of(self._chain, self._swept.balls, to))
            return True
        measured, room = self._certifier.one(to)
        if not (measured >= self.robot.margin and room >= 0.0):  # catches NaN
            return False
        self._clearance = measured
        return True

    def _brake(self, before: float, dt: float, to: np.ndarray, out: np.ndarray) -> int:
        mean = 0.5 * (before + dt)
        causal.brake(self._at, self._v, mean, dt, self._bounds, to)
        if causal.safe(
            self._chain, self._swept, self._scratch, self._at, self._v, to, mean, dt,
            self._bounds, self._care, out,
        ):  # fmt: skip
            return causal.BRAKED
        if self._rests(to, (to - self._at) / dt, dt, out):
            return causal.BRAKED
        return self._otherwise(before, dt, to, out)

    def _otherwise(self, before: float, dt: float, to: np.ndarray, out: np.ndarray) -> int:
        # Steps have changed in length, so the rows are others than those that were proven. Some
        # other way to slow down that stays farther away, looked for as any step is.
        rest, w, then = to.copy(), (to - self._at) / dt, np.empty_like(to)
        while causal.brake(rest, w, dt, dt, self._bounds, then):
            w, rest[:] = (then - rest) / dt, then
        for want in (rest, self.robot.anchor, self._at.copy()):
            how = causal.advance(
                self._chain, self._swept, self._scratch, self._at, self._v, before, dt,
                self._ends(dt), self._care, want, self._nothing, self._bone, self._memory.W, to,
                out,
            )  # fmt: skip
            if how != causal.HELD:
                return causal.BRAKED
        return self._stand(to, out)

    def _rests(self, here: np.ndarray, v: np.ndarray, dt: float, out: np.ndarray) -> bool:
        """Is the motion proven on which the robot would brake from here, however many rows?"""
        here, then, bound = here.copy(), np.empty_like(here), np.zeros(2)
        if not self._clear(self._at, here, out):
            return False
        for _ in range(_LONG):
            if not causal.brake(here, v, dt, dt, self._bounds, then):
                return True
            if not self._clear(here, then, bound):
                return False
            v, here[:] = (then - here) / dt, then
        return False

    def _clear(self, q0: np.ndarray, q1: np.ndarray, out: np.ndarray) -> bool:
        its = self._chain, self._swept, self._scratch
        return bool(causal.clear(*its, q0, q1, self._care, out))

    def _ends(self, dt: float) -> Bounds:
        """The bounds in which a joint may go on so that it can brake whatever steps come."""
        lower, upper = np.empty_like(self._at), np.empty_like(self._at)
        ends.within_reach(self._at, dt, self._bounds, lower, upper)
        slow = np.maximum(_ROWS * dt * self._bounds.acceleration, np.abs(self._v))
        speed = np.minimum(self._bounds.speed, slow)
        return self._bounds._replace(lower=lower, upper=upper, speed=speed)

    def _as_wanted(
        self,
        wanted: np.ndarray,
        before: float,
        dt: float,
        near: Bounds,
        to: np.ndarray,
        out: np.ndarray,
    ) -> bool:
        """Can the wanted pose be taken as it is?"""
        mean = 0.5 * (before + dt)
        if not causal.within(self._at, self._v, mean, dt, near, wanted):
            return False
        to[:] = wanted
        if not causal.safe(
            self._chain, self._swept, self._scratch, self._at, self._v, to, mean, dt, near,
            self._care, out,
        ):  # fmt: skip
            return False
        self._memory.flag[pursue.MODE] = self._memory.flag[pursue.LEFT] = 0
        return True

    def _pursue(
        self,
        wanted: np.ndarray,
        before: float,
        dt: float,
        near: Bounds,
        starts: np.ndarray,
        to: np.ndarray,
        out: np.ndarray,
    ) -> int:
        return pursue.pursue(
            self._chain, self._swept, self._scratch, self._memory, self._at, self._v, before,
            dt, near, self._careful(), wanted, self._seen(wanted), self._bone, self._W, starts,
            self.robot.anchor, to, out,
        )  # fmt: skip

    def _direct(
        self,
        wanted: np.ndarray,
        rate: np.ndarray,
        before: float,
        dt: float,
        near: Bounds,
        to: np.ndarray,
        out: np.ndarray,
    ) -> int:
        return direct.direct(
            self._chain, self._swept, self._scratch, self._at, self._v, before, dt, near,
            self._careful(), wanted, rate, self._bone, self._W, to, out,
        )  # fmt: skip

    def _blocked(self, wanted: np.ndarray, to: np.ndarray, dt: float) -> bool:
        """Is the robot to look for a way around, as it does not get to where it is wanted?"""
        far, moved = np.abs(to - wanted).max(initial=0.0), np.abs(to - self._at).max(initial=0.0)
        flag = self._memory.flag
        flag[pursue.WAIT] = max(flag[pursue.WAIT] - int(np.ceil(1e3 * dt)), 0)
        if not (far > _FAR and moved < _STILL * dt) or flag[pursue.WAIT] > 0:
            return False
        flag[pursue.WAIT] = _OFTEN
        return True

    def _rate_of(self, wanted: np.ndarray, dt: float) -> np.ndarray:
        """How fast what is wanted moves [rad/s], (n,): the slower of its last two steps.

        Where they differ in sign, or there are no two, it stands: a jump is no speed, nor is noise.
        """
        now, last = (wanted - self._asked) / dt, self._pace
        steady = now * last > 0.0  # False where NaN
        return np.where(steady, np.sign(now) * np.minimum(np.abs(now), np.abs(last)), 0.0)

    def _note(self, wanted: np.ndarray, dt: float) -> None:
        self._pace = (wanted - self._asked) / dt
        self._asked = wanted

    def _careful(self) -> causal.Care:
        """The clearances of a step: some in reserve, but no more than the robot has already."""
        care, reserve = self._care, self.settings.reserve
        if not reserve:
            return care
        most = max(self._clearance - _NEARER, care.margin)
        return care._replace(
            margin=min(care.margin + reserve, most, care.target),
            between=min(care.between + reserve, care.margin),
        )

    def _stand(self, to: np.ndarray, out: np.ndarray) -> int:
        to[:] = self._at
        out[0] = self._clearance
        return causal.HELD

    def _seen(self, wanted: np.ndarray) -> np.ndarray:
        if not self._skeleton:
            return np.empty(0)
        x = np.empty((1, DIM))
        inside = np.clip(wanted, self.most.lower, self.most.upper)
        batch._skeletons(self._chain, inside[None], x)
        return x[0]
