"""Keypoints written as text: JSON and CSV into trees of lists and arrays, nothing guessed yet."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from s3le.human.keypoints.clocks import is_clock
from s3le.human.keypoints.values import MOST_VALUES, SEEN
from s3le.human.text import read_bytes, refusal, require, shown, split_lines

LARGEST_JSON = 32 * 2**20  # [bytes]; parsed it may need 20 times as much
LARGEST_CSV = 64 * 2**20
MOST_COLUMNS = 2000
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_NOTHING = ("", "nan", "na", "null", "none")  # fields that hold no number
_AXIS = re.compile(rf"(.+?)[ _.:\-]?\(?(x|y|z|{'|'.join(SEEN)})\)?", re.IGNORECASE)
_AXIS_FIRST = re.compile(r"(x|y|z|v)[ _.:\-]?(.+)", re.IGNORECASE)
_FRAME = ("frame", "frames", "index", "id", "frameid", "framenumber", "")


def read_json(path: Path | str, data: bytes | None = None) -> Any:
    """What a JSON file holds; NaN, which is no JSON but is written, is null.

    Args:
        path: the file.
        data: its content, where it is at hand.

    Raises:
        ClipError: no valid JSON, a key that is there twice, or longer than LARGEST_JSON.
    """
    data = read_bytes(path, LARGEST_JSON) if data is None else data
    require(path, data, "JSON text")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        tree = dict(pairs)
        if len(tree) < len(pairs):
            twice = next(key for i, (key, _) in enumerate(pairs) if key in dict(pairs[:i]))
            raise refusal(path, None, f"{shown(twice)} is there twice")
        return tree

    def constant(word: str) -> None:
        if word != "NaN":
            raise refusal(path, None, f"{word} is no number of a motion")

    try:
        return json.loads(data.decode("utf-8"), parse_constant=constant, object_pairs_hook=once)
    except json.JSONDecodeError as error:
        raise refusal(path, error.lineno, f"not valid JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:
        raise refusal(path, None, f"not valid JSON: {error}") from None


def read_csv(path: Path | str) -> dict[str, Any]:
    """A table with three columns a joint: `left_elbow_x`, `LeftElbow.y`, `x12`, or without names.

    Fields may be parted by commas, semicolons or tabs. A joint may have a fourth column, its
    visibility or confidence. Empty fields and `nan` are joints that were not seen.

    Returns:
        Joints by name (n, 3) or (n, 4), clocks and rates by their names (see clocks); or one array
        of numbered joints.

    Raises:
        ClipError: no text, lines of unequal lengths, a field that is no number, a joint that
            lacks an axis; names the line, counted from 1.
    """
    data = read_bytes(path, LARGEST_CSV)
    if b"\0" in data:
        raise refusal(path, None, "is no text (a zero byte)")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(path, None, f"is no text in UTF-8 (byte {error.start})") from None
    split_lines(path, data)  # its bounds
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise refusal(path, None, "looks like an empty file, not a table")
    comma = max(",;\t", key=lines[0][1].count)
    header = _fields(path, *lines[0], comma)
    nameless = all(_NUMBER.fullmatch(field) for field in header)
    if len(header) > MOST_COLUMNS:
        raise refusal(path, lines[0][0], f"{len(header)} columns, at most {MOST_COLUMNS} are read")
    for name in header if not nameless else []:
        if header.count(name) > 1:
            raise refusal(path, lines[0][0], f"column {shown(name)} is there twice")
    if len(lines) * len(header) > MOST_VALUES:
        raise refusal(path, None, f"more than the {MOST_VALUES} numbers that are read")
    rows = [_row(path, i, line, comma, header) for i, line in lines[0 if nameless else 1 :]]
    if not rows:
        raise refusal(path, None, "no frames")
    table = np.array(rows)
    if nameless:
        return {"coordinates": table}
    return _joints(path, lines[0][0], header, table)


def _fields(path: Path | str, number: int, line: str, comma: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=comma, strict=True))]
    except csv.Error as error:
        raise refusal(path, number, str(error)) from None


def _row(path: Path | str, number: int, line: str, comma: str, header: list[str]) -> list[float]:
    fields = _fields(path, number, line, comma)
    if len(fields) != len(header):
        raise refusal(path, number, f"{len(fields)} fields for {len(header)} columns")
    pairs = zip(fields, header, strict=True)
    return [cell(path, number, field, shown(name)) for field, name in pairs]


def cell(path: Path | str, number: int, field: str, what: str) -> float:
    """One field of a table, NaN where it is empty or says that there is no number.

    Args:
        path, number: file and line, for messages.
        field: without blanks around it.
        what: whose field, for messages.

    Raises:
        ClipError: anything else than a decimal number.
    """
    if field.isascii() and _NUMBER.fullmatch(field):
        return float(field)
    if field.lower() in _NOTHING:
        return float("nan")
    raise refusal(path, number, f"{what} must be a number, got {shown(field)}")


def _joints(path: Path | str, line: int, header: list[str], table: np.ndarray) -> dict[str, Any]:
    columns: dict[str, dict[str, int]] = {}
    tree: dict[str, Any] = {}
    for place, name in enumerate(header):
        plain = re.sub(r"[^a-z]", "", name.lower())
        if clock := is_clock(name):
            tree[clock] = table[:, place]
            continue
        if plain in _FRAME:
            if plain:
                tree["frame"] = table[:, place]
            continue
        found = _AXIS.fullmatch(name)
        last = _AXIS_FIRST.fullmatch(name)
        if found:
            joint, axis = found[1], found[2].lower()
        elif last:
            joint, axis = last[2], last[1].lower()
        else:
            raise refusal(
                path, line, f"column {shown(name)} is neither time nor a joint's x, y or z"
            )
        own = columns.setdefault(joint, {})
        axis = axis if axis in "xyz" else "seen"
        if axis in own:
            raise refusal(path, line, f"joint {shown(joint)} has {axis} twice")
        own[axis] = place
    if not columns:
        raise refusal(path, line, "no column is a joint's x, y or z")
    for joint, own in columns.items():
        lacking = [axis for axis in "xyz" if axis not in own]
        if lacking == ["z"]:
            raise refusal(path, line, f"joint {shown(joint)} has x and y only; 3D is needed")
        if lacking:
            raise refusal(path, line, f"joint {shown(joint)} has no {' or '.join(lacking)}")
    kinds = {tuple(sorted(own)) for own in columns.values()}
    axes = ["x", "y", "z", *(["seen"] if len(kinds) == 1 and "seen" in kinds.copy().pop() else [])]
    joints = {name: table[:, [own[axis] for axis in axes]] for name, own in columns.items()}
    numbered = [re.sub(r"\D", "", name) for name in joints]
    if all(numbered) and not any(re.search(r"[a-z]{4}", name.lower()) for name in joints):
        order = sorted(range(len(joints)), key=lambda i: int(numbered[i]))  # x0, kp_12_x
        first = int(numbered[order[0]])
        if [int(numbered[i]) for i in order] != list(range(first, first + len(joints))):
            raise refusal(path, line, "numbered joints with numbers left out, or twice")
        stacked = np.stack(list(joints.values()), axis=1)
        return tree | {"joints": stacked[:, order]}
    return tree | joints
