"""The one way to follow skeletons in time, from first to last: knowing what comes, or not."""

import time as clock
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.plan.steps import SHORTEST
from s3le.retarget.rows import Mode, Rows, rows_of
from s3le.retarget.stream import Step
from s3le.robot.robot import Robot
from s3le.skeleton import DIM
from s3le.types import Progress

LONGEST_LEAD_IN = 600.0  # [s]


class Streams(Protocol):
    """What is asked of one robot in motion; s3le.retarget.stream.Stream does it."""

    def step(self, x: np.ndarray | None, dt: float) -> Step:
        """The next pose; see Stream.step."""


class Follows(Protocol):
    """What is asked of a retargeter; s3le.retarget.stream.Retargeter does it."""

    robot: Robot

    def start(self, q: np.ndarray | None = None, *, given: Sequence[str] | None = None) -> Streams:
        """A new stream; see Retargeter.start."""

    def plan(
        self,
        x: np.ndarray,
        times: np.ndarray,
        start: np.ndarray | None = None,
        progress: Progress | None = None,
    ) -> Rows:
        """A whole motion; see Retargeter.plan."""


class Followed(NamedTuple):
    """A retargeted motion, one entry a row: those of the lead-in, then one a frame."""

    time: np.ndarray  # [s], (n,)
    q: np.ndarray  # [rad], (n, n_dof)
    mode: np.ndarray  # str (n,), see Mode
    clearance: np.ndarray  # [m], (n,), of the pose
    bound: np.ndarray  # [m], (n,), proven of the path from the row before
    distance: np.ndarray  # (n,), mean cosine distance to the human; NaN: no human yet
    wanted: np.ndarray  # (n,), the same before the guard
    seconds: np.ndarray  # [s], (n,), what each took; NaN: nothing was computed
    v: np.ndarray  # [rad/s], (n, n_dof)
    clip_from: int  # first row that belongs to a frame
    offset: float  # [s], time here minus time of the frames


def follow(
    retargeter: Follows,
    x: np.ndarray,
    times: np.ndarray,
    *,
    fps: float = 30.0,
    start: np.ndarray | None = None,
    lead_in: float = 0.0,
    look_ahead: bool = True,
    progress: Progress | None = None,
) -> Followed:
    """Let a retargeter follow skeletons.

    Args:
        retargeter: the one to follow them.
        x: skeletons, (n, 21); rows that cannot be used are dropped frames.
        times: of the rows [s], (n,), rising.
        fps: rate of the rows that lead in [Hz], and of the first one.
        start: pose that the robot starts from [rad], (n_dof,); None: the anchor if there is a
            lead-in, else the first usable frame's own pose.
        lead_in: time to move from there to the first frame [s]; 0: none.
        look_ahead: plan the motion as a whole. False: frame by frame, as a stream has to.
        progress: called with numbers of frames done.

    Raises:
        ParameterError: shapes differ, times do not rise, lead_in is negative or too long, or no
            frame can be used.
        S3leError: whatever the retargeter refuses.
    """
    if not 0.0 <= lead_in <= LONGEST_LEAD_IN:
        raise ParameterError(f"lead-in must be in [0, {LONGEST_LEAD_IN:g}] s, got {lead_in!r}")
    x, times = _motion(x, times)
    robot = retargeter.robot
    bones = robot.seen(x).reshape(-1, 7, 3)
    usable = np.isfinite(bones).all(axis=(1, 2)) & (bones != 0.0).any(axis=2).all(axis=1)
    if not usable.any():
        raise ParameterError("a motion needs one frame with seven finite vectors")
    first, own = int(np.argmax(usable)), times
    lead = 0
    if lead_in:
        start = robot.anchor if start is None else np.asarray(start, float)
        lead = max(1, round(lead_in * fps))
        ahead = approach(batch.skeletons(robot.chain, start[None])[0], x[first], lead)
        x = np.concatenate([ahead, x])
        times = np.concatenate(
            [np.arange(1, lead + 1), lead + 1 + (times - times[0]) * fps]
        ) / fps  # fmt: skip
        first = 0
    first = first if start is None else 0
    unseen = first  # rows before the human is seen
    if look_ahead and unseen:  # who is seen then was there before, so the robot starts from rest
        x = np.concatenate([x[first][None].repeat(first, axis=0), x[first:]])
        first = 0
    dt = np.diff(times[first:], prepend=times[first] - 1.0 / fps)
    walk = retargeter.plan if look_ahead else partial(frame_by_frame, retargeter)
    made = walk(x[first:], dt, start, _late(progress, lead))
    made.mode[:lead] = Mode.LEAD_IN
    if lead and start is not None:
        made = _stack(_standing(start), made)
        times = np.concatenate([[0.0], times])
    if first:
        before = Rows(*(part[:1].repeat(first, axis=0) for part in made))
        before.mode[:] = Mode.DROPPED
        before.distance[:], before.seconds[:] = np.nan, np.nan
        made = _stack(before, made)
    elif unseen:
        made.mode[:unseen], made.mode[unseen] = Mode.DROPPED, Mode.START
        made.distance[:unseen], made.seconds[:unseen] = np.nan, np.nan
    clip_from = lead + 1 if lead else 0
    offset = float(times[clip_from] - own[0]) if lead else 0.0
    return Followed(times, *made._replace(mode=made.mode.astype(str)), clip_from, offset)


def frame_by_frame(
    retargeter: Follows,
    x: np.ndarray,
    dt: np.ndarray,
    start: np.ndarray | None,
    progress: Progress | None,
) -> Rows:
    """As a stream has to, which does not know what comes; given joints stand as they are held."""
    stream, rows = retargeter.start(start, given=()), []
    for frame, step in zip(x, dt, strict=True):
        began = clock.perf_counter()
        row = stream.step(frame, step)
        rows.append((*row[:6], clock.perf_counter() - began, row.v))
        if progress:
            progress(1)
    return rows_of(rows)


def _late(progress: Progress | None, lead: int) -> Progress | None:
    """Count frames alone, not those of a lead-in."""
    if not progress or not lead:
        return progress
    left = lead

    def counted(rows: int) -> None:
        nonlocal left
        own = max(rows - left, 0)
        left = max(left - rows, 0)
        if own:
            progress(own)

    return counted


def approach(x_from: np.ndarray, x_to: np.ndarray, count: int) -> np.ndarray:
    """Skeletons that lead from one to another, slow at both ends, neither included, (count, 21).

    Each bone turns through the plane of its two directions; one that must turn about goes by any.
    """
    s = np.arange(1, count + 1)[:, None, None] / (count + 1)
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)  # least jerk
    return turned(x_from.reshape(1, 7, 3), x_to.reshape(1, 7, 3), s).reshape(count, -1)


def turned(a: np.ndarray, b: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Unit vectors some way from one to another, each through the plane of the two.

    Args:
        a, b: unit vectors, (m, k, 3).
        s: share of the angle between them, (m, 1, 1).
    """
    angle = np.arccos(np.clip((a * b).sum(axis=2, keepdims=True), -1.0, 1.0))
    aside = b - (a * b).sum(axis=2, keepdims=True) * a
    least = np.abs(a).argmin(axis=2)[..., None]
    other = np.cross(a, np.eye(3)[least[..., 0]])
    aside = np.where(np.linalg.norm(aside, axis=2, keepdims=True) > 1e-6, aside, other)
    aside = aside / np.linalg.norm(aside, axis=2, keepdims=True)
    made = np.cos(s * angle) * a + np.sin(s * angle) * aside
    return made / np.linalg.norm(made, axis=2, keepdims=True)


def _standing(q: np.ndarray) -> Rows:
    """The row of a robot that stands where it was told to begin."""
    return rows_of([(np.array(q, float), Mode.START, *[np.nan] * 5, np.zeros(len(q)))])


def _stack(one: Rows, other: Rows) -> Rows:
    return Rows(*(np.concatenate(pair) for pair in zip(one, other, strict=True)))


def _motion(x: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, times = np.asarray(x, float), np.asarray(times, float)
    if x.ndim != 2 or x.shape[1] != DIM or times.shape != (len(x),) or not len(x):
        raise ParameterError(
            f"a motion needs skeletons (n, {DIM}) and n times, got {x.shape} and {times.shape}"
        )
    if not np.isfinite(times).all() or not (np.diff(times) >= SHORTEST).all():
        raise ParameterError(f"the times of a motion must rise by {SHORTEST:g} s and more a row")
    return x, times
