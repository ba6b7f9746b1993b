"""Numbers and words as the page shows them; what is missing is called "not measured"."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeGuard

MISSING = "not measured"
NONE = "-"  # where a cell has no meaning


def at(tree: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A branch of the metrics; an empty one where it is missing."""
    branch = tree.get(key)
    return branch if isinstance(branch, Mapping) else {}


def is_number(value: object) -> TypeGuard[float]:
    """Is it a finite number?"""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def text(value: object) -> str:
    """Words from outside, on one line."""
    return MISSING if value is None else " ".join(str(value).split())


def count(value: object) -> str:
    """A number of things."""
    return f"{value:,.0f}" if is_number(value) else MISSING


def of(value: object, total: object) -> str:
    """A number of things, and which share of all it is."""
    if not (is_number(value) and is_number(total) and total > 0):
        return count(value)
    return f"{value:,.0f} ({rate(value / total)})"


def distance(value: object) -> str:
    """A cosine distance."""
    return f"{value:.3f}" if is_number(value) else MISSING


def longest(values: Iterable[object]) -> float:
    """The largest of some numbers, for bars to be measured by; 1 where there is none above 0."""
    return max((value for value in values if is_number(value) and value > 0.0), default=1.0)


def plain(value: object) -> str:
    """Any number, three digits of it."""
    return f"{value:.3g}" if is_number(value) else MISSING


def rate(value: object) -> str:
    """A share in percent; only an exact zero (or one) reads as 0 (or 100)."""
    if not is_number(value):
        return MISSING
    if value in (0, 1):
        return f"{100 * value:.0f} %"
    if 0 < value < 0.0005:
        return "< 0.1 %"
    return "> 99.9 %" if 0.9995 < value < 1 else f"{100 * value:.1f} %"


def degrees(distance: float) -> str:
    """The angle by which every direction is off at a cosine distance."""
    return f"{math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - distance)))):.0f}°"


def listed(words: list[str]) -> str:
    """Words as a sentence lists them."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
