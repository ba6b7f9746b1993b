"""TRC tables of joint centres, as Pose2Sim, OpenCap and Theia write them.

Markers on the skin come in the same format and are refused: no marker lies at a hip joint, so
names of both hips, shoulders, elbows and wrists are what tells joint centres.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from s3le.human.keypoints.clocks import Clock
from s3le.human.keypoints.found import Found, refuse_flat
from s3le.human.keypoints.layouts import by_names
from s3le.human.keypoints.values import MOST_VALUES
from s3le.human.keypoints.written import cell
from s3le.human.text import listed, read_bytes, refusal, shown, split_lines

LARGEST = 64 * 2**20  # [bytes]
MOST_MARKERS = 1000
SKIN = (
    "markers lie on the skin, and joint centres need a model of the body: take the trial's .amc or "
    ".bvh, or compute the centres elsewhere and give them as .trc or .csv with named joints"
)


def read_trc(path: Path | str, given: Mapping[str, str] | None = None) -> Found:
    """The named joints of a table, NaN where a field is empty.

    Args:
        path: the file.
        given: what the file calls our joints, as rigs.match takes it.

    Raises:
        ClipError: no TRC, markers on the skin, or damage; names the line, counted from 1.
    """
    data = read_bytes(path, LARGEST)
    split_lines(path, data)  # its bounds
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(path, None, f"is no text in UTF-8 (byte {error.start})") from None
    lines = [(i, line.rstrip("\r\n")) for i, line in enumerate(text.split("\n"), 1)]
    lines = [(i, line) for i, line in lines if line.strip()]
    if not lines or not lines[0][1].startswith("PathFileType"):
        raise refusal(path, None, "is no TRC (its first line does not begin with PathFileType)")
    about = _about(path, lines)
    number, head = lines[3]
    names = [field.strip() for field in head.split("\t")[2:] if field.strip()]
    if not 0 < len(names) <= MOST_MARKERS or len(set(names)) < len(names):
        why = f"{len(names)} names of joints, wanted 1 to {MOST_MARKERS}, each once"
        raise refusal(path, number, why)
    named = by_names(names, given)
    if named.missing:
        there = f"no joint for {listed(named.missing)} among {listed(names)}"
        raise refusal(path, number, f"{there}; {SKIN}")
    rows = lines[5:]
    width = 2 + 3 * len(names)
    if len(rows) * width > MOST_VALUES:
        raise refusal(path, None, f"more than the {MOST_VALUES} numbers that are read")
    table = np.array([_row(path, i, line, width, names) for i, line in rows]).reshape(-1, width)
    if not len(table):
        raise refusal(path, None, "no frames")
    joints = table[:, 2:].reshape(len(table), len(names), 3)
    refuse_flat(path, joints, "its table")
    told: tuple[str, ...] = ()
    if about.get("numframes", len(table)) != len(table):
        told = (f"its head announces {about['numframes']:g} frames, there are {len(table)}",)
    time = table[:, 1] if np.isfinite(table[:, 1]).all() else None
    clock = Clock(about.get("datarate"), time, 1.0)
    return Found(
        joints, tuple(names), None, clock, "the joint centres of its table", told=told,
        by_name=named.layout,
    )  # fmt: skip


def _about(path: Path | str, lines: list[tuple[int, str]]) -> dict[str, float]:
    """The numbers in the second and third line, by their names in small letters."""
    if len(lines) < 5 or not lines[3][1].lower().startswith("frame#"):
        raise refusal(path, None, "is no TRC (its fourth line does not begin with Frame#)")
    keys, values = ([f.strip() for f in lines[i][1].split("\t")] for i in (1, 2))
    about: dict[str, float] = {}
    for name, value in zip(keys, values, strict=False):
        if name.lower() in ("datarate", "numframes"):
            about[name.lower()] = cell(path, lines[2][0], value, name)
    return {name: value for name, value in about.items() if np.isfinite(value)}


def _row(path: Path | str, number: int, line: str, width: int, names: list[str]) -> list[float]:
    fields: list[Any] = [field.strip() for field in line.split("\t")]
    while len(fields) > width and not fields[-1]:
        fields.pop()
    if len(fields) != width:
        raise refusal(path, number, f"{len(fields)} fields for {len(names)} joints, wanted {width}")
    return [
        cell(path, number, field, "Frame# or Time" if i < 2 else shown(names[(i - 2) // 3]))
        for i, field in enumerate(fields)
    ]
