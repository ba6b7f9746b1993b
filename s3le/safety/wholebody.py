"""Does a whole-body motion hold, in which others move joints too (legs, hands)?

All pairs of bodies are looked at with all joints moving, by the same engines as in
s3le/safety/audit.py. Limits, speeds and accelerations are asked of our joints; of the given ones it
is told what they break. Clearance counts whoever moved. Pairs that no joint of ours can part (a
leg and the other leg) are told apart: nothing that is decided here would mend them. A floating
base does not move bodies against each other and is left out; the floor is not modelled.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody
from s3le.safety import audit, checks
from s3le.safety.audit import Check, Demands, Report
from s3le.safety.checks import check
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, certify


class Looked(NamedTuple):
    """What one set of pairs keeps in a motion."""

    names: tuple[str, ...]  # of the pairs
    clearance: np.ndarray  # [m], (m,), of every pose by coal
    pair: np.ndarray  # int64 (m,), which has it
    close: np.ndarray  # bool (m,), poses that do not keep what is asked
    status: np.ndarray  # uint8 (m - 1,), of every path
    bound: np.ndarray  # [m], (m - 1,), proven; where a path collides, coal's word at a pose of it
    at: np.ndarray  # int64 (m - 1,), which pair that is; -1: none
    share: np.ndarray  # (m - 1,), where on the path; NaN: nowhere

    @property
    def open(self) -> np.ndarray:
        """Paths that are not proven, bool (m - 1,)."""
        return self.status != CERTIFIED


class Whole(NamedTuple):
    """What was found of a whole-body motion."""

    report: Report  # of all pairs
    ours: Looked  # the pairs that a joint of ours can part
    rest: Looked | None  # the pairs that given joints alone move; None: there is none


def look(
    body: WholeBody,
    time: np.ndarray,
    q: np.ndarray,
    given: np.ndarray,
    wanted: Demands,
    at_rows: np.ndarray | None = None,
    progress: Callable[[int], object] | None = None,
) -> Whole:
    """Check a whole-body motion, pose by pose and path by path.

    Args:
        body: whose motion it is.
        time: rising [s], (m,).
        q: of our joints [rad], (m, n).
        given: of the given joints [rad], (m, k).
        wanted: what is asked, of our joints.
        at_rows: clearance asked of each pose [m], (m,), instead of wanted.margin.
        progress: called with numbers of further rows done; 2 m - 1 in all.
    """
    time, q = np.asarray(time, float), np.ascontiguousarray(q, float)
    whole = body.poses(q, given)
    margin = np.full(len(q), wanted.margin) if at_rows is None else at_rows
    ours = _looked(body.robot, whole, wanted, margin, progress)
    rest = None if body.rest is None else _looked(body.rest, whole, wanted, margin, None)
    parts = [ours] if rest is None else [ours, rest]
    step = np.diff(time)[:, None]
    speed = np.abs(np.diff(q, axis=0)) / step
    hardest = wanted.acceleration
    poses, paths = _of(parts, time, margin, wanted)
    clearance = np.min([part.clearance for part in parts], axis=0)  # NaN stays
    close = np.any([part.close for part in parts], axis=0)
    collides = np.any([part.status == COLLIDES for part in parts], axis=0)
    proven = not any(part.open.any() for part in parts) and len(q) > 1
    report = Report(
        rows=len(q),
        seconds=float(time[-1] - time[0]),
        checks=(
            checks.limits(body.base, time, q, q),
            checks.velocities(body.base, time, speed, wanted.velocity),
            *([] if hardest is None else [checks.accelerations(body.base, time, q, hardest)]),
            poses,
            paths,
        ),
        deep=int((clearance < 0.0).sum()),
        between=int((collides & ~close[:-1] & ~close[1:]).sum()),
        least=float(clearance.min()),
        bound=float(min(part.bound.min() for part in parts)) if proven else np.nan,
        fastest=float(speed.max(initial=0.0)),
        clearance=clearance,
        given=_given(body, time, whole, wanted),
        apart=() if rest is None else _of([rest], time, margin, wanted),
    )
    return Whole(report, ours, rest)


def certificate(body: WholeBody, wanted: Demands, report: Report) -> dict[str, Any]:
    """What was shown of a whole-body motion, and what was not, as JSON can hold it."""
    return audit.certificate(body.base, wanted, report) | {
        "given": list(body.given),
        "not_covered": not_covered(body),
        "by_design": audit.by_design(body.robot),
        "covers": "watched pairs of the modelled capsules on straight joint paths, given joints as "
        "the motion has them; no floor, no dynamics, no tracking error",
    }


def not_covered(body: WholeBody) -> list[dict[str, str]]:
    """The pairs of bodies that nothing is said about, with the reason."""
    return [
        {"a": a, "b": b, "kind": kind, "reason": reason} for a, b, kind, reason in body.unwatched()
    ]


def _looked(
    robot: Robot,
    q: np.ndarray,
    wanted: Demands,
    margin: np.ndarray,
    progress: Callable[[int], object] | None,
) -> Looked:
    if robot.margin != wanted.margin:
        robot = replace(robot, margin=wanted.margin)
    paths = certify(robot, q, wanted.margin_between, wanted.budget, progress)
    checker = robot.certifier()
    poses = checker.check(q, progress)
    bound, at, hit = paths.bound.copy(), paths.pair.copy(), np.flatnonzero(paths.status == COLLIDES)
    share = paths.t[hit][:, None]
    seen = robot.certifier(wanted.margin_between).check((1.0 - share) * q[hit] + share * q[hit + 1])
    bound[hit], at[hit] = seen.clearance, seen.pair
    names = tuple(robot.pair_name(row) for row in range(len(robot.watched)))
    close = ~(poses.clearance >= margin)  # catches NaN
    return Looked(names, poses.clearance, poses.pair, close, paths.status, bound, at, paths.t)


def _of(
    parts: list[Looked], time: np.ndarray, margin: np.ndarray, wanted: Demands
) -> tuple[Check, Check]:
    """Poses and paths of all pairs of the parts together, each place by its worst pair."""
    rows = np.arange(len(time))
    clearance = np.stack([part.clearance for part in parts])
    which = np.where(np.isnan(clearance), -np.inf, clearance).argmin(axis=0)

    def pose(i: int) -> str:
        part = parts[which[i]]
        return part.names[part.pair[i]] if part.pair[i] >= 0 else ""

    least = clearance[which, rows]
    close = np.any([part.close for part in parts], axis=0)
    poses = check("poses", "m", time, close, least - margin, least, pose, margin)
    # What collides goes before what is not decided: how bad that is is not known.
    value = np.stack([np.where(p.status == UNDECIDED, np.nan, p.bound) for p in parts])
    status = np.stack([part.status for part in parts])
    rank = np.where(status == UNDECIDED, 1e9, value)
    rank[status == COLLIDES] -= 1e6
    first = rank.argmin(axis=0)
    steps = np.arange(len(time) - 1)
    undecided = ~(status == COLLIDES).any(axis=0) & (status == UNDECIDED).any(axis=0)
    found = np.where(undecided, np.nan, value[first, steps])
    share = np.stack([part.share for part in parts])[first, steps]
    hit = status[first, steps] == COLLIDES
    when = time[:-1] + np.where(hit, np.nan_to_num(share) * np.diff(time), 0.0)

    def path(i: int) -> str:
        part = parts[first[i]]
        return part.names[part.at[i]] if part.at[i] >= 0 and not undecided[i] else ""

    broken = np.any([part.open for part in parts], axis=0)
    order = np.where(undecided, np.inf, found)
    paths = check(
        "paths", "m", when, broken, order, found, path, wanted.margin_between
    )  # fmt: skip
    return poses, paths._replace(undecided=int(undecided.sum()))


def _given(
    body: WholeBody, time: np.ndarray, whole: np.ndarray, wanted: Demands
) -> tuple[Check, ...]:
    """What the given joints break of their own limits and speeds."""
    own = _Named(
        [body.robot.joint_names[column] for column in body.others],
        body.robot.lower[body.others],
        body.robot.upper[body.others],
    )
    q: Any = whole[:, body.others]
    most = np.array([body.robot.joints[column].velocity for column in body.others])
    most[~(most > 0.0)] = np.inf
    speed = np.abs(np.diff(q, axis=0)) / np.diff(time)[:, None]
    robot: Any = own
    return checks.limits(robot, time, q, q), checks.velocities(robot, time, speed, most)


class _Named(NamedTuple):
    """Joints as audit's checks of limits and speeds want them."""

    joint_names: list[str]
    lower: np.ndarray  # [rad], (k,)
    upper: np.ndarray  # [rad], (k,)
