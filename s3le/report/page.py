"""One HTML page that reads a run to somebody who has not seen it.

Every number on it comes from the arguments; what is missing is called "not measured" (a figure:
"not drawn"). Its only calculations are ratios and sums of such numbers, and angles: acos(1 - d)
for a distance d. The page is one file: it holds its pictures, asks no network for anything and
runs no program, which its own policy has the browser enforce.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from s3le.report import cells, embed, html, look, made, parameters, records, results
from s3le.report.html import Html, join, paragraph, tag, words
from s3le.show import style

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


class _Picture(NamedTuple):
    section: str  # title
    alt: str
    how: str
    more: tuple[str, ...]
    narrowest: int  # [CSS pixels] below which it scrolls


_PICTURES = {
    "bars": _Picture(
        "Motion by motion",
        "Bars: for each test motion the mean distance of every method to the ground truth.",
        "each bar is one method on one motion, shorter is better, and a short upright line is "
        "brute force for the nearest skeleton among the same stored poses.",
        (
            "The grey band is their mean, in which every motion counts once (in the tables every "
            "frame does); the scale above the bars turns a distance into degrees.",
        ),
        620,
    ),
    "strip": _Picture(
        "Snapshots",
        "A strip of moments of one test motion: the human above, below it the robot in the pose "
        "of the ground truth and of each method.",
        "each column is one moment, the first row is the human that the robots below should "
        "resemble, and a red outline marks a pose in which the robot collides with itself.",
        (
            "The number below a pose is its cosine distance to the ground truth (of the ground "
            "truth: to the human). The certified robot keeps its joints' speeds, so it lags where "
            "the human is faster, and catches up.",
        ),
        900,
    ),
    "spaces": _Picture(
        "Latent spaces",
        "Scatter plots, one for each training: latents of robot poses, of human frames, and lines "
        "between each frame and its ground truth.",
        "a coloured dot is a human frame, the line from it leads to the latent of the pose that "
        "optimisation found for it: the shorter these lines against the grey cloud of robot "
        "poses, the better the two domains share the space.",
        (
            "Each panel is one method's latent space in the plane in which robot poses (grey) "
            "spread most; the number below is over all dimensions.",
        ),
        720,
    ),
    "curves": _Picture(
        "Training",
        "Line plots, one for each training: every term of its loss over the steps.",
        "each panel is one training, each line one term of its loss, and lines that have gone "
        "flat say that more steps of the same kind would probably change little.",
        ("Terms of different methods are not comparable in height.",),
        760,
    ),
    "maps": _Picture(
        "Synthetic example",
        "Coloured squares: the true map of the synthetic example, what was learnt without and "
        "with NT-Xent, and the errors of both.",
        "a colour stands for one point of Feasible X and its y; inside the red dashes many points "
        "share one answer, and there the colours of a learned map should run on straight, as "
        "those of the true one do.",
        ("This is the paper's example in a plane, without a robot.",),
        720,
    ),
}


class _Section(NamedTuple):
    name: str
    title: str
    parts: list[Html]


def page(
    metrics: Mapping[str, Any],
    training: Mapping[str, list[Mapping[str, float]]],
    figures: Mapping[str, embed.Media],
    *,
    motions: Sequence[Mapping[str, Any]] = (),
    unwatched: Sequence[tuple[str, str, str, str]] = (),
    knobs: Sequence[parameters.Parameter] = (),
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
    labels = dict(style.METHODS)
    for split in splits.values():
        labels |= results.labels_of(cells.at(split, "methods"))
    bars = [*_picture("bars", figures), *_table(motions, labels)]
    parts = [
        _Section("run", "What was run", _run(metrics, knobs)),
        *_results(metrics),
        *([_Section("grid", "Which pool, which distance", made.grid(grid))] if grid else []),
        _Section("motions", "Motion by motion", bars),
        _Section("snapshots", "Snapshots", _picture("strip", figures)),
        *([_Section("video", video[0].title, _video(*video))] if video else []),
        *_between(splits),
        _Section("latents", "Latent spaces", _picture("spaces", figures)),
        _Section(
            "training", "Training", [*_picture("curves", figures), *made.training(training)]
        ),
        _Section(
            "coverage", "What each sampler covers", made.coverage(cells.at(metrics, "coverage"))
        ),
        _Section("synthetic", "Synthetic example", _picture("maps", figures)),
        *_others(figures),
        _Section("latency", "How long a frame takes", made.latency(latency, robot_tag)),
        _Section(
            "guarantees", "What is guaranteed, and what is not",
            [results.guarantees(metrics), *made.unwatched(unwatched)],
        ),
        _Section("compare", "Compare with another run", [_compare()]),
    ]  # fmt: skip
    held = [*figures.values(), *([video[1]] if video else [])]
    return _document(_head(metrics), parts, sum(len(media.content) for media in held), len(held))


def _document(head: Html, sections: list[_Section], size: int, pictures: int) -> str:
    links = [tag("li", tag("a", one.title, href=f"#{one.name}")) for one in sections]
    contents = tag("nav", tag("h2", "Contents"), tag("ol", *links), aria_label="Contents")
    bodies = [
        tag("section", tag("h2", one.title), *one.parts, id=one.name) for one in sections
    ]
    foot = tag(
        "footer",
        paragraph(
            words(
                "This page is one file with its {} pictures ({} kB) in it; it asks no network and "
                "runs no program. Wall times are no part of a result; those of the last run's "
                "stages stand in `reports/timing.json`.",
                pictures, f"{size / 1000:,.0f}",
            )
        ),
    )  # fmt: skip
    document = tag(
        "html",
        tag(
            "head",
            tag("meta", charset="utf-8"),
            tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
            tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
            tag("meta", name="color-scheme", content="light dark"),
            tag("title", "S3LE: what this run found"),
            tag("style", Html(look.sheet())),
        ),
        tag("body", head, contents, tag("main", *bodies, foot)),
        lang="en",
    )
    return f"<!doctype html>\n{document}\n"


def _head(metrics: Mapping[str, Any]) -> Html:
    return tag(
        "header",
        tag("h1", "What this run found"),
        paragraph(
            words(
                "Human skeletons go in, poses of the robot come out. S3LE and LWL2 look up the "
                "nearest pose in a store of poses that were all checked; ALE computes a pose and "
                "checks nothing. Each is compared with the best pose that a slow optimisation "
                "finds under the robot's limits and without collisions, the *ground truth*. The "
                "motions measured here were not trained on, unless a split is called *train*."
            ),
            kind="lead",
        ),
        *results.key_numbers(cells.at(metrics, "splits")),
    )


def _run(metrics: Mapping[str, Any], knobs: Sequence[parameters.Parameter]) -> list[Html]:
    run = cells.at(metrics, "run")
    shown = [
        f"{cells.text(name)}: {cells.count(split.get('frames'))} frames of "
        f"{cells.count(split.get('clips'))} motions"
        for name, split in cells.at(metrics, "splits").items()
    ]
    facts = [
        ("robot", f"{cells.text(run.get('robot'))}, {cells.count(run.get('n_dof'))} moving joints"),
        ("clips", cells.text(run.get("clips"))),
        ("measured on", "; ".join(shown) or cells.MISSING),
        ("pairs of bodies watched for collision", cells.count(run.get("pairs_watched"))),
        ("clearance wanted", f"{cells.plain(run.get('margin_mm'))} mm"),
    ]
    return [
        html.explained(
            html.table(["", ""], facts, numbers=False),
            "this is what the numbers on the page hold for; every other choice is among the "
            "parameters.",
        ),
        *([parameters.section(list(knobs))] if knobs else []),
        html.folded("Frames dropped, tuples made, projection", *made.data(metrics)),
    ]


def _results(metrics: Mapping[str, Any]) -> list[_Section]:
    splits = cells.at(metrics, "splits")
    measure = results.measure(cells.at(metrics, "run"))
    if not splits:
        missing = paragraph(f"Results: {cells.MISSING}.")
        return [_Section("results", "Results", [measure, missing])]
    return [
        _Section(
            "results" if not place else f"results-{place}",
            f"Results on {cells.text(name)}",
            [*([] if place else [measure]), *results.split_tables(split)],
        )
        for place, (name, split) in enumerate(splits.items())
    ]


def _between(splits: Mapping[str, Any]) -> list[_Section]:
    parts = []
    for name, split in splits.items():
        own = results.segments(split)
        parts += own if len(splits) == 1 else [tag("h3", f"On {cells.text(name)}"), *own]
    return [_Section("between", "Between the frames", parts)] if parts else []


def _picture(name: str, figures: Mapping[str, embed.Media]) -> list[Html]:
    about = _PICTURES[name]
    if name not in figures:
        return [paragraph("Figure: not drawn.")]
    shown = embed.shown(figures[name], name, about.alt, about.narrowest)
    return [html.explained(shown, about.how, *about.more)]


def _others(figures: Mapping[str, embed.Media]) -> list[_Section]:
    found = []
    for place, name in enumerate(name for name in figures if name not in _PICTURES):
        title = cells.text(name.replace("_", " "))
        shown = embed.shown(figures[name], f"other-{place}", title, 620)
        found.append(_Section(f"other-{place}", title[:1].upper() + title[1:], [shown]))
    return found


def _table(motions: Sequence[Mapping[str, Any]], labels: Mapping[str, str]) -> list[Html]:
    """The numbers of the bars, for those who cannot see them or want to copy them."""
    if not motions:
        return []
    known = [key for key in labels if any(row["method"] == key for row in motions)]
    value = {
        (row["split"], row["clip"], row["method"]): row.get("to_truth") for row in motions
    }
    places = dict.fromkeys((row["split"], row["clip"]) for row in motions)
    rows = [
        [f"{cells.text(split)}: {cells.text(clip)}"]
        + [cells.distance(value.get((split, clip, key))) for key in known]
        for split, clip in places
    ]
    shown = html.explained(
        html.table(["motion", *(labels[key] for key in known)], rows),
        "mean cosine distance to the ground truth over the frames of one motion, lower is better.",
    )
    return [html.folded("The numbers of this chart", shown)]


def _video(about: records.Figure, media: embed.Media) -> list[Html]:
    facts = [html.table(["", ""], about.numbers, numbers=False)] if about.numbers else []
    alt = "A strip of moments: frames of a video, skeletons estimated in them, the robot's poses."
    how = (
        "each column is one moment of the video: the frame above, the skeleton that was estimated "
        "in it, and the robot below, which should be in the same pose."
    )
    return [
        paragraph(about.caption),
        html.explained(embed.shown(media, "video", alt, 760), how),
        *([html.folded("Numbers of this picture", *facts)] if facts else []),
    ]


def _compare() -> Html:
    lines = [
        ("dvc exp run -S alpha=0.5", "another run, only what the change touches"),
        ("dvc params diff; dvc metrics diff", "what differs from the last commit, in numbers"),
        ("dvc plots diff", "the charts of both runs in one page"),
        ("dvc plots diff main my-branch", "the same for any two commits, branches or experiments"),
    ]
    return join(
        [
            paragraph(
                words(
                    "Every run leaves its figures as numbers beside this page, so that two runs "
                    "are laid over each other by a command; the page that `dvc plots diff` writes "
                    "is `dvc_plots/index.html` and, unlike this one, fetches what draws its charts "
                    "from the network."
                )
            ),
            html.table(["", ""], [[tag("code", line), told] for line, told in lines], False),
        ]
    )
