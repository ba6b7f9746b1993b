"""A motion as a curve: rows of position and speed, a way to rest from each, and what of it holds.

A file may tell speeds: then they are proven. If it tells none, speeds are looked for with which its
own rows hold (s3le/plan/through.py); where there are none, the nearest curve is planned
(s3le/plan/flow.py). Rows that planning had no need to move are put back to the bit, with speeds
that lead from one to the other. The audit has the word on what comes out.

A file that has no place for speeds is read straight from row to row. If its own rows hold as a
curve and not straight, rows that do both are looked for; what is left is counted (`astray`), for
at the limits of acceleration a curve is farther from its chords than clearances allow for.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from s3le.errors import CertificateError, S3leError
from s3le.guard.claim import Claim
from s3le.guard.layouts.episode import Episode
from s3le.guard.made import SAME, TRIES, Made, Progress, looks, work
from s3le.plan import flow, gentle, through
from s3le.plan.examine import DRIVEN, PLANNED, WANTED, Plan
from s3le.plan.limits import Limits
from s3le.plan.whole import Planner
from s3le.robot.robot import Robot
from s3le.safety import audit, checks, paths

_ROUNDS = 4  # so often rows are put back, fewer each time
_NEAR = 6  # rows about one that does not hold, which are not put back then
_RESERVE = 1e-4  # [rad], the first where speeds are lost with the file


class Its(Protocol):
    """What is asked of a guard here; clean.Guard does it."""

    robot: Robot
    claim: Claim
    demands: audit.Demands
    most: Limits

    def check(
        self, episode: Episode, q: np.ndarray, progress: Progress | None = None,
        v: np.ndarray | None = None,
    ) -> audit.Report:  # fmt: skip
        """The audit of a motion; see clean.Guard."""

    def asked(self, episode: Episode, q: np.ndarray) -> np.ndarray | None:
        """Clearance that is asked of each row; see clean.Guard."""

    def planned(self, reserve: float, step: float, straight: bool = False) -> Planner:
        """A planner that keeps a reserve; see clean.Guard."""


class Curve(NamedTuple):
    """A motion that holds."""

    q: np.ndarray  # [rad], (m, n)
    v: np.ndarray  # [rad/s], (m, n)
    report: audit.Report  # of it


class Seen(NamedTuple):
    """A motion as it is in its file."""

    before: audit.Report  # what of it holds
    curve: Curve | None  # its rows with speeds with which all holds; None: there are none
    good: bool  # it may stay as it is


def see(its: Its, episode: Episode, progress: Progress | None = None) -> Seen:
    """What does not hold of a motion as it is.

    A file that tells no speeds is held against what it says, rows with straight joints between; and
    `stops` counts its rows that lie on no curve with a proven way to rest.

    Args:
        its: the guard.
        episode: as it was read.
        progress: called with numbers of further rows done, looks(m) in all.
    """
    report, q = None, episode.q
    if episode.v is not None:
        report = its.check(episode, q, progress, episode.v)
        if report.holds:
            return Seen(report, Curve(q, episode.v, report), True)
        progress = None
    curve, _, bad = _found(its, episode, q)
    if episode.pace is None or (report is None and curve is None):
        report = its.check(episode, q, progress)
        report = _with_stops(report, episode.time, bad)
    elif report is None and curve is not None:
        report = curve.report
        if progress:
            progress(looks(len(q)))
    assert report is not None  # one of the three
    good = curve is not None and (episode.pace is not None or report.holds)
    return Seen(report, curve, good)


def nearest(its: Its, episode: Episode, progress: Progress | None = None) -> Made:
    """The nearest motion that holds as it will be written; see clean.Guard.

    Raises:
        CertificateError: none was found.
    """
    time, wanted, m = episode.time, episode.q, len(episode.time)
    here = see(its, episode, progress)
    kept: Made | None = None
    if here.curve is not None:
        as_wanted = np.full(m, WANTED, np.uint8)
        kept = Made(wanted, here.before, here.curve.report, as_wanted, 0.0, v=here.curve.v)
        if here.good and not rough(its, time, wanted, here.curve.v):
            if progress:
                progress(work(m) - looks(m))
            return kept
    step = float(np.diff(time).min()) if m > 1 else 1.0
    reserve, rounds, why = 0.0, 0.0, ""
    for turn in range(TRIES + 1):
        told = None if turn else progress
        try:
            plan = _plan(its, reserve, step, time, wanted, _of(m, told))
            assert plan.v is not None  # of curves
            written, v = episode.as_written(plan.q), episode.paced(plan.v)
        except S3leError as refusal:
            if kept is not None:
                break
            tail = f" (a reserve of {reserve:.1g} rad, for the file rounds)" if turn else ""
            raise CertificateError(f"{episode.name}: {refusal}{tail}") from None
        if told:
            told(looks(m))
        still = (plan.how == WANTED) | (np.abs(written - wanted) < SAME).all(axis=1)
        made = _put_back(its, episode, written, v, still)
        if made is None:
            made = _as_planned(its, episode, written, v)
        if made.report.holds:
            q = made.q
            how = np.where((q == wanted).all(axis=1), WANTED, np.maximum(plan.how, PLANNED))
            done = Made(q, here.before, made.report, how.astype(np.uint8), reserve, v=made.v)
            # Rows that a curve leads through stay, unless others hold straight as well.
            return done if kept is None or here.good or not astray(its, q) else kept
        why = made.report.complaint
        off = float(np.abs(written - plan.q).max()), step * float(np.abs(v - plan.v).max())
        rounds = max(rounds, *off)
        grain = rounds if episode.pace is not None else max(rounds, _RESERVE)
        if not grain > 0.0:  # also NaN: no reserve will help
            break
        reserve = grain * 2.0**turn
    if kept is not None:
        return kept
    raise CertificateError(
        f"{episode.name}: what would be written does not hold: {why}"
        + (f"; the file rounds angles by {rounds:.2g} rad" if rounds > 0.0 else "")
    )


def rough(its: Its, time: np.ndarray, q: np.ndarray, v: np.ndarray | None) -> bool:
    """Has a motion more jerk than is aimed at? See gentle.jerks."""
    limit = its.claim.jerk
    return bool(limit) and bool((np.abs(gentle.jerks(time, q, v)) > limit).any())


def astray(its: Its, q: np.ndarray) -> int:
    """Steps of rows (m, n) [rad] that are not proven if joints go straight from one to the next."""
    between = its.demands.margin_between
    status = paths.certify(its.robot, q, between, its.demands.budget).status
    return int((status != paths.CERTIFIED).sum())


def broken(
    its: Its, time: np.ndarray, q: np.ndarray, v: np.ndarray, margin: np.ndarray, room: np.ndarray
) -> np.ndarray:
    """Rows that take part in what does not hold of a curve, bool (m,).

    Args:
        its: the guard.
        time, q, v: rows [s], (m,), [rad], [rad/s], (m, n).
        margin: asked of each [m], (m,).
        room: how much more each keeps [m], (m,).
    """
    robot, want = its.robot, its.demands
    bad = ~(room >= 0.0)
    speed, bent, low, high = checks.between(time, q, v)
    bad |= ~((low >= robot.lower) & (high <= robot.upper)).all(axis=1)
    more = 1.0 + checks.ROUNDING
    steps = ~(speed <= want.velocity * more).all(axis=1)
    steps |= ~(bent <= its.most.acceleration * more).all(axis=1)
    found = paths.certify(robot, q, want.margin_between, want.budget, None, time, v)
    steps |= found.status != paths.CERTIFIED
    bad[:-1] |= steps
    bad[1:] |= steps
    own = np.flatnonzero(~bad & (margin >= robot.margin))
    if len(own):
        rest = paths.rests(
            robot, time, q, v, its.most.acceleration, want.margin_between, want.budget
        )
        bad[own] |= ~rest[own]
    return bad


def _found(
    its: Its, episode: Episode, q: np.ndarray, known: np.ndarray | None = None,
    told: np.ndarray | None = None,
) -> tuple[Curve | None, np.ndarray, np.ndarray]:  # fmt: skip
    """The curve through rows with which all holds, if one is found.

    Speeds are the smoothest; where these do not hold, and about such rows alone, those of SHARES
    that do. They follow from the rows alone, so that they are found again; unless some are told.

    Args:
        its: the guard.
        episode: for its times, and how it writes speeds.
        q: its rows [rad], (m, n).
        known, told: rows, bool (m,), whose speeds [rad/s], (m, n), are to be near these.

    Returns:
        (the curve or None, the speeds that are left, rows that do not hold with them bool (m,)).
    """
    way, asked = through.Through(episode.time, q, its.most), its.asked(episode, q)
    margin = np.full(len(q), its.demands.margin) if asked is None else asked
    room = its.robot.certifier().check(q).clearance - margin
    guess, bad, v = np.empty(0), np.ones(len(q), bool), np.empty(0)
    for share in through.SHARES:
        here = way.guess(share)
        if known is not None and told is not None:
            here = np.where(known[:, None], told, here)
        if len(guess):
            here = np.where(_near(bad)[:, None], here, guess)
        speeds = episode.paced(way.near(here))
        found, other = bad.copy(), np.ones(len(q), bool)
        if len(guess):
            other = (speeds != v).any(axis=1)
        for part in _runs(other):  # nothing has changed elsewhere
            own = slice(max(part.start - 1, 0), part.stop + 1)
            wide = slice(max(part.start - 2, 0), part.stop + 2)
            held = broken(its, episode.time[wide], q[wide], speeds[wide], margin[wide], room[wide])
            found[own] = held[own.start - wide.start :][: own.stop - own.start]
        if not len(guess) or found.sum() < bad.sum():
            guess, bad, v = here, found, speeds
        if not bad.any():
            break
    if bad.any():
        return None, v, bad
    report = its.check(episode, q, None, v)
    return (Curve(q, v, report) if report.holds else None), v, bad


def _plan(
    its: Its,
    reserve: float,
    step: float,
    time: np.ndarray,
    wanted: np.ndarray,
    progress: Progress | None,
) -> Plan:
    """The nearest motion.

    If none is found, or only by driving the robot past a place step by step, a calmer motion is
    planned too, and then the nearest straight rows; and the nearest of all is taken.

    Raises:
        CertificateError: none was found.
    """
    planner = its.planned(reserve, step)
    plans: list[Plan] = []
    why: CertificateError | None = None
    tries: tuple[Callable[[], np.ndarray], ...] = (
        lambda: wanted,
        lambda: flow.calmed(time, wanted),
        lambda: its.planned(reserve, step, straight=True).plan(time, wanted).q,
    )
    for rows in tries:
        try:
            plans.append(planner.plan(time, rows(), progress=None if plans or why else progress))
        except CertificateError as refusal:
            why = why or refusal
            continue
        if not (plans[-1].how == DRIVEN).any():
            break
    if not plans:
        assert why is not None  # something was tried
        raise why
    return min(plans, key=lambda plan: float(np.square(plan.q - wanted).sum()))


def _put_back(
    its: Its, episode: Episode, written: np.ndarray, v: np.ndarray, still: np.ndarray
) -> Curve | None:
    """A plan whose rows are those of the file wherever they may be; None: they may not.

    Args:
        its: the guard.
        episode: as it was read.
        written: rows of the plan as the file holds them [rad], (m, n).
        v: its speeds [rad/s], (m, n).
        still: rows that planning had no need to move, bool (m,).
    """
    told = None if episode.pace is None else v
    for _ in range(_ROUNDS):
        if not still.any():
            return None
        q = np.where(still[:, None], episode.q, written)
        made, _, bad = _found(its, episode, q, ~still, told)
        if made is not None:
            return made
        left = still & ~_near(bad)
        if (left == still).all():
            return None
        still = left
    return None


def _as_planned(its: Its, episode: Episode, written: np.ndarray, v: np.ndarray) -> Curve:
    """A plan as the file holds it, and what the audit says of it."""
    if episode.pace is not None:
        return Curve(written, v, its.check(episode, written, None, v))
    made, v, _ = _found(its, episode, written)
    return made or Curve(written, v, its.check(episode, written, None, v))


def _runs(rows: np.ndarray) -> list[slice]:
    """Runs of rows, of bool (m,); those that are four rows apart or less are one."""
    at = np.flatnonzero(rows)
    parts = np.split(at, np.flatnonzero(np.diff(at) > 4) + 1) if len(at) else []
    return [slice(int(part[0]), int(part[-1]) + 1) for part in parts]


def _near(bad: np.ndarray) -> np.ndarray:
    """Rows about those that are bad, bool (m,)."""
    near = np.zeros(len(bad), bool)
    for row in np.flatnonzero(bad).tolist():
        near[max(row - _NEAR, 0) : row + _NEAR + 1] = True
    return near


def _with_stops(report: audit.Report, time: np.ndarray, bad: np.ndarray) -> audit.Report:
    """A report on straight rows, and how many of them lie on no curve with a way to rest."""
    value = np.where(bad, 0.0, 1.0)
    stops = checks.check("stops", "-", time, bad, value, value, lambda i: "", 1.0)
    own = [check for check in report.checks if check.name in ("poses", "paths")]
    rest = [check for check in report.checks if check.name not in ("poses", "paths")]
    return report._replace(checks=(*rest, stops, *own))


def _of(rows: int, progress: Progress | None) -> Progress | None:
    """Tell of so many rows at most: a plan has a control point more."""
    if progress is None:
        return None
    left = rows

    def told(count: int) -> None:
        nonlocal left
        progress(min(count, left))
        left -= min(count, left)

    return told
