"""Motions whose accelerations change gently: a limit of jerk that planning aims at.

It is no claim, and nothing is refused for it. Rows about a change of acceleration beyond the limit
are planned once more from where they are, with a price on accelerations that grows until the limit
is kept; where that would leave something unproven, they stay as they were. What comes out is told.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from s3le.plan import limits

if TYPE_CHECKING:
    from s3le.plan.whole import _Job

Motion = tuple[np.ndarray, np.ndarray, np.ndarray | None]  # time, q, v
_PRICES = tuple(2.0**k for k in range(13))  # of squared second differences [1/rad^2], in turn,
_EVERY = 1.0 / 30.0  # [s], of rows so far apart; it grows as their square squared falls
_BURSTS = 3  # times that rows are planned at each of these


def jerks(
    time: np.ndarray,
    q: np.ndarray,
    v: np.ndarray | None = None,
    lasts: np.ndarray | None = None,
) -> np.ndarray:
    """How fast the acceleration changes from each to the next [rad/s^3], (k, n); empty: too short.

    Of a curve the mean acceleration of each step; of straight rows that at each row.

    Args:
        time: of the rows [s], (m,).
        q: [rad], (m, n).
        v: [rad/s], (m, n); None: joints go straight from row to row.
        lasts: time in which the speed of these changes at each row; see limits.accelerations.
    """
    if v is not None:
        step = np.diff(time)
        return np.diff(np.diff(v, axis=0) / step[:, None], axis=0) / _between(step)[:, None]
    if len(time) < 4:
        return np.empty((0, q.shape[1]))
    return np.diff(limits.accelerations(time, q, lasts), axis=0) / np.diff(time)[1:-1, None]


def about(motions: Iterable[Motion], limit: float) -> dict[str, float | int | None]:
    """What a summary tells of the jerk of motions.

    Args:
        motions: time, q and v of each, see jerks.
        limit: that was aimed at [rad/s^3]; 0: none.
    """
    each = [np.abs(jerks(*motion)).max(axis=1, initial=0.0) for motion in motions]
    found = np.concatenate(each)
    return {
        "limit_rad_s3": limit or None,
        "largest_rad_s3": float(found.max(initial=0.0)),
        "beyond": int((found > limit).sum()) if limit else None,
        "of": len(found),
    }


def ease(job: "_Job", limit: float) -> None:
    """Plan what changes its acceleration too fast once more, as far as all still holds.

    Args:
        job: a motion that is settled; changed.
        limit: [rad/s^3]; 0: none.
    """
    if not limit:
        return
    most = job.its.settings.window
    step = float(np.median(np.diff(job.times))) if len(job.times) > 1 else _EVERY
    for price in _PRICES:
        price *= (_EVERY / step) ** 4
        for first, last in limits.stretches(_rough(job, limit), job.reach, len(job.q)):
            for start in range(first, last, most):
                _window(job, *job.edges(start, min(start + most, last)), price)


def _rough(job: "_Job", limit: float) -> np.ndarray:
    """Rows that take part in a change of acceleration beyond the limit, bool (m,)."""
    rough = np.zeros(len(job.q), bool)
    hit = (np.abs(jerks(job.times, job.q, lasts=job.lasts)) > limit).any(axis=1)
    for shift in range(4):
        rough[shift : shift + len(hit)] |= hit
    return rough


def _window(job: "_Job", start: int, stop: int, price: float) -> None:
    m = len(job.q)
    rows = slice(start, min(stop + job._after, m))
    kept, open_ = job.q.copy(), int(job.close(rows.start, rows.stop).sum())
    for _ in range(_BURSTS):
        job._window(start, stop, stop < m, price)
    good = job.close(rows.start, rows.stop).sum() <= open_
    if not good or limits.broken(job.times, job.q, job.its.most, job.lasts).any():
        job.q[:] = kept
        job.measure(rows.start, rows.stop)


def _between(step: np.ndarray) -> np.ndarray:
    """From the middle of each step to that of the next [s]."""
    return 0.5 * (step[1:] + step[:-1])
