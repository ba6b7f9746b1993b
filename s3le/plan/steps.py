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
from s3le.plan import causal, limits, pursue, weights
from s3le.plan.limits import SHORTEST, Limits
from s3le.plan.settings import Settings, bounds
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.swept import swept
from s3le.skeleton import DIM

SLOWEST = "pursue.pursue"  # of the kernels that a step needs, to compile
LONGEST = 1.0  # [s], a robot that was left alone for longer moves as if it had been this
HOW = {
    causal.WANTED: "wanted",
    causal.LIMITED: "limited",
    causal.SHORTENED: "shortened",
    causal.BRAKED: "braked",
    causal.HELD: "held",
    pursue.AROUND: "around",
}


class Step(NamedTuple):
    """One answer."""

    q: np.ndarray  # [rad], (n,), where to be when the step is over
    how: str  # how it came about, one of HOW
    clearance: float  # [m], of the pose
    bound: float  # [m], proven clearance of the path that leads there
    certified: bool  # within all limits and proven; False only where it had to stand still at once


class Walker:
    """One robot in motion, from rest; holds scratch, so one per thread."""

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
        self._bounds, self._swept = bounds(self.most), swept(robot.chain)
        self._scratch, self._certifier = segment.scratch(robot.chain), robot.certifier()
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
        self._none = np.zeros((0, n))
        self._q = _pose(q, n, "the pose of the robot")
        report = self._certifier.require(self._q[None], robot.margin)
        self._clearance = float(report.clearance[0])
        self._v, self._before = np.zeros(n), np.nan

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
            wanted = _pose(wanted, n, "a wanted pose")
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
        chain = self.robot.chain
        if wanted is None:
            how = self._brake(before, dt, to, out)
        else:
            how = pursue.pursue(
                chain, self._swept, self._scratch, self._memory, self._q, self._v, before, dt,
                self._bounds, self._care, wanted, self._seen(wanted), self._bone, self._W, starts,
                self.robot.anchor, to, out,
            )  # fmt: skip
        if how != causal.HELD and not self._measured(to):
            # The two engines disagree: then it is no, and what was proven before is driven.
            how = self._brake(before, dt, to, out)
            if how != causal.HELD and not self._measured(to):
                how = self._stand(to, out)
        certified = how != causal.HELD or not self._v.any()
        self._v[:] = (to - self._q) / dt
        self._q[:] = to
        self._before = dt
        return Step(self.q, HOW[how], self._clearance, float(out[0]), certified)

    def _measured(self, to: np.ndarray) -> bool:
        """Does a pose hold by the independent check, if it is asked? Notes its clearance."""
        if not self.settings.check:
            self._clearance = float(clearance_of(self.robot.chain, self._swept.balls, to))
            return True
        measured, room = self._certifier.one(to)
        if not (measured >= self.robot.margin and room >= 0.0):  # catches NaN
            return False
        self._clearance = measured
        return True

    def _brake(self, before: float, dt: float, to: np.ndarray, out: np.ndarray) -> int:
        mean = 0.5 * (before + dt)
        causal.brake(self._q, self._v, mean, dt, self._bounds, to)
        if causal.safe(
            self.robot.chain, self._swept, self._scratch, self._q, to, dt, self._bounds,
            self._care, out,
        ):  # fmt: skip
            return causal.BRAKED
        return self._stand(to, out)

    def _stand(self, to: np.ndarray, out: np.ndarray) -> int:
        to[:] = self._q
        out[0] = self._clearance
        return causal.HELD

    def _seen(self, wanted: np.ndarray) -> np.ndarray:
        if not self._skeleton:
            return np.empty(0)
        x = np.empty((1, DIM))
        inside = np.clip(wanted, self.most.lower, self.most.upper)
        batch._skeletons(self.robot.chain, inside[None], x)
        return x[0]


def _pose(q: np.ndarray, n: int, what: str) -> np.ndarray:
    try:
        q = np.array(q, float)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{what} must hold numbers") from None
    if q.shape != (n,):
        raise ParameterError(f"{what} must have shape ({n},), got {q.shape}")
    if not np.isfinite(q).all():
        joint = int(np.argmin(np.isfinite(q)))
        raise ParameterError(f"{what} is not finite at joint {joint} ({q[joint]!r})")
    return q


def walk(walker: Walker, times: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Follow wanted poses from where the walker is, which is row 0; for tests and benchmarks.

    Args:
        walker: at rest.
        times: [s], (m,), rising.
        wanted: [rad], (m, n).

    Returns:
        (q (m, n) [rad], how each came about; "start" for row 0).

    Raises:
        CertificateError: a step had to stand still at once, and that was not allowed.
    """
    times, wanted = limits.motion(times, wanted, len(walker.q))
    q, how = [walker.q], ["start"]
    for row in range(1, len(times)):
        step = walker.step(wanted[row], times[row] - times[row - 1])
        if not step.certified:
            raise CertificateError(f"row {row}: the robot could not brake within its limits")
        q.append(step.q)
        how.append(step.how)
    return np.array(q), how
