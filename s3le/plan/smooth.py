"""Streams whose speed is continuous, and which always carry a proven motion to a standstill.

    walker = Smooth(robot, limits(robot), Settings(curved=True), q=where_the_robot_is)
    step = walker.step(wanted, dt)      # step.q at speed walker.v, a parabola from the last row

A step is made only if it is proven, and if from its end a motion is proven on which each joint
brakes within its acceleration, whose rows keep the margin and which ends within limits. That motion
is kept until another is proven: where no step can be, it is driven. So whatever comes, the robot
has a way to rest that has been proven.
"""

import numpy as np

from s3le.kernels.solver import clearance_of
from s3le.plan import causal
from s3le.plan.state import State
from s3le.plan.steps import Via, Walker
from s3le.safety import curve
from s3le.safety.curve import EPS
from s3le.safety.rest import rests

_SAME = 1e-12  # [s], two moments of a stop that differ by no more are one


class Smooth(Walker):
    """One robot in motion whose rows are (q, v); see Walker."""

    _path: np.ndarray  # (curve.ROWS, n), the motion on which it would brake
    _lasts: float = 0.0  # [s], how long it takes; 0: the robot rests
    _gone: float = 0.0  # [s], how much of it has been driven
    _driven: tuple[np.ndarray, np.ndarray, tuple[Via, ...]] | None = None  # instead of a step

    def _begin(self, before: float, dt: float) -> float:
        self._at, self._driven = self._q + 0.5 * dt * self._v, None
        return dt

    def _aim(self, wanted: np.ndarray, dt: float) -> np.ndarray:
        # Control points are half a step ahead of rows.
        return wanted + 0.5 * dt * self._rate_of(wanted, dt)

    def _measured(self, to: np.ndarray) -> bool:
        return super()._measured(0.5 * (self._at + to))

    def _brake(self, before: float, dt: float, to: np.ndarray, out: np.ndarray) -> int:
        causal.brake(self._at, self._v, dt, dt, self._bounds, to)
        if causal.safe(
            self._chain, self._swept, self._scratch, self._at, self._v, to, dt, dt,
            self._bounds, self._care, out,
        ):  # fmt: skip
            return causal.BRAKED
        return self._stand(to, out)

    def _settled(
        self, how: int, before: float, dt: float, to: np.ndarray, out: np.ndarray
    ) -> tuple[int, bool]:
        if how != causal.HELD and self._holds(to, dt, dt):
            return how, True
        if how not in (causal.BRAKED, causal.HELD):  # the engines disagree
            how = self._brake(dt, dt, to, out)
            if how != causal.HELD and self._holds(to, dt, dt):
                return how, True
        if not self._v.any():  # it rests, where it has been proven to be
            self._stand(to, out)
            return causal.HELD, True
        self._driven = self._along(dt)
        out[0] = self._care.between
        # A row off the grid of what was proven may keep less than the margin; then it says so.
        end = self._driven[0]
        self._clearance = float(clearance_of(self._chain, self._swept.balls, end))
        good = self._clearance >= self.robot.margin and super()._measured(end)
        return causal.BRAKED, good

    def _along(self, dt: float) -> tuple[np.ndarray, np.ndarray, tuple[Via, ...]]:
        """Drive the motion on which it brakes for dt more: where it ends, and rows on the way."""
        *way, (_, q, v) = self._rows(self._gone, self._gone + dt)
        return q, v, tuple(way)

    def _rows(self, begin: float, end: float) -> list[Via]:
        """Rows of that motion: where a joint turns to another acceleration, and the end."""
        turns = np.unique(self._path[[curve.ONE, curve.TWO]]) * self._lasts
        turns = turns[np.diff(turns, prepend=-1.0) > _SAME]
        inner = turns[(turns > begin + _SAME) & (turns < end - _SAME)]
        return [Via(float(t - begin), *self._moment(t)) for t in (*inner, end)]

    def _moment(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        q, v = np.empty_like(self._q), np.zeros_like(self._q)
        share = min(t / self._lasts, 1.0)
        curve.position(self._path, share, q)
        if share < 1.0:
            curve.speed(self._path, share, v)
        return np.clip(q, self.most.lower, self.most.upper), v / self._lasts

    def _end(self, to: np.ndarray, dt: float) -> tuple[Via, ...]:
        if self._driven is not None:
            self._q[:], self._v[:], via = self._driven
            self._gone += dt
            return via
        w = (to - self._at) / dt
        self._q[:] = np.clip(0.5 * (self._at + to), self.most.lower, self.most.upper)
        self._v[:] = np.where(to == self._at, 0.0, w)
        self._keep(dt)
        return ()

    def _keep(self, dt: float) -> None:
        """Keep the motion on which it brakes from here; it has been proven."""
        hardest = self._bounds.acceleration * (1.0 - EPS)
        self._path = np.empty((curve.ROWS, len(self._q)))
        self._lasts = float(curve.stop(self._q, self._v, hardest, dt, self._path))
        self._gone = 0.0

    def rest(self) -> tuple[Via, ...]:
        """The proven motion to a standstill: rows from now on, a parabola between two."""
        here = Via(0.0, self.q, self.v)
        if not self._gone < self._lasts:
            return (here,)
        return here, *self._rows(self._gone, self._lasts)

    def state(self) -> State:
        """Where the robot is and what it is about; a copy."""
        stop = (self._path.copy(), self._lasts, self._gone) if self._lasts > 0.0 else None
        return super().state()._replace(stop=stop)

    def put(self, state: State) -> None:
        """Go back to a state of this very walker; it is not looked at again."""
        super().put(state)
        if state.stop is None:
            self._lasts = self._gone = 0.0
        else:
            self._path, self._lasts, self._gone = state.stop

    def restore(self, state: State) -> None:
        """Go on from a state of a walker of the same robot, limits and settings; as Walker's."""
        super().restore(state)
        if self._v.any():
            self._keep(self._before)

    def _may_brake(self, state: State) -> bool:
        path, care = np.empty((curve.ROWS, len(self._q))), self._care
        return rests(
            self._chain, self._swept, self._scratch, state.q, state.v, self._bounds.acceleration,
            state.before, care.margin, care.between, care.budget, path,
        )[0]  # fmt: skip

    def warm_up(self) -> None:
        """Compile what a step needs, or read it from the store, so that no step waits for it."""
        kept = self.state()
        for wanted in (self.robot.anchor, self.most.upper + 1.0, self.most.upper + 1.0, None):
            self.step(wanted, 0.02)
        if self._lasts > 0.0:
            self._along(0.02)
        self.put(kept)


def walker(robot, most, settings, **how) -> Walker:
    """A walker whose speed is continuous, if the settings say so; arguments of Walker."""
    return (Smooth if settings.curved else Walker)(robot, most, settings, **how)
