"""Human motion to certified robot motion, frame by frame: propose, refine, guard, check.

A stream of skeletons x (seven unit vectors) becomes a stream of poses q. Each pose is within
limits and keeps the robot's margin; between two poses the joints move straight, no joint faster
than allowed, and the whole of that path is proven to keep `between`. What the kernels accept is
measured once more by the independent check before it counts. There is no input for which an
unproven pose or step comes out: where nothing else can be proven, the robot holds.
"""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.retarget import exported, guard
from s3le.retarget.calm import calm, directions, middle
from s3le.retarget.propose import Proposer
from s3le.retarget.refine import LOOKUP, NOTHING
from s3le.retarget.settings import Settings
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.swept import swept
from s3le.skeleton import BONES, DIM

SHORTEST = 1e-6  # [s], in less time nothing moves
LONGEST = 1.0  # [s], a robot that was left alone for longer moves as if it had been this


class Mode(StrEnum):
    """How a row of a retargeted motion was obtained; every row is certified, whatever its mode."""

    START = "start"  # the first pose; nothing leads to it
    REFINED = "refined"  # the pose wanted, refined towards the human
    LOOKUP = "lookup"  # the pose wanted, as it is stored
    LIMITED = "limited"  # towards it, as far as the joints get in the time
    SHORTENED = "shortened"  # the first part of a step whose whole could not be proven
    DETOUR = "detour"  # another way, for the straight one could not be proven
    HELD = "held"  # stands still: nothing else could be proven, or no time has passed
    LEAD_IN = "lead_in"  # on the way from a given pose to the human's first
    DROPPED = "dropped"  # the frame could not be used; towards the one before it
    EASED = "eased"  # towards it, as far as the brake lets the joints go


_HOW = {
    guard.EASED: Mode.EASED,
    guard.LIMITED: Mode.LIMITED,
    guard.DETOUR: Mode.DETOUR,
    guard.SHORTENED: Mode.SHORTENED,
    guard.HELD: Mode.HELD,
}
_ARRIVED = (Mode.START, Mode.REFINED, Mode.LOOKUP, Mode.EASED)


class Step(NamedTuple):
    """One answer."""

    q: np.ndarray  # [rad], (n_dof,), where to be when the step is over
    mode: Mode  # how it was obtained
    clearance: float  # [m], of the pose
    bound: float  # [m], proven of the path that leads to it
    distance: float  # mean cosine distance to the human as wanted; NaN: no human yet
    wanted: float  # the same of the pose that would have been the answer without the guard


class Stream:
    """One robot in motion: all that is remembered from frame to frame, and scratch."""

    def __init__(self, retargeter: "Retargeter", q: np.ndarray | None, check: bool) -> None:
        """Use Retargeter.start."""
        robot = retargeter.robot
        self._its, self._check = retargeter, check
        self._scratch = segment.scratch(robot.chain)
        self._certifier = robot.certifier()
        self.reset(q)

    def reset(self, q: np.ndarray | None = None) -> None:
        """Forget everything and start anew, as Retargeter.start does."""
        robot = self._its.robot
        self._memory = guard.memory(robot.n_dof)
        self._kept, self._rate = np.zeros(DIM), np.zeros(DIM)
        self._seen: list[np.ndarray] = []  # the last frames, where the answer comes one late
        self._x: np.ndarray | None = None  # the skeleton last wanted
        self._clearance = np.nan
        self._leading = q is not None
        if q is not None:
            q = _pose(q, robot.n_dof)
            report = self._certifier.require(q[None], robot.margin)
            self._clearance = float(report.clearance[0])
            self._memory.q[:] = self._memory.last[:] = q
            self._memory.flag[guard.WARM] = 1

    @property
    def q(self) -> np.ndarray | None:
        """Where the robot is [rad], (n_dof,); None before the first pose."""
        return self._memory.q.copy() if self._memory.flag[guard.WARM] else None

    def step(self, x: np.ndarray | None, dt: float) -> Step:
        """Take one frame and say where the robot is to be dt later.

        Args:
            x: the human's seven vectors, (21,) or (7, 3), of any length; None, values that are
                not finite, or a vector without length: the frame is dropped, and the robot goes
                on towards the one before it.
            dt: time since the frame before [s]. Where it is not finite or below 1e-6 s no time
                has passed: the robot holds, and the frame is not looked at. The first pose of a
                stream without a given one does not depend on it.

        Raises:
            ParameterError: x has another shape or holds no numbers, or there is neither a usable
                frame nor a pose yet. Nothing has changed, and the stream can go on.
        """
        usable = None if x is None else _directions(self._its.robot, x)
        memory, started = self._memory, bool(self._memory.flag[guard.WARM])
        try:
            dt = min(float(dt), LONGEST)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"dt must be a number, got {dt!r}") from None
        if started and not dt >= SHORTEST:  # catches NaN
            return self._hold(Mode.HELD)
        if usable is not None:
            self._take(usable, dt)
        elif not started:
            raise ParameterError("the first frame of a stream has no seven finite vectors")
        x_now = self._x
        if x_now is None:
            return self._hold(Mode.DROPPED)
        its = self._its
        found, how = guard.frame(
            its.robot.chain, its.swept, self._scratch, memory, x_now,
            its.propose(x_now), its.robot.anchor, dt, its.speed, its.brake, its.rule,
        )  # fmt: skip
        if started:
            return self._go(found, how, dt, usable is None)
        if found == NOTHING:
            memory.next[:] = memory.want[:] = its.robot.anchor
        measured, room = self._certifier.one(memory.next)
        if not (measured >= its.robot.margin and room >= 0.0):
            raise CertificateError(self._certifier.why(memory.next, 0, its.robot.margin))
        self._clearance = measured
        self._move(dt, 0.0)
        return self._answer(Mode.START, self._clearance)

    def _take(self, x: np.ndarray, dt: float) -> None:
        """Filter a frame; what is wanted is then in self._x."""
        settings = self._its.settings
        if settings.delay:
            self._seen = [*(self._seen or [x, x])[-2:], x]
            late = np.empty(DIM)
            middle(*self._seen, late)
            x = late
        if self._x is None:
            self._kept[:] = x
        else:
            calm(x, dt, self._its.cutoff, self._its.quickness, self._kept, self._rate)
        self._x = self._kept

    def _go(self, found: int, how: int, dt: float, dropped: bool) -> Step:
        """Let the independent check decide, then move on."""
        memory, robot = self._memory, self._its.robot
        mode = _HOW.get(how, Mode.LOOKUP if found == LOOKUP else Mode.REFINED)
        clearance = self._clearance if mode is Mode.HELD else float(memory.out[6])
        if self._check and mode is not Mode.HELD:
            measured, room = self._certifier.one(memory.next)
            if measured >= robot.margin and room >= 0.0:
                clearance = measured
            else:  # the two engines disagree: then it is no
                memory.next[:] = memory.q
                memory.out[0] = clearance = self._clearance
                mode = Mode.HELD
        self._clearance = clearance
        self._move(dt, 1.0 / dt)
        if self._leading and mode in _ARRIVED:
            self._leading = False
        if dropped:
            mode = Mode.DROPPED
        elif self._leading:
            mode = Mode.LEAD_IN
        return self._answer(mode, float(memory.out[0]))

    def _move(self, dt: float, per_second: float) -> None:
        memory = self._memory
        np.subtract(memory.next, memory.q, memory.v)
        np.multiply(memory.v, per_second, memory.v)
        memory.q[:] = memory.next
        memory.last[:] = memory.want
        memory.flag[guard.WARM] = 1

    def _answer(self, mode: Mode, bound: float) -> Step:
        out = self._memory.out
        return Step(
            self._memory.q.copy(), mode, self._clearance, bound,
            float(out[5]) / len(self._its.robot.vectors),
            float(out[2]) / len(self._its.robot.vectors),
        )  # fmt: skip

    def _hold(self, mode: Mode) -> Step:
        self._memory.v[:] = 0.0
        q = self._memory.q.copy()
        return Step(q, mode, self._clearance, self._clearance, np.nan, np.nan)


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
        self.rule, self.speed = settings.rule(robot), settings.speed(robot)
        self.brake = float(settings.brake) or np.inf
        self.cutoff = float(settings.cutoff) or np.inf
        self.quickness = float(settings.quickness)  # another type would be compiled anew
        self.swept = swept(robot.chain)
        self._proposer = proposer

    @classmethod
    def load(
        cls,
        folder: Path,
        changed: Mapping[str, object] | None = None,
        method: str | None = None,
    ) -> "Retargeter":
        """The retargeter that a folder holds, ready for its first frame.

        The first time after an installation this compiles the kernels, which takes about a minute.

        Args:
            folder: written by stage `export`.
            changed: settings to change, by name.
            method: refuse any other method of look-up than this; None: any.

        Raises:
            BundleError: a piece is missing, damaged, or of another retargeter.
            ModelError: there is none, or of another method.
            ParameterError: a changed setting is unknown or out of range.
        """
        made = cls(*exported.load(folder, changed, method))
        made.warm_up()
        return made

    def warm_up(self) -> None:
        """Compile what a frame needs, or read it from the store, so that no frame waits for it.

        A look-up's scratch is made too, for the thread that calls this.
        """
        x = batch.skeletons(self.robot.chain, self.robot.anchor[None])[0]
        stream = self.start()
        for _ in range(2):  # a first frame, and one that moves
            stream.step(x, 1.0 / 30.0)
        kept, rate, late = x.copy(), np.zeros(DIM), np.empty(DIM)
        middle(x, x, x, late)
        calm(x, 1.0 / 30.0, self.cutoff, self.quickness, kept, rate)

    def propose(self, x: np.ndarray) -> np.ndarray:
        """Poses to start from [rad], (k, n_dof)."""
        return np.ascontiguousarray(self._proposer.propose(x), float)

    def start(self, q: np.ndarray | None = None, check: bool | None = None) -> Stream:
        """A new stream.

        Args:
            q: where the robot is [rad], (n_dof,); it moves from there (Mode.LEAD_IN). None: the
                first pose is that of the first frame (Mode.START), and to be there is the
                caller's business.
            check: whether each pose is checked independently before it counts; None: as the
                settings say.

        Raises:
            CertificateError: q is not feasible.
            ParameterError: q has another shape.
        """
        return Stream(self, q, self.settings.check if check is None else check)


def _pose(q: np.ndarray, n_dof: int) -> np.ndarray:
    q = np.array(q, float)
    if q.shape != (n_dof,):
        raise ParameterError(f"a pose must have shape ({n_dof},), got {q.shape}")
    return q


def _directions(robot: Robot, x: np.ndarray) -> np.ndarray | None:
    """Seven unit vectors (21,), as the robot sees them; None where there are none.

    Raises:
        ParameterError: x has another shape or holds no numbers.
    """
    try:
        if np.iscomplexobj(x):
            raise TypeError
        x = np.asarray(x, float)
    except (TypeError, ValueError, OverflowError):  # the last: an int beyond every float
        raise ParameterError("a frame must hold numbers") from None
    if x.shape not in ((DIM,), (len(BONES), 3)):
        raise ParameterError(f"a frame must have shape ({DIM},) or (7, 3), got {x.shape}")
    x = np.ascontiguousarray(robot.seen(x.reshape(DIM)))
    out = np.empty(DIM)
    return out if directions(x, out) else None
