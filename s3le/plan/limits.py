"""What a motion must keep in time, and whether rows of poses do.

Speed of a step is the difference of its two rows over its duration. Acceleration at a row is the
difference of the speeds of the two steps that meet there over the mean of their durations: the
second difference of positions over the squared mean step, for even rows.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.robot.robot import Robot

ACCELERATION = 60.0  # [rad/s^2], of a joint whose robot file says nothing
ROUNDING = 1e-9  # share by which a speed or an acceleration may exceed its limit: of floats
SHORTEST = 1e-6  # [s], least time from row to row


class Limits(NamedTuple):
    """What each joint may do, (n,)."""

    lower: np.ndarray  # [rad]
    upper: np.ndarray  # [rad]
    speed: np.ndarray  # [rad/s]; inf: any
    acceleration: np.ndarray  # [rad/s^2]; inf: any


def limits(
    robot: Robot, acceleration: float | np.ndarray | None = None, speed_factor: float = 1.0
) -> Limits:
    """The limits of a robot.

    Args:
        robot: the robot; positions and speeds are its file's. A speed of 0 is none.
        acceleration: one for all joints, or one each (n,) [rad/s^2]; inf: any. None: the robot
            file's, and ACCELERATION where it says nothing.
        speed_factor: share of the speeds that is used, in (0, 1].

    Raises:
        ParameterError: a number is out of its range.
    """
    n = robot.n_dof
    speed = np.array([joint.velocity for joint in robot.joints], float)
    speed[~(speed > 0.0)] = np.inf
    if not 0.0 < speed_factor <= 1.0:
        raise ParameterError(f"speed factor must be in (0, 1], got {speed_factor!r}")
    if acceleration is None:
        own = [joint.acceleration for joint in robot.joints]
        acceleration = np.array([ACCELERATION if one is None else one for one in own])
    try:
        most = np.broadcast_to(np.asarray(acceleration, float), (n,)).copy()
    except (TypeError, ValueError):
        raise ParameterError(
            f"acceleration must be a number or {n} numbers, got {acceleration!r}"
        ) from None
    if not (most > 0.0).all():  # catches NaN
        raise ParameterError(
            f"the acceleration of {robot.joint_names[int(np.argmin(most > 0.0))]} must be "
            f"above 0 rad/s^2, got {most[int(np.argmin(most > 0.0))]!r}"
        )
    return Limits(robot.lower.copy(), robot.upper.copy(), speed * speed_factor, most)


def motion(times: np.ndarray, q: np.ndarray, n_dof: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows as arrays of float, refused where they are no motion.

    Raises:
        ParameterError: shapes differ, a number is not finite, or times do not rise.
    """
    try:
        times, q = np.ascontiguousarray(times, float), np.ascontiguousarray(q, float)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError("times and poses of a motion must be numbers") from None
    if q.ndim != 2 or q.shape[1] != n_dof or not len(q) or times.shape != (len(q),):
        raise ParameterError(
            f"a motion needs poses (m, {n_dof}) and m times, got {q.shape} and {times.shape}"
        )
    if not (finite := np.isfinite(q)).all():
        row, joint = np.argwhere(~finite)[0]
        raise ParameterError(f"row {row}: joint {joint} is not finite ({q[row, joint]!r})")
    if not np.isfinite(times).all() or not (np.diff(times) >= SHORTEST).all():
        raise ParameterError(f"the times of a motion must rise by {SHORTEST:g} s and more a row")
    return times, q


def speeds(times: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Speed of each step [rad/s], (m - 1, n)."""
    return np.diff(q, axis=0) / np.diff(times)[:, None]


def changing(times: np.ndarray) -> np.ndarray:
    """Time in which the speed of a straight motion changes at each row [s], (m,)."""
    dt = np.diff(times, prepend=times[0], append=times[-1])
    return 0.5 * (dt[:-1] + dt[1:])


def accelerations(times: np.ndarray, q: np.ndarray, lasts: np.ndarray | None = None) -> np.ndarray:
    """Acceleration at each row but the first and the last [rad/s^2], (m - 2, n).

    Args:
        times: [s], (m,).
        q: [rad], (m, n).
        lasts: time in which the speed changes at each row [s], (m,); None: changing(times).
    """
    lasts = changing(times) if lasts is None else lasts
    return np.diff(speeds(times, q), axis=0) / lasts[1:-1, None]


def broken(
    times: np.ndarray, q: np.ndarray, most: Limits, lasts: np.ndarray | None = None
) -> np.ndarray:
    """Rows that take part in something beyond the limits, bool (m,).

    A step that is too fast marks both its rows, an acceleration that is too high all three.

    Args:
        times: [s], (m,).
        q: [rad], (m, n).
        most: the limits.
        lasts: see accelerations.
    """
    bad = np.logical_not(((q >= most.lower) & (q <= most.upper)).all(axis=1))
    fast = ~(np.abs(speeds(times, q)) <= most.speed * (1.0 + ROUNDING)).all(axis=1)
    bad[:-1] |= fast
    bad[1:] |= fast
    hard = np.abs(accelerations(times, q, lasts)) <= most.acceleration * (1.0 + ROUNDING)
    hard = ~hard.all(axis=1)
    for shift in range(3):
        bad[shift : len(bad) - 2 + shift] |= hard
    return bad


def stretches(bad: np.ndarray, reach: int, m: int) -> list[tuple[int, int]]:
    """Stretches of rows around the bad ones, not touching one another."""
    found: list[tuple[int, int]] = []
    for row in np.flatnonzero(bad).tolist():
        start, stop = max(row - reach, 0), min(row + reach + 1, m)
        if found and start <= found[-1][1] + 4:
            found[-1] = found[-1][0], stop
        else:
            found.append((start, stop))
    return found
