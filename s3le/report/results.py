"""The part of the page on what was measured: key numbers, the measure, a table for each split."""

from collections.abc import Mapping
from typing import Any

from s3le.learn.methods import ENTRIES
from s3le.learn.methods import label as label_of
from s3le.report import between, cells, html
from s3le.report.html import Html, join, paragraph, tag, words
from s3le.show import style

# All of whose poses were checked: stored ones, and those of certified motions.
_CHECKED = tuple(key for key, entry in ENTRIES.items() if entry.pool or entry.online)
_ALARMS = (
    ("collision_rate", "collisions"),
    ("below_margin_rate", "too little clearance"),
    ("limit_rate", "broken limits"),
)
_KEY = ("certified_refined", "s3le", "lwl2", "lwl2_pairs", "ale")  # on top of the page


def labels_of(methods: Mapping[str, Any]) -> dict[str, str]:
    """What people read of each method, in the order to show: the known ones, then the others."""
    known = dict(style.METHODS)
    labels = known | {key: key for key in methods if key not in known}
    for key in methods:
        if key in known and "proposed_by" in cells.at(methods, key):
            labels[key] = label_of(key, methods[key]["proposed_by"])
    return labels


def key_numbers(splits: Mapping[str, Any]) -> list[Html]:
    """The few numbers to look at first: of the first split that was not trained on."""
    name = next((one for one in splits if one != "train"), next(iter(splits), None))
    if name is None:
        return []
    split = cells.at(splits, name)
    methods, truth = cells.at(split, "methods"), cells.at(split, "truth")
    labels = labels_of(methods)
    shown = [key for key in _KEY if key in methods]
    far = [cells.at(methods, key).get("to_truth") for key in shown]
    longest = cells.longest(far)
    cards = []
    for key, value in zip(shown, far, strict=True):
        got = cells.at(methods, key)
        known = cells.is_number(value)
        degrees = f"{cells.degrees(value)} in every direction" if known else ""
        width = f"width:{100 * value / longest:.1f}%" if known else "width:0"
        own = " own" if ENTRIES[key].online or key == "s3le" else ""
        cards.append(
            tag(
                "div",
                tag("h3", labels[key]),
                tag("p", cells.distance(value), class_="big"),
                tag("div", tag("i", style=width), class_="gauge", aria_hidden="true"),
                paragraph(degrees, kind="quiet"),
                tag(
                    "dl",
                    *_pair("poses collide", cells.rate(got.get("collision_rate"))),
                    *_pair("paths collide", cells.rate(got.get("segment_collision_rate"))),
                    *_pair("steps too fast", cells.rate(got.get("segment_too_fast_rate"))),
                ),
                class_=f"card{own}",
            )
        )
    return [
        tag("div", *cards, class_="cards"),
        paragraph(
            tag("b", "How to read it: "),
            words(
                "the large number is the mean cosine distance to the ground truth "
                "on *{}* ({} frames of {} motions; lower is better, the ground truth itself lies "
                "{} from the human), and below it stand the share of poses in which the robot "
                "touches itself, of the paths between two safe poses on which it does, and of the "
                "steps that are faster than its joints can go.",
                cells.text(name), cells.count(split.get("frames")),
                cells.count(split.get("clips")), cells.distance(truth.get("to_human")),
            ),
            kind="how",
        ),
    ]  # fmt: skip


def _pair(name: str, value: str) -> tuple[Html, Html]:
    return tag("dt", name), tag("dd", value)


def measure(run: Mapping[str, Any]) -> Html:
    """What a cosine distance is."""
    degrees = "; ".join(f"{d:g} is {cells.degrees(d)}" for d in (0.01, 0.05, 0.1, 0.2))
    return paragraph(
        words(
            "A pose is seen as seven directions: trunk, shoulders, upper arms, forearms. *Cosine "
            "distance* is the mean over {} of 1 - cos(angle between the two directions): 0 is the "
            "same pose, and d is what one gets when every direction is off by acos(1 - d). {}.",
            run.get("vectors_are", "the seven"), degrees,
        )
    )  # fmt: skip


def split_tables(split: Mapping[str, Any]) -> list[Html]:
    """Table, findings and segments of one split."""
    methods, truth = cells.at(split, "methods"), cells.at(split, "truth")
    labels = labels_of(methods)
    longest = cells.longest(cells.at(methods, key).get("to_truth") for key in labels)
    rows = [_row(key, label, methods, longest) for key, label in labels.items()]
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
    return [
        *findings(methods, truth),
        html.explained(
            html.table(titles, rows),
            "the first two columns are cosine distances, mean over all frames, lower is better, "
            "and the ground truth's own distance to the human is what the robot's body leaves no "
            "way around.",
            "Collisions and beyond limits are shares of frames.",
            words(
                "The last column is what a search without any learning, brute force for the "
                "nearest skeleton among the same stored poses, reaches against the ground truth "
                "(the rows *nearest skeleton* say more about it)."
            ),
            words(
                "S3LE and LWL2 look up the nearest pose in a store of poses that were all checked; "
                "ALE computes a pose and checks nothing. The rows *+ certify* follow each motion "
                "frame by frame from its own first pose, as the exported retargeter does."
            ),
        ),
    ]


def segments(split: Mapping[str, Any]) -> list[Html]:
    """What lies between the frames of one split."""
    methods = cells.at(split, "methods")
    return between.section(methods, labels_of(methods))


def _row(key: str, label: str, methods: Mapping[str, Any], longest: float) -> list[str]:
    label = cells.text(label)
    if key not in methods:
        return [label, *[cells.MISSING] * 6]
    got = cells.at(methods, key)
    pool = cells.NONE if "pool" in got and not got["pool"] else cells.count(got.get("pool"))
    if key in style.BRUTE_FORCE:
        same = cells.distance(cells.at(methods, style.BRUTE_FORCE[key]).get("to_truth"))
    else:
        same = cells.NONE
    far = got.get("to_truth")
    told = cells.distance(far)
    return [
        label,
        html.gauged(told, far / longest) if cells.is_number(far) else told,
        cells.distance(got.get("to_human")),
        cells.rate(got.get("collision_rate")),
        cells.rate(got.get("limit_rate")),
        pool,
        same,
    ]


def findings(methods: Mapping[str, Any], truth: Mapping[str, Any]) -> list[Html]:
    """What the table says, in sentences; nothing about what was not measured."""
    to_truth = {key: cells.at(methods, key).get("to_truth") for key in methods}
    own = to_truth.get("s3le")
    found, alarms = [], []
    if cells.is_number(own):
        found.append(
            f"S3LE stays {cells.distance(own)} from the ground truth, as if every direction were "
            f"{cells.degrees(own)} off."
        )
        ratios = [
            f"{own / to_truth[key]:.2f} times {told}"
            for key, told in (
                ("lwl2_pairs", "LWL2's (mocap pairs)"),
                ("lwl2", "LWL2's (with robot poses)"),
                ("lwl2_all", "LWL2's (with S3LE's poses)"),
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
        alarms.append(
            "This must not happen: poses that were checked turned out unsafe. "
            + "; ".join(broken)
            + "."
        )
    if cells.is_number(truth.get("collision_rate")) and truth["collision_rate"] > 0.0:
        alarms.append(
            f"The ground truth itself collides in {cells.rate(truth['collision_rate'])} of the "
            "frames, so it is not a reference to trust."
        )
    parts = [paragraph(" ".join(found))] if found else []
    return parts + [paragraph(one, kind="alarm") for one in alarms]


def guarantees(metrics: Mapping[str, Any]) -> Html:
    """What is promised, and what is not."""
    run = cells.at(metrics, "run")
    margin = run.get("margin_mm")
    known = cells.is_number(margin)
    kept = f"at least {cells.plain(margin)} mm" if known else "a margin (not stated)"
    points = [
        words(
            "**Guaranteed**: every single pose that S3LE, LWL2 or brute force returns is a stored "
            "pose, and each stored pose, as each pose of the rows *+ certify*, was checked one by "
            "one: all joints within their limits, and {} of clearance over all {} watched pairs "
            "of the robot's collision bodies.",
            kept, cells.count(run.get("pairs_watched")),
        ),
        words(
            "**Guaranteed in the rows** *+ certify* **alone**: the way from one pose to the next, "
            "a straight joint path that is proven to keep its own, smaller clearance, within the "
            "joints' speeds. Between two safe poses of the other rows the robot may pass through "
            "one that collides (*Between the frames* says how often)."
        ),
        words(
            "**Not guaranteed**: ALE's poses; pairs of bodies that are not watched; balance; the "
            "real robot where it differs from its collision bodies; and that a pose resembles the "
            "human."
        ),
    ]  # fmt: skip
    return tag("ul", join([tag("li", point) for point in points]))
