"""Whole motions by the file door: clips as `s3le retarget` plans them, drawn from a seed.

Half are recorded clips at up to four times their speed, mirrored or shaken; half smooth motions
through the robot's own body. Frames are dropped (rows missing, or not finite), times uneven, and
some begin with a lead-in from the anchor. What comes out is the plan itself, before the audit that
stands between it and a file.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import streams
from streams import Log, Steps

from s3le.errors import CertificateError, ParameterError
from s3le.kernels import batch
from s3le.plan.whole import Plan, Planner
from s3le.retarget.follow import follow
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter

FRAMES = (24, 200)  # of a motion, least and most


class Clip(NamedTuple):
    """What is to be followed."""

    x: np.ndarray  # skeletons, (m, 21)
    times: np.ndarray  # [s], (m,)
    lead_in: float  # [s]


class _Overheard:
    """A planner that remembers what it was asked for."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.wanted = np.empty((0, planner.robot.n_dof))

    def plan(self, times: np.ndarray, wanted: np.ndarray, **how) -> Plan:
        self.wanted = wanted
        return self._planner.plan(times, wanted, **how)


def draw(
    retargeter: Retargeter,
    rng: np.random.Generator,
    clips: Sequence[tuple[float, np.ndarray]],
) -> Clip:
    """A motion of skeletons for whose robot the retargeter is."""
    rows = int(rng.integers(*FRAMES))
    if rng.random() < 0.5:
        x, dt = recorded(rng, clips, rows)
    else:
        q = streams.smooth(retargeter, rng, rows, int(rng.integers(4, 30)))
        x = batch.skeletons(retargeter.robot.chain, q)
        dt = float(rng.choice([0.1, 1 / 30, 1 / 30, 1 / 60, 1 / 120, 1 / 250]))
    times = np.arange(len(x)) * dt
    if rng.random() < 0.3:
        times = uneven(len(x), dt, rng)
    x = x.copy()
    if rng.random() < 0.3:
        x[rng.random(len(x)) < 0.05] = np.nan
    if rng.random() < 0.3 and len(x) > 2:
        stays = rng.random(len(x)) > 0.1
        stays[:2] = True
        x, times = x[stays], times[stays]
    lead_in = float(rng.choice([0.0, 0.0, 0.0, 0.1, 0.5]))
    return Clip(x, times, lead_in)


def recorded(
    rng: np.random.Generator, clips: Sequence[tuple[float, np.ndarray]], rows: int
) -> tuple[np.ndarray, float]:
    """As streams.recorded, three rows at least."""
    while True:
        x, dt = streams.recorded(rng, clips, rows)
        if len(x) >= 3:
            return x, dt


def uneven(rows: int, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Times of rows whose steps are a third to three times dt [s], (rows,)."""
    return np.concatenate([[0.0], np.cumsum(dt * 3.0 ** rng.uniform(-1.0, 1.0, rows - 1))])


def drive(retargeter: Retargeter, clip: Clip) -> Steps:
    """Plan a motion.

    Raises:
        Exception: whatever comes but the documented refusals: no usable frame (ParameterError), no
            motion that holds (CertificateError). A refused motion is one row of `refused`.
    """
    log = Log(retargeter.robot.n_dof)
    heard, watched = _Overheard(retargeter.planner()), copy.copy(retargeter)
    watched.planner = lambda: heard  # type: ignore[method-assign]
    try:
        made = follow(
            watched, clip.x, clip.times, fps=1.0 / np.median(np.diff(clip.times)),
            lead_in=clip.lead_in,
        )  # fmt: skip
    except (CertificateError, ParameterError):
        log.refused += 1
        return log.steps()
    m = len(made.q)
    own = m - int((made.mode == Mode.START).argmax()) if not clip.lead_in else m - 1
    wanted = heard.wanted[-own:]
    wanted = np.concatenate([wanted[:1].repeat(m - len(wanted), axis=0), wanted])
    stands = bool(clip.lead_in)  # else nothing is promised of what went before
    for i in range(1, m):
        dt = float(made.time[i] - made.time[i - 1])
        free = wanted[i - 1], wanted[i]
        rows = streams.moved(made.q[i - 1], made.v[i - 1], made.q[i], made.v[i], dt, ())
        log.add(
            made.q[i - 1], made.q[i], dt, made.mode[i], i, free, smooth=stands or i > 1, rows=rows
        )  # fmt: skip
        if i % streams.STOP_EVERY == 0:
            grid = float(np.median(np.diff(made.time)))
            streams.stopped(log, at_rest(retargeter, made.q[i], made.v[i], grid), i, free)
    return log.steps()


def at_rest(retargeter: Retargeter, q: np.ndarray, v: np.ndarray, dt: float) -> list[tuple]:
    """Rows of the motion on which each joint brakes as hard as it may, in steps of dt [s]."""
    most, rows = retargeter.most.acceleration * (1.0 - 1e-7), [(0.0, q, v)]
    while rows[-1][2].any():
        t, here, fast = rows[-1]
        slower = np.sign(fast) * np.maximum(np.abs(fast) - most * dt, 0.0)
        rows.append((t + dt, here + 0.5 * dt * (fast + slower), slower))
    t, rest, still = rows[-1]
    inside = np.clip(rest, retargeter.robot.lower, retargeter.robot.upper)
    if np.abs(inside - rest).max() <= 1e-9:  # of floats
        rows[-1] = t, inside, still
    return rows
