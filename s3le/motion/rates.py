"""A certified motion at another rate: the same path, told in other samples.

Between certified poses the joints move straight, so every pose of that polyline is certified too,
and a step between two samples of one straight piece lies on the proven path. A step over a corner
cuts it: such a step is proven anew, and where it cannot be, the corner's own pose becomes a row
of its own, between two rows of the rate; or the motion is refused where rows must be even.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.safety.paths import CERTIFIED

RATES = (30.0, 1000.0)  # [Hz]
ON_CORNER = 1e-7  # a sample this close to a corner, in samples, is that corner
MOST_ROWS = 10_000_000


class Emission(NamedTuple):
    """The rows to be written."""

    time: np.ndarray  # [s], (m,)
    q: np.ndarray  # [rad], (m, n_dof), each on the path
    corner: np.ndarray  # int (m,), which given pose a row is; -1: between two
    next: np.ndarray  # int (m,), the given pose that a row is, or that it moves to
    cut: int  # corners that were cut, each proven
    kept: int  # rows that the rate does not have: corners that could not be cut


def at_rate(
    robot: Robot, time: np.ndarray, q: np.ndarray, rate: float, margin_between: float
) -> Emission:
    """Sample a motion at a rate.

    Args:
        robot: whose motion it is.
        time: of the poses, rising [s], (n,).
        q: poses whose straight paths are certified [rad], (n, n_dof).
        rate: rows per second [Hz], in RATES.
        margin_between: what cut corners must keep [m].

    Raises:
        ParameterError: rate is out of its range, or the motion too long for it.
    """
    check_rate(rate)
    return _sample(robot, time, q, rate, margin_between)


def evenly(
    robot: Robot, time: np.ndarray, q: np.ndarray, rate: float, margin_between: float
) -> Emission:
    """Sample a motion at a rate, with no row between two of the rate's.

    Args:
        robot, time, q, margin_between: see at_rate.
        rate: rows per second [Hz], any that check_rate or the clip's own reader lets pass.

    Raises:
        ParameterError: a corner cannot be cut; says where, and what does instead.
    """
    made = _sample(robot, time, q, rate, margin_between)
    if made.kept:
        place = (made.time - made.time[0]) * rate
        first = int(np.argmax(np.abs(place - np.rint(place)) > ON_CORNER / 2))
        raise ParameterError(
            f"at an even {rate:g} Hz {made.kept} of its poses cannot be passed by on a proven "
            f"path, one at {made.time[first]:.4f} s; give a whole multiple of its own rate as "
            "--rate, which passes through all of them"
        )
    return made


def check_rate(rate: float) -> None:
    """Refuse a rate outside RATES [Hz].

    Raises:
        ParameterError: it is.
    """
    if not RATES[0] <= rate <= RATES[1]:
        raise ParameterError(f"rate must be in [{RATES[0]:g}, {RATES[1]:g}] Hz, got {rate!r}")


def _sample(
    robot: Robot, time: np.ndarray, q: np.ndarray, rate: float, margin_between: float
) -> Emission:
    """Rows at a rate, and the corners between them that could not be cut."""
    span = (time[-1] - time[0]) * rate
    if not span < MOST_ROWS:
        raise ParameterError(f"{span:.0f} rows at {rate:g} Hz; at most {MOST_ROWS} are made")
    grid = time[0] + np.arange(int(span + ON_CORNER) + 1) / rate
    left, corner = _place(time, grid, rate)
    made = _interpolate(time, q, grid, left, corner)
    proven = paths.certify(robot, made, margin_between).status == CERTIFIED
    # Given poses strictly inside a step: it runs from after `inner` to before `outer`.
    inner = np.where(corner >= 0, corner, left)[:-1] + 1
    outer = np.where(corner >= 0, corner, left + 1)[1:]
    crossed = np.maximum(outer - inner, 0)
    open_steps = np.flatnonzero((crossed > 0) & ~proven)
    added = [np.arange(inner[k], outer[k]) for k in open_steps]
    extra = np.concatenate([np.zeros(0, int), *added])
    grid = np.concatenate([grid, time[extra]])
    order = np.argsort(grid, kind="stable")
    left = np.concatenate([left, np.minimum(extra, max(len(time) - 2, 0))])[order]
    corner = np.concatenate([corner, extra])[order]
    made = np.concatenate([made, q[extra]])[order]
    upcoming = np.where(corner >= 0, corner, left + 1)
    return Emission(
        grid[order], made, corner, upcoming, int(crossed.sum()) - len(extra), len(extra)
    )


def as_given(time: np.ndarray, q: np.ndarray) -> Emission:
    """A motion as it is."""
    rows = np.arange(len(time))
    return Emission(np.array(time), np.array(q), rows, rows, 0, 0)


def _place(time: np.ndarray, grid: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Which straight piece each sample lies on, and which corner it is (-1: none)."""
    if len(time) < 2:
        return np.zeros(len(grid), int), np.zeros(len(grid), int)
    left = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 2)
    to_left, to_right = grid - time[left], time[left + 1] - grid
    near = np.where(np.abs(to_left) <= np.abs(to_right), left, left + 1)
    close = np.minimum(np.abs(to_left), np.abs(to_right)) * rate <= ON_CORNER
    return left, np.where(close, near, -1)


def _interpolate(
    time: np.ndarray, q: np.ndarray, grid: np.ndarray, left: np.ndarray, corner: np.ndarray
) -> np.ndarray:
    if len(time) < 2:
        return q[left]
    share = (grid - time[left]) / (time[left + 1] - time[left])
    share = np.clip(share, 0.0, 1.0)[:, None]
    a, b = q[left], q[left + 1]
    # Rounding must not carry a joint that rests on its limit beyond it.
    made = np.clip((1.0 - share) * a + share * b, np.minimum(a, b), np.maximum(a, b))
    on = corner >= 0
    made[on] = q[corner[on]]
    return made
