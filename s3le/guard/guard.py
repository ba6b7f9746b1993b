"""The guard in a program: wanted joint positions in, certified ones out, row by row.

    guard = Guard.load("g1")
    guard.start(where_the_robot_stands)
    step = guard.step(wanted, dt)  # step.q, step.v, step.reason, step.certified

A guard is always in one of four states: it follows what is wanted, it is led out of a pose that
cannot be certified, it brakes because it was stopped, or it stands stopped. A stop is latched.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from s3le.errors import ParameterError, StateError
from s3le.guard import given as others
from s3le.guard import out, stored
from s3le.guard.answers import Chunk, Kept, Step
from s3le.guard.given import Given, Told
from s3le.guard.leaving import Leaving
from s3le.guard.reasons import BRAKED, LEADING_OUT, STOPPED, Reasons
from s3le.guard.wanted import Reader, duration, is_lost
from s3le.plan import limits
from s3le.plan.limits import SHORTEST
from s3le.plan.settings import Settings
from s3le.plan.smooth import walker
from s3le.plan.state import LONGEST, State
from s3le.plan.steps import Via, Walker
from s3le.robot.known import MARGIN
from s3le.robot.robot import Robot

TOLERANCE = 0.1  # [rad], by which a measured joint may be away from where it should be
# Of a guard: what is proven is to hold for other steps too.
SETTINGS = Settings(reserve=0.0005, curved=True)


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
        given: Sequence[str] | str | None = None,
        given_speed: float | np.ndarray | None = None,
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
            given: joints that others move, k names, or "all" that the robot has beside ours; None:
                those that the robot file names. Every step is then told of them.
            given_speed: how fast they may move where a step is told nothing else, one or (k,)
                [rad/s]; None: each step has to say.

        Raises:
            RobotError: a given joint is none of the robot's, or is ours.
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
        self._reader = Reader(robot, robot.joint_names, robot.lower, robot.upper)
        self._certifier, body = robot.certifier(), others.of(robot, given)
        self._others = None if body is None else Given(body, self.most, self.settings, given_speed)
        if self._others:
            self._walker: Walker = self._others.walker
        elif given_speed is not None:
            raise ParameterError("given_speed is said, but no joint of the robot is given")
        else:
            self._walker = walker(robot, self.most, self.settings, q=robot.anchor)
        self._curved = self.settings.curved and not self._others
        self._tag = robot.tag + (f" given={','.join(self.given)}" if self._others else "")
        self._walker.warm_up()
        self._reasons = Reasons(robot, self.most, self.settings, self._walker.bodies)
        self._fresh = self._walker.state()
        self._stand(robot.anchor, self._fresh, None)

    @classmethod
    def load(
        cls,
        robot: Path | str,
        *,
        margin: float = MARGIN,
        acceleration: float | np.ndarray | None = None,
        speed_factor: float = 1.0,
        settings: Settings | None = None,
        tolerance: float | np.ndarray = TOLERANCE,
        given: Sequence[str] | str | None = None,
        given_speed: float | np.ndarray | None = None,
    ) -> "Guard":
        """The guard of a robot by name, robot file or folder; it stands at the anchor.

        Args:
            robot, margin: see Robot.load.
            acceleration, speed_factor, settings, tolerance, given, given_speed: see Guard.

        Raises:
            RobotError, TableError: see Robot.load.
            ParameterError: a number is out of its range.
        """
        return cls(
            Robot.load(robot, margin), acceleration=acceleration, speed_factor=speed_factor,
            settings=settings, tolerance=tolerance, given=given, given_speed=given_speed,
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

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the joints that others move."""
        return self._others.names if self._others else ()

    def start(self, q: object = None, given: object = None) -> None:
        """Begin anew, at rest; a latched stop is released.

        Args:
            q: where the robot stands [rad], (n,) or by name; None: at its anchor. A pose that
                cannot be certified is led out of: the rows to come say so. Among given joints they
                are forced until it can.
            given: where the given joints are [rad], (k,) or by name; None: where the robot file
                holds them.

        Raises:
            ParameterError: q or given is no pose of this robot; see wanted.Reader.
            CertificateError: no way leads out of q. Nothing has changed.
        """
        at = self.robot.anchor if q is None else self._reader.pose(q, "the pose of the robot")
        if self._others:
            clearance = self._others.start(at, given)
            self._stand(at, self._fresh._replace(q=at, clearance=clearance), None)
            return
        others.refuse(given)
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

    def rest(self) -> tuple[Via, ...]:
        """The motion to a standstill that is proven from here, kept in case nothing else is.

        Returns:
            Rows (after [s] from now, q [rad], v [rad/s]), the first one now, the last one at rest;
            between two each joint is accelerated evenly. Among given joints, and while the robot
            is led out, there is none: ().
        """
        return () if self._leaving else self._walker.rest()

    def stop(self) -> None:
        """Latch a stop: the rows to come drive the motion of `rest`, and then stand still."""
        self._stopped = True

    def release(self) -> None:
        """Let go of a stop: the next row follows what is wanted again."""
        self._stopped = False

    def step(
        self,
        q_wanted: object,
        dt: float,
        measured: object = None,
        *,
        given: object = None,
        given_next: object = None,
        given_speed: object = None,
    ) -> Step:
        """Where the robot is to be dt later.

        Args:
            q_wanted: [rad], (n,) in the order of robot.joint_names, or a mapping from their names;
                it need not be feasible. None: the robot brakes. While a stop is latched it is not
                looked at.
            dt: time since the row before [s]; above a second it counts as one.
            measured: where the robot is by its own sensors, as q_wanted; None: not known. It must
                be within the tolerance of the path that the last row led along, and is used for
                nothing else: what is certified are the rows themselves.
            given: where the given joints are [rad], (k,) or by name; None: where they were said to
                be by now.
            given_next: where they will be dt later; they move there straight.
            given_speed: instead of that, how fast they may move, in any way, one or (k,) [rad/s];
                then `given` is asked for. What is proven holds for all that they may do.

        Raises:
            ParameterError: q_wanted, dt, measured or what is said of given joints is of the wrong
                shape or kind, or not finite. Nothing has changed, except that a measured pose that
                is not finite latches a stop.
            StateError: the measured pose is too far from where it should be. A stop is latched; the
                next row brakes.
        """
        dt = duration(dt, SHORTEST)
        wanted, told, note = None, None, ""
        if q_wanted is not None and not self._stopped:
            wanted = self._reader.pose(q_wanted)
        if self._others:
            told = self._others.told(given, given_next, given_speed, dt)
        else:
            others.refuse(given, given_next, given_speed)
        if measured is not None:
            self._compare(measured)
        if self._others and told:
            note = self._others.broken(told)
        return self._row(wanted, min(dt, LONGEST), told)._replace(given=note)

    def chunk(
        self,
        q: object,
        dt: float | Sequence[float] | np.ndarray,
        measured: object = None,
        advance: bool | int = False,
        *,
        given: object = None,
        given_next: object = None,
        given_speed: object = None,
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
        every = [dt] * h if np.ndim(dt) == 0 else list(np.asarray(dt))
        each = [duration(one, SHORTEST) for one in every]
        if not isinstance(advance, (bool, int, np.integer)) or not 0 <= advance <= h:
            raise ParameterError(f"advance must be true, false or 0 to {h} rows, got {advance!r}")
        driven = h if advance is True else int(advance)
        told: Sequence[Told | None] = [None] * h
        if self._others:
            told = self._others.chunk(given, given_next, given_speed, each)
        else:
            others.refuse(given, given_next, given_speed)
        if measured is not None:
            self._compare(measured)
        kept, made = self._keep(), []
        for row, one, said in zip(rows, each, told, strict=True):
            if self._others and said:
                self._others.broken(said)  # from here on it is this that they have to keep
            made.append(self._row(None if self._stopped else row, min(one, LONGEST), said))
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
            via=tuple(one.via for one in made),
        )

    def _compare(self, measured: object) -> None:
        try:
            at = self._reader.pose(measured, "the measured pose")
        except ParameterError:
            if is_lost(measured):
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

    def _row(self, wanted: np.ndarray | None, dt: float, told: Told | None) -> Step:
        if self._leaving is not None:
            return self._lead(self._leaving, dt)
        before = dt if np.isnan(self._before) else self._before
        if self._others and told:
            self._others.walker.others(*told)
        made = self._walker.step(wanted, dt)
        v = self._walker.v
        if self._others and (why := self._others.reason(made)):
            reason = why
            made = made._replace(certified=made.certified and not self._others.walker.apart)
        elif wanted is None:
            reason = BRAKED if v.any() else STOPPED
        elif self._curved:  # control points move as rows of a straight motion do
            at, to = self._q + 0.5 * dt * self._v, made.q + 0.5 * dt * v
            reason = self._reasons.of(made.how, at, self._v, dt, dt, wanted, to)
        else:
            reason = self._reasons.of(made.how, self._q, self._v, before, dt, wanted, made.q)
        self._came, self._q, self._v, self._before = self._q, made.q, v, dt
        return Step(
            made.q.copy(), v.copy(), reason, made.certified, made.clearance, made.bound,
            via=made.via,
        )  # fmt: skip

    def _lead(self, leaving: Leaving, dt: float) -> Step:
        before = dt if np.isnan(self._before) else self._before
        q = leaving.step(0.5 * (before + dt), dt, self._stopped)
        v = (q - self._q) / dt
        clearance = float(self._certifier.one(q)[0])
        self._came, self._q, self._v, self._before = self._q, q, v, dt
        if leaving.done:
            self._leaving = None
            if self._curved:  # the way out, which is not certified, ends at rest
                v = self._v = np.zeros_like(v)
            self._walker.put(
                self._fresh._replace(q=q, v=v, before=dt, clearance=clearance, even=False)
            )  # fmt: skip
        reason = LEADING_OUT
        if self._stopped:
            reason = BRAKED if v.any() else STOPPED
        self._led_out += 1
        return Step(q.copy(), v.copy(), reason, False, clearance, np.nan)

    def _keep(self) -> Kept:
        lead = self._leaving
        leaving = None if lead is None else (lead.way, lead.leg, lead.share, lead.rate)
        return Kept(
            self._walker.state(), leaving, self._q, self._v, self._came, self._before,
            self._led_out, self._stopped, None if self._others is None else self._others.keep(),
        )  # fmt: skip

    def _return(self, kept: Kept) -> None:
        self._walker.put(kept.walker)
        if self._others and kept.others:
            self._others.put(*kept.others)
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
            "robot": self._tag, "q": kept.q, "v": kept.v, "came": kept.came,
            "before": kept.before, "even": walker.even, "asked": walker.asked,
            "pace": walker.pace, "flag": walker.flag,
            "around": walker.way, "out": way, "leg": leg, "share": share, "rate": rate,
            "led_out": kept.led_out, "stopped": kept.stopped,
        } | ({} if kept.others is None else {"given": kept.others[0]})  # fmt: skip
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
        number = stored.checked(state, self.state(), self._tag)
        q, v, before = number["q"], number["v"], float(number["before"])
        way, leg = number["out"], int(number["leg"])
        share, rate, led_out = (float(number[name]) for name in ("share", "rate", "led_out"))
        if len(way) == 0:
            walker = State(
                q, v, before, np.nan, bool(number["even"]), number["asked"], number["pace"],
                number["flag"], number["around"],
            )  # fmt: skip
            if self._others:
                self._others.put(number["given"])
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
        assert self._q.shape == (self.robot.n_dof,)
