"""Folders with one file a frame: FrankMocap's pickles and OpenPose's JSON.

The number at the end of a file's name is its frame's; a number that is left out is a frame in
which nobody was found. FrankMocap's joints are in pixels, nearer people larger: each frame is
scaled to a trunk of TRUNK, which no direction depends on.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from s3le.human.keypoints.clocks import Clock
from s3le.human.keypoints.found import Found, openpose
from s3le.human.keypoints.how import How
from s3le.human.keypoints.layouts import LAYOUTS
from s3le.human.keypoints.people import choose
from s3le.human.keypoints.values import numbers
from s3le.human.keypoints.written import read_json
from s3le.human.text import read_bytes, refusal
from s3le.inert import pickles

FRANKMOCAP = re.compile(r"(.*?)(\d*)_prediction_result\.pkl")
OPENPOSE = re.compile(r"(.*?)(\d*)_keypoints\.json")
MOST_FILES = 200_000
LARGEST = 64 * 2**20  # [bytes] of one frame, which may hold a mesh and a picture
SPREAD = 20.0  # times as many frames as files: the numbers are none of frames
TRUNK = 0.5  # [m] of FrankMocap's people
_PLACES = ("pred_joints_img", "pred_body_joints_img", "pred_joints_smpl")
_HANDS = ("left_hand", "right_hand")


def frames_of(path: Path | str) -> Path | None:
    """The folder of frames that a folder is, or that lies in it as `mocap`; None: it is none."""
    path = Path(path)
    for folder in (path, path / "mocap"):
        if folder.is_dir() and any(_kind(file.name) for file in folder.iterdir()):
            return folder
    return None


def read_frames(path: Path | str, how: How) -> Found:
    """The joints of one person in a folder of frames.

    Raises:
        ClipError: files of two kinds or of two sequences, several persons and none chosen, and
            whatever is wrong with a file.
    """
    folder = frames_of(path)
    if folder is None:
        raise refusal(path, None, "is no folder of frames")
    files = {file.name: _kind(file.name) for file in sorted(folder.iterdir())}
    kinds = {kind for kind in files.values() if kind}
    if len(kinds) > 1:
        raise refusal(folder, None, "holds frames of FrankMocap and of OpenPose; keep one kind")
    pattern = kinds.pop()
    names = [name for name, kind in files.items() if kind]
    if len(names) > MOST_FILES:
        raise refusal(folder, None, f"{len(names)} frames, at most {MOST_FILES} are read")
    rows, count = _numbered(folder, names, pattern)
    if pattern is FRANKMOCAP:
        return _frankmocap(folder, names, rows, count, how)
    frames: list[Any] = [None] * count
    for name, row in zip(names, rows, strict=True):
        tree = read_json(folder / name)
        frames[row] = tree.get("people") if isinstance(tree, Mapping) else None
        if not isinstance(frames[row], list):
            raise refusal(folder / name, None, 'no list "people" in it')
    return openpose(folder, frames, how)


def is_frame(path: Path | str) -> bool:
    """Whether a file is named as one frame of such a folder."""
    return _kind(Path(path).name) is not None


def _kind(name: str) -> re.Pattern | None:
    return next((kind for kind in (FRANKMOCAP, OPENPOSE) if kind.fullmatch(name)), None)


def _numbered(folder: Path, names: list[str], pattern: re.Pattern) -> tuple[list[int], int]:
    """Which frame each file is, and how many frames there are."""
    parts = [found.groups() for name in names if (found := pattern.fullmatch(name))]
    if len({stem for stem, _ in parts}) > 1:
        stems = sorted({stem for stem, _ in parts})[:4]
        raise refusal(folder, None, f"holds frames of several sequences: {', '.join(stems)}, ...")
    if len(parts) == 1:
        return [0], 1
    if not all(number and len(number) <= 12 for _, number in parts):
        raise refusal(folder, None, "a file of it has no number of a frame in its name")
    at = [int(number) for _, number in parts]
    if len(set(at)) < len(at):
        raise refusal(folder, None, "two files of it have the number of one frame")
    step = math.gcd(*(number - min(at) for number in at))
    rows = [(number - min(at)) // step for number in at]
    if max(rows) + 1 > SPREAD * len(rows):
        raise refusal(folder, None, f"{len(rows)} files for {max(rows) + 1} frames by their names")
    return rows, max(rows) + 1


def _frankmocap(folder: Path, names: list[str], rows: list[int], count: int, how: How) -> Found:
    hip, neck = (LAYOUTS["spin49"].points[i][0] for i in (0, 3))
    lists = []
    for name in names:
        tree = pickles.load(folder / name, read_bytes(folder / name, LARGEST))
        people = tree.get("pred_output_list") if isinstance(tree, Mapping) else None
        if not isinstance(people, list):
            raise refusal(folder / name, None, "no list 'pred_output_list': no FrankMocap result")
        # Meshes and pictures of a thousand frames are not kept.
        lists.append([_joints_of(person) for person in people])
    most = max(map(len, lists))
    if not most:
        raise refusal(folder, None, "nobody is in any of its frames")
    person, at = choose(folder, list(range(most)), how)
    joints = np.full((count, LAYOUTS["spin49"].sizes[0], 3), np.nan)
    for name, row, people in zip(names, rows, lists, strict=True):
        if len(people) > at and people[at] is not None:
            joints[row] = _body(folder / name, people[at], joints.shape[1])
    with np.errstate(invalid="ignore", divide="ignore"):  # a trunk of no length: no frame
        trunk = np.linalg.norm(joints[:, neck] - joints[:, hip], axis=1)[:, None, None]
        joints = np.where(trunk > 0.0, joints * TRUNK / trunk, np.nan)
    return Found(joints, None, None, Clock(), "FrankMocap's body joints", "spin49", person)


def _joints_of(person: Any) -> Any:
    if not isinstance(person, Mapping):
        return person
    return {key: person[key] for key in (*_PLACES, *_HANDS) if key in person}


def _body(path: Path, output: Any, count: int) -> np.ndarray:
    """The joints of one person in one frame, (49, 3)."""
    if not isinstance(output, Mapping):
        raise refusal(path, None, "a person of it is no dict")
    key = next((key for key in _PLACES if key in output), None)
    if key is None:
        hands = any(key in output for key in _HANDS)
        why = "holds hands only" if hands else f"has none of {', '.join(_PLACES)}"
        raise refusal(path, None, f"{why}; the body is needed (demo_bodymocap, demo_frankmocap)")
    table = numbers(path, output[key], f"'{key}'")
    if table is None or table.size != 3 * count:
        seen = None if table is None else table.shape
        raise refusal(path, None, f"'{key}' is {seen}, wanted ({count}, 3)")
    return table.reshape(count, 3)
