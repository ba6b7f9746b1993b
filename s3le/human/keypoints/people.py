"""Files that list people frame by frame, as the one person's joints or rotations by key.

mmpose's 3D inferencer (instances), the Azure Kinect's offline_processor (bodies), OpenPose
(people) and their like; 4D-Humans and PHALP (a frame a picture, tid and smpl in it).
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from s3le.human.keypoints.clocks import key
from s3le.human.keypoints.how import How
from s3le.human.text import listed, refusal

LISTS = ("instances", "bodies", "persons", "humans", "subjects", "detections", "poses3d")
_TRACK = ("bodyid", "trackid", "personid", "id", "trackingid")
FRAME = ("frameid", "frame", "framenumber", "frameindex", "frameidx", "imageid")
_CLOCKS = ("time", "dt", "fps")  # beginnings of keys that belong to a frame, not to a person
SPREAD = 20  # times as many frames as rows: the numbers are none of frames
WHOLE = re.compile(r"[0-9]{1,9}")  # the number of a person
LIFT = "retargeting needs 3D; lift them first, or take an estimator of 3D"


def choose(path: Path | str, there: list[Any], how: How) -> tuple[int | None, Any]:
    """One of several persons, and its number where that had to be chosen.

    Raises:
        ClipError: there are several and none was chosen, or the chosen one is not there.
    """
    numbered = [int(str(k)) if WHOLE.fullmatch(str(k)) else i for i, k in enumerate(there)]
    if how.person is None:
        if len(there) == 1:
            return None, there[0]
        seen = listed(map(str, sorted(numbered)))
        raise refusal(path, None, f"holds {len(there)} persons ({seen}); choose one: --person N")
    if how.person in numbered:
        return how.person, there[numbered.index(how.person)]
    seen = listed(map(str, sorted(numbered)))
    raise refusal(path, None, f"holds no person {how.person}; there: {seen}")


def list_of(frames: Any) -> str | None:
    """The key under which each of these frames lists its people, or None."""
    if not isinstance(frames, list) or not frames:
        return None
    if not all(isinstance(frame, Mapping) for frame in frames):
        return None
    for name in LISTS:
        given = [_get(frame, name) for frame in frames]
        if all(v is None or (isinstance(v, list) and all(isinstance(p, Mapping) for p in v))
               for v in given) and any(given):  # fmt: skip
            return name
    return None


def of_frames(
    path: Path | str, frames: list[Mapping], name: str, how: How
) -> tuple[list[dict[str, Any] | None], int | None]:
    """One person's values in each frame, with the frame's own clock; and which person it is.

    Raises:
        ClipError: several persons and none chosen.
    """
    rows: list[dict[Any, Mapping]] = []
    for frame in frames:
        people = _get(frame, name) or []
        numbers = [_track(person) for person in people]
        if None in numbers or len(set(numbers)) < len(numbers):
            numbers = list(range(len(people)))
        rows.append(dict(zip(numbers, people, strict=True)))
    there = sorted({number for row in rows for number in row})
    if not there:
        raise refusal(path, None, "nobody is in any of its frames")
    person, chosen = choose(path, there, how)
    found: list[dict[str, Any] | None] = []
    for frame, row in zip(frames, rows, strict=True):
        own = {k: v for k, v in frame.items() if key(k) in FRAME or key(k).startswith(_CLOCKS)}
        found.append(dict(row.get(chosen, {})) | own)
    return found, person


def is_phalp(tree: Mapping) -> bool:
    """Whether these are PHALP's or 4D-Humans' frames: a dict of pictures with tracks."""
    frames = list(tree.values())
    return bool(frames) and all(
        isinstance(f, Mapping) and all(isinstance(f.get(k), list) for k in ("tid", "smpl"))
        for f in frames
    )


def of_phalp(path: Path | str, tree: Mapping, how: How) -> tuple[dict[str, Any], int | None]:
    """SMPL's rotations of one track, null where it was not seen; and which track it is.

    Raises:
        ClipError: several tracks and none chosen, or people without numbers.
    """
    rows = []
    for name in sorted(tree, key=str):
        frame = tree[name]
        if len(frame["tid"]) < len(frame["smpl"]):
            raise refusal(path, None, f"frame {str(name)[-40:]!r} has people without a track")
        people = zip(frame["tid"], frame["smpl"], strict=False)  # tracks not seen come last
        rows.append({tid: one for tid, one in people if type(tid) is int})
    there = sorted({tid for row in rows for tid in row})
    if not there:
        raise refusal(path, None, "nobody is in any of its frames")
    person, chosen = choose(path, there, how)
    ones = [row.get(chosen) for row in rows]
    made: dict[str, Any] = {}
    for part, count in (("global_orient", 1), ("body_pose", 23)):
        table = np.full((len(ones), count, 3, 3), np.nan)
        for row, one in enumerate(ones):
            value = one.get(part) if isinstance(one, Mapping) else None
            if isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
                if value.size != 9 * count:
                    raise refusal(path, None, f"'{part}' of a track is of shape {value.shape}")
                table[row] = value.reshape(count, 3, 3)
        made[part] = table
    return made, person


def gaps(path: Path | str, numbers: np.ndarray | None, count: int) -> np.ndarray | None:
    """Which row each frame is, by the frames' numbers; None: they follow each other.

    Raises:
        ClipError: numbers with so large gaps that they are none of frames.
    """
    if numbers is None or numbers.shape != (count,) or count < 2:
        return None
    if not np.isfinite(numbers).all() or (np.abs(numbers) > 2**53).any():
        return None
    steps = np.diff(numbers)
    if not ((steps > 0).all() and (steps == np.round(steps)).all()):
        return None
    step = math.gcd(*map(int, steps.tolist()))
    rows = np.rint((numbers - numbers[0]) / step).astype(int)
    if rows[-1] + 1 == count:
        return None
    if rows[-1] + 1 > SPREAD * count:
        raise refusal(path, None, f"{count} rows for {rows[-1] + 1} frames by their numbers; if "
                      "these are none of frames, leave them out")  # fmt: skip
    return rows


def _get(frame: Mapping, name: str) -> Any:
    return next((value for k, value in frame.items() if key(k) == name), None)


def _track(person: Mapping) -> int | None:
    given = next((_get(person, name) for name in _TRACK if _get(person, name) is not None), None)
    return given if type(given) is int and given >= 0 else None
