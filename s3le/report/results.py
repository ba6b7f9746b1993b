"""What was measured of each method: key numbers, and the tables and findings of each split."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from s3le.learn.methods import ENTRIES
from s3le.learn.methods import label as label_of
from s3le.report import cells
from s3le.show import style

# All of whose poses were checked: stored ones, and those of certified motions.
_CHECKED = tuple(key for key, entry in ENTRIES.items() if entry.pool or entry.online)
_ONLINE = tuple(key for key, entry in ENTRIES.items() if entry.online)
_ALARMS = (
    ("collision_rate", "collisions"),
    ("below_margin_rate", "too little clearance"),
    ("limit_rate", "broken limits"),
)
_KEY = ("certified_refined", "s3le", "lwl2", "lwl2_pairs", "ale")  # on top of the page
_RIVALS = (
    ("lwl2_pairs", "LWL2's (mocap pairs)"),
    ("lwl2", "LWL2's (with robot poses)"),
    ("lwl2_all", "LWL2's (with S3LE's poses)"),
    ("ale", "ALE's"),
    ("skeleton_all", "that of brute force over the same poses"),
)
_BAD = ("segments_colliding", "segments_undecided", "segments_too_fast")
_GUARDED = ("limited_rate", "avoiding_rate", "held_rate")


class Gauge(NamedTuple):
    """A number with a bar before it."""

    shown: str
    share: float  # length of the bar, from 0 to 1 of its room


def gauge(value: object, longest: float) -> str | Gauge:
    """A distance with its bar, of so many as the longest."""
    told = cells.distance(value)
    return Gauge(told, value / longest) if cells.is_number(value) else told


def labels_of(methods: Mapping[str, Any]) -> dict[str, str]:
    """What people read of each method, in the order to show: the known ones, then the others."""
    known = dict(style.METHODS)
    labels = known | {key: key for key in methods if key not in known}
    for key in methods:
        if key in known and "proposed_by" in cells.at(methods, key):
            labels[key] = label_of(key, methods[key]["proposed_by"])
    return labels


def key_numbers(splits: Mapping[str, Any]) -> dict[str, Any] | None:
    """The few numbers to look at first: of the first split that was not trained on."""
    name = next((one for one in splits if one != "train"), next(iter(splits), None))
    if name is None:
        return None
    split = cells.at(splits, name)
    methods = cells.at(split, "methods")
    labels = labels_of(methods)
    shown = {key: cells.at(methods, key) for key in _KEY if key in methods}
    longest = cells.longest(got.get("to_truth") for got in shown.values())
    cards = [
        {
            "label": labels[key],
            "own": ENTRIES[key].online or key == "s3le",
            "far": got.get("to_truth"),
            "longest": longest,
            "rates": [
                ("poses collide", got.get("collision_rate")),
                ("paths collide", got.get("segment_collision_rate")),
                ("steps too fast", got.get("segment_too_fast_rate")),
            ],
        }
        for key, got in shown.items()
    ]
    return {"name": name, "split": split, "truth": cells.at(split, "truth"), "cards": cards}


def split(name: str, split: Mapping[str, Any]) -> dict[str, Any]:
    """Tables and findings of one split."""
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
    to_truth = {key: cells.at(methods, key).get("to_truth") for key in methods}
    own, collides = to_truth.get("s3le"), truth.get("collision_rate")
    return {
        "name": name,
        "frames": split.get("frames"),
        "clips": split.get("clips"),
        "rows": rows,
        "own": own,
        "ratios": [
            f"{own / other:.2f} times {told}"
            for key, told in _RIVALS
            if cells.is_number(own) and cells.is_number(other := to_truth.get(key)) and other > 0.0
        ],
        "unsafe": [
            f"{label} ({what} in {cells.rate(cells.at(methods, key).get(rate))} of the frames)"
            for key, label in style.METHODS
            if key in _CHECKED
            for rate, what in _ALARMS
            if _above(cells.at(methods, key).get(rate))
        ],
        "truth_collides": collides if _above(collides) else None,
        "between": _between({key: cells.at(methods, key) for key in labels}, labels),
    }


def _above(value: object) -> bool:
    return cells.is_number(value) and value > 0


def _row(key: str, label: str, methods: Mapping[str, Any], longest: float) -> list[str | Gauge]:
    label = cells.text(label)
    if key not in methods:
        return [label, *[cells.MISSING] * 6]
    got = cells.at(methods, key)
    same = cells.NONE
    if key in style.BRUTE_FORCE:
        same = cells.distance(cells.at(methods, style.BRUTE_FORCE[key]).get("to_truth"))
    return [
        label,
        gauge(got.get("to_truth"), longest),
        cells.distance(got.get("to_human")),
        cells.rate(got.get("collision_rate")),
        cells.rate(got.get("limit_rate")),
        cells.NONE if "pool" in got and not got["pool"] else cells.count(got.get("pool")),
        same,
    ]


def _between(got: Mapping[str, Mapping[str, Any]], labels: Mapping[str, str]) -> dict[str, Any]:
    """What lies between the frames of one split, and what the guard had to do."""
    margins = [found["segment_margin_mm"] for found in got.values() if "segment_margin_mm" in found]

    def share(found: Mapping[str, Any], rate: str, of: str) -> str:
        return cells.NONE if found.get(of) == 0 else cells.rate(found.get(rate))

    return {
        "margin": f"{cells.plain(margins[0])} mm" if margins else "their margin",
        "own": got.get("s3le", {}),
        "broken": list(
            dict.fromkeys(
                key for key in _ONLINE for bad in _BAD if _above(got.get(key, {}).get(bad))
            )
        ),
        "rows": [
            [
                cells.text(label),
                cells.count(got[key].get("segments")),
                cells.of(got[key].get("segments_feasible"), got[key].get("segments")),
                share(got[key], "segment_collision_rate", "segments_feasible"),
                share(got[key], "segment_undecided_rate", "segments_feasible"),
                share(got[key], "segment_uncertified_rate", "segments"),
                share(got[key], "segment_too_fast_rate", "segments"),
                cells.plain(got[key].get("largest_jump_rad")),
            ]
            for key, label in labels.items()
        ],
        "cost": [
            [cells.text(labels[key]), *(cells.rate(got[key].get(rate)) for rate in _GUARDED)]
            + [cells.distance(got[key].get("to_truth")), cells.distance(got[key].get("to_human"))]
            for key in _ONLINE
            if got.get(key)
        ],
    }
