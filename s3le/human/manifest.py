"""The lists of clips: small CSV files whose every field is checked on the way in."""

import csv
import io
import re
from pathlib import Path

from s3le.errors import ClipError, ParameterError
from s3le.human.clip import check_rate
from s3le.human.text import SMALL_BYTES, read_bytes, shown

SPLITS = ("train", "test", "heldout")


IDENTITIES = ("", "certain", "inferred")  # of a trial that somebody else's list stands for


def manifest(
    path: Path, columns: tuple[str, ...], optional: tuple[str, ...] = ()
) -> list[dict[str, str]]:
    """Rows of a list of clips whose names are safe as file names, unique, in a known split.

    Args:
        path: CSV, UTF-8.
        columns: what the first line must be; `split` is among them, the first is the key.
        optional: what may follow them there, all or none.

    Raises:
        ClipError: with file and line, anything else.
    """
    rows = table(path, columns, optional)
    for line, row in enumerate(rows, 2):
        if not re.fullmatch(r"[A-Za-z0-9_]{1,100}", row[columns[0]]):
            raise ClipError(f"{path}:{line}: {shown(row[columns[0]])} is no name of a clip")
        if row["split"] not in SPLITS:
            raise ClipError(f"{path}:{line}: split must be one of {', '.join(SPLITS)}")
        for key in ("sha256", "asf_sha256"):
            if row.get(key) and not re.fullmatch(r"[0-9a-f]{64}", row[key]):
                raise ClipError(f"{path}:{line}: {shown(row[key])} is no {key}")
        if row.get("identity", "") not in IDENTITIES:
            raise ClipError(f"{path}:{line}: identity must be empty, certain or inferred")
    return rows


def table(
    path: Path, columns: tuple[str, ...], optional: tuple[str, ...] = ()
) -> list[dict[str, str]]:
    """Rows of a CSV with exactly these columns, or optional ones after them; the first is a key.

    Raises:
        ClipError: with file and line: other columns, no rows, a short or long row, a key
            that is there twice, an unprintable character, broken quoting. A last line without an
            end is read like any other.
    """
    try:
        text = read_bytes(path, limit=SMALL_BYTES).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ClipError(f"{path}: not UTF-8 text: {error}") from None
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = list(reader)
    except csv.Error as error:
        raise ClipError(f"{path}:{reader.line_num}: {error}") from None
    there = tuple(reader.fieldnames or ())
    if there not in (columns, columns + optional):
        raise ClipError(f"{path}:1: columns must be {','.join(columns)}")
    seen: set[str] = set()
    for line, row in enumerate(rows, 2):
        if None in row or None in row.values():
            raise ClipError(f"{path}:{line}: a row has {len(there)} values")
        if odd := [value for value in row.values() if not value.isprintable()]:
            raise ClipError(f"{path}:{line}: an unprintable character in {shown(odd[0])}")
        if row[columns[0]] in seen:
            raise ClipError(f"{path}:{line}: {shown(row[columns[0]])} is there twice")
        seen.add(row[columns[0]])
    if not rows:
        raise ClipError(f"{path}: no rows")
    return rows


def rate(path: Path, clip: str, text: str) -> float:
    """A field that is a frame rate [Hz].

    Raises:
        ClipError: it is no number or no sensible rate.
    """
    try:
        if not re.fullmatch(r"([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
            raise ValueError(text)
        check_rate(fps := float(text), "fps")
    except (ValueError, ParameterError):
        raise ClipError(f"{path}: fps of {clip} must be a frame rate, got {shown(text)}") from None
    return fps
