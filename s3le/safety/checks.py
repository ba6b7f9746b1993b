"""Of what an audit consists: kinds of checks over a trajectory, and the places that each names."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from s3le.robot.robot import Robot
from s3le.safety import curve
from s3le.safety.curve import BEYOND
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, Segments, rests, sampled

ROUNDING = 1e-6  # share by which speed, acceleration may exceed a limit: files round their times
PLACES = 5  # worst places that are named, at most one of each run of neighbours


class Finding(NamedTuple):
    """One place where something is broken, or is nearest to it."""

    row: int  # of the pose, or of the one that a step starts at
    time: float  # [s]
    what: str  # the joint, or the two bodies
    value: float  # what was found there, in the check's unit; NaN: not decided
    wanted: float  # what was asked for


class Check(NamedTuple):
    """One kind of demand over a whole trajectory."""

    name: str  # limits, velocities, accelerations (where asked), poses or paths
    unit: str
    total: int  # poses or steps looked at
    broken: int  # of them, how many do not hold; the undecided ones are among them
    undecided: int
    first: Finding | None  # the first that does not hold
    worst: tuple[Finding, ...]  # the worst that do not hold; if all do, the nearest to not doing so


def say(check: str, one: Finding) -> str:
    """What a check of this name found, as a sentence."""
    when = f"{one.time:.4f} s (row {one.row}): "
    if check in ("limits", "velocities", "accelerations") and np.isnan(one.value):
        return when + f"{one.what} is not a number"
    if check == "limits" and one.value < 0:
        return when + f"{one.what} is {-one.value:.5f} rad outside its range"
    if check == "limits":
        return when + f"{one.what} is {one.value:.5f} rad from the end of its range"
    if check == "stops":
        return when + "no way to rest is proven from here"
    if check == "velocities":
        return when + f"{one.what} turns at {one.value:.3f} rad/s of {one.wanted:g}"
    if check == "accelerations":
        return when + f"{one.what} changes speed by {one.value:.2f} rad/s^2 of {one.wanted:g}"
    if not one.what:
        return when + (
            "not decided within the budget (--budget)" if check == "paths" else "no pose"
        )
    if one.value < 0:
        return when + f"{one.what} overlap by {-one.value * 1e3:.3f} mm"
    return when + f"{one.what} are {one.value * 1e3:.3f} mm apart"


def between(
    time: np.ndarray, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What joints do between rows.

    Returns:
        Greatest speed [rad/s] and acceleration [rad/s^2] of each step (n - 1, n_dof), least and
        greatest angle [rad] from each row to the next (n, n_dof).
    """
    shape = (len(q) - 1, q.shape[1])
    speed, bent, low, high = (np.empty(shape) for _ in range(4))
    q, v = np.require(q, float, ["C", "W"]), np.require(v, float, ["C", "W"])
    curve.steps(q, v, np.diff(time), speed, bent, low, high)
    low = np.minimum(q, np.concatenate([low + BEYOND, q[-1:]]))
    high = np.maximum(q, np.concatenate([high - BEYOND, q[-1:]]))
    return speed, bent, low, high


def limits(robot: Robot, time: np.ndarray, low: np.ndarray, high: np.ndarray) -> Check:
    """Least and greatest angle of each row [rad], (n, n_dof), against the joints' ranges."""
    inside = np.minimum(low - robot.lower, robot.upper - high)  # (n, n_dof)
    joint = inside.argmin(axis=1)
    least = inside[np.arange(len(low)), joint]
    name = robot.joint_names
    return check(
        "limits", "rad", time, ~(least >= 0.0), least, least, lambda i: name[joint[i]], 0.0
    )


def velocities(robot: Robot, time: np.ndarray, speed: np.ndarray, limit: np.ndarray) -> Check:
    """Speed of each step [rad/s], (n - 1, n_dof), against the limits (n_dof,)."""
    return _shares(robot, "velocities", "rad/s", time, speed, limit)


def accelerations(robot: Robot, time: np.ndarray, q: np.ndarray, limit: np.ndarray) -> Check:
    """Change of speed from step to step over the mean of their durations, at the row between.

    Args:
        robot: whose joints.
        time: rising [s], (n,).
        q: poses [rad], (n, n_dof).
        limit: of each joint [rad/s^2], (n_dof,); inf: any.
    """
    step = np.diff(time)
    mean = 0.5 * (step[1:] + step[:-1])
    turned = np.diff(q, axis=0) / step[:, None]
    hard = np.abs(np.diff(turned, axis=0)) / mean[:, None]  # (n - 2, n_dof)
    return _shares(robot, "accelerations", "rad/s^2", time[1:-1], hard, limit, first=1)


def bends(robot: Robot, time: np.ndarray, bent: np.ndarray, limit: np.ndarray) -> Check:
    """Greatest acceleration of each step of a motion that tells speeds."""
    return _shares(robot, "accelerations", "rad/s^2", time, bent, limit)


def _shares(
    robot: Robot,
    name: str,
    unit: str,
    time: np.ndarray,
    value: np.ndarray,
    limit: np.ndarray,
    first: int = 0,
) -> Check:
    """Values of each step or row (m, n_dof), at least 0, against the joints' limits (n_dof,)."""
    share = value / limit  # of a limit that is not known: 0
    joint = share.argmax(axis=1) if len(share) else np.zeros(0, int)
    rows = np.arange(len(share))
    worst, names = share[rows, joint], robot.joint_names
    return check(
        name, unit, time, ~(worst <= 1.0 + ROUNDING), -worst, value[rows, joint],
        lambda i: names[joint[i]], limit[joint], first,
    )  # fmt: skip


def stops(
    robot: Robot,
    time: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    acceleration: np.ndarray,
    between: float,
    margin: np.ndarray,
) -> Check:
    """From which rows a way to rest is proven, of those of which the robot's margin is asked.

    Args:
        robot, time, q, v, acceleration, between: see paths.rests.
        margin: asked of each row [m], (n,).
    """
    own = np.flatnonzero(margin >= robot.margin)
    good = rests(robot, time[own], q[own], v[own], acceleration, between)
    value = np.where(good, 1.0, 0.0)
    found = check("stops", "-", time[own], ~good, value, value, lambda i: "", 1.0)

    def placed(one: Finding) -> Finding:
        return one._replace(row=int(own[one.row]))

    first = found.first and placed(found.first)
    return found._replace(first=first, worst=tuple(placed(one) for one in found.worst))


def poses(
    robot: Robot,
    time: np.ndarray,
    clearance: np.ndarray,
    pair: np.ndarray,
    margin: np.ndarray,
    clear: np.ndarray,
) -> Check:
    """Clearance of each row [m], (n,), and its closest pair, against what is asked of it."""
    return check(
        "poses", "m", time, ~clear, clearance - margin, clearance,
        lambda i: robot.pair_name(pair[i]) if pair[i] >= 0 else "", margin,
    )  # fmt: skip


def paths(
    robot: Robot,
    time: np.ndarray,
    q: np.ndarray,
    v: np.ndarray | None,
    paths: Segments,
    margin: float,
) -> Check:
    """Paths by coal's word where the proof found a pose that is too close."""
    hit = np.flatnonzero(paths.status == COLLIDES)
    t = paths.t[hit][:, None]
    when = time[:-1].copy()
    when[hit] += t[:, 0] * np.diff(time)[hit]
    if v is None:
        there = (1.0 - t) * q[hit] + t * q[hit + 1]
    else:
        there = sampled(time, q, v, hit, when[hit])[0]
    seen = robot.certifier(margin).check(there)
    value, pair = paths.bound.copy(), paths.pair.copy()
    value[hit], pair[hit] = seen.clearance, seen.pair
    unknown = paths.status == UNDECIDED
    value[unknown] = np.nan
    order = np.where(unknown, np.inf, value)  # last: how bad they are is not known
    found = check(
        "paths", "m", when, paths.status != CERTIFIED, order, value,
        lambda i: robot.pair_name(pair[i]) if pair[i] >= 0 else "", margin,
    )  # fmt: skip
    return found._replace(undecided=int(unknown.sum()))


def check(
    name: str,
    unit: str,
    time: np.ndarray,
    broken: np.ndarray,
    order: np.ndarray,
    value: np.ndarray,
    what: Callable[[int], str],
    wanted: np.ndarray | float,
    first: int = 0,
) -> Check:
    """Count what is broken and pick the places worth naming: the lower its order, the worse.

    first is the row that the first entry speaks of.
    """
    wanted = np.broadcast_to(wanted, broken.shape)

    def finding(i: int) -> Finding:
        return Finding(int(i) + first, float(time[i]), what(i), float(value[i]), float(wanted[i]))

    rank = np.where(np.isnan(order), -np.inf, order)
    bad = np.flatnonzero(broken)
    if len(bad):
        runs = np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1)
        picked = sorted((run[rank[run].argmin()] for run in runs), key=lambda i: rank[i])
    else:
        picked = [rank.argmin()] if len(rank) else []
    return Check(
        name,
        unit,
        len(broken),
        len(bad),
        0,
        finding(bad[0]) if len(bad) else None,
        tuple(finding(i) for i in picked[:PLACES]),
    )
