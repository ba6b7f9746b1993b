"""The part of the page on what lies between the frames, and on what the guard had to do."""

from collections.abc import Mapping
from typing import Any

from s3le.learn.methods import ENTRIES
from s3le.report import cells, html
from s3le.report.html import Html, paragraph, tag, words

_ONLINE = tuple(key for key, entry in ENTRIES.items() if entry.online)
_GUARDED = (
    ("limited_rate", "joints at their speed"),
    ("eased_rate", "braked"),
    ("avoiding_rate", "around an obstacle"),
    ("held_rate", "held"),
)


def section(methods: Mapping[str, Any], labels: Mapping[str, str]) -> list[Html]:
    """Paragraphs and tables for one split.

    Args:
        methods: by entry its figures, as evaluation.summary has them under "all".
        labels: what people read of each entry, in the order to show.
    """
    got = {key: cells.at(methods, key) for key in labels}
    margins = [found["segment_margin_mm"] for found in got.values() if "segment_margin_mm" in found]
    margin = f"{cells.plain(margins[0])} mm" if margins else "their margin"
    titles = [
        "method", "segments", "between safe poses", "of these: collide", "of these: undecided",
        f"not certified at {margin}", "too fast", "largest jump [rad]",
    ]  # fmt: skip
    rows = [
        [
            cells.text(label),
            cells.count(got[key].get("segments")),
            cells.of(got[key].get("segments_feasible"), got[key].get("segments")),
            _share(got[key], "segment_collision_rate", "segments_feasible"),
            _share(got[key], "segment_undecided_rate", "segments_feasible"),
            _share(got[key], "segment_uncertified_rate", "segments"),
            _share(got[key], "segment_too_fast_rate", "segments"),
            cells.plain(got[key].get("largest_jump_rad")),
        ]
        for key, label in labels.items()
    ]
    return [
        *_finding(got),
        html.explained(
            html.table(titles, rows),
            words(
                "a segment is the straight joint path from one frame's pose to the next's, and "
                "*collide* are shares of the segments whose two poses are both safe: a pose on the "
                "way was found in which watched bodies overlap, so checking poses alone does not "
                "see it."
            ),
            words(
                "*Undecided* are those for which neither that nor its absence was proven; they "
                "count as no for *not certified*, which asks of all segments for a proof that "
                "watched pairs stay {} apart all the way.",
                margin,
            ),
            words(
                "*Too fast* are segments on which a joint would exceed the robot's speed at the "
                "clip's frame rate, and the *largest jump* is what one joint would have to turn "
                "from one frame to the next. The rows *+ certify* keep all of this by "
                "construction, and pay for it in distance."
            ),
        ),
        *_guard(got, labels),
    ]


def _share(found: Mapping[str, Any], rate: str, of: str) -> str:
    return cells.NONE if found.get(of) == 0 else cells.rate(found.get(rate))


def _finding(got: Mapping[str, Mapping[str, Any]]) -> list[Html]:
    own = got.get("s3le", {})
    if not (
        cells.is_number(own.get("segment_collision_rate"))
        and cells.is_number(own.get("segment_too_fast_rate"))
    ):
        return []
    found = [
        paragraph(
            f"Between two safe poses that S3LE looked up, the straight path collides in "
            f"{cells.rate(own['segment_collision_rate'])} of the segments, and "
            f"{cells.rate(own['segment_too_fast_rate'])} of all its segments are too fast."
        )
    ]
    broken = [
        key
        for key in _ONLINE
        for figure in ("segments_colliding", "segments_undecided", "segments_too_fast")
        if cells.is_number(got.get(key, {}).get(figure)) and got[key][figure] > 0
    ]
    if broken:
        found.append(
            paragraph(
                "This must not happen: a certified motion has a segment that collides, is "
                f"undecided or too fast ({cells.listed(list(dict.fromkeys(broken)))}).",
                kind="alarm",
            )
        )
    return found


def _guard(got: Mapping[str, Mapping[str, Any]], labels: Mapping[str, str]) -> list[Html]:
    rows = [
        [
            cells.text(labels[key]),
            *(cells.rate(got[key].get(rate)) for rate, _ in _GUARDED),
            cells.distance(got[key].get("to_truth")),
            cells.distance(got[key].get("to_human")),
        ]
        for key in _ONLINE
        if got.get(key)
    ]
    if not rows:
        return []
    titles = ["method", *(words for _, words in _GUARDED), "to the ground truth", "to the human"]
    return [
        tag("h3", "What certifying cost"),
        html.explained(
            html.table(titles, rows),
            "shares of frames in which the guard did not let the robot go where the method wanted "
            "it: a joint could not turn so far in one frame, the brake kept it from changing speed "
            "so much, the straight way was not free, or nothing but standing still could be "
            "proven.",
            "Both rows have the same look-up and the same guard; what lies between them is the "
            "refining.",
        ),
    ]
