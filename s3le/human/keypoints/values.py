"""Numbers out of what JSON, pickles and archives hold, counted before they are believed."""

import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from s3le.human.text import refusal

MOST_VALUES = 10_000_000  # numbers of one text; 75,000 frames of 33 joints with confidence
DEEPEST = 5  # lists within lists
_XYZ = ("x", "y", "z")
SEEN = ("visibility", "confidence", "conf", "score", "c")  # a joint's, beside x, y and z


def numbers(path: Path | str, value: Any, what: str) -> np.ndarray | None:
    """An array of numbers, float64, NaN where there is none; None where value is no such thing.

    Args:
        path: for messages.
        value: an array, or lists of numbers and null; of joints as {x, y, z}, too.
        what: for messages.

    Raises:
        ClipError: lists of unequal lengths, words among numbers, more than MOST_VALUES.
    """
    if isinstance(value, np.ndarray):
        with np.errstate(invalid="ignore"):  # NaN of other bits are NaN all the same
            return value.astype(float) if value.dtype.kind in "iuf" and value.ndim else None
    if not isinstance(value, (list, tuple)) or not value:
        return None
    if _count(value, 0) > MOST_VALUES:
        raise refusal(path, None, f"{what} holds more than {MOST_VALUES} values, or is too deep")
    try:
        table = np.array(_even(value), dtype=object)
    except ValueError:
        raise refusal(path, None, f"{what}: frames or joints of unequal lengths") from None
    flat = table.ravel().tolist()
    kinds = set(map(type, flat))
    if list in kinds or tuple in kinds:
        raise refusal(path, None, f"{what}: frames or joints of unequal lengths")
    if not kinds <= {int, float, type(None)}:
        odd = next(v for v in flat if type(v) not in (int, float, type(None)))
        if kinds <= {str} or kinds <= {dict} or kinds <= {np.ndarray}:
            return None  # a list of words or of other things, not a table with a flaw
        raise refusal(path, None, f"{what}: must be numbers, got {reprlib.repr(odd)[:60]}")
    try:
        return table.astype(float)
    except OverflowError:
        raise refusal(path, None, f"{what}: a number that is too large") from None


def _count(value: Any, depth: int) -> int:
    """Values in lists within lists, at most just beyond MOST_VALUES."""
    if isinstance(value, np.ndarray):
        return value.size
    if not isinstance(value, (list, tuple)):
        return 1
    if depth >= DEEPEST:
        return MOST_VALUES + 1
    total = 0
    for item in value:
        total += _count(item, depth + 1) if isinstance(item, (list, tuple, np.ndarray)) else 1
        if total > MOST_VALUES:
            break
    return total


def _even(rows: Sequence[Any]) -> list[Any]:
    """Rows with {x, y, z} as lists, and with empty ones of the same form where there is null."""
    rows = [_place(row) for row in rows]
    if any(isinstance(row, (list, tuple)) for row in rows):
        rows = [_even(row) if isinstance(row, (list, tuple)) else row for row in rows]
        like = next(row for row in rows if isinstance(row, list))
        rows = [_blank(like) if row is None else row for row in rows]
    return rows


def _place(value: Any) -> Any:
    if isinstance(value, Mapping) and all(key in value for key in _XYZ):
        seen = [value[key] for key in SEEN if key in value][:1]
        place = [*(value[key] for key in _XYZ), *seen]
        if not any(isinstance(v, (list, tuple, Mapping, np.ndarray)) for v in place):
            return place
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        return value.tolist()
    return value


def _blank(like: Any) -> Any:
    return [_blank(item) for item in like] if isinstance(like, list) else None


def number(value: Any) -> float | None:
    """One finite number, or None."""
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "iuf":
        value = value.reshape(-1)[0].item()
    if type(value) not in (int, float):
        return None
    try:
        return float(value) if np.isfinite(float(value)) else None
    except OverflowError:
        return None


def turned(value: Any) -> Any:
    """A list of frames, each a dict, as a dict of lists: null where a frame lacks a key."""
    frames = isinstance(value, list) and value
    if not frames or not all(isinstance(v, Mapping) or v is None for v in value):
        return value
    if any(v is not None and all(key in v for key in _XYZ) for v in value):
        return value  # joints of one frame
    keys = dict.fromkeys(key for frame in value if frame for key in frame)
    if len(keys) * len(value) > MOST_VALUES:
        return value
    return {key: [frame.get(key) if frame else None for frame in value] for key in keys}
