"""A certified motion told in other rows: samples of the same curve, with nothing cut.

A motion of rows of position and speed is a curve, so a row may be put wherever one is wanted. If a
new rate is a whole multiple of the motion's own, every step between two new rows lies on one piece
of the curve: it is what was proven. So a clip is followed at such a rate (`planned`) to begin with.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.safety.paths import sampled

RATES = (30.0, 1000.0)  # [Hz]
ON_ROW = 1e-6  # a moment this close to a row, in rows, is that row's
MOST_ROWS = 10_000_000


class Emission(NamedTuple):
    """The rows to be written."""

    time: np.ndarray  # [s], (m,)
    q: np.ndarray  # [rad], (m, n_dof), each on the path
    v: np.ndarray | None  # [rad/s], (m, n_dof); None: straight from row to row
    own: np.ndarray  # int (m,), which row of the motion it is; -1: between two
    next: np.ndarray  # int (m,), the row of the motion that it is, or that it moves to


def planned(rate: float, own: float) -> float:
    """The rate [Hz] to follow a clip at: the one nearest to its own that divides the one wanted.

    Args:
        rate: of the rows wanted [Hz].
        own: of the clip [Hz].
    """
    found = rate / max(1, round(rate / own))
    return own if abs(found - own) <= 1e-9 * own else found


def on_grid(time: np.ndarray, rate: float) -> bool:
    """Does every row lie where rows at this rate [Hz] would, from the first one on?"""
    place = (time - time[0]) * rate
    return bool((np.abs(place - np.rint(place)) <= ON_ROW).all())


def at_rate(time: np.ndarray, q: np.ndarray, v: np.ndarray, rate: float) -> Emission:
    """Sample a motion at a rate.

    Args:
        time, q, v: rows [s], (n,), [rad], [rad/s], (n, n_dof); each lies on the rate's grid.
        rate: rows per second [Hz].

    Raises:
        ParameterError: the motion is too long for it, or a row lies off its grid.
    """
    span = (time[-1] - time[0]) * rate
    if not span < MOST_ROWS:
        raise ParameterError(f"{span:.0f} rows at {rate:g} Hz; at most {MOST_ROWS} are made")
    if not on_grid(time, rate):
        raise ParameterError(f"not every row of the motion is one at {rate:g} Hz")
    if len(time) == 1:
        return as_given(time, q, v)
    count = round(float(span)) + 1
    moments = time[0] + np.arange(count) / rate
    place = np.rint((time - time[0]) * rate).astype(int)  # of each row among the new ones
    own = np.full(count, -1)
    own[place] = np.arange(len(time))
    upcoming = np.searchsorted(place, np.arange(count))
    left = np.clip(upcoming - (own < 0), 0, len(time) - 2)
    made_q, made_v = sampled(time, q, v, left, moments)
    known = own >= 0
    made_q[known], made_v[known] = q[own[known]], v[own[known]]
    moments[known] = time[own[known]]
    return Emission(moments, made_q, made_v, own, upcoming)


def as_given(time: np.ndarray, q: np.ndarray, v: np.ndarray | None = None) -> Emission:
    """A motion as it is."""
    rows = np.arange(len(time))
    kept = None if v is None else np.array(v)
    return Emission(np.array(time), np.array(q), kept, rows, rows)


def check_rate(rate: float) -> None:
    """Refuse a rate outside RATES [Hz].

    Raises:
        ParameterError: it is.
    """
    if not RATES[0] <= rate <= RATES[1]:
        raise ParameterError(f"rate must be in [{RATES[0]:g}, {RATES[1]:g}] Hz, got {rate!r}")
