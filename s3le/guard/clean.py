"""One motion: what is broken in it, the nearest that holds, and the proof of what is written.

Planning has the first word and no say: a motion holds if the audit (s3le/safety/audit.py) says
so of the very numbers that will lie in the file. One of which it says so at once is left alone.
Motions are curves with a way to rest from each row (s3le/guard/curves.py), or, where that is asked
for, straight from row to row.
Where others move joints too (legs that walk), steps for which they leave no certified way are
forced: they are listed, and nothing is claimed of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import CertificateError, S3leError
from s3le.guard import curves, forced, moved, sense
from s3le.guard.claim import Claim, with_reserve
from s3le.guard.forced import Forced
from s3le.guard.layouts.episode import Episode, Layout
from s3le.guard.made import SAME, TRIES, Made, Progress, jerk, looks, work
from s3le.motion.trajectory import BETWEEN
from s3le.plan.examine import DRIVEN, PLANNED, WANTED
from s3le.plan.flow import planner
from s3le.plan.limits import limits
from s3le.plan.whole import Planner
from s3le.plan.wholebody import BodyPlanner
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody, whole_body
from s3le.safety import audit, checks, wholebody


class Cleaned(NamedTuple):
    """What became of one file."""

    q: list[np.ndarray | None]  # [rad], of each episode; None: it is left as it is
    summary: dict[str, Any]  # as JSON can hold it
    v: list[np.ndarray | None]  # [rad/s], of each episode; None: the file's own, or none, stay


class Guard:
    """Cleans motions of one robot, one at a time; holds scratch: one per thread."""

    def __init__(self, robot: Robot, claim: Claim) -> None:
        """Make what all motions share.

        Args:
            robot: of claim.claim.
            claim: what is asked of every motion.
        """
        self.robot, self.claim = robot, claim
        self.demands = claim.demands(robot)
        self.most = limits(robot, np.array(claim.acceleration), claim.speed_factor)
        self._planner: Planner | None = None
        self._bodies: dict[tuple[str, ...], WholeBody] = {}
        self._planners: dict[tuple[str, ...], BodyPlanner] = {}

    def body(self, episode: Episode) -> WholeBody | None:
        """The robot with the joints that others move in a motion; None: they move none.

        Raises:
            RobotError: such a joint cannot move in the model.
        """
        if episode.others is None:
            return None
        names = episode.others.joints
        if names not in self._bodies:
            self._bodies[names] = whole_body(self.robot, names)
        return self._bodies[names]

    def check(
        self,
        episode: Episode,
        q: np.ndarray,
        progress: Progress | None = None,
        v: np.ndarray | None = None,
    ) -> audit.Report:
        """The audit of a motion, accelerations included.

        Rows that lie between two frames by their mode are held to what the path is, as in
        `s3le audit`, unless they are others than in the file.

        Args:
            episode: as it was read.
            q: [rad], (m, n), as it is or will be written.
            progress: called with numbers of further rows done, 2 m - 1 in all.
            v: [rad/s], (m, n), where it is a curve. None: it goes straight from row to row; but
                in a guard of straight rows a file that tells speeds is taken at its word.
        """
        if episode.others is not None:
            return self._look(episode, q, progress)[0]
        at_rows = self.asked(episode, q)
        if v is None and self.claim.straight and (q == episode.q).all():
            v = episode.v
        return audit.audit(self.robot, episode.time, q, self.demands, at_rows, progress, v)

    def _look(
        self, episode: Episode, q: np.ndarray, progress: Progress | None = None
    ) -> tuple[audit.Report, wholebody.Whole | None]:
        """As check; and where others move joints too, whose pairs are broken."""
        body, others = self.body(episode), episode.others
        if body is None or others is None:
            return self.check(episode, q, progress), None
        whole = wholebody.look(
            body, episode.time, q, others.q, self.demands, self.asked(episode, q), progress
        )
        return whole.report, whole

    def asked(self, episode: Episode, q: np.ndarray) -> np.ndarray | None:
        """Clearance that is asked of each row [m], (m,); None: the margin of all."""
        if episode.mode is None:
            return None
        between = (episode.mode == BETWEEN) & (q == episode.q).all(axis=1)
        return np.where(between, self.demands.margin_between, self.demands.margin)

    def _forced(self, episode: Episode, whole: wholebody.Whole | None) -> tuple[Forced, ...]:
        return () if whole is None else forced.found(whole, episode.time, self.demands)

    def survey(self, layout: Layout, degrees: bool, progress: Progress | None = None) -> Cleaned:
        """Look at a file without planning: as clean, but what is broken stays so.

        Raises:
            TrajectoryError: its angles cannot be this robot's.
        """
        notes = self._refuse(layout, degrees)
        reports = [
            self.check(one, one.q, progress)
            if self._straight(one)
            else curves.see(self, one, progress).before
            for one in layout.episodes
        ]
        summary = self._summary(layout, notes, reports)
        none: list[np.ndarray | None] = [None] * len(reports)
        return Cleaned(none, summary | {"holds": all(r.holds for r in reports)}, none)

    def clean(self, layout: Layout, degrees: bool, progress: Progress | None = None) -> Cleaned:
        """The nearest certified motion of every episode of a file.

        Args:
            layout: the file, as it was read.
            degrees: its angles were said to be in degrees.
            progress: called with numbers of further rows done, `work` in all.

        Raises:
            TrajectoryError: its angles cannot be this robot's.
            CertificateError: no motion was found that holds once it is written.
        """
        notes = self._refuse(layout, degrees)
        made = []
        for one in layout.episodes:
            made.append(self.nearest(one, progress))
            notes += [_named(layout, one, note) for note in self._said(one, made[-1])]
        reports = [one.after for one in made]
        runs = [
            (_short(layout, one), run)
            for one, done in zip(layout.episodes, made, strict=True)
            for run in done.forced
        ]
        how = np.concatenate([one.how for one in made])
        summary = self._summary(layout, notes, [one.before for one in made])
        wanted = [one.q for one in layout.episodes]
        tallied = moved.tally(wanted, [one.q for one in made], self.robot.joint_names)
        summary |= {
            "moved": tallied,
            "rows": {
                "as_wanted": int((how == WANTED).sum()),
                "planned": int((how == PLANNED).sum()),
                "driven": int((how == DRIVEN).sum()),
            },
            "reserve_rad": max(one.reserve for one in made),
            "jerk": jerk(layout.episodes, made, self.claim.jerk),
            "after": _merged(layout, reports),
            "certificate": self.certificate(layout.episodes, reports) | self._lost(layout, made),
            "holds": all(report.holds for report in reports),
        }
        if runs:
            summary["forced"] = forced.tree(runs)
            summary["certificate"]["forced"] = summary["forced"]
        q = [
            None if (done.q == one.q).all() else done.q
            for done, one in zip(made, layout.episodes, strict=True)
        ]
        v = [done.paced(one) for done, one in zip(made, layout.episodes, strict=True)]
        return Cleaned(q, summary, v)

    def _straight(self, episode: Episode) -> bool:
        """Are straight rows asked of a motion? So they are among joints that others move."""
        return self.claim.straight or episode.others is not None

    def _lost(self, layout: Layout, made: Sequence[Made]) -> dict[str, Any]:
        """What is to be said of speeds that a file has no place for."""
        lost = [
            done.q
            for one, done in zip(layout.episodes, made, strict=True)
            if one.pace is None and done.v is not None
        ]
        if not lost:
            return {}
        astray = sum(curves.astray(self, q) for q in lost)
        return {
            "between_rows": f"{audit.CUBIC}; the file has no place for speeds, and the smoothest "
            "that keep the limits were taken",
            "straight_rows": audit.straight_rows(astray),
        }

    def nearest(self, episode: Episode, progress: Progress | None = None) -> Made:
        """The nearest motion that holds as it will be written.

        Raises:
            CertificateError: none was found.
        """
        if not self._straight(episode):
            return curves.nearest(self, episode, progress)
        name, time, wanted = episode.name, episode.time, episode.q
        before, seen = self._look(episode, wanted, progress)
        m = len(time)
        kept: Made | None = None
        if before.holds or (seen is not None and forced.only(seen, np.zeros(m, bool))):
            runs = self._forced(episode, seen)
            kept = Made(wanted, before, before, np.full(m, WANTED, np.uint8), 0.0, runs)
            if not curves.rough(self, time, wanted, None):
                if progress:
                    progress(work(m) - looks(m))
                return kept
        step = float(np.diff(time).min()) if m > 1 else 1.0
        reserve, grain, why = 0.0, 0.0, ""
        for turn in range(TRIES + 1):
            told = None if turn else progress
            try:
                q, how, given_way = self._plan(episode, reserve, step, told)
                written = episode.as_written(q)
            except S3leError as refusal:
                if kept is not None:
                    break
                tail = f" (a reserve of {reserve:.1g} rad, for the file rounds)" if turn else ""
                raise CertificateError(f"{name}: {refusal}{tail}") from None
            # Rows that planning hardly moved stay as they are, to the bit, if all holds so too.
            still = (np.abs(written - wanted) < SAME).all(axis=1)
            put_back = np.where(still[:, None], wanted, written)
            same = (put_back == written).all()
            for made in (written,) if same else (put_back, written):
                after, seen = self._look(episode, made, told)
                if after.holds or (seen is not None and forced.only(seen, given_way)):
                    how = np.where((made == wanted).all(axis=1), WANTED, np.maximum(how, PLANNED))
                    runs = self._forced(episode, seen)
                    return Made(made, before, after, how.astype(np.uint8), reserve, runs)
                told = None
            why = after.complaint
            grain = max(grain, float(np.abs(written - q).max()))
            if not grain > 0.0:  # also NaN: no reserve will help
                break
            reserve = grain * 2.0**turn
        if kept is not None:  # its jerk is no reason to refuse it
            return kept
        raise CertificateError(
            f"{name}: what would be written does not hold: {why}"
            + (f"; the file rounds angles by {grain:.2g} rad" if grain > 0.0 else "")
        )

    def warm_up(self, planning: bool = True) -> None:
        """Compile what a motion needs, or read it from the store; at first this takes minutes.

        Args:
            planning: False: motions are only looked at.
        """
        if planning:
            self.planned(0.0, 1.0).warm_up()
        rows = np.tile(self.robot.anchor, (3, 1))
        for v in (None, None if self.claim.straight else np.zeros_like(rows)):
            audit.audit(self.robot, np.arange(3.0), rows, self.demands, v=v)

    def _plan(
        self, episode: Episode, reserve: float, step: float, progress: Progress | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest motion, how its rows came about, and which steps are forced, bool (m,)."""
        body, others = self.body(episode), episode.others
        if body is None or others is None:
            plan = self.planned(reserve, step).plan(episode.time, episode.q, progress=progress)
            return plan.q, plan.how, np.zeros(len(plan.q), bool)
        planner = self._planned_among(body, reserve, step)
        made = planner.among(episode.time, episode.q, others.q, progress)
        return made.q, made.how, made.forced

    def _planned_among(self, body: WholeBody, reserve: float, step: float) -> BodyPlanner:
        if not reserve and body.given in self._planners:
            return self._planners[body.given]
        robot, most, settings = with_reserve(self.robot, self.claim, reserve, step)
        made = BodyPlanner(replace(body, base=robot), most, settings)
        if not reserve:
            self._planners[body.given] = made
        return made

    def planned(self, reserve: float, step: float, straight: bool = False) -> Planner:
        """A planner that keeps a reserve, see with_reserve; straight: of rows without speeds."""
        claim = replace(self.claim, straight=straight or self.claim.straight)
        if reserve or claim != self.claim:
            return planner(*with_reserve(self.robot, claim, reserve, step))
        if self._planner is None:
            self._planner = planner(*with_reserve(self.robot, self.claim, 0.0, step))
        return self._planner

    def _refuse(self, layout: Layout, degrees: bool) -> list[str]:
        notes: list[str] = []
        for one in layout.episodes:
            said, body = [], self.body(one)
            if body is None or one.others is None:
                said += sense.refuse_foreign(one.name, self.robot, one.q, degrees)
            else:
                whole = body.poses(one.q, one.others.q)
                said += sense.refuse_foreign(one.name, body.robot, whole, degrees)
            said += sense.jumps(self.robot, one.time, one.q, self.most)
            if not self.claim.straight and one.others is not None:
                said.append(
                    "among joints that others move rows go straight, and no way to rest is proven"
                )
            notes += [_named(layout, one, note) for note in [*one.notes, *said]]
        return notes

    def _said(self, one: Episode, made: Made) -> list[str]:
        """What a person should know about the first row, from which a robot would begin."""
        at = made.before.clearance[0]
        if at >= self.demands.margin or (one.others is not None and (made.q[0] == one.q[0]).all()):
            return []
        by = float(np.rad2deg(np.abs(made.q[0] - one.q[0]).max()))
        return [
            f"its first row keeps {at * 1e3:.2f} mm; it is moved by {by:.2f} deg, and is not "
            "where a robot that stands as the file says would begin"
        ]

    def _summary(
        self, layout: Layout, notes: list[str], before: list[audit.Report]
    ) -> dict[str, Any]:
        names = list(dict.fromkeys(name for one in layout.episodes for name in _given(one)))
        given = {"given": {"joints": names, "breaks": forced.breaks(before)}} if names else {}
        return given | {
            "robot": self.robot.tag,
            "joints": list(self.robot.joint_names),
            "claim": {
                "margin_m": self.claim.margin,
                "margin_between_m": self.demands.margin_between,
                "speed_factor": self.claim.speed_factor,
            },
            "episodes": len(layout.episodes),
            "frames": sum(report.rows for report in before),
            "seconds": sum(report.seconds for report in before),
            "notes": notes,
            "before": _merged(layout, before),
        }

    def certificate(
        self, episodes: Sequence[Episode], reports: Sequence[audit.Report]
    ) -> dict[str, Any]:
        """One certificate over some episodes, as JSON can hold it.

        Args:
            episodes: as they were read.
            reports: what the audit found of each as it will be written.
        """
        bent = [any(check.name == "stops" for check in one.checks) for one in reports]
        curve = any(bent)
        whole = audit.certificate(self.robot, self.demands, reports[0], v=curve)
        bodies = [body for one in episodes if (body := self.body(one)) is not None]
        for body in bodies:
            also = wholebody.certificate(body, self.demands, reports[0])
            whole["given"] = list(dict.fromkeys([*whole.get("given", []), *also["given"]]))
            for key in ("not_covered", "by_design"):
                pairs = whole[key]
                whole[key] = pairs + [p for p in also[key] if p not in pairs]
        rows = sum(report.rows for report in reports)
        bounds = [report.bound for report in reports if report.rows > 1]
        whole["poses"] |= {
            "checked": rows, "least_clearance_m": min(report.least for report in reports),
        }  # fmt: skip
        paths = [check for report in reports for check in report.checks if check.name == "paths"]
        bound = float(np.min(bounds)) if bounds else np.nan  # NaN: some path is not proven
        whole["paths"] = {
            "proven": sum(check.total - check.broken for check in paths),
            "bound_m": bound if np.isfinite(bound) else None,
        }
        if not curve:
            whole["covers"] = (
                "watched pairs of the modelled capsules on straight joint paths, "
                "accelerations as second differences of rows; no dynamics, no tracking error"
            )
        elif not all(bent):
            straight = "; straight joints, and no way to rest, where others move joints"
            whole["between_rows"] += straight
            whole["covers"] += straight
        if bodies:
            whole["covers"] += "; given joints as the motion has them, no floor"
        return whole | {"holds": all(report.holds for report in reports)}


def _given(episode: Episode) -> tuple[str, ...]:
    return () if episode.others is None else episode.others.joints


def _short(layout: Layout, episode: Episode) -> str:
    """What an episode is called within its file; empty where it is the only one."""
    if len(layout.episodes) == 1:
        return ""
    return episode.name.removeprefix(str(layout.path)).removeprefix(", ")


def _named(layout: Layout, episode: Episode, note: str) -> str:
    name = _short(layout, episode)
    return f"{name}: {note}" if name else note


def _merged(layout: Layout, reports: list[audit.Report]) -> dict[str, Any]:
    """The checks of all episodes together: how many, and the worst places."""
    found: dict[str, Any] = {}
    names = dict.fromkeys(check.name for report in reports for check in report.checks)
    for name in names:
        told = [(one, check) for one, report in zip(layout.episodes, reports, strict=True)
                for check in report.checks if check.name == name]  # fmt: skip
        kind = [check for _, check in told]
        worst = [
            (_badness(name, one), _short(layout, episode), one)
            for episode, check in told
            if check.broken
            for one in check.worst
        ]
        worst.sort(key=lambda item: item[0], reverse=True)
        found[name] = {
            "unit": kind[0].unit,
            "total": sum(check.total for check in kind),
            "broken": sum(check.broken for check in kind),
            "undecided": sum(check.undecided for check in kind),
            "worst": [
                {
                    "episode": where, "row": one.row, "time": one.time, "what": one.what,
                    "value": one.value if np.isfinite(one.value) else None,
                    "wanted": one.wanted, "says": checks.say(name, one),
                }
                for _, where, one in worst[: checks.PLACES]
            ],
        }  # fmt: skip
    return found


def _badness(check: str, one: checks.Finding) -> float:
    if np.isnan(one.value):
        return -np.inf  # how bad is not known
    if check in ("velocities", "accelerations"):
        return one.value / one.wanted
    return one.wanted - one.value
