"""A whole motion planned at once: the poses wanted for all frames, then the nearest that holds."""

import time as clock
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.plan.whole import Plan, Planner
from s3le.retarget.calm import middle
from s3le.retarget.frames import Calm, seen
from s3le.retarget.refine import LOOKUP, NOTHING
from s3le.retarget.rows import Mode, Rows
from s3le.retarget.settings import Settings
from s3le.robot.robot import Robot
from s3le.skeleton import DIM
from s3le.types import Progress

AS_WANTED = 0.02  # [rad], a row in which every joint is as near counts as the pose wanted


class Refines(Protocol):
    """What is asked of a retargeter here; s3le.retarget.stream.Retargeter does it."""

    robot: Robot
    settings: Settings

    def propose(self, x: np.ndarray) -> np.ndarray:
        """Poses to start from; see Retargeter.propose."""

    def refine(
        self, x: np.ndarray, starts: np.ndarray, last: np.ndarray, here: np.ndarray, warm: bool,
        want: np.ndarray, out: np.ndarray,
    ) -> int:  # fmt: skip
        """The feasible pose nearest to a skeleton; see Retargeter.refine."""

    def planner(self) -> Planner:
        """What plans whole motions; see Retargeter.planner."""


def planned(
    its: Refines,
    x: np.ndarray,
    dt: np.ndarray,
    start: np.ndarray | None,
    progress: Progress | None,
) -> Rows:
    """See Retargeter.plan."""
    half = share(progress, 2 * len(x), len(x))
    aims, wanted, mode, cost, seconds = want(its, x, dt, start, half)
    began = clock.perf_counter()
    times = np.cumsum(dt)
    if start is None:
        plan = its.planner().plan(times, wanted, skeleton=True, progress=half)
    else:
        times = np.concatenate([times[0] - dt[0] * np.array([2.0, 1.0]), times])
        stood = np.concatenate([[start, start], wanted])
        plan = its.planner().plan(times, stood, skeleton=True, stands=True, progress=half)
    plan = Plan(*(part[0 if start is None else 2 :] for part in plan if part is not None))
    assert plan.v is not None  # whole motions of a retargeter are curves
    mark(mode, plan.q, wanted)
    found = batch.skeletons(its.robot.chain, plan.q)
    far = 0.5 * np.square(found - aims).sum(axis=1) / len(its.robot.vectors)
    seconds += (clock.perf_counter() - began) / len(x)
    return Rows(plan.q, mode, plan.clearance, plan.bound, far, cost, seconds, plan.v)


def mark(mode: np.ndarray, q: np.ndarray, wanted: np.ndarray) -> None:
    """Say of rows that are not the pose wanted that they were planned; changes mode.

    Args:
        mode: of each row, object (m,).
        q: of each row [rad], (m, n).
        wanted: the poses wanted [rad], (m, n).
    """
    arrived = np.isin(mode, (Mode.REFINED, Mode.LOOKUP))
    mode[arrived & (np.abs(q - wanted).max(axis=1) > AS_WANTED)] = Mode.PLANNED


def want(
    its: Refines,
    x: np.ndarray,
    dt: np.ndarray,
    start: np.ndarray | None,
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What is seen in each frame and the pose wanted for it, however fast it must be reached.

    Returns:
        (aims (m, 21), NaN where no human has been seen yet; poses (m, n) [rad]; Mode of each;
        its mean cosine distance to the human; seconds that each took).
    """
    m, n = len(x), its.robot.n_dof
    aims, wanted = np.full((m, DIM), np.nan), np.empty((m, n))
    mode, cost, seconds = np.empty(m, object), np.full(m, np.nan), np.empty(m)
    frames = [seen(its.robot, row) for row in x]
    calm, out = Calm(replace(its.settings, delay=False)), np.zeros(3)
    if its.settings.delay:
        frames = _odd_ones_out(frames)
    warm = start is not None
    last = np.zeros(n) if start is None else np.array(start, float)
    aim = None
    for i, frame in enumerate(frames):
        began = clock.perf_counter()
        if frame is not None:
            aim = calm(frame, float(dt[i]))
        elif not warm:
            raise ParameterError("the first frame of a motion has no seven finite vectors")
        mode[i] = Mode.DROPPED
        wanted[i] = last
        if aim is not None:
            aims[i] = aim
            found = its.refine(aim, its.propose(aim), last, last, warm, wanted[i], out)
            if found == NOTHING and not warm:
                wanted[i] = its.robot.anchor
            if not warm:
                mode[i] = Mode.START
            elif frame is not None:
                mode[i] = Mode.LOOKUP if found == LOOKUP else Mode.REFINED
            cost[i] = out[0] / len(its.robot.vectors)
            last, warm = wanted[i].copy(), True
        seconds[i] = clock.perf_counter() - began
        progress(1)
    return aims, wanted, mode, cost, seconds


def _odd_ones_out(frames: list[np.ndarray | None]) -> list[np.ndarray | None]:
    """Of each frame and its neighbours the middle one, bone by bone; none comes late."""
    kept = [row for row in frames if row is not None]
    late = []
    for i, now in enumerate(kept):
        late.append(np.empty(DIM))
        middle(kept[max(i - 1, 0)], now, kept[min(i + 1, len(kept) - 1)], late[-1])
    rest = iter(late)
    return [None if row is None else next(rest) for row in frames]


def share(progress: Progress | None, work: int, m: int) -> Callable[[int], object]:
    """Tell of m rows while `work` of something is counted."""
    seen, told = 0, 0

    def counted(count: int) -> None:
        nonlocal seen, told
        seen += count
        now = min(seen * m // work, m)
        if progress and now > told:
            progress(now - told)
            told = now

    return counted
