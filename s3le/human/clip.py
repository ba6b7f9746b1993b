"""One motion clip as ten named points per frame, and its resampling in time.

Frame of reference: x forward, y left, z up; only the vertical is known for certain, because
a clip may begin facing anywhere. Points are positions, so resampling never touches an angle.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ClipError, ParameterError
from s3le.human.keypoints.how import How
from s3le.skeleton import POINTS

FARTHEST = 1e4  # [m] a coordinate beyond this is damage or a wrong unit, not motion
ARM_RANGE = (0.05, 5.0)  # [m] shoulder to hand, of a doll and of a giant: beyond, a wrong unit
MOST_TURNED = 1000.0  # [rad] 160 turns; an angle beyond this is damage, not motion
FPS_RANGE = (0.1, 10_000.0)  # [Hz]
_ON_FRAME = 1e-6  # a sample this close to a frame, in frames, is that frame
_ARMS = [[POINTS.index(f"{side}_{p}") for p in ("shoulder", "elbow", "hand")] for side in "rl"]


class Reading(NamedTuple):
    """How a file was understood that leaves something open; nothing of this for BVH and its like.

    Attributes:
        what: which part of the file the joints are.
        how: options with which it reads alike again.
        unit: of its lengths.
        told: what was assumed or estimated, for people.
    """

    what: str
    how: How
    unit: str
    told: tuple[str, ...]

    def summary(self) -> dict[str, Any]:
        """As a part of a summary in JSON."""
        how = {key: value for key, value in self.how._asdict().items() if value is not None}
        return {"joints": self.what, **how, "unit": self.unit, "assumed": list(self.told)}


class Clip(NamedTuple):
    """A motion clip at a constant rate.

    Attributes:
        name: what the clip is called in tables and messages.
        fps: frames per second [Hz].
        points: positions [m], float64 of shape (n, 10, 3), ordered as skeleton.POINTS,
            read-only; the neck is the file's own neck or thorax joint; NaN where unknown.
        reading: how the file was understood, where that was open.
    """

    name: str
    fps: float
    points: np.ndarray
    reading: Reading | None = None


def make_clip(path: Path | str, fps: float, points: np.ndarray, gaps: bool = False) -> Clip:
    """A clip named after its file, once its numbers can be believed.

    Args:
        path: the file it was read from; the name is the file's, without suffixes.
        fps: frames per second [Hz].
        points: positions [m], shape (n, 10, 3).
        gaps: whether frames may be NaN; such a frame is unknown as a whole then.

    Raises:
        ClipError: no frames, a position that is not finite or beyond FARTHEST, or arms (median
            over frames and sides) of a length outside ARM_RANGE.
        ParameterError: fps is outside FPS_RANGE.
    """
    check_rate(fps, "fps")
    points = np.ascontiguousarray(points, dtype=float)
    if points.shape[1:] != (len(POINTS), 3) or not len(points):
        raise ClipError(f"{path}: no frames")
    known = np.ones(len(points), bool)
    if gaps:
        known = ~np.isnan(points).any(axis=(1, 2))
        points = np.where(known[:, None, None], points, np.nan)
        if not known.any():
            raise ClipError(f"{path}: not one frame of {len(points)} is known")
    near = ~known | (np.abs(points) <= FARTHEST).all(axis=(1, 2))  # NaN compares False
    if not near.all():
        frame = int(np.argmin(near))
        raise ClipError(
            f"{path}: frame {frame} (from 0) puts a joint beyond {FARTHEST:g} m or nowhere; "
            "the file is damaged or in another unit"
        )
    arm = np.median(
        [
            np.linalg.norm(points[known, above] - points[known, below], axis=1)
            + np.linalg.norm(points[known, below] - points[known, hand], axis=1)
            for above, below, hand in _ARMS
        ]
    )
    if not ARM_RANGE[0] <= arm <= ARM_RANGE[1]:
        raise ClipError(
            f"{path}: an arm is {arm:.3g} m long, wanted [{ARM_RANGE[0]:g}, {ARM_RANGE[1]:g}] m "
            "(noise is in metres); the file is damaged or in another unit"
        )
    points.setflags(write=False)
    return Clip(clip_name(path), float(fps), points)


def refuse_wild_angles(path: Path | str, angles: np.ndarray) -> None:
    """Refuse angles [rad], shape (n, any), of which one is beyond MOST_TURNED.

    Raises:
        ClipError: names the frame and the angle.
    """
    wild = ~(np.abs(angles) <= MOST_TURNED)
    if wild.any():
        frame, column = np.argwhere(wild)[0]
        raise ClipError(
            f"{path}: frame {frame} (from 0) turns a joint by {angles[frame, column]:g} rad, more "
            f"than {MOST_TURNED:g}; the file is damaged or its angles are in another unit"
        )


def clip_name(path: Path | str) -> str:
    """The file's name without .gz and without the suffix before it."""
    path = Path(path)
    return Path(path.stem if path.suffix.lower() == ".gz" else path.name).stem


def check_rate(fps: float, what: str) -> None:
    """Refuse a rate outside FPS_RANGE.

    Raises:
        ParameterError: fps is not a number or not in the range.
    """
    if not isinstance(fps, (int, float, np.number)) or not FPS_RANGE[0] <= fps <= FPS_RANGE[1]:
        low, high = FPS_RANGE
        raise ParameterError(f"{what} must be in [{low:g}, {high:g}] Hz, got {fps!r}")


def frame_indices(n: int, fps: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the times k/rate, from frame 0 to the last that the clip covers, fall between frames.

    Args:
        n: frames of the clip, at least 1.
        fps: the clip's rate [Hz].
        rate: the wanted rate [Hz]; may be higher.

    Returns:
        Pair (left, weight): sample k lies at (1 - weight) left + weight (left + 1), in frames;
        left is integer of shape (m,), weight in [0, 1) of shape (m,), exactly 0 on a frame.

    Raises:
        ParameterError: n < 1 or a rate outside FPS_RANGE.
    """
    if n < 1:
        raise ParameterError(f"a clip has at least 1 frame, got {n}")
    check_rate(fps, "fps")
    check_rate(rate, "rate")
    count = int((n - 1) * rate / fps + _ON_FRAME) + 1
    place = np.arange(count) * fps / rate  # [frames]
    left = np.minimum(np.floor(place + _ON_FRAME).astype(int), n - 1)
    weight = place - left
    weight[np.abs(weight) <= _ON_FRAME] = 0.0
    return left, weight


def resample(clip: Clip, rate: float) -> Clip:
    """The clip at another rate, by linear interpolation of its positions.

    A sample that falls on a frame is that frame, so a frame of NaN reaches only the samples
    strictly between its two neighbours.

    Args:
        clip: any clip.
        rate: wanted frames per second [Hz].

    Returns:
        Clip at `rate`, of int((n - 1) rate / fps) + 1 frames, read-only.

    Raises:
        ParameterError: rate is outside FPS_RANGE.
    """
    left, weight = frame_indices(len(clip.points), clip.fps, rate)
    return clip._replace(fps=float(rate), points=_blend(clip.points, left, weight))


def at_constant_rate(points: np.ndarray, times: np.ndarray, rate: float) -> np.ndarray:
    """Positions at times[0] + k/rate from frames at uneven times, linearly interpolated.

    Args:
        points: positions [m], shape (n, 10, 3).
        times: strictly rising [s], shape (n,).
        rate: wanted frames per second [Hz].

    Returns:
        Positions [m], shape (m, 10, 3), read-only.
    """
    spans = np.diff(times)
    count = int((times[-1] - times[0]) * rate + _ON_FRAME) + 1
    at = times[0] + np.arange(count) / rate
    left = np.searchsorted(times, at + _ON_FRAME / rate, side="right") - 1
    span = np.append(spans, np.inf)[left]  # nothing lies beyond the last frame
    weight = (at - times[left]) / span
    weight[np.abs(weight) <= _ON_FRAME] = 0.0
    return _blend(points, left, weight)


def _blend(points: np.ndarray, left: np.ndarray, weight: np.ndarray) -> np.ndarray:
    sampled = points[left]  # (m, 10, 3)
    between = np.flatnonzero(weight)
    w = weight[between, None, None]
    sampled[between] = (1.0 - w) * sampled[between] + w * points[left[between] + 1]
    sampled.setflags(write=False)
    return sampled
