"""One Markdown page that reads a run to somebody who has not seen it.

Every number on it comes from the arguments; what is missing is called "not measured" (a figure:
"not drawn"). Its only calculations are ratios and sums of such numbers, and angles: acos(1 - d)
for a distance d.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from s3le.methods import ENTRIES
from s3le.methods import label as label_of
from s3le.report import between, cells, style
from s3le.report.curves import TERMS

_CAUSES = (
    ("dropped_tilt", "torso tilted too far"),
    ("dropped_pelvis", "pelvis line without direction"),
    ("dropped_bone", "bone without length"),
    ("dropped_not_finite", "not a finite number"),
)
# All of whose poses were checked: stored ones, and those of certified motions.
_CHECKED = tuple(key for key, entry in ENTRIES.items() if entry.pool or entry.online)
_ALARMS = (
    ("collision_rate", "collisions"),
    ("below_margin_rate", "too little clearance"),
    ("limit_rate", "broken limits"),
)
_FIGURES = {
    "bars": (
        "Motion by motion",
        "Each bar is one method on one motion, the grey band their mean, in which every motion "
        "counts once (in the tables every frame does); a short upright line is "
        "brute force for the nearest skeleton among the same stored poses. Shorter is better; the "
        "scale above the bars turns a distance into degrees.",
    ),
    "strip": (
        "Snapshots",
        "Each column is one moment. The first row is the human that the robots below should "
        "resemble; a red outline marks a pose in which the robot collides with itself.",
    ),
    "spaces": (
        "Latent spaces",
        "Each panel is one method's latent space in the plane in which robot poses (grey) spread "
        "most. A coloured dot is a human frame, the line from it leads to the latent of the pose "
        "that optimisation found for it: the shorter these lines against the grey cloud (the "
        "number below, over all dimensions), the better the two domains share the space.",
    ),
    "curves": (
        "Training curves",
        "Each panel is one training, each line one term of its loss. Lines that have gone flat "
        "say that more steps of the same kind would probably change little; terms of different "
        "methods are not comparable in height.",
    ),
    "maps": (
        "Synthetic example",
        "The paper's example in a plane, without a robot: a colour stands for one point of "
        "Feasible X and its y. Inside the red dashes many points share one answer; there the "
        "colours of a learned map should run on straight, as those of the true one do.",
    ),
}


def markdown(
    metrics: Mapping[str, Any],
    training: Mapping[str, list[Mapping[str, float]]],
    figures: Mapping[str, str],
    unwatched: Sequence[tuple[str, str, str, str]] = (),
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
        figures: path of each picture, relative to the page: "bars", "strip", "spaces", "curves",
            "maps", or any other name.
        unwatched: pairs of bodies that do not count for clearance: first body, second body, what
            they are (e.g. "limb-trunk"), and why.

    Returns:
        The page, ending in a newline.
    """
    parts = [
        *_head(metrics),
        *_measure(cells.at(metrics, "run")),
        *_splits(cells.at(metrics, "splits")),
        *_pictures(figures),
        *_guarantees(metrics),
        *_unwatched(unwatched),
        *_data(metrics),
        *_coverage(cells.at(metrics, "coverage")),
        *_training(training),
        "Wall times are no part of a result; those of the last run stand in `timing.json`.",
    ]
    return "\n\n".join(parts) + "\n"


def _head(metrics: Mapping[str, Any]) -> list[str]:
    run = cells.at(metrics, "run")
    splits = cells.at(metrics, "splits")
    shown = [
        f"*{cells.text(name)}*: {cells.count(split.get('frames'))} frames of "
        f"{cells.count(split.get('clips'))} motions"
        for name, split in splits.items()
    ]
    facts = [
        ("robot", f"{cells.text(run.get('robot'))}, {cells.count(run.get('n_dof'))} moving joints"),
        ("clips", cells.text(run.get("clips"))),
        ("measured on", "; ".join(shown) or cells.MISSING),
        ("pairs of bodies watched for collision", cells.count(run.get("pairs_watched"))),
        ("clearance wanted", f"{cells.plain(run.get('margin_mm'))} mm"),
    ]
    return [
        "# What this run found",
        "Human skeletons go in, poses of the robot come out. S3LE and LWL2 look up the nearest "
        "pose in a store of poses that were all checked; ALE computes a pose and checks nothing. "
        "Each is compared with the best pose that a slow optimisation finds under the robot's "
        "limits and without collisions, the *ground truth*. The rows *+ certify* follow each "
        "motion frame by frame from its own first pose, as the exported retargeter does. The "
        "motions measured here were not trained on, unless a split is called *train*.",
        cells.table(["this run", ""], [[name, value] for name, value in facts]),
    ]


def _measure(run: Mapping[str, Any]) -> list[str]:
    return [
        "## The measure",
        "A pose is seen as seven directions: trunk, shoulders, upper arms, forearms. *Cosine "
        f"distance* is the mean over {run.get('vectors_are', 'the seven')} of 1 - cos(angle "
        "between the two directions): 0 is the same pose, and d is what one gets when every "
        "direction is off by acos(1 - d). "
        + "; ".join(f"{d:g} is {cells.degrees(d)}" for d in (0.01, 0.05, 0.1, 0.2))
        + ".",
    ]


def _splits(splits: Mapping[str, Any]) -> list[str]:
    if not splits:
        return ["## Results", f"Results: {cells.MISSING}."]
    parts = []
    for name, split in splits.items():
        methods = cells.at(split, "methods")
        known = [key for key, _ in style.METHODS]
        labels = dict(style.METHODS) | {key: key for key in methods if key not in known}
        for key in methods:
            if key in known and "proposed_by" in cells.at(methods, key):
                labels[key] = label_of(key, methods[key]["proposed_by"])
        rows = [_method_row(key, label, methods) for key, label in labels.items()]
        truth = cells.at(split, "truth")
        rows.append(
            [
                "ground truth",
                cells.NONE,
                cells.distance(truth.get("to_human")),
                cells.rate(truth.get("collision_rate")),
                cells.rate(truth.get("limit_rate")),
                cells.NONE,
                cells.NONE,
            ]
        )
        titles = [
            "method", "to the ground truth", "to the human", "collisions", "beyond limits",
            "stored poses", "brute force on the same poses",
        ]  # fmt: skip
        parts += [
            f"## Results on *{cells.text(name)}* ({cells.count(split.get('clips'))} motions, "
            f"{cells.count(split.get('frames'))} frames)",
            cells.table(titles, rows),
            "How to read it: the first two columns are cosine distances, mean over all frames, "
            "lower is better, and the ground truth's own distance to the human is what the "
            "robot's body leaves no way around; collisions and beyond limits are shares of "
            "frames; the last column is what a search without any learning, brute force for "
            "the nearest skeleton among the same stored poses, reaches against the ground truth "
            "(the rows *nearest skeleton* say more about it).",
            *_findings(methods, truth),
            *between.section(methods, labels),
        ]
    return parts


def _method_row(key: str, label: str, methods: Mapping[str, Any]) -> list[str]:
    if key not in methods:
        return [label, *[cells.MISSING] * 6]
    got = cells.at(methods, key)
    pool = cells.NONE if "pool" in got and not got["pool"] else cells.count(got.get("pool"))
    if key in style.BRUTE_FORCE:
        same = cells.distance(cells.at(methods, style.BRUTE_FORCE[key]).get("to_truth"))
    else:
        same = cells.NONE
    return [
        cells.text(label),
        cells.distance(got.get("to_truth")),
        cells.distance(got.get("to_human")),
        cells.rate(got.get("collision_rate")),
        cells.rate(got.get("limit_rate")),
        pool,
        same,
    ]


def _findings(methods: Mapping[str, Any], truth: Mapping[str, Any]) -> list[str]:
    """What the table says, in sentences; nothing about what was not measured."""
    to_truth = {key: cells.at(methods, key).get("to_truth") for key in methods}
    own = to_truth.get("s3le")
    found = []
    if cells.is_number(own):
        found.append(
            f"S3LE stays {cells.distance(own)} from the ground truth, as if every direction were "
            f"{cells.degrees(own)} off."
        )
        ratios = [
            f"{own / to_truth[key]:.2f} times {words}"
            for key, words in (
                ("lwl2_pairs", "LWL2's (mocap pairs)"),
                ("lwl2", "LWL2's (with robot poses)"),
                ("ale", "ALE's"),
                ("skeleton_all", "that of brute force over the same poses"),
            )
            if cells.is_number(to_truth.get(key)) and to_truth[key] > 0.0
        ]
        if ratios:
            found.append(f"Its distance is {cells.listed(ratios)}.")
    broken = [
        f"{label} ({what} in {cells.rate(cells.at(methods, key).get(rate))} of the frames)"
        for key, label in style.METHODS
        if key in _CHECKED
        for rate, what in _ALARMS
        if cells.is_number(cells.at(methods, key).get(rate)) and cells.at(methods, key)[rate] > 0.0
    ]
    if broken:
        found.append(
            "**This must not happen: poses that were checked turned out unsafe.** "
            + "; ".join(broken)
            + "."
        )
    if cells.is_number(truth.get("collision_rate")) and truth["collision_rate"] > 0.0:
        found.append(
            f"**The ground truth itself collides in {cells.rate(truth['collision_rate'])} of the "
            "frames, so it is not a reference to trust.**"
        )
    return [" ".join(found)] if found else []


def _pictures(figures: Mapping[str, str]) -> list[str]:
    parts = []
    for name, (title, how) in _FIGURES.items():
        parts.append(f"## {title}")
        if figures.get(name):
            parts += [f"![{title}]({figures[name]})", f"How to read it: {how[0].lower()}{how[1:]}"]
        else:
            parts.append("Figure: not drawn.")
    for name in figures:
        if name not in _FIGURES:
            title = cells.text(name.replace("_", " "))
            parts += [f"## {title[:1].upper()}{title[1:]}", f"![{title}]({figures[name]})"]
    return parts


def _guarantees(metrics: Mapping[str, Any]) -> list[str]:
    run = cells.at(metrics, "run")
    margin = run.get("margin_mm")
    known = cells.is_number(margin)
    kept = f"at least {cells.plain(margin)} mm" if known else "a margin (not stated)"
    return [
        "## What is guaranteed, and what is not",
        "- Guaranteed: every single pose that S3LE, LWL2 or brute force returns is a stored pose, "
        "and each stored pose, as each pose of the rows *+ certify*, was checked one by one: all "
        f"joints within their limits, and {kept} of clearance over all "
        f"{cells.count(run.get('pairs_watched'))} watched pairs of the robot's collision bodies.\n"
        "- Guaranteed in the rows *+ certify* alone: the way from one pose to the next, a straight "
        "joint path that is proven to keep its own, smaller clearance, within the joints' speeds. "
        "Between two safe poses of the other rows the robot may pass through one that collides "
        "(*Between the frames* says how often).\n"
        "- Not guaranteed: ALE's poses; pairs of bodies that are not watched; balance; the real "
        "robot where it differs from its collision bodies; and that a pose resembles the human.",
    ]


def _unwatched(pairs: Sequence[tuple[str, str, str, str]]) -> list[str]:
    if not pairs:
        return []
    rows = [[cells.text(cell) for cell in pair] for pair in pairs]
    return [
        "## Pairs of bodies that are not watched",
        cells.table(["body", "body", "what they are", "why"], rows, words=True),
        "How to read it: two bodies that already overlap in the anchor pose (when grown a little) "
        "are neighbours by construction, and their distance cannot serve as a warning; bodies that "
        "cannot move relative to each other are left out here. All pairs stand in "
        "`data/robot/pairs.parquet`.",
    ]


def _data(metrics: Mapping[str, Any]) -> list[str]:
    clips = cells.at(metrics, "clips")
    rows = [
        [cells.text(name), cells.count(split.get("clips")), cells.count(split.get("frames"))]
        + [cells.count(split.get(key)) for key, _ in _CAUSES]
        for name, split in clips.items()
    ]
    dropped = (
        [
            cells.table(
                ["split", "motions", "frames kept", *[words for _, words in _CAUSES]], rows
            ),
            "How to read it: the last four columns count frames that were dropped, each under "
            "the reason why.",
        ]
        if rows
        else [f"Frames kept and dropped: {cells.MISSING}."]
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
        "## Frames kept and dropped",
        *dropped,
        "## What the training saw, and what projection did",
        cells.table(["", ""], [[name, value] for name, value in facts]),
        "How to read it: projection moves a drawn pose to the nearest one found that is safe. "
        "The fallback is the poorer way, taken where the solver does not get there; it should "
        "be rare.",
    ]


def _coverage(splits: Mapping[str, Any]) -> list[str]:
    if not splits:
        return []
    first = next(iter(splits.values()))
    names = list(dict.fromkeys(name for split in splits.values() for name in split))
    names.sort(key=lambda name: first.get(name, {}).get("mean", math.inf))
    titles = ["stored poses"]
    for split in splits:
        titles += [f"{cells.text(split)}: alone", f"{cells.text(split)}: with the IK pairs"]
    rows = []
    for name in names:
        row = [cells.text(name.replace("_", " "))]
        for split in splits.values():
            found = split.get(name, {})
            with_pairs = found.get("with_pairs")
            row.append(cells.distance(found.get("mean")))
            row.append(cells.NONE if with_pairs is None else cells.distance(with_pairs))
        rows.append(row)
    return [
        "## What each sampler covers",
        cells.table(titles, rows),
        "How to read it: cosine distance of the nearest stored pose to people that no sampler "
        "has seen, every sampler with the same number of poses, found by brute force, so no "
        "look-up among these poses can do better. *uniform* is the paper's; *pairs alone* are "
        "the poses that inverse kinematics made of the training clips. `reports/coverage.csv` "
        "has the 90th percentile too.",
    ]


def _training(training: Mapping[str, list[Mapping[str, float]]]) -> list[str]:
    parts = ["## Training"]
    rows = []
    order = [key for key in style.TRAINED if key in training]
    for method in order + [key for key in training if key not in order]:
        history = training[method]
        if not history:
            label = cells.text(style.TRAINED.get(method, method))
            rows.append([label, cells.MISSING, cells.MISSING])
            continue
        first, last = history[0], history[-1]
        terms = [
            f"{cells.text(TERMS[key][0] if key in TERMS else key.replace('_', ' '))} "
            f"{cells.plain(first.get(key))} to {cells.plain(last[key])}"
            for key in [*TERMS, *[key for key in last if key not in TERMS]]
            if key in last and key != "step"
        ]
        label = cells.text(style.TRAINED.get(method, method))
        rows.append([label, cells.count(last.get("step")), "; ".join(terms)])
    if not rows:
        return [*parts, f"Training: {cells.MISSING}."]
    return [
        *parts,
        cells.table(["method", "steps", "loss terms, first to last row of the history"], rows),
        "How to read it: a term that ends where it began was not learned.",
    ]
