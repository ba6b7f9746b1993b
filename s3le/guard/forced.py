"""Steps for which the joints that others move leave no certified way: which, whose, by how much.

A step is a row's pose and the path that leads to it. It is forced if one of them is not certified
and planning found nothing of ours that would be; or if only given joints move the two bodies, a leg
and the other leg, where nothing of ours could change anything.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from s3le.safety.audit import Demands, Report
from s3le.safety.wholebody import Looked, Whole

NAMED = 3  # runs that are named in a sentence


class Forced(NamedTuple):
    """Forced steps in a row."""

    first: int  # row that the first of the steps ends at
    last: int
    begin: float  # [s]
    end: float
    ours: bool  # a joint of ours moves the two bodies; False: nothing of ours could change anything
    pair: str  # the two bodies that are worst
    row: int  # where they are: the row that the step ends at
    clearance: float  # [m], there; NaN: not decided
    wanted: float  # [m], what was asked for there

    @property
    def steps(self) -> int:
        """How many there are."""
        return self.last - self.first + 1


def steps(part: Looked) -> np.ndarray:
    """Which steps are not certified, by the row that they end at, bool (m,)."""
    bad = part.close.copy()
    bad[1:] |= part.open
    return bad


def only(whole: Whole, allowed: np.ndarray) -> bool:
    """Does all that is asked of ours hold, except clearance at some steps?

    Args:
        whole: what the audit found.
        allowed: the steps, bool (m,).
    """
    rest = [check for check in whole.report.checks if check.name not in ("poses", "paths")]
    return not any(check.broken for check in rest) and not (steps(whole.ours) & ~allowed).any()


def found(whole: Whole, time: np.ndarray, wanted: Demands) -> tuple[Forced, ...]:
    """All steps that are not certified, run by run.

    Args:
        whole: what the audit found.
        time: of the rows [s], (m,).
        wanted: what was asked.
    """
    made = []
    for part, ours in ((whole.ours, True), (whole.rest, False)):
        if part is None:
            continue
        bad = np.flatnonzero(steps(part))
        for run in np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1) if len(bad) else []:
            made.append(_run(part, ours, run, time, wanted))
    return tuple(sorted(made, key=lambda one: (one.first, not one.ours)))


def _run(part: Looked, ours: bool, run: np.ndarray, time: np.ndarray, wanted: Demands) -> Forced:
    """One run of steps, by the place that lacks most."""
    worst: tuple[float, str, int, float, float] = (-np.inf, "", int(run[0]), np.nan, np.nan)
    for row in run.tolist():
        if part.close[row] and part.pair[row] >= 0:
            at = float(part.clearance[row])
            here = (wanted.margin - at, part.names[part.pair[row]], row, at, wanted.margin)
            worst = max(worst, here, key=lambda one: one[0])
        if row and part.open[row - 1] and part.at[row - 1] >= 0:
            at, least = float(part.bound[row - 1]), wanted.margin_between
            here = (least - at, part.names[part.at[row - 1]], row, at, least)
            worst = max(worst, here, key=lambda one: one[0])
    first, last = int(run[0]), int(run[-1])
    return Forced(first, last, float(time[first]), float(time[last]), ours, *worst[1:])


def tree(runs: Sequence[tuple[str, Forced]]) -> dict[str, Any]:
    """Forced steps of all motions of a file, as JSON can hold them.

    Args:
        runs: what the motion is called within its file, and a run of steps in it.
    """
    return {
        "steps": sum(one.steps for _, one in runs if one.ours),
        "steps_not_ours_to_change": sum(one.steps for _, one in runs if not one.ours),
        "runs": [
            {
                "episode": where, "first_row": one.first, "last_row": one.last,
                "from_s": one.begin, "to_s": one.end,
                "whose": "ours" if one.ours else "not ours to change",
                "pair": one.pair, "row": one.row,
                "clearance_m": one.clearance if np.isfinite(one.clearance) else None,
                "wanted_m": one.wanted if np.isfinite(one.wanted) else None, "says": say(one),
            }
            for where, one in runs
        ],
    }  # fmt: skip


def say(one: Forced) -> str:
    """A run of forced steps, as a sentence."""
    rows = f"row {one.first}" if one.steps == 1 else f"rows {one.first} to {one.last}"
    at = "not decided"
    if np.isfinite(one.clearance):
        lies = (
            f"overlap by {-one.clearance * 1e3:.2f} mm"
            if one.clearance < 0.0
            else (f"are {one.clearance * 1e3:.2f} mm apart")
        )
        at = f"{one.pair} {lies}"
    tail = "" if one.ours else ", not ours to change"
    return f"{one.begin:.3f} s ({rows}): {at}{tail}"


def sentence(summary: dict[str, Any]) -> str:
    """Why a file with forced steps has no certificate, in a sentence; of its summary."""
    said = summary["forced"]
    counts = [f"{said['steps']} steps forced"] if said["steps"] else []
    if apart := said["steps_not_ours_to_change"]:
        counts.append(f"{apart} steps with bodies that others alone move, not ours to change")
    runs = [one["says"] for one in said["runs"][:NAMED]]
    more = f"; {len(said['runs']) - NAMED} more" if len(said["runs"]) > NAMED else ""
    return f"{', '.join(counts)}: {'; '.join(runs)}{more}"


def breaks(reports: Sequence[Report]) -> dict[str, dict[str, Any]]:
    """What given joints break of their own ranges and speeds, over all motions of a file."""
    made: dict[str, dict[str, Any]] = {}
    for report in reports:
        for check in report.given:
            one = made.setdefault(check.name, {"unit": check.unit, "total": 0, "broken": 0})
            one["total"] += check.total
            one["broken"] += check.broken
            if check.broken:
                worst = check.worst[0]
                one.setdefault("worst", []).append(
                    {"row": worst.row, "time": worst.time, "what": worst.what,
                     "value": worst.value, "wanted": worst.wanted}
                )  # fmt: skip
    return made
