"""What is fed to the retargeter: streams of frames that are hard to follow, drawn from a seed.

    random        smooth motions between random poses that may collide; the human cuts through
                  the robot's body, at rates from 10 to 250 Hz
    adversarial   jumps between poses in which limbs stand on the wrong side of each other, swaps
                  of left and right, noise, frames that are no frames, times that are none
    real          recorded clips, played at up to four times their speed, mirrored, with noise,
                  with dropped and swapped frames

Targets are not projected, so the robot is pressed against itself nearly all the time: what is
judged is near contact.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from judging import LONGEST, SHORTEST, Came, Judge, Row, Verdict

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.retarget.stream import Mode, Retargeter
from s3le.robot.certificate import Certifier

KINDS = ("random", "adversarial", "real")
FRAMES = 40  # of a stream, its lead from where it starts included
SAG = 2e-4  # [m], most that a curve strays from the chords that a prover of straight paths gets
STOP, STOP_EVERY = "stop", 7  # mode of a motion to rest, and of how many steps it is judged


class Script(NamedTuple):
    """One stream of input."""

    kind: str  # one of KINDS, or what a search calls it
    start: np.ndarray | None  # [rad], (n_dof,), where the robot stands; None: at the first frame
    frames: list[tuple[np.ndarray | None, float]]  # skeleton as Stream.step takes it, dt [s]


class Steps(NamedTuple):
    """What came of a script, one entry a step."""

    q0: np.ndarray  # [rad], (n, n_dof)
    q1: np.ndarray  # [rad], (n, n_dof)
    dt: np.ndarray  # [s], (n,), as it was given
    mode: np.ndarray  # (n,), see Mode
    frame: np.ndarray  # (n,), the step's frame in the script
    free0: np.ndarray  # [rad], (n, n_dof), the same step with the guard off: from the pose that
    free1: np.ndarray  # [rad], (n, n_dof), was wanted before to the one wanted now
    refused: int  # frames that were answered by the documented error
    v0: np.ndarray  # [rad/s], (n, n_dof), speed of the step before
    dt0: np.ndarray  # [s], (n,), its duration; NaN: no acceleration is promised here
    led: np.ndarray  # bool (n,), leads out of where nothing holds: time alone is judged
    rows: tuple[tuple[Row, ...], ...]  # (n,), of a step whose speed is continuous; (): straight
    short: np.ndarray  # bool (n,), is not called certified: its end may keep less than the margin
    wrong: tuple[str, ...] = ()  # what was answered though it had to be refused, or the like

    def came(self, i: int) -> Came:
        """How the robot came to where step i begins."""
        return Came(self.v0[i], float(self.dt0[i]))

    def judged(self, judge: Judge, i: int) -> Verdict:
        """What a judge sees of step i."""
        if self.rows[i]:
            came = None if np.isnan(self.dt0[i]) else self.came(i)
            seen = judge.curve(self.rows[i], came)
            if self.short[i]:
                seen = seen._replace(broken=tuple(k for k in seen.broken if k != "margin"))
            return seen
        return judge.step(self.q0[i], self.q1[i], float(self.dt[i]), self.came(i))

    def chords(self, judge: Judge, i: int) -> np.ndarray:
        """Poses between which step i goes straight, or within SAG of it [rad], (m, n_dof)."""
        if self.rows[i]:
            return judge.chords(self.rows[i], SAG)
        return np.stack([self.q0[i], self.q1[i]])


class Log:
    """Steps as they come, with the speed at which each begins."""

    def __init__(self, n_dof: int) -> None:
        """Nothing yet; the robot stands, for as long as the first step takes."""
        self.refused, self.wrong = 0, []
        self._n, self._rows = n_dof, []
        self._v, self._dt = np.zeros(n_dof), None

    def add(
        self,
        q0: np.ndarray,
        q1: np.ndarray,
        dt: float,
        mode: str,
        frame: int,
        free: tuple[np.ndarray, np.ndarray],
        *,
        smooth: bool = True,
        led: bool = False,
        rows: Sequence[Row] = (),
        aside: bool = False,
        v1: np.ndarray | None = None,
        short: bool = False,
    ) -> None:
        """Note a step.

        Args:
            q0, q1, dt, mode, frame: see Steps.
            free: free0 and free1.
            smooth: its acceleration is promised.
            led, rows: see Steps.
            aside: it could be taken, and is not: the next one begins where this one does.
            short: see Steps.
            v1: speed at its end [rad/s]; None: that of its last row, or of all of it.
        """
        took = min(dt, LONGEST) if dt >= SHORTEST else np.nan  # NaN: no time passed
        before = took if self._dt is None else self._dt
        known = before if smooth else np.nan
        self._rows.append(
            (q0, q1, dt, mode, frame, *free, self._v, known, led, tuple(rows), short)
        )  # fmt: skip
        if took > 0.0 and not aside:
            v1 = rows[-1].v if rows else v1
            self._v, self._dt = (q1 - q0) / took if v1 is None else v1, took

    def jumped(self) -> None:
        """Where the robot is now nothing led: it stands."""
        self._v, self._dt = np.zeros(self._n), None

    def steps(self) -> Steps:
        """All of them."""
        if not self._rows:
            none, no = np.empty((0, self._n)), np.empty(0)
            return Steps(
                none, none, no, no, no, none, none, self.refused, none, no,
                np.empty(0, bool), (), np.empty(0, bool), tuple(self.wrong),
            )  # fmt: skip
        q0, q1, dt, mode, frame, free0, free1, v0, dt0, led, rows, short = zip(
            *self._rows, strict=True
        )  # fmt: skip
        return Steps(
            np.array(q0), np.array(q1), np.array(dt, float), np.array(mode), np.array(frame),
            np.array(free0), np.array(free1), self.refused, np.array(v0), np.array(dt0),
            np.array(led), rows, np.array(short), tuple(self.wrong),
        )  # fmt: skip


def swapped(x: np.ndarray) -> np.ndarray:
    """Left and right exchanged, as a tracker does that confuses them (21,)."""
    return np.r_[x[:3], x[12:], x[3:12]]


def mirrored(x: np.ndarray) -> np.ndarray:
    """The mirror image of skeletons (n, 21): y changes its sign and left is right."""
    x = x * np.tile([1.0, -1.0, 1.0], 7)
    return np.concatenate([x[:, :3], x[:, 12:], x[:, 3:12]], axis=1)


def _somewhere(x: np.ndarray, rng: np.random.Generator, share: float, value: float) -> np.ndarray:
    return np.where(rng.random(21) < share, value, x)


# What may happen to a frame.
ODD: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray | None]] = {
    "nan": lambda x, rng: _somewhere(x, rng, 0.1, np.nan),
    "inf": lambda x, rng: _somewhere(x, rng, 0.1, np.inf),
    "minus inf": lambda x, rng: _somewhere(x, rng, 0.1, -np.inf),
    "zero": lambda x, rng: np.zeros(21),
    "a zero vector": lambda x, rng: np.r_[x[:3], np.zeros(3), x[6:]],
    "none": lambda x, rng: None,
    "huge": lambda x, rng: x * 1e8,
    "too huge": lambda x, rng: x * 1e300,
    "tiny": lambda x, rng: x * 1e-7,
    "noise": lambda x, rng: x + rng.normal(0.0, 0.15, 21),
    "teleport": lambda x, rng: rng.normal(size=21),
    "inside out": lambda x, rng: -x,
    "swapped": lambda x, rng: swapped(x),
}
ODD_TIMES = (0.0, -0.1, -1e-9, 1e-300, 1e-7, 9.99e-7, 1e-6, 1e-4, 1.0, 10.0, 3600.0, 1e300,
             np.nan, np.inf, -np.inf)  # fmt: skip


def draw(
    kind: str,
    retargeter: Retargeter,
    rng: np.random.Generator,
    clips: Sequence[tuple[float, np.ndarray]] = (),
) -> Script:
    """One script of a kind.

    Args:
        kind: one of KINDS.
        retargeter: for whose robot.
        rng: where all chance comes from.
        clips: for "real": rate [Hz] and skeletons (n, 21) of each.
    """
    if kind == "real":
        frames = _real(rng, clips)
    elif kind == "random":
        frames = _random(retargeter, rng)
    else:
        frames = _adversarial(retargeter, rng)
    start = None
    if rng.random() < 0.25:  # from where another human left the robot
        start = np.array(retargeter.propose(targets(retargeter, rng, 1)[0])[0])
        report = _certifier(retargeter).check(start[None])
        if not (report.clearance[0] >= retargeter.robot.margin and report.limit_margin[0] >= 0):
            start = None
    return Script(kind, start, frames)


def poses(retargeter: Retargeter, rng: np.random.Generator, n: int) -> np.ndarray:
    """Poses within limits, those that collide first, (n, n_dof) [rad]: out of four times as many.

    The human whose pose it is cannot be followed all the way: the robot ends at its margin.
    """
    robot = retargeter.robot
    q = rng.uniform(robot.lower, robot.upper, (4 * n, robot.n_dof))
    clearance = _certifier(retargeter).check(q).clearance
    return q[np.argsort(clearance >= 0.0, kind="stable")[:n]]


@cache
def _certifier(retargeter: Retargeter) -> Certifier:
    return retargeter.robot.certifier()


def targets(retargeter: Retargeter, rng: np.random.Generator, n: int) -> np.ndarray:
    """Skeletons of such poses, (n, 21)."""
    return batch.skeletons(retargeter.robot.chain, poses(retargeter, rng, n))


def smooth(retargeter: Retargeter, rng: np.random.Generator, rows: int, every: int) -> np.ndarray:
    """Rows of a motion through the body [rad], (rows, n_dof): a pose every so many of them."""
    knots = poses(retargeter, rng, rows // every + 2)
    at = np.arange(rows) / every
    share = (at % 1.0)[:, None] ** 2 * (3.0 - 2.0 * (at % 1.0)[:, None])
    return (1.0 - share) * knots[at.astype(int)] + share * knots[at.astype(int) + 1]


def _random(retargeter: Retargeter, rng: np.random.Generator) -> list:
    every = int(rng.integers(4, 16))
    q = smooth(retargeter, rng, FRAMES, every)
    dt = float(rng.choice([0.1, 1 / 30, 1 / 30, 1 / 30, 1 / 60, 1 / 120, 1 / 250]))
    return [(x, dt) for x in batch.skeletons(retargeter.robot.chain, q)]


def _adversarial(retargeter: Retargeter, rng: np.random.Generator) -> list:
    places = targets(retargeter, rng, 4)
    places = np.concatenate([places, mirrored(places), [swapped(x) for x in places]])
    usual = float(rng.choice([1 / 30, 1 / 30, 1 / 30, 1 / 15, 1 / 15, 0.2, 1e-4]))
    stays, odd, x = int(rng.integers(1, 12)), rng.choice([0.0, 0.1, 0.4]), places[0]
    frames: list[tuple[np.ndarray | None, float]] = []
    while len(frames) < FRAMES:
        if frames and len(frames) % stays == 0:
            x = places[rng.integers(len(places))]
        given, dt = x, usual
        if rng.random() < odd:
            with np.errstate(over="ignore"):
                given = ODD[str(rng.choice(list(ODD)))](x, rng)
        if rng.random() < odd / 2:
            dt = float(rng.choice(ODD_TIMES))
        frames.append((given, dt))
    return frames


def recorded(
    rng: np.random.Generator, clips: Sequence[tuple[float, np.ndarray]], rows: int
) -> tuple[np.ndarray, float]:
    """Up to so many rows of a clip, (m, 21), and the time from one to the next [s].

    It is played at up to four times its speed, mirrored or not, shaken or not.
    """
    rate, x = clips[rng.integers(len(clips))]
    stride = max(1, int(rng.integers(1, 1 + max(1, round(rate / 20)))))
    x, dt = x[::stride], stride / rate / float(rng.choice([1.0, 1.0, 1.5, 2.0, 4.0]))
    first = int(rng.integers(max(1, len(x) - rows)))
    x = x[first : first + rows]
    if rng.random() < 0.5:
        x = mirrored(x)
    if rng.random() < 0.3:
        x = x + rng.normal(0.0, 0.1, x.shape)  # 3 cm at the end of a limb
    return x, dt


def _real(rng: np.random.Generator, clips: Sequence[tuple[float, np.ndarray]]) -> list:
    x, dt = recorded(rng, clips, FRAMES)
    frames: list[tuple[np.ndarray | None, float]] = [(row, dt) for row in x]
    for i in range(1, len(frames)):
        if rng.random() < 0.02:
            frames[i] = (swapped(x[i]), dt)
        elif rng.random() < 0.02:
            frames[i] = (None, dt)
    return frames


def drive(retargeter: Retargeter, script: Script) -> Steps:
    """Let a retargeter follow a script.

    Raises:
        Exception: whatever the retargeter raises but the one documented refusal of a frame.
    """
    stream, log = retargeter.start(script.start), Log(retargeter.robot.n_dof)
    for i, (x, dt) in enumerate(script.frames):
        q0, free0, v0 = stream.q, stream.wanted, stream.v
        try:
            made = stream.step(x, dt)
        except ParameterError:  # documented: neither a usable frame nor a pose yet
            if q0 is not None:
                raise
            log.refused += 1
            continue
        if q0 is None:  # nothing leads to the first pose
            log.add(made.q, made.q, 1.0, made.mode, i, (stream.wanted, stream.wanted))
            log.jumped()
            continue
        smooth = made.mode is not Mode.HALTED
        free = free0, stream.wanted
        rows = moved(q0, v0, made.q, made.v, float(dt), made.via)
        log.add(q0, made.q, float(dt), made.mode, i, free, smooth=smooth, rows=rows)
        if i % STOP_EVERY == 0:  # cut off here, it would go to rest
            stopped(log, stream.rest(), i, free)
    return log.steps()


def moved(q0, v0, q1, v1, dt: float, via: Sequence[tuple]) -> tuple[Row, ...]:
    """Rows of a step whose speed is continuous; none where no time passed."""
    if v1 is None or not dt >= SHORTEST:
        return ()
    return Row(0.0, q0, v0), *(Row(*one) for one in via), Row(min(dt, LONGEST), q1, v1)


def stopped(log: Log, rest: Sequence[tuple], frame: int, free: tuple) -> None:
    """Note the motion to rest that the robot could be cut off to."""
    if len(rest) > 1:
        rows = tuple(Row(*one) for one in rest)
        log.add(
            rows[0].q, rows[-1].q, rows[-1].t, STOP, frame, free, rows=rows, aside=True
        )  # fmt: skip


def shares(mode: np.ndarray) -> dict[str, int]:
    """How many steps came about how."""
    return {str(one): int((mode == one).sum()) for one in dict.fromkeys(mode.tolist())}
