"""DeepMimic motion files (humanoid3d), the JSON that pybullet ships.

A row of `Frames` has 44 numbers: seconds until the next row, root position [m], then in the
order chest, neck, right hip, knee, ankle, shoulder, elbow, left hip .. elbow the joints'
rotations against their parents: quaternions, scalar first, for all but knees and elbows,
which are one angle [rad] about z. File axes: x forward, y up, z right.

Source: offsets and row layout, the character file humanoid3d of xbpeng/DeepMimic (Peng et
al. 2018), equal to pybullet's humanoid.urdf at a quarter of its size.
"""

import json
from pathlib import Path

import numpy as np

from s3le.human.clip import FPS_RANGE, Clip, at_constant_rate, make_clip, refuse_wild_angles
from s3le.human.rotation import about, from_quaternion, turn
from s3le.human.text import read_bytes, refusal, require, shown
from s3le.skeleton import POINTS

WIDTH = 44
LARGEST = 32 * 2**20  # [bytes] 40,000 frames; parsed JSON may need 20 times as much
UNEVEN = 20.0  # refuse durations that would give more frames per row than this
NORM_RANGE = (0.5, 1.5)  # of a quaternion; real files, blended by hand, stray to 0.58

# Each joint against its parent [m]; the left side mirrors the right in z.
_HIP_TO_CHEST = np.array([0.0, 0.236151, 0.0])
_CHEST_TO_NECK = np.array([0.0, 0.223894, 0.0])
_HIP_TO_THIGH = np.array([0.0, 0.0, 0.084887])
_CHEST_TO_SHOULDER = np.array([-0.02405, 0.24350, 0.18311])
_SHOULDER_TO_ELBOW = np.array([0.0, -0.274788, 0.0])
_ELBOW_TO_WRIST = np.array([0.0, -0.258947, 0.0])
_MIRROR = np.array([1.0, 1.0, -1.0])
_QUATERNIONS = (4, 8, 12, 16, 21, 25, 30, 35, 39)  # first column of each
_ANGLES = (20, 29, 34, 43)  # columns of knees and elbows
_ROOT, _CHEST = 4, 8
_SHOULDER = {"r": 25, "l": 39}
_ELBOW = {"r": 29, "l": 43}


def read_deepmimic(path: Path | str, fps: float | None = None) -> Clip:
    """Read a motion, place the ten points in every frame, and even out the frames' durations.

    The rate is 1 over the median duration, taken as whole where it is within 1e-4 of it.
    Where all durations agree to 1e-4 the frames are kept as they are; otherwise positions are
    interpolated linearly at that rate. The last row's duration leads nowhere and is ignored.

    Args:
        path: .txt or .json, or either with .gz.
        fps: frames per second [Hz], instead of the durations in the file.

    Returns:
        Clip in metres, z up; the neck is the file's neck joint, the hip its root.

    Raises:
        ClipError: with file and line or frame (from 0), anything but valid JSON with a
            non-empty list `Frames` of rows of 44 finite numbers, positive durations and
            quaternions of length 1; or durations too uneven to resample.
        ParameterError: fps is no sensible rate.
    """
    data = read_bytes(path, LARGEST)
    require(path, data, "JSON text")
    frames = _frames(path, data)
    refuse_wild_angles(path, frames[:, _ANGLES])
    with np.errstate(over="ignore", invalid="ignore"):  # make_clip refuses what comes of it
        points = _points(_unit_quaternions(path, frames))[..., [0, 2, 1]] * (1.0, -1.0, 1.0)
    if fps is not None or len(frames) == 1:
        return make_clip(path, 1.0 if fps is None else fps, points)  # one pose has no rate
    durations = frames[:-1, 0]
    low, high = FPS_RANGE
    for frame in np.flatnonzero(~((durations >= 1.0 / high) & (durations <= 1.0 / low))):
        why = f"frame {frame} lasts {durations[frame]:g} s, wanted [{1 / high:g}, {1 / low:g}]"
        raise refusal(path, None, why)
    rate = 1.0 / np.median(durations)
    if abs(round(rate) - rate) <= 1e-4 * rate:
        rate = float(round(rate))
    if np.abs(durations * rate - 1.0).max() > 1e-4:
        if durations.sum() * rate > UNEVEN * len(frames):
            raise refusal(path, None, "durations are too uneven to be one motion")
        times = np.concatenate([[0.0], np.cumsum(durations)])  # [s]
        points = at_constant_rate(make_clip(path, rate, points).points, times, rate)
    return make_clip(path, rate, points)


def _frames(path: Path | str, data: bytes) -> np.ndarray:
    """The rows, float64 of shape (n, 44), all finite."""

    def refuse_constant(word: str) -> None:
        raise refusal(path, None, f"{word} is no number of a motion")

    def refuse_twice(pairs: list[tuple[str, object]]) -> dict[str, object]:
        tree: dict[str, object] = {}
        for name, value in pairs:
            if name in tree:
                raise refusal(path, None, f"{shown(name)} is there twice")
            tree[name] = value
        return tree

    try:
        text = data.decode("utf-8")
        tree = json.loads(text, parse_constant=refuse_constant, object_pairs_hook=refuse_twice)
    except json.JSONDecodeError as error:
        raise refusal(path, error.lineno, f"not valid JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:
        raise refusal(path, None, f"not valid JSON: {error}") from None
    rows = tree.get("Frames") if isinstance(tree, dict) else None
    if not isinstance(rows, list) or not rows:
        raise refusal(path, None, 'no list "Frames" with rows in it')
    for frame, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != WIDTH:
            seen = f"{len(row)} values" if isinstance(row, list) else type(row).__name__
            raise refusal(path, None, f"frame {frame} must be {WIDTH} numbers, got {seen}")
        if not set(map(type, row)) <= {int, float}:
            odd = next(v for v in row if type(v) not in (int, float))
            raise refusal(path, None, f"frame {frame} must be numbers, got {odd!r:.40}")
    try:
        table = np.array(rows, dtype=float)
    except OverflowError:
        raise refusal(path, None, "a number that is too large") from None
    for frame, column in np.argwhere(~np.isfinite(table)):
        raise refusal(path, None, f"frame {frame}, value {column} is {table[frame, column]}")
    return table


def _unit_quaternions(path: Path | str, frames: np.ndarray) -> np.ndarray:
    frames = frames.copy()
    for first in _QUATERNIONS:
        columns = slice(first, first + 4)
        norm = np.linalg.norm(frames[:, columns], axis=1, keepdims=True)
        low, high = NORM_RANGE
        for frame in np.flatnonzero(~((norm >= low) & (norm <= high)).ravel()):
            why = f"frame {frame}: values {first} to {first + 3} are no unit quaternion"
            raise refusal(path, None, f"{why}, their norm is {norm[frame, 0]:g}")
        frames[:, columns] /= norm
    return frames


def _points(frames: np.ndarray) -> np.ndarray:
    """The ten points in the file's axes [m], shape (n, 10, 3)."""
    root = from_quaternion(frames[:, _ROOT : _ROOT + 4])
    chest = root @ from_quaternion(frames[:, _CHEST : _CHEST + 4])
    at = {"hip": frames[:, 1:4]}
    torso = at["hip"] + turn(root, _HIP_TO_CHEST)
    at["neck"] = torso + turn(chest, _CHEST_TO_NECK)
    for side, mirror in (("r", 1.0), ("l", _MIRROR)):
        first = _SHOULDER[side]
        upper = chest @ from_quaternion(frames[:, first : first + 4])
        lower = upper @ about(2, frames[:, _ELBOW[side]])
        at[f"{side}_pelvis"] = at["hip"] + turn(root, _HIP_TO_THIGH * mirror)
        at[f"{side}_shoulder"] = torso + turn(chest, _CHEST_TO_SHOULDER * mirror)
        at[f"{side}_elbow"] = at[f"{side}_shoulder"] + turn(upper, _SHOULDER_TO_ELBOW)
        at[f"{side}_hand"] = at[f"{side}_elbow"] + turn(lower, _ELBOW_TO_WRIST)
    return np.stack([at[point] for point in POINTS], axis=1)
