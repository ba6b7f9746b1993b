"""The part of the page on what a run was made of: frames, projection, coverage, training."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from s3le.learn.methods import PROPOSERS
from s3le.report import cells, html
from s3le.report.curves import TERMS
from s3le.report.html import Html, paragraph, tag, words
from s3le.show import style

_CAUSES = (
    ("dropped_tilt", "torso tilted too far"),
    ("dropped_pelvis", "pelvis line without direction"),
    ("dropped_bone", "bone without length"),
    ("dropped_not_finite", "not a finite number"),
)
_TIMES = (("us_p50", "median"), ("us_p99", "99th percentile"), ("us_worst", "worst"))


def data(metrics: Mapping[str, Any]) -> list[Html]:
    """Frames kept and dropped, and what projection did."""
    clips = cells.at(metrics, "clips")
    rows = [
        [cells.text(name), cells.count(split.get("clips")), cells.count(split.get("frames"))]
        + [cells.count(split.get(key)) for key, _ in _CAUSES]
        for name, split in clips.items()
    ]
    titles = ["split", "motions", "frames kept", *[told for _, told in _CAUSES]]
    kept = html.explained(
        html.table(titles, rows),
        "the last four columns count frames that were dropped, each under the reason why.",
    )
    domain, pairs = cells.at(metrics, "domain"), cells.at(metrics, "pairs")
    sampling, poses = cells.at(metrics, "sampling"), cells.at(metrics, "poses")
    total = sampling.get("rows")
    moved = sampling.get("moved_mean_rad")
    turned = f"{cells.plain(moved)} rad" + (
        f" ({math.degrees(moved):.1f}°)" if cells.is_number(moved) else ""
    )
    facts = [
        ("skeletons to learn from: raw", cells.count(domain.get("raw"))),
        ("skeletons to learn from: mirrored", cells.count(domain.get("mirrored"))),
        ("skeletons to learn from: with noise", cells.count(domain.get("noisy"))),
        ("pairs of human and robot", cells.count(pairs.get("rows"))),
        (
            "of these colliding before projection",
            cells.of(pairs.get("collided"), pairs.get("rows")),
        ),
        ("sampled poses", cells.count(total)),
        ("of these feasible as drawn", cells.of(sampling.get("feasible"), total)),
        ("of these projected by the solver", cells.of(sampling.get("solved"), total)),
        ("of these projected by the fallback", cells.of(sampling.get("fallback"), total)),
        ("mean change in q by projection", turned),
        ("robot poses", cells.count(poses.get("rows"))),
        ("share of draws accepted as robot poses", cells.rate(poses.get("accepted_share"))),
    ]
    return [
        tag("h3", "Frames kept and dropped"),
        kept if rows else paragraph(f"Frames kept and dropped: {cells.MISSING}."),
        tag("h3", "What the training saw, and what projection did"),
        html.explained(
            html.table(["", ""], facts),
            "projection moves a drawn pose to the nearest one found that is safe; the fallback is "
            "the poorer way, taken where the solver does not get there, and should be rare.",
        ),
    ]


def grid(rows: Sequence[Mapping[str, Any]]) -> list[Html]:
    """Each model in each pool by each metric, to the ground truth.

    Args:
        rows: of reports/grid.csv: "split", "model", "pool", "metric", "stored", "to_truth".
    """
    splits = list(dict.fromkeys(row["split"] for row in rows))
    metrics = list(dict.fromkeys(row["metric"] for row in rows))
    found = {(r["split"], r["model"], r["pool"], r["metric"]): r["to_truth"] for r in rows}
    stored = {(row["model"], row["pool"]): row["stored"] for row in rows}
    longest = cells.longest(found.values())
    parts: list[Html] = []
    for split in splits:
        table = []
        for (model, pool), count in stored.items():
            row = [f"{PROPOSERS.get(model, cells.text(model))}, {cells.text(pool)}"]
            for metric in metrics:
                far = found.get((split, model, pool, metric))
                row.append(cells.NONE if far is None else _gauged(far, longest))
            table.append([*row, cells.count(count)])
        titles = ["looked up in", *(cells.text(metric) for metric in metrics), "stored poses"]
        parts += [] if len(splits) == 1 else [tag("h3", f"On {cells.text(split)}")]
        parts.append(
            html.explained(
                html.table(titles, table),
                "the same trainings, looked up in every pool by every distance between latents; "
                "mean cosine distance to the ground truth, lower is better.",
                words(
                    "*pairs* are the mocap pairs' poses, *poses* these and the robot domain's, "
                    "*all* these and the sampled tuples'. Brute force compares skeletons by *l2*."
                ),
            )
        )
    return parts


def coverage(splits: Mapping[str, Any]) -> list[Html]:
    """How near each sampler's poses come to people."""
    if not splits:
        return [paragraph(f"Coverage: {cells.MISSING}.")]
    first = next(iter(splits.values()))
    names = list(dict.fromkeys(name for split in splits.values() for name in split))
    names.sort(key=lambda name: first.get(name, {}).get("mean", math.inf))
    titles = ["stored poses"]
    for split in splits:
        titles += [f"{cells.text(split)}: alone", f"{cells.text(split)}: with the IK pairs"]
    longest = cells.longest(own.get("mean") for split in splits.values() for own in split.values())
    rows = []
    for name in names:
        row = [cells.text(name.replace("_", " "))]
        for split in splits.values():
            found = split.get(name, {})
            with_pairs = found.get("with_pairs")
            row.append(_gauged(found.get("mean"), longest))
            row.append(cells.NONE if with_pairs is None else _gauged(with_pairs, longest))
        rows.append(row)
    return [
        html.explained(
            html.table(titles, rows),
            "cosine distance of the nearest stored pose to people that no sampler has seen, every "
            "sampler with the same number of poses, found by brute force, so no look-up among "
            "these poses can do better.",
            words(
                "*uniform* is the paper's; *pairs alone* are the poses that inverse kinematics "
                "made of the training clips. `reports/coverage.csv` has the 90th percentile too."
            ),
        )
    ]


def _gauged(value: object, longest: float) -> str:
    told = cells.distance(value)
    return html.gauged(told, value / longest) if cells.is_number(value) else told


def training(histories: Mapping[str, list[Mapping[str, float]]]) -> list[Html]:
    """First and last value of every loss term."""
    rows = []
    order = [key for key in style.TRAINED if key in histories]
    for method in order + [key for key in histories if key not in order]:
        history = histories[method]
        label = cells.text(style.TRAINED.get(method, method))
        if not history:
            rows.append([label, cells.MISSING, cells.MISSING])
            continue
        first, last = history[0], history[-1]
        terms = [
            f"{cells.text(TERMS[key][0] if key in TERMS else key.replace('_', ' '))} "
            f"{cells.plain(first.get(key))} to {cells.plain(last[key])}"
            for key in [*TERMS, *[key for key in last if key not in TERMS]]
            if key in last and key != "step"
        ]
        rows.append([label, cells.count(last.get("step")), "; ".join(terms)])
    if not rows:
        return [paragraph(f"Training: {cells.MISSING}.")]
    titles = ["method", "steps", "loss terms, first to last row of the history"]
    return [
        html.explained(
            html.table(titles, rows, numbers=False),
            "a term that ends where it began was not learned.",
        )
    ]


def unwatched(pairs: Sequence[tuple[str, str, str, str]]) -> list[Html]:
    """Pairs of bodies that do not count for clearance."""
    if not pairs:
        return []
    rows = [[cells.text(cell) for cell in pair] for pair in pairs]
    return [
        html.folded(
            f"The {len(rows)} pairs of bodies that are not watched",
            html.explained(
                html.table(["body", "body", "what they are", "why"], rows, numbers=False),
                "two bodies that already overlap in the anchor pose (when grown a little) are "
                "neighbours by construction, and their distance cannot serve as a warning.",
                words(
                    "Bodies that cannot move relative to each other are left out here. All pairs "
                    "stand in `data/robot/pairs.parquet`."
                ),
            ),
        )
    ]


def latency(record: Mapping[str, Any] | None, tag_of_run: str | None) -> list[Html]:
    """How long a frame takes, as it was recorded.

    Args:
        record: records.latency; None: there is none.
        tag_of_run: the tag of the run's own robot (Robot.tag); None: not compared.
    """
    if record is None:
        return [
            paragraph(
                words(
                    "Times: {}. They are measured on purpose, on a quiet machine: "
                    "`python benchmarks/online.py --record`.",
                    cells.MISSING,
                )
            )
        ]
    settings = ", ".join(f"{key} {value}" for key, value in sorted(record["settings"].items()))
    modes = ", ".join(
        f"{key.replace('_', ' ')} {cells.rate(share)}" for key, share in record["modes"].items()
    )
    facts = [
        ("machine", f"{record['robot']}, {record['threads']} thread"
         + ("s" if record["threads"] != 1 else "")),
        ("recorded", record["date"]),
        ("robot", f"{record['robot']}, {record['joints']} joints, {record['pairs']} pairs of "
         f"bodies watched ({record['robot_tag']})"),
        ("poses proposed by", record["method"]),
        ("coal checks every pose", "yes" if record["check"] else "no"),
        ("settings", settings),
        ("frames by mode", modes or cells.MISSING),
    ]  # fmt: skip
    rows = [
        [row["part"], cells.count(row["calls"]), *(_time(row[key]) for key, _ in _TIMES)]
        for row in record["rows"]
    ]
    return [
        *_whose(record, tag_of_run),
        html.explained(
            html.table(["part", "calls", *(told for _, told in _TIMES)], rows),
            words(
                "half of the calls are faster than the median and one in a hundred is slower than "
                "the 99th percentile; *whole* is what a robot waits for from 21 numbers to a "
                "certified pose, the rows above it are its parts, timed by themselves."
            ),
        ),
        html.folded(
            "Robot, robot and settings of these times", html.table(["", ""], facts, numbers=False)
        ),
    ]


def _whose(record: Mapping[str, Any], tag_of_run: str | None) -> list[Html]:
    if tag_of_run is None or record["robot_tag"] == tag_of_run:
        told = "Measured on {} with this run's robot, apart from this run: wall times differ from "
        told += "one time to the next, so they are no part of its results."
        return [paragraph(words(told, record["machine"]))]
    same = record["robot_tag"].split()[:2] == tag_of_run.split()[:2]
    whom = "this run's robot with another margin or neck" if same else "another robot"
    told = words(
        "These times are not of this run: they were measured with {} ({}; this run: {}) on {}. "
        "`python benchmarks/online.py --record` measures those of this run.",
        whom, record["robot_tag"], tag_of_run, record["machine"],
    )  # fmt: skip
    return [paragraph(told, kind="alarm")]


def _time(us: float) -> str:
    return f"{us / 1e3:,.2f} ms" if us >= 1000.0 else f"{us:.1f} µs"
