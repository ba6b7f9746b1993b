"""What the page is made of: numbers and names of a run, as page.html.j2 lays them out.

Every number on the page comes from the arguments; what is missing is called "not measured" (a
figure: "not drawn"). The only calculations are ratios and sums of such numbers, and angles:
acos(1 - d) for a distance d. The page is one file: it holds its pictures, asks no network for
anything and runs no program, which its own policy has the browser enforce.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from s3le.learn.methods import PROPOSERS
from s3le.report import cells, embed, records, results
from s3le.report.curves import TERMS
from s3le.report.parameters import Parameter
from s3le.show import style, svg

_DROPPED = ("dropped_tilt", "dropped_pelvis", "dropped_bone", "dropped_not_finite")
_TIMES = ("us_p50", "us_p99", "us_worst")
_PICTURES = ("bars", "strip", "spaces", "curves", "maps")


def page(
    metrics: Mapping[str, Any],
    training: Mapping[str, list[Mapping[str, float]]],
    figures: Mapping[str, embed.Media],
    *,
    motions: Sequence[Mapping[str, Any]] = (),
    unwatched: Sequence[tuple[str, str, str, str]] = (),
    knobs: Sequence[Parameter] = (),
    latency: Mapping[str, Any] | None = None,
    robot_tag: str | None = None,
    video: tuple[records.Figure, embed.Media] | None = None,
    grid: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Write the page.

    Args:
        metrics: the run's merged metrics, any part of which may be missing: "run", "clips",
            "domain", "pairs", "sampling", "poses", "splits". Distances are cosine distances [-],
            mean over a split's frames; rates are shares in [0, 1]; a pool is a number of poses,
            None or 0 for a method that stores none; "margin_mm" [mm],
            "moved_mean_rad" [rad], "accepted_share" a share in [0, 1], the rest counts.
        training: for each method its history, rows of "step" and loss terms [-]
            (as curves.draw takes it).
        figures: "bars", "strip", "spaces", "curves", "maps"; others are shown by their names.
        motions: rows as bars.draw takes them, for the table below the bars.
        unwatched: pairs of bodies that do not count for clearance: first body, second body, what
            they are (e.g. "limb-trunk"), and why.
        knobs: every parameter of the run.
        latency: records.latency.
        robot_tag: Robot.tag of the run's robot.
        video: what was made of a plain video: words and picture.
        grid: rows of reports/grid.csv; none: there is no section on it.

    Returns:
        The page, ending in a newline; equal arguments give equal bytes.
    """
    splits = cells.at(metrics, "splits")
    held = [*figures.values(), *([video[1]] if video else [])]
    return _template().render(
        figures=figures,
        others=[name for name in figures if name not in _PICTURES],
        held=len(held),
        size=sum(len(media.content) for media in held),
        twins={svg.variable(old): new for old, new in svg.DARK.items()},
        key=results.key_numbers(splits),
        run=cells.at(metrics, "run"),
        splits=[results.split(name, cells.at(splits, name)) for name in splits],
        clips=[
            [cells.text(name), cells.count(split.get("clips")), cells.count(split.get("frames"))]
            + [cells.count(split.get(key)) for key in _DROPPED]
            for name, split in cells.at(metrics, "clips").items()
        ],
        made=_made(metrics),
        grid=_grid(grid),
        motions=_motions(motions, splits),
        coverage=_coverage(cells.at(metrics, "coverage")),
        training=_training(training),
        unwatched=[[cells.text(cell) for cell in pair] for pair in unwatched],
        knobs=knobs,
        latency=latency and _latency(latency, robot_tag),
        video=video,
    )


def _template():
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        extensions=["jinja2.ext.do"],
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_printable,
    )
    for filter_ in (cells.count, cells.degrees, cells.distance, cells.plain, cells.rate):
        environment.filters[filter_.__name__] = filter_
    environment.filters |= {
        "told": cells.text,
        "number": cells.is_number,
        "listed": cells.listed,
    }
    return environment.get_template("page.html.j2")


def _printable(value: object) -> object:
    """What does not print (also what turns the reading direction) is replaced.

    A lone surrogate does not print either, so the page can always be written as UTF-8.
    """
    if hasattr(value, "__html__"):
        return value
    return "".join(c if c.isprintable() or c == "\n" else "\ufffd" for c in str(value))


def _made(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the training saw, and what projection did."""
    domain, pairs = cells.at(metrics, "domain"), cells.at(metrics, "pairs")
    sampling, poses = cells.at(metrics, "sampling"), cells.at(metrics, "poses")
    total, moved = sampling.get("rows"), sampling.get("moved_mean_rad")
    turned = f" ({math.degrees(moved):.1f}°)" if cells.is_number(moved) else ""
    collided = cells.of(pairs.get("collided"), pairs.get("rows"))
    return [
        ("skeletons to learn from: raw", cells.count(domain.get("raw"))),
        ("skeletons to learn from: mirrored", cells.count(domain.get("mirrored"))),
        ("skeletons to learn from: with noise", cells.count(domain.get("noisy"))),
        ("pairs of human and robot", cells.count(pairs.get("rows"))),
        ("of these colliding before projection", collided),
        ("sampled poses", cells.count(total)),
        ("of these feasible as drawn", cells.of(sampling.get("feasible"), total)),
        ("of these projected by the solver", cells.of(sampling.get("solved"), total)),
        ("of these projected by the fallback", cells.of(sampling.get("fallback"), total)),
        ("mean change in q by projection", f"{cells.plain(moved)} rad{turned}"),
        ("robot poses", cells.count(poses.get("rows"))),
        ("share of draws accepted as robot poses", cells.rate(poses.get("accepted_share"))),
    ]


def _grid(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each model in each pool by each metric, to the ground truth: a table for each split.

    Args:
        rows: of reports/grid.csv: "split", "model", "pool", "metric", "stored", "to_truth".
    """
    metrics = list(dict.fromkeys(row["metric"] for row in rows))
    found = {(r["split"], r["model"], r["pool"], r["metric"]): r["to_truth"] for r in rows}
    stored = {(row["model"], row["pool"]): row["stored"] for row in rows}
    longest = cells.longest(found.values())
    return [
        {
            "split": split,
            "titles": ["looked up in", *(cells.text(metric) for metric in metrics), "stored poses"],
            "rows": [
                [
                    f"{PROPOSERS.get(model, cells.text(model))}, {cells.text(pool)}",
                    *(
                        cells.NONE
                        if found.get((split, model, pool, metric)) is None
                        else results.gauge(found[split, model, pool, metric], longest)
                        for metric in metrics
                    ),
                    cells.count(count),
                ]
                for (model, pool), count in stored.items()
            ],
        }
        for split in dict.fromkeys(row["split"] for row in rows)
    ]


def _motions(
    motions: Sequence[Mapping[str, Any]], splits: Mapping[str, Any]
) -> dict[str, list] | None:
    """The numbers of the bars, for those who cannot see them or want to copy them."""
    labels = dict(style.METHODS)
    for split in splits.values():
        labels |= results.labels_of(cells.at(split, "methods"))
    known = [key for key in labels if any(row["method"] == key for row in motions)]
    value = {(row["split"], row["clip"], row["method"]): row.get("to_truth") for row in motions}
    places = dict.fromkeys((row["split"], row["clip"]) for row in motions)
    rows = [
        [f"{cells.text(split)}: {cells.text(clip)}"]
        + [cells.distance(value.get((split, clip, key))) for key in known]
        for split, clip in places
    ]
    return {"titles": ["motion", *(labels[key] for key in known)], "rows": rows} if rows else None


def _coverage(splits: Mapping[str, Any]) -> dict[str, list] | None:
    """How near each sampler's poses come to people."""
    if not splits:
        return None
    first = next(iter(splits.values()))
    names = list(dict.fromkeys(name for split in splits.values() for name in split))
    names.sort(key=lambda name: first.get(name, {}).get("mean", math.inf))
    titles = ["stored poses"]
    for split in splits:
        titles += [f"{cells.text(split)}: alone", f"{cells.text(split)}: with the IK pairs"]
    longest = cells.longest(own.get("mean") for split in splits.values() for own in split.values())
    rows = []
    for name in names:
        row: list[str | results.Gauge] = [cells.text(name.replace("_", " "))]
        for split in splits.values():
            found = split.get(name, {})
            paired = found.get("with_pairs")
            row.append(results.gauge(found.get("mean"), longest))
            row.append(cells.NONE if paired is None else results.gauge(paired, longest))
        rows.append(row)
    return {"titles": titles, "rows": rows}


def _training(histories: Mapping[str, list[Mapping[str, float]]]) -> list[list[str]]:
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
    return rows


def _latency(record: Mapping[str, Any], tag_of_run: str | None) -> dict[str, Any]:
    """How long a frame takes, as it was recorded, and whether with the run's own robot."""
    own = tag_of_run is None or record["robot_tag"] == tag_of_run
    same = tag_of_run and record["robot_tag"].split()[:2] == tag_of_run.split()[:2]
    settings = ", ".join(f"{key} {value}" for key, value in sorted(record["settings"].items()))
    modes = ", ".join(
        f"{key.replace('_', ' ')} {cells.rate(share)}" for key, share in record["modes"].items()
    )
    threads = f"{record['threads']} thread" + ("s" if record["threads"] != 1 else "")
    joints = f"{record['joints']} joints, {record['pairs']} pairs of bodies watched"
    return {
        "record": record,
        "of_run": tag_of_run,
        "whose": "this run's robot with another margin or neck" if same else "another robot",
        "own": own,
        "facts": [
            ("machine", f"{record['machine']}, {threads}"),
            ("recorded", record["date"]),
            ("robot", f"{record['robot']}, {joints} ({record['robot_tag']})"),
            ("poses proposed by", record["method"]),
            ("coal checks every pose", "yes" if record["check"] else "no"),
            ("settings", settings),
            ("frames by mode", modes or cells.MISSING),
        ],
        "rows": [
            [row["part"], cells.count(row["calls"]), *(_time(row[key]) for key in _TIMES)]
            for row in record["rows"]
        ],
    }


def _time(us: float) -> str:
    return f"{us / 1e3:,.2f} ms" if us >= 1000.0 else f"{us:.1f} µs"
