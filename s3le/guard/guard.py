"""The guard in a program: wanted joint positions in, certified ones out, row by row.

    guard = Guard.load("g1")
    guard.start(where_the_robot_stands)
    step = guard.step(wanted, dt)  # step.q, step.v, step.reason, step.certified

A guard is always in one of four states: it follows what is wanted, it is led out of a pose that
cannot be certified, it brakes because it was stopped, or it stands stopped. A stop is latched.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError, StateError
from s3le.guard import out
from s3le.guard.leaving import Leaving
from s3le.guard.reasons import BRAKED, LEADING_OUT, STOPPED, Reasons
from s3le.guard.wanted import Reader, duration
from s3le.plan import limits
from s3le.plan.limits import SHORTEST
from s3le.plan.settings import Settings
from s3le.plan.state import LONGEST, State
from s3le.plan.steps import Walker
from s3le.robot.known import MARGIN
from s3le.robot.robot import Robot

TOLERANCE = 0.1  # [rad], by which a measured joint may be away from where it should be
_MAY_BE_NAN = ("before", "asked", "pace")  # entries of a state: there was none yet
SETTINGS = Settings(reserve=0.0005)  # of a guard: what is proven is to hold for other steps too


class Step(NamedTuple):
    """One row."""

    q: np.ndarray  # [rad], (n,), where to be when the step is over
    v: np.ndarray  # [rad/s], (n,), the speed of the step
    reason: str  # why it is not what was wanted, see reasons
    certified: bool  # within all limits, and proven
    clearance: float  # [m], of the pose, measured by coal
    bound: float  # [m], proven clearance of the path that leads there; NaN: none is proven


class Chunk(NamedTuple):
    """Rows of a chunk, h of them."""

    q: np.ndarray  # [rad], (h, n)
    v: np.ndarray  # [rad/s], (h, n)
    reason: tuple[str, ...]
    certified: np.ndarray  # bool (h,)
    clearance: np.ndarray  # [m], (h,)
    bound: np.ndarray  # [m], (h,)


class _Kept(NamedTuple):
    """All that changes from row to row."""

    walker: State
    leaving: tuple[np.ndarray, int, float, float] | None  # way, leg, share, rate
    q: np.ndarray
    v: np.ndarray
    came: np.ndarray
    before: float
    led_out: int
    stopped: bool


class Guard:
    """One robot in motion; of one thread."""

    def __init__(
        self,
        robot: Robot,
        *,
        acceleration: float | np.ndarray | None = None,
        speed_factor: float = 1.0,
        settings: Settings | None = None,
        tolerance: float | np.ndarray = TOLERANCE,
    ) -> None:
        """Put the robot at its anchor; compiles kernels the first time on a machine.

        Args:
            robot: whose guard it is.
            acceleration: limit for all joints, or one each (n,) [rad/s^2]; None: the robot file's,
                60 where it says nothing.
            speed_factor: share of the joints' speeds that is used, in (0, 1].
            settings: of planning; None: SETTINGS.
            tolerance: how far a measured joint may be from where it should be, for all joints or
                one each (n,) [rad].

        Raises:
            ParameterError: a number is out of its range.
        """
        self.robot, n = robot, robot.n_dof
        self.most = limits.limits(robot, acceleration, speed_factor)
        self.settings = settings or SETTINGS
        try:
            self.tolerance = np.broadcast_to(np.asarray(tolerance, float), (n,)).copy()
        except (TypeError, ValueError):
            raise ParameterError(f"tolerance must be a number or {n} numbers [rad]") from None
        if not (self.tolerance > 0.0).all():  # catches NaN
            raise ParameterError(f"tolerance must be above 0 rad, got {tolerance!r}")
        self._reader, self._certifier = Reader(robot), robot.certifier()
        self._walker = Walker(robot, self.most, self.settings, q=robot.anchor)
        self._walker.warm_up()
        self._reasons = Reasons(robot, self.most, self.settings)
        self._fresh = self._walker.state()
        self._stand(robot.anchor, self._fresh, None)

    @classmethod
    def load(
        cls,
        given: Path | str,
        *,
        margin: float = MARGIN,
        acceleration: float | np.ndarray | None = None,
        speed_factor: float = 1.0,
        settings: Settings | None = None,
        tolerance: float | np.ndarray = TOLERANCE,
    ) -> "Guard":
        """The guard of a robot by name, robot file or folder; it stands at the anchor.

        Args:
            given, margin: see Robot.load.
            acceleration, speed_factor, settings, tolerance: see Guard.

        Raises:
            RobotError, TableError: see Robot.load.
            ParameterError: a number is out of its range.
        """
        return cls(
            Robot.load(given, margin), acceleration=acceleration, speed_factor=speed_factor,
            settings=settings, tolerance=tolerance,
        )  # fmt: skip

    @property
    def q(self) -> np.ndarray:
        """Where the robot should be [rad], (n,): the last row."""
        return self._q.copy()

    @property
    def v(self) -> np.ndarray:
        """The speed of the last row [rad/s], (n,)."""
        return self._v.copy()

    @property
    def led_out(self) -> int:
        """Rows since the start that led out of where nothing could be certified."""
        return self._led_out

    @property
    def leading_out(self) -> bool:
        """Whether the robot has still to be led out."""
        return self._leaving is not None

    @property
    def stopped(self) -> bool:
        """Whether a stop is latched."""
        return self._stopped

    def start(self, q: object = None) -> None:
        """Begin anew, at rest; a latched stop is released.

        Args:
            q: where the robot stands [rad], (n,) or by name; None: at its anchor. A pose that
                cannot be certified is led out of: the rows to come say so.

        Raises:
            ParameterError: q is no pose of this robot; see wanted.Reader.
            CertificateError: no way leads out of q. Nothing has changed.
        """
        at = self.robot.anchor if q is None else self._reader.pose(q, "the pose of the robot")
        clearance, room = self._certifier.one(at)
        if clearance >= self.robot.margin and room >= 0.0:
            fresh = self._fresh._replace(q=at, clearance=clearance)
            self._stand(at, fresh, None)
            return
        need = out.Need(self.robot.margin, self.settings.target, self.settings.between)
        way = out.find(self.robot, at, need)
        self._stand(at, self._fresh, self._led(way))

    def _led(self, way: np.ndarray) -> Leaving:
        return Leaving(way, self.most.speed, self.most.acceleration)

    def _stand(self, q: np.ndarray, fresh: State, leaving: Leaving | None) -> None:
        self._walker.put(fresh)
        self._leaving, self._stopped, self._led_out = leaving, False, 0
        self._q, self._v, self._came, self._before = q, np.zeros_like(q), q, np.nan

    def stop(self) -> None:
        """Latch a stop: the rows to come brake, along what was proven, and then stand still."""
        self._stopped = True

    def release(self) -> None:
        """Let go of a stop: the next row follows what is wanted again."""
        self._stopped = False

    def step(self, q_wanted: object, dt: float, measured: object = None) -> Step:
        """Where the robot is to be dt later.

        Args:
            q_wanted: [rad], (n,) in the order of robot.joint_names, or a mapping from their names;
                it need not be feasible. None: the robot brakes. While a stop is latched it is not
                looked at.
            dt: time since the row before [s]; above a second it counts as one.
            measured: where the robot is by its own sensors, as q_wanted; None: not known. It must
                be within the tolerance of the path that the last row led along, and is used for
                nothing else: what is certified are the rows themselves.

        Raises:
            ParameterError: q_wanted, dt or measured is of the wrong shape or kind, or not finite.
                Nothing has changed, except that a measured pose that is not finite latches a stop.
            StateError: the measured pose is too far from where it should be. A stop is latched; the
                next row brakes.
        """
        dt = min(duration(dt, SHORTEST), LONGEST)
        wanted = None
        if q_wanted is not None and not self._stopped:
            wanted = self._reader.pose(q_wanted)
        if measured is not None:
            self._compare(measured)
        return self._row(wanted, dt)

    def chunk(
        self,
        q: object,
        dt: float | Sequence[float] | np.ndarray,
        measured: object = None,
        advance: bool | int = False,
    ) -> Chunk:
        """Several rows from where the robot is, as so many calls of step would give them.

        Args:
            q: wanted poses [rad], (h, n), or by name, see wanted.Reader.rows.
            dt: time from row to row [s], one or (h,).
            measured: see step.
            advance: False: nothing moves, however often it is asked. True: all rows are driven; k:
                the first k are.

        Raises:
            ParameterError, StateError: see step; names the row. Nothing has changed but for a stop.
        """
        rows = self._reader.rows(q)
        h = len(rows)
        if np.ndim(dt) not in (0, 1) or (np.ndim(dt) == 1 and np.shape(dt) != (h,)):
            raise ParameterError(f"dt must be one number or {h} [s], got {np.shape(dt)}")
        given = [dt] * h if np.ndim(dt) == 0 else list(np.asarray(dt))
        each = [min(duration(one, SHORTEST), LONGEST) for one in given]
        if not isinstance(advance, (bool, int, np.integer)) or not 0 <= advance <= h:
            raise ParameterError(f"advance must be true, false or 0 to {h} rows, got {advance!r}")
        driven = h if advance is True else int(advance)
        if measured is not None:
            self._compare(measured)
        kept, made = self._keep(), []
        for row, one in zip(rows, each, strict=True):
            made.append(self._row(None if self._stopped else row, one))
            if len(made) == driven:
                kept = self._keep()
        self._return(kept)
        return Chunk(
            q=np.array([one.q for one in made]),
            v=np.array([one.v for one in made]),
            reason=tuple(one.reason for one in made),
            certified=np.array([one.certified for one in made]),
            clearance=np.array([one.clearance for one in made]),
            bound=np.array([one.bound for one in made]),
        )

    def _compare(self, measured: object) -> None:
        try:
            at = self._reader.pose(measured, "the measured pose")
        except ParameterError:
            if _is_lost(measured):
                self._stopped = True
            raise
        off = np.maximum(np.minimum(self._came, self._q) - at, at - np.maximum(self._came, self._q))
        far = off - self.tolerance
        if far.max() > 0.0:
            self._stopped = True
            joint = int(far.argmax())
            raise StateError(
                f"{self.robot.joint_names[joint]} is measured at {at[joint]:.4f} rad, "
                f"{off[joint]:.4f} rad from where it should be ({self._q[joint]:.4f} rad); "
                f"{self.tolerance[joint]:g} rad are allowed. The stop is latched: "
                "step on to brake, then start from where the robot is"
            )

    def _row(self, wanted: np.ndarray | None, dt: float) -> Step:
        if self._leaving is not None:
            return self._lead(self._leaving, dt)
        before = dt if np.isnan(self._before) else self._before
        made = self._walker.step(wanted, dt)
        v = self._walker.v
        if wanted is None:
            reason = BRAKED if v.any() else STOPPED
        else:
            reason = self._reasons.of(made.how, self._q, self._v, before, dt, wanted, made.q)
        self._came, self._q, self._v, self._before = self._q, made.q, v, dt
        return Step(made.q.copy(), v.copy(), reason, made.certified, made.clearance, made.bound)

    def _lead(self, leaving: Leaving, dt: float) -> Step:
        before = dt if np.isnan(self._before) else self._before
        q = leaving.step(0.5 * (before + dt), dt, self._stopped)
        v = (q - self._q) / dt
        clearance = float(self._certifier.one(q)[0])
        self._came, self._q, self._v, self._before = self._q, q, v, dt
        if leaving.done:
            self._leaving = None
            self._walker.put(
                self._fresh._replace(q=q, v=v, before=dt, clearance=clearance, even=False)
            )  # fmt: skip
        reason = LEADING_OUT
        if self._stopped:
            reason = BRAKED if v.any() else STOPPED
        self._led_out += 1
        return Step(q.copy(), v.copy(), reason, False, clearance, np.nan)

    def _keep(self) -> _Kept:
        lead = self._leaving
        leaving = None if lead is None else (lead.way, lead.leg, lead.share, lead.rate)
        return _Kept(
            self._walker.state(), leaving, self._q, self._v, self._came, self._before,
            self._led_out, self._stopped,
        )  # fmt: skip

    def _return(self, kept: _Kept) -> None:
        self._walker.put(kept.walker)
        self._leaving = None
        if kept.leaving is not None:
            way, leg, share, rate = kept.leaving
            self._leaving = self._led(way)
            self._leaving.leg, self._leaving.share, self._leaving.rate = leg, share, rate
        self._q, self._v, self._came, self._before = kept.q, kept.v, kept.came, kept.before
        self._led_out, self._stopped = kept.led_out, kept.stopped

    def state(self) -> dict[str, np.ndarray]:
        """Where the robot is and what it is about: plain arrays by name, as np.savez takes them."""
        kept, walker = self._keep(), self._walker.state()
        way, leg, share, rate = kept.leaving or (np.zeros((0, self.robot.n_dof)), 0, 0.0, 0.0)
        found = {
            "robot": self.robot.tag, "q": kept.q, "v": kept.v, "came": kept.came,
            "before": kept.before, "even": walker.even, "asked": walker.asked,
            "pace": walker.pace, "flag": walker.flag,
            "around": walker.way, "out": way, "leg": leg, "share": share, "rate": rate,
            "led_out": kept.led_out, "stopped": kept.stopped,
        }  # fmt: skip
        return {name: np.array(value) for name, value in found.items()}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a state of a guard of the same robot, limits and settings.

        Raises:
            StateError: something is missing or of another kind, or it is another robot's.
            CertificateError: the pose is not certified, or it is not proven that the robot can
                brake from there. Nothing has changed.
        """
        kept = self._keep()
        try:
            self._restore(state)
        except BaseException:
            self._return(kept)
            raise

    def _restore(self, state: Mapping[str, np.ndarray]) -> None:
        n = self.robot.n_dof
        own = self.state()
        for name, like in own.items():
            if name not in state:
                raise StateError(f"a state lacks '{name}'")
            given = np.asarray(state[name])
            shaped = given.shape[1:] if name == "out" else given.shape
            if given.dtype.kind != like.dtype.kind or shaped != (
                like.shape[1:] if name == "out" else like.shape
            ):
                raise StateError(f"a state's '{name}' is of another kind or shape")
            if given.dtype.kind == "f" and name not in _MAY_BE_NAN and not np.isfinite(given).all():
                raise StateError(f"a state's '{name}' is not finite")
        if str(state["robot"]) != self.robot.tag:
            raise StateError(f"the state is of {state['robot']!s:.100}, not of {self.robot.tag}")
        number = {name: np.array(state[name]) for name in own if name != "robot"}
        q, v, before = number["q"], number["v"], float(number["before"])
        way, leg = number["out"], int(number["leg"])
        share, rate, led_out = (float(number[name]) for name in ("share", "rate", "led_out"))
        if len(way) == 0:
            walker = State(
                q, v, before, np.nan, bool(number["even"]), number["asked"], number["pace"],
                number["flag"], number["around"],
            )  # fmt: skip
            self._walker.restore(walker)
            self._leaving = None
        else:
            need = out.Need(self.robot.margin, self.settings.target, self.settings.between)
            if not (0 <= leg < len(way) - 1 and 0.0 <= share <= 1.0 and rate >= 0.0) or not (
                out.leads(self.robot, way, need)
            ):
                raise StateError("a state's way out does not lead out")
            self._leaving = self._led(way)
            self._leaving.leg, self._leaving.share, self._leaving.rate = leg, share, rate
            if np.abs(self._leaving.here() - q).max() > 1e-9:
                raise StateError("a state's pose is not on its way out")
            self._walker.put(self._fresh)
        self._q, self._v, self._came, self._before = q, v, number["came"], before
        self._led_out, self._stopped = int(led_out), bool(number["stopped"])
        assert self._q.shape == (n,)


def _is_lost(measured: object) -> bool:
    """Whether a measured pose holds what is not finite: nobody knows where the robot is."""
    values = list(measured.values()) if isinstance(measured, Mapping) else measured
    try:
        return not np.isfinite(np.asarray(values, float)).all()
    except (TypeError, ValueError):
        return False
