"""Human motion to certified robot motion, frame by frame: propose, refine, and go there.

A stream of skeletons x (seven unit vectors) becomes a stream of poses q. For each skeleton the
feasible pose nearest to it is found (s3le/retarget/refine.py), and the robot makes the certified
step that leads nearest to that pose (s3le/plan/steps.py). There is no input for which an unproven
pose or step comes out: where nothing else can be proven, the robot brakes along what was proven
with the step before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.guard.given import Given, of, refuse
from s3le.kernels import batch
from s3le.kernels.poses import cost_of
from s3le.plan import steps
from s3le.plan.flow import planner
from s3le.plan.smooth import walker
from s3le.plan.steps import SHORTEST, Via, Walker
from s3le.plan.whole import Planner
from s3le.retarget import exported
from s3le.retarget.ahead import AS_WANTED, planned
from s3le.retarget.frames import Calm, seen
from s3le.retarget.propose import Proposer
from s3le.retarget.refine import LOOKUP, NOTHING, refine
from s3le.retarget.rows import Mode, Rows
from s3le.retarget.settings import Settings
from s3le.robot.chain import Chain
from s3le.robot.robot import Robot
from s3le.safety.swept import Swept, swept
from s3le.types import Progress

_HOW = {
    "limited": Mode.LIMITED,
    "shortened": Mode.SHORTENED,
    "around": Mode.DETOUR,
    "braked": Mode.BRAKED,
    "held": Mode.HELD,
    "gave way": Mode.GAVE_WAY,
}
_THERE = 0.01  # mean cosine distance lost, below which a robot has come to where the human is


class Step(NamedTuple):
    """One answer."""

    q: np.ndarray  # [rad], (n_dof,), where to be when the step is over
    mode: Mode  # how it was obtained
    clearance: float  # [m], of the pose
    bound: float  # [m], proven of the path that leads to it
    distance: float  # mean cosine distance to the human as wanted; NaN: no human yet
    wanted: float  # the same of the pose that would have been the answer without the guard
    given: str = ""  # what others did otherwise than was said of the step before; empty: nothing
    v: np.ndarray | None = None  # [rad/s], (n_dof,), at q; None: straight, among given joints
    via: tuple[Via, ...] = ()  # rows within the step, see plan.steps.Step


class Stream:
    """One robot in motion; of one thread."""

    def __init__(
        self,
        retargeter: "Retargeter",
        q: np.ndarray | None,
        check: bool,
        others: Given | None = None,
    ) -> None:
        """Use Retargeter.start."""
        self._its, self._check, self._others = retargeter, check, others
        self.reset(q)

    def reset(self, q: np.ndarray | None = None, given: object = None) -> None:
        """Forget everything and start anew, as Retargeter.start does.

        Args:
            q: see there.
            given: where the given joints are [rad]; None: where the robot file holds them.
        """
        its = self._its
        self._want, self._found = np.zeros(its.robot.n_dof), np.zeros(3)
        self._calm, self._leading = Calm(its.settings), q is not None
        self._x: np.ndarray | None = None  # the skeleton last wanted
        self._word = ""  # what others did otherwise than they said
        self._walker: Walker | None = None
        if q is not None:
            self._want = _pose(q, its.robot.n_dof)
            if self._others:
                self._others.start(self._want, given)
                self._walker = self._others.walker
            else:
                self._walker = its.walker(self._want, self._check)

    @property
    def q(self) -> np.ndarray | None:
        """Where the robot is [rad], (n_dof,); None before the first pose."""
        return self._walker.q if self._walker else None

    @property
    def v(self) -> np.ndarray:
        """How fast it is there [rad/s], (n_dof,); at rest before the first pose."""
        return self._walker.v if self._walker else np.zeros(self._its.robot.n_dof)

    def rest(self) -> tuple[Via, ...]:
        """The motion to a standstill that is proven from where the robot is; see Guard.rest."""
        return self._walker.rest() if self._walker else ()

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the joints that others move."""
        return self._others.names if self._others else ()

    @property
    def wanted(self) -> np.ndarray:
        """The pose wanted for the last frame, whatever limits in time [rad], (n_dof,)."""
        return self._want.copy()

    def step(
        self,
        x: np.ndarray | None,
        dt: float,
        *,
        given: object = None,
        given_next: object = None,
        given_speed: object = None,
    ) -> Step:
        """Take one frame and say where the robot is to be dt later.

        Args:
            x: the human's seven vectors, (21,) or (7, 3), of any length; None, values that are
                not finite, or a vector without length: the frame is dropped, and the robot goes
                on towards the one before it.
            dt: time since the frame before [s]. Where it is not finite or below 1e-6 s no time
                has passed: the robot holds, and the frame is not looked at. The first pose of a
                stream without a given one does not depend on it.
            given, given_next, given_speed: of the joints that others move; see Guard.step.

        Raises:
            ParameterError: x has another shape or holds no numbers, or there is neither a usable
                frame nor a pose yet. Nothing has changed, and the stream can go on.
        """
        its, walker = self._its, self._walker
        usable = None if x is None else seen(its.robot, x)
        try:
            dt = float(dt)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"dt must be a number, got {dt!r}") from None
        if walker and not dt >= SHORTEST:  # catches NaN
            return self._still(walker.step(None, dt), Mode.HELD)
        self._word = ""
        if self._others:
            told = self._others.told(given, given_next, given_speed, dt)
            self._word = self._others.broken(told)
            self._others.walker.others(*told)
            self._others.walker.see()
        else:
            refuse(given, given_next, given_speed)
        if usable is not None:
            self._x = self._calm(usable, dt)
        elif walker is None:
            raise ParameterError("the first frame of a stream has no seven finite vectors")
        if self._x is None:
            assert walker is not None  # else a frame was asked for above
            return self._still(walker.step(None, dt), Mode.DROPPED)
        starts = its.propose(self._x)
        last = self._want.copy()
        here = walker.q if walker else last
        found = its.refine(
            self._x, starts, last, here, walker is not None, self._want, self._found,
            self._others.walker.bodies if self._others else None,
        )  # fmt: skip
        if walker:
            made = walker.step(self._want, dt, starts)
            mode = _HOW.get(made.how, Mode.LOOKUP if found == LOOKUP else Mode.REFINED)
            if not self._others and not made.certified:
                mode = Mode.HALTED
            if mode in (Mode.REFINED, Mode.LOOKUP):
                off = np.abs(made.q - self._want).max(initial=0.0)
                mode = mode if off <= AS_WANTED else Mode.LIMITED
            mode = self._forced(made, mode)
            step = self._answer(self._x, made.q, mode, made.clearance, made.bound, usable is None)
            return self._moving(step, made)
        if found == NOTHING:
            self._want[:] = its.robot.anchor
        self._walker = walker = its.walker(self._want, self._check)
        room = walker.clearance
        step = self._answer(self._x, walker.q, Mode.START, room, room, False)
        return step._replace(v=walker.v)

    def _moving(self, step: Step, made: steps.Step) -> Step:
        """A step with its speeds, where these are what was proven."""
        if self._others or self._walker is None:
            return step
        return step._replace(v=self._walker.v, via=made.via)

    def _answer(
        self,
        x: np.ndarray,
        q: np.ndarray,
        mode: Mode,
        clearance: float,
        bound: float,
        dropped: bool,
    ) -> Step:
        its = self._its
        far = its.far(q, x)
        wanted = float(self._found[0]) / len(its.robot.vectors)
        if self._leading and (mode in (Mode.REFINED, Mode.LOOKUP) or far - wanted < _THERE):
            self._leading = False
        if mode is not Mode.HALTED:
            if dropped and mode is not Mode.FORCED:
                mode = Mode.DROPPED
            elif self._leading and mode is not Mode.FORCED:
                mode = Mode.LEAD_IN
        return Step(q, mode, clearance, bound, far, wanted, self._word)

    def _still(self, made: steps.Step, mode: Mode) -> Step:
        """What is answered where no human has been seen."""
        step = Step(
            made.q, self._forced(made, mode), made.clearance, made.bound, np.nan, np.nan, self._word
        )
        return self._moving(step, made)

    def _forced(self, made: steps.Step, mode: Mode) -> Mode:
        """The mode of a step; forced, if given joints left no certified way."""
        if self._others and (not made.certified or self._others.walker.apart):
            return Mode.FORCED
        return mode


class Retargeter:
    """From human skeletons to certified robot motion; only read while in use.

    Any number of threads may share one; each has streams of its own.
    """

    def __init__(self, robot: Robot, proposer: Proposer, settings: Settings) -> None:
        """Join the parts; `load` does it from a folder.

        Raises:
            ParameterError: settings do not fit the robot.
        """
        self.robot, self.settings = robot, settings
        self.rule, self.most = settings.rule(robot), settings.limits(robot)
        self.speed = self.most.speed  # [rad/s], (n_dof,)
        self._bodies, self._proposer = (robot.chain, swept(robot.chain)), proposer
        self._warm = False

    @classmethod
    def load(
        cls,
        folder: Path,
        changed: Mapping[str, object] | None = None,
        method: str | None = None,
    ) -> "Retargeter":
        """The retargeter that a folder holds.

        Args:
            folder: written by stage `export`.
            changed: settings to change, by name.
            method: refuse any other method of look-up than this; None: any.

        Raises:
            BundleError: a piece is missing, damaged, or of another retargeter.
            ModelError: there is none, or of another method.
            ParameterError: a changed setting is unknown or out of range.
        """
        return cls(*exported.load(folder, changed, method))

    def gentler(self, jerk: float) -> "Retargeter":
        """The same, but what it plans as a whole aims at a jerk [rad/s^3]; 0: at none.

        It is told in the summary and not certified; streams know nothing of it.

        Raises:
            ParameterError: the jerk is out of range.
        """
        return Retargeter(self.robot, self._proposer, replace(self.settings, jerk=jerk))

    def warm_up(self) -> None:
        """Compile what a frame needs, or read it from the store, so that no frame waits for it.

        The first time after an installation this takes a minute or two. A look-up's scratch is
        made too, for the thread that calls this. The first stream does it by itself; what a file
        needs is compiled with the first one, or by warm_up_plan.
        """
        x = batch.skeletons(self.robot.chain, self.robot.anchor[None])[0]
        stream, self._warm = Stream(self, None, True), True
        for _ in range(2):  # a first frame, and one that moves
            stream.step(x, 1.0 / 30.0)
        assert stream._walker is not None  # the first frame made it
        stream._walker.warm_up()  # steps that do not lead to where they are wanted
        Calm.warm_up(x)

    def warm_up_plan(self) -> None:
        """Compile what a whole motion needs, or read it from the store."""
        self.planner().warm_up()
        x = batch.skeletons(self.robot.chain, self.robot.anchor[None]).repeat(3, axis=0)
        self.plan(x, np.full(3, 1.0 / 30.0))

    def propose(self, x: np.ndarray) -> np.ndarray:
        """Poses to start from [rad], (k, n_dof)."""
        return np.ascontiguousarray(self._proposer.propose(x), float)

    def refine(
        self,
        x: np.ndarray,
        starts: np.ndarray,
        last: np.ndarray,
        here: np.ndarray,
        warm: bool,
        want: np.ndarray,
        out: np.ndarray,
        bodies: tuple[Chain, Swept] | None = None,
    ) -> int:
        """The feasible pose nearest to a skeleton, into want; see refine.refine.

        Bodies are Walker.bodies; None: the robot's own.
        """
        chain, moved = bodies or self._bodies
        return refine(chain, moved.balls, x, starts, last, here, warm, self.rule, want, out)

    def far(self, q: np.ndarray, x: np.ndarray) -> float:
        """Mean cosine distance of a pose's skeleton to x (21,)."""
        return float(cost_of(self.robot.chain, q, x)) / len(self.robot.vectors)

    def walker(self, q: np.ndarray, check: bool = True) -> Walker:
        """What takes steps from where the robot stands, q (n_dof,) [rad].

        Raises:
            CertificateError: q is not feasible.
        """
        return walker(self.robot, self.most, self.settings.planning(check), q=q, skeleton=True)

    def planner(self, curved: bool = True) -> Planner:
        """What plans whole motions; of one thread.

        Args:
            curved: rows of position and speed; False: of positions, joints moving straight between.
        """
        return planner(self.robot, self.most, replace(self.settings.planning(), curved=curved))

    def plan(
        self,
        x: np.ndarray,
        dt: np.ndarray,
        start: np.ndarray | None = None,
        progress: Progress | None = None,
    ) -> Rows:
        """A whole motion at once: what comes is known, so the robot prepares for it.

        Args:
            x: skeletons, (m, 21); rows that are not finite are dropped frames.
            dt: time from the row before to each [s], (m,).
            start: pose at which the robot stands before the first row [rad], (n_dof,); None: the
                motion begins at the first row.
            progress: called with numbers of rows done.

        Raises:
            ParameterError: neither a start nor a usable first row.
            CertificateError: no motion was found that holds; says which row does not.
        """
        return planned(self, x, dt, start, progress)

    def start(
        self,
        q: np.ndarray | None = None,
        check: bool | None = None,
        given: Sequence[str] | str | None = None,
        given_speed: object = None,
    ) -> Stream:
        """A new stream, ready for its first frame; the first one waits for warm_up.

        Args:
            q: where the robot is [rad], (n_dof,); it moves from there (Mode.LEAD_IN). None: the
                first pose is that of the first frame (Mode.START), and to be there is the
                caller's business.
            check: whether each pose is checked independently before it counts; None: as the
                settings say.
            given, given_speed: joints that others move, see Guard; the robot then begins at q or
                its anchor, and every step is told of them.

        Raises:
            CertificateError: q is not feasible.
            ParameterError: q has another shape, or what is given makes no sense.
            RobotError: a given joint is none of the robot's, or is ours.
        """
        check = self.settings.check if check is None else check
        if not self._warm:
            self.warm_up()
        body = of(self.robot, given)
        if body is None:
            refuse(given_speed)
            return Stream(self, q, check)
        others = Given(body, self.most, self.settings.planning(check), given_speed, skeleton=True)
        others.walker.warm_up()
        return Stream(self, self.robot.anchor if q is None else q, check, others)


def _pose(q: np.ndarray, n_dof: int) -> np.ndarray:
    q = np.array(q, float)
    if q.shape != (n_dof,):
        raise ParameterError(f"a pose must have shape ({n_dof},), got {q.shape}")
    return q
