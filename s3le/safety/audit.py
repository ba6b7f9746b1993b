"""Does a trajectory hold? Limits, speeds, clearance at every pose, and a proof for every path.

Poses are measured by coal (s3le.robot.certificate), the straight paths between them are proven
(s3le.safety.paths); where a path collides, coal says how deep at the pose that the proof found.
What could not be decided counts as broken. Nothing is said of the pairs of bodies that are not
watched (Robot.unwatched), of what is drawn of the robot beyond its bodies (s3le.safety.covered),
of dynamics, or of how well a robot tracks it.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.robot.certificate import Certifier
from s3le.robot.robot import Robot
from s3le.safety import covered
from s3le.safety.paths import BUDGET, CERTIFIED, COLLIDES, UNDECIDED, Segments, certify

ROUNDING = 1e-6  # share by which speed, acceleration may exceed a limit: files round their times
PLACES = 5  # worst places that are named, at most one of each run of neighbours


class Demands(NamedTuple):
    """What is asked of a trajectory."""

    margin: float  # [m], clearance of every pose, above 0
    margin_between: float  # [m], clearance on the paths between, above 0, at most margin
    velocity: np.ndarray  # [rad/s], (n_dof,), inf: none known
    budget: int = BUDGET  # poses that the proof of one path may look at
    acceleration: np.ndarray | None = None  # [rad/s^2], (n_dof,), inf: any; None: not asked


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


class Report(NamedTuple):
    """What an audit found."""

    rows: int
    seconds: float
    checks: tuple[Check, ...]
    deep: int  # poses in which watched bodies overlap
    between: int  # paths that collide although both their ends keep the margin
    least: float  # [m], least clearance of a pose
    bound: float  # [m], proven lower bound of the clearance on all paths; NaN: not all are proven
    fastest: float  # [rad/s], highest speed of any joint
    clearance: np.ndarray  # [m], (n,), of every pose by coal; NaN: no pose
    given: tuple[Check, ...] = ()  # limits and so on of joints that others move; nothing is held
    # against them, and so it is not counted
    apart: tuple[Check, ...] = ()  # poses and paths, pairs that such joints alone move; these are
    # counted among `checks` too

    @property
    def holds(self) -> bool:
        """True only if every pose and every path is known to be good."""
        return not any(check.broken for check in self.checks)

    @property
    def first(self) -> Finding | None:
        """The earliest thing that does not hold."""
        found = (check.first for check in self.checks if check.first)
        return min(found, key=lambda one: one.time, default=None)

    @property
    def complaint(self) -> str:
        """The earliest thing that does not hold, as a sentence; empty if everything does."""
        first = self.first
        return next((say(c.name, first) for c in self.checks if first and c.first is first), "")


def demands(
    robot: Robot,
    margin: float | None = None,
    margin_between: float | None = None,
    velocity: dict[str, float] | float | None = None,
    budget: int = BUDGET,
    acceleration: dict[str, float] | float | None = None,
) -> Demands:
    """Demands that fit a robot; what is not given is the robot's own.

    Args:
        robot: the robot.
        margin: [m]; robot.margin if None.
        margin_between: [m]; a quarter of margin if None.
        velocity: one limit for all joints, or some by name, instead of the URDF's [rad/s].
        budget: see segments.certify.
        acceleration: one limit for all joints, or some by name (the others may do anything)
            [rad/s^2]; None: it is not looked at.

    Raises:
        ParameterError: a number is out of its range, or a joint unknown.
    """
    margin = robot.margin if margin is None else margin
    if not 0.0 < margin < np.inf:
        raise ParameterError(f"margin must be above 0 m, got {margin!r}")
    margin_between = margin / 4 if margin_between is None else margin_between
    if not 0.0 < margin_between <= margin:
        raise ParameterError(
            f"margin_between must be above 0 and at most margin, {margin!r} m, "
            f"got {margin_between!r}"
        )
    limit = np.array([joint.velocity for joint in robot.joints])
    limit[~(limit > 0.0)] = np.inf  # a URDF without a limit is read as 0
    limit = _by_joint(robot, "velocity", "rad/s", velocity, limit)
    hardest = None
    if acceleration is not None:
        free = np.full(robot.n_dof, np.inf)
        hardest = _by_joint(robot, "acceleration", "rad/s^2", acceleration, free)
    return Demands(float(margin), float(margin_between), limit, int(budget), hardest)


def _by_joint(
    robot: Robot, what: str, unit: str, given: dict[str, float] | float | None, limit: np.ndarray
) -> np.ndarray:
    """A limit for each joint, those that are given in place of the others."""
    names = robot.joint_names
    for joint, value in (given if isinstance(given, dict) else dict.fromkeys(names, given)).items():
        if joint not in names:
            raise ParameterError(f"{what} names '{joint}'; joints: {', '.join(names)}")
        if value is None:
            continue
        if not value > 0.0:
            raise ParameterError(f"the {what} of {joint} must be above 0 {unit}, got {value!r}")
        limit[names.index(joint)] = value
    limit.setflags(write=False)
    return limit


def audit(
    robot: Robot,
    time: np.ndarray,
    q: np.ndarray,
    wanted: Demands,
    at_rows: np.ndarray | None = None,
    progress: Callable[[int], object] | None = None,
) -> Report:
    """Check a trajectory, pose by pose and path by path.

    Args:
        robot: whose trajectory it is.
        time: rising [s], (n,).
        q: poses [rad], (n, n_dof), n at least 1.
        wanted: what is asked of it.
        at_rows: clearance asked of each pose [m], (n,), instead of wanted.margin.
        progress: called with numbers of further rows done; 2 n - 1 in all.
    """
    if robot.margin != wanted.margin:
        robot = replace(robot, margin=wanted.margin)
    time, q = np.asarray(time, float), np.ascontiguousarray(q, float)
    margin = np.full(len(q), wanted.margin) if at_rows is None else at_rows
    paths = certify(robot, q, wanted.margin_between, wanted.budget, progress)
    checker = robot.certifier()
    poses = checker.check(q, progress)
    speed = np.abs(np.diff(q, axis=0)) / np.diff(time)[:, None]  # (n - 1, n_dof)
    hardest = wanted.acceleration
    clear = poses.clearance >= margin  # NaN compares False
    proven = paths.status == CERTIFIED
    return Report(
        rows=len(q),
        seconds=float(time[-1] - time[0]),
        checks=(
            _limits(robot, time, q),
            _velocities(robot, time, speed, wanted.velocity),
            *([] if hardest is None else [accelerations(robot, time, q, hardest)]),
            _poses(robot, time, poses.clearance, poses.pair, margin, clear),
            _paths(robot, checker, time, q, paths, wanted.margin_between),
        ),
        deep=int((poses.clearance < 0.0).sum()),
        between=int(((paths.status == COLLIDES) & clear[:-1] & clear[1:]).sum()),
        least=float(poses.clearance.min()),
        bound=float(paths.bound.min(initial=np.inf)) if proven.all() and len(proven) else np.nan,
        fastest=float(speed.max(initial=0.0)),
        clearance=poses.clearance,
    )


def certificate(robot: Robot, wanted: Demands, report: Report) -> dict[str, Any]:
    """What was shown of a trajectory that holds, and what was not, as JSON can hold it."""
    more: dict[str, Any] = {}
    if wanted.acceleration is not None:
        more["acceleration_rad_s2"] = {
            name: _number(float(limit))
            for name, limit in zip(robot.joint_names, wanted.acceleration, strict=True)
        }
    if ranges := robot.description.ranges:
        more["given_ranges_rad"] = {name: list(ends) for name, ends in ranges.items()}
    return more | {
        "robot": robot.name,
        "robot_hash": robot.digest,
        "poses": {"checked": report.rows, "by": "coal", "least_clearance_m": report.least},
        "paths": {"proven": max(report.rows - 1, 0), "bound_m": _number(report.bound)},
        "margin_m": wanted.margin,
        "margin_between_m": wanted.margin_between,
        "velocity_rad_s": {
            name: _number(limit)
            for name, limit in zip(robot.joint_names, wanted.velocity, strict=True)
        },
        "covers": "watched pairs of the modelled capsules on straight joint paths; "
        "no dynamics, no tracking error",
        "not_covered": not_covered(robot),
        "not_covered_links": covered.tree(robot),
        "holds": report.holds,
    }


def not_covered(robot: Robot) -> list[dict[str, str]]:
    """The pairs of bodies that nothing is said about, with the reason."""
    return [
        {"a": a, "b": b, "kind": kind, "reason": reason} for a, b, kind, reason in robot.unwatched()
    ]


def tree(report: Report) -> dict[str, Any]:
    """A report as JSON can hold it; what is not known is null."""
    found = {
        "holds": report.holds,
        "rows": report.rows,
        "seconds": report.seconds,
        "poses_overlapping": report.deep,
        "paths_colliding_between_clear_poses": report.between,
        "least_clearance_m": _number(report.least),
        "proven_bound_m": _number(report.bound),
        "fastest_rad_s": _number(report.fastest),
        "first": _tree(report.first),
        "checks": _checks(report.checks),
    }
    if report.given:
        found["given"] = _checks(report.given)
        found["moved_by_given_joints_alone"] = _checks(report.apart)
    return found


def _checks(checks: tuple[Check, ...]) -> dict[str, Any]:
    return {
        check.name: {
            "unit": check.unit,
            "total": check.total,
            "broken": check.broken,
            "undecided": check.undecided,
            "first": _tree(check.first),
            "worst": [_tree(one) for one in check.worst],
        }
        for check in checks
    }


def say(check: str, one: Finding) -> str:
    """What a check of this name found, as a sentence."""
    when = f"{one.time:.4f} s (row {one.row}): "
    if check in ("limits", "velocities", "accelerations") and np.isnan(one.value):
        return when + f"{one.what} is not a number"
    if check == "limits" and one.value < 0:
        return when + f"{one.what} is {-one.value:.5f} rad outside its range"
    if check == "limits":
        return when + f"{one.what} is {one.value:.5f} rad from the end of its range"
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


def _tree(one: Finding | None) -> dict[str, Any] | None:
    return one and {key: _number(value) for key, value in one._asdict().items()}


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _limits(robot: Robot, time: np.ndarray, q: np.ndarray) -> Check:
    inside = np.minimum(q - robot.lower, robot.upper - q)  # (n, n_dof)
    joint = inside.argmin(axis=1)
    least = inside[np.arange(len(q)), joint]
    name = robot.joint_names
    return _check(
        "limits", "rad", time, ~(least >= 0.0), least, least, lambda i: name[joint[i]], 0.0
    )


def _velocities(robot: Robot, time: np.ndarray, speed: np.ndarray, limit: np.ndarray) -> Check:
    share = speed / limit  # of a limit that is not known: 0
    joint = share.argmax(axis=1) if len(share) else np.zeros(0, int)
    rows = np.arange(len(share))
    worst, fast = share[rows, joint], speed[rows, joint]
    name = robot.joint_names
    return _check(
        "velocities", "rad/s", time, ~(worst <= 1.0 + ROUNDING), -worst, fast,
        lambda i: name[joint[i]], limit[joint],
    )  # fmt: skip


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
    share = hard / limit
    joint = share.argmax(axis=1) if len(share) else np.zeros(0, int)
    rows = np.arange(len(share))
    worst, name = share[rows, joint], robot.joint_names
    return _check(
        "accelerations", "rad/s^2", time[1:-1], ~(worst <= 1.0 + ROUNDING), -worst,
        hard[rows, joint], lambda i: name[joint[i]], limit[joint], first=1,
    )  # fmt: skip


def _poses(
    robot: Robot,
    time: np.ndarray,
    clearance: np.ndarray,
    pair: np.ndarray,
    margin: np.ndarray,
    clear: np.ndarray,
) -> Check:
    return _check(
        "poses", "m", time, ~clear, clearance - margin, clearance,
        lambda i: robot.pair_name(pair[i]) if pair[i] >= 0 else "", margin,
    )  # fmt: skip


def _paths(
    robot: Robot,
    checker: Certifier,
    time: np.ndarray,
    q: np.ndarray,
    paths: Segments,
    margin: float,
) -> Check:
    """Paths by coal's word where the proof found a pose that is too close."""
    hit = np.flatnonzero(paths.status == COLLIDES)
    t = paths.t[hit][:, None]
    seen = checker.check((1.0 - t) * q[hit] + t * q[hit + 1])
    value, pair = paths.bound.copy(), paths.pair.copy()
    value[hit], pair[hit] = seen.clearance, seen.pair
    when = time[:-1].copy()
    when[hit] += t[:, 0] * np.diff(time)[hit]
    unknown = paths.status == UNDECIDED
    value[unknown] = np.nan
    order = np.where(unknown, np.inf, value)  # last: how bad they are is not known
    found = _check(
        "paths", "m", when, paths.status != CERTIFIED, order, value,
        lambda i: robot.pair_name(pair[i]) if pair[i] >= 0 else "", margin,
    )  # fmt: skip
    return found._replace(undecided=int(unknown.sum()))


def _check(
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
