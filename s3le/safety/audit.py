"""Does a trajectory hold? Limits, speeds, clearance at every pose, and a proof for every path.

Poses are measured by coal (s3le.robot.certificate), the paths between them are proven
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
from s3le.robot.ranges import origin
from s3le.robot.robot import Robot
from s3le.safety import checks, covered
from s3le.safety.checks import Check, Finding, say
from s3le.safety.paths import BUDGET, CERTIFIED, COLLIDES, certify

STRAIGHT = "straight"  # how joints move between rows
CUBIC = "the cubic that meets positions and speeds"


class Demands(NamedTuple):
    """What is asked of a trajectory."""

    margin: float  # [m], clearance of every pose, above 0
    margin_between: float  # [m], clearance on the paths between, above 0, at most margin
    velocity: np.ndarray  # [rad/s], (n_dof,), inf: none known
    budget: int = BUDGET  # poses that the proof of one path may look at
    acceleration: np.ndarray | None = None  # [rad/s^2], (n_dof,), inf: any; None: not asked


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
    v: np.ndarray | None = None,
) -> Report:
    """Check a trajectory, pose by pose and path by path.

    Args:
        robot: whose trajectory it is.
        time: rising [s], (n,).
        q: poses [rad], (n, n_dof), n at least 1.
        wanted: what is asked of it.
        at_rows: clearance asked of each pose [m], (n,), instead of wanted.margin; a row of which
            less is asked lies between two others, and no way to rest is asked of it.
        progress: called with numbers of further rows done; 2 n - 1 in all.
        v: speeds [rad/s], (n, n_dof); then the joints move between rows on the cubics that meet
            them, at every moment of which limits, speeds and accelerations are held against what
            is wanted; where accelerations are asked for, so is a proven way to rest from each row.
    """
    if robot.margin != wanted.margin:
        robot = replace(robot, margin=wanted.margin)
    time, q = np.asarray(time, float), np.ascontiguousarray(q, float)
    margin = np.full(len(q), wanted.margin) if at_rows is None else at_rows
    paths = certify(robot, q, wanted.margin_between, wanted.budget, progress, time, v)
    checker = robot.certifier()
    poses = checker.check(q, progress)
    hardest = wanted.acceleration
    low, high = q, q
    more: list[Check] = []
    if v is None:
        speed = np.abs(np.diff(q, axis=0)) / np.diff(time)[:, None]  # (n - 1, n_dof)
        if hardest is not None:
            more = [checks.accelerations(robot, time, q, hardest)]
    else:
        speed, bent, low, high = checks.between(time, q, v)
        if hardest is not None:
            more = [
                checks.bends(robot, time, bent, hardest),
                checks.stops(robot, time, q, v, hardest, wanted.margin_between, margin),
            ]
    clear = poses.clearance >= margin  # NaN compares False
    proven = paths.status == CERTIFIED
    return Report(
        rows=len(q),
        seconds=float(time[-1] - time[0]),
        checks=(
            checks.limits(robot, time, low, high),
            checks.velocities(robot, time, speed, wanted.velocity),
            *more,
            checks.poses(robot, time, poses.clearance, poses.pair, margin, clear),
            checks.paths(robot, time, q, v, paths, wanted.margin_between),
        ),
        deep=int((poses.clearance < 0.0).sum()),
        between=int(((paths.status == COLLIDES) & clear[:-1] & clear[1:]).sum()),
        least=float(poses.clearance.min()),
        bound=float(paths.bound.min(initial=np.inf)) if proven.all() and len(proven) else np.nan,
        fastest=float(speed.max(initial=0.0)),
        clearance=poses.clearance,
    )


def certificate(robot: Robot, wanted: Demands, report: Report, v: bool = False) -> dict[str, Any]:
    """What was shown of a trajectory that holds, and what was not, as JSON can hold it.

    v says that speeds were told with it.
    """
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
        "between_rows": CUBIC if v else STRAIGHT,
        "covers": "watched pairs of the modelled capsules on the joint paths between rows"
        + (
            ", and on the motion to rest from each row; "
            if v and wanted.acceleration is not None
            else "; "
        )
        + "no dynamics, no tracking error",
        "not_covered": not_covered(robot),
        "by_design": by_design(robot),
        "not_covered_links": covered.tree(robot),
        "holds": report.holds,
    }


def straight_rows(astray: int) -> dict[str, Any]:
    """Whether rows of a curve hold too if joints go straight between them, as JSON can hold it.

    Args:
        astray: steps of which it is not proven.
    """
    return {
        "proven": astray == 0,
        "steps_not_proven": astray,
        "about": "joints that move straight from row to row; what is certified is the curve",
    }


def not_covered(robot: Robot) -> list[dict[str, str]]:
    """The pairs of bodies that nothing is said about, with the reason."""
    return [
        {"a": a, "b": b, "kind": kind, "reason": reason} for a, b, kind, reason in robot.unwatched()
    ]


def by_design(robot: Robot) -> list[dict[str, Any]]:
    """Pairs of bodies that overlap by design: the baseline that they come no deeper than.

    Poses come at most pairs.RESTING deeper, the paths between them pairs.DEEPER; where no angles
    can bring them deeper, that is proven, and said.
    """
    names = [origin(body.name) for body in robot.bodies]
    return [
        {"a": names[p.a], "b": names[p.b], "kind": p.kind, "reason": p.reason,
         "baseline_m": p.baseline}
        for p in robot.pairs if robot.designed(p)
    ]  # fmt: skip


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


def _tree(one: Finding | None) -> dict[str, Any] | None:
    return one and {key: _number(value) for key, value in one._asdict().items()}


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value
