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

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.retarget.stream import Mode, Retargeter
from s3le.robot.certificate import Certifier

KINDS = ("random", "adversarial", "real")
FRAMES = 40  # of a stream, its lead from where it starts included


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


def _random(retargeter: Retargeter, rng: np.random.Generator) -> list:
    every = int(rng.integers(4, 16))
    knots = poses(retargeter, rng, FRAMES // every + 2)
    at = np.arange(FRAMES) / every
    share = (at % 1.0)[:, None] ** 2 * (3.0 - 2.0 * (at % 1.0)[:, None])
    q = (1.0 - share) * knots[at.astype(int)] + share * knots[at.astype(int) + 1]
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


def _real(rng: np.random.Generator, clips: Sequence[tuple[float, np.ndarray]]) -> list:
    rate, x = clips[rng.integers(len(clips))]
    stride = max(1, int(rng.integers(1, 1 + max(1, round(rate / 20)))))
    x, dt = x[::stride], stride / rate / float(rng.choice([1.0, 1.0, 1.5, 2.0, 4.0]))
    first = int(rng.integers(max(1, len(x) - FRAMES)))
    x = x[first : first + FRAMES]
    if rng.random() < 0.5:
        x = mirrored(x)
    if rng.random() < 0.3:
        x = x + rng.normal(0.0, 0.1, x.shape)  # 3 cm at the end of a limb
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
    stream, rows, refused = retargeter.start(script.start), [], 0
    for i, (x, dt) in enumerate(script.frames):
        q0, free0 = stream.q, stream.wanted
        try:
            made = stream.step(x, dt)
        except ParameterError:  # documented: neither a usable frame nor a pose yet
            if q0 is not None:
                raise
            refused += 1
            continue
        if q0 is None:  # nothing leads to the first pose
            q0, free0, dt = made.q, stream.wanted, 1.0
        rows.append((q0, made.q, dt, made.mode, i, free0, stream.wanted))
    if not rows:
        n_dof = retargeter.robot.n_dof
        none = np.empty((0, n_dof))
        return Steps(none, none, *np.empty((3, 0)), none, none, refused)
    return Steps(*map(np.array, zip(*rows, strict=True)), refused)


def shares(mode: np.ndarray) -> dict[str, int]:
    """How many steps came about how."""
    return {str(one): int((mode == one).sum()) for one in Mode if (mode == one).any()}
