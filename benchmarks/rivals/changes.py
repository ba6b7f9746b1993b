"""What the numbers say about who is ahead of whom: our losses, and what would change the order."""

from collections.abc import Mapping
from typing import Any

import numpy as np

Row = Mapping[str, Any]
LESS_IS_BETTER = {
    "angle": "nearer to the human", "us_p50": "quicker in the median",
    "us_p99": "quicker in the slowest hundredth", "lag_ms": "less late",
    "first_s": "sooner at the first motion", "size_mb": "smaller to install",
    "jerk_p99": "smoother (jerk)", "acceleration_p99": "gentler (acceleration)",
    "held": "less often standing still",
}  # fmt: skip


def number(row: Row, key: str) -> float | None:
    """A number of a row, without its interval."""
    value = row.get(key)
    return value["value"] if isinstance(value, Mapping) else value


def losses(record: Row) -> list[str]:
    """Where a rival is ahead of both of ours, or of our stream alone, a sentence each.

    The stream is what is like the rivals: it does not know what comes.
    """
    found = []
    places = dict.fromkeys((r["robot"], r["protocol"], r["adversarial"]) for r in record["rows"])
    for robot, protocol, hard in places:
        mine = [
            r
            for r in record["rows"]
            if r["motions"]
            and (r["robot"], r["protocol"], r["adversarial"]) == (robot, protocol, hard)
        ]
        ours = {r["key"]: r for r in mine if r["key"] in ("file", "stream")}
        where = f"{robot}, protocol {protocol}{', adversarial' if hard else ''}"
        for key, words in LESS_IS_BETTER.items():
            known = {name: v for name, r in ours.items() if (v := number(r, key)) is not None}
            theirs = {
                r["label"]: v
                for r in mine
                if r["key"] not in ours and (v := number(r, key)) is not None
            }
            if not known:
                continue
            both = [name for name, v in theirs.items() if v < min(known.values())]
            if both:
                found.append(f"{where}: {words}: {', '.join(both)}.")
            rest = [
                name
                for name, v in theirs.items()
                if name not in both and v < known.get("stream", -np.inf)
            ]
            if rest:
                found.append(f"{where}: {words} than our stream: {', '.join(rest)}.")
    return found


def paragraph(record: Row) -> str:
    """What would change the order, from the numbers of protocol 1 on clips."""
    said = []
    for robot in dict.fromkeys(r["robot"] for r in record["rows"]):
        mine = [
            r
            for r in record["rows"]
            if r["robot"] == robot and r["protocol"] == 1 and not r["adversarial"] and r["motions"]
        ]
        ours = [r for r in mine if r["key"] in ("file", "stream")]
        others = [r for r in mine if r not in ours]
        if not ours or not others:
            continue
        clean = [r["label"] for r in others if not number(r, "paths_broken")
                 and not number(r, "poses_broken")]  # fmt: skip
        best = min(ours, key=lambda r: number(r, "angle") or 0.0)
        near = min(others, key=lambda r: number(r, "angle") or 0.0)
        quick = min(others, key=lambda r: r["us_p50"])
        said.append(
            f"On {robot} the nearest of ours is {best['label']} with {number(best, 'angle'):.1f}° "
            f"a bone, the nearest rival {near['label']} with {number(near, 'angle'):.1f}°, the "
            f"quickest rival {quick['label']} with {quick['us_p50'] / 1e3:.2f} ms; "
            + (f"without one broken pose or path: {', '.join(clean)}." if clean else
               "no rival is without a broken pose or path.")
        )  # fmt: skip
        documented = [
            r
            for r in record["rows"]
            if r["robot"] == robot and r["protocol"] == 2 and not r["adversarial"]
            and r["motions"] and r["key"] not in ("file", "stream")
        ]  # fmt: skip
        if documented:
            near = min(documented, key=lambda r: number(r, "angle") or 0.0)
            said.append(
                f"Of the tools as documented the nearest on {robot} is {near['label']} with "
                f"{number(near, 'angle'):.1f}°, {100 * (number(near, 'paths_broken') or 0.0):.0f} "
                "% of its paths broken."
            )
    return (
        " ".join(said)
        + " Who asks for no proof can compare the angle and the time alone, and the order is then "
        "that of these two columns. Larger margins for the rivals would break less and cost angle; "
        "meshes instead of capsules as the judged bodies count for those who were told of capsules "
        "as a surprise, for us too; slower motions or faster joints bring all angles together; and "
        "whole bodies with feet and floor are out of this comparison."
    )
