"""Any motion file as skeletons in time: what the method sees, with every dropped frame counted.

Frames that cannot be used (`skeletons`) are left out and counted. The others keep their own times,
so a gap shows as a longer step in time: whoever follows them moves from the last usable frame to
the next in as long as the human took.
"""

from math import radians
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ClipError
from s3le.human.clip import Reading, resample
from s3le.human.keypoints.how import How
from s3le.human.read import read_clip
from s3le.skeleton import face_forward, features

LEVEL_MIN = 0.2  # least horizontal share of the pelvis line for which a heading means anything
TILT_MAX = 60.0  # [deg], as params.yaml has it for the pipeline


class Kept(NamedTuple):
    """Skeletons of the frames that could be used."""

    rows: np.ndarray  # int (m,), which of the given frames
    x: np.ndarray  # (m, 21), facing forward
    heading: np.ndarray  # [rad], (m,), the yaw that was taken out
    dropped: dict[str, int]  # cause -> frames


def skeletons(points: np.ndarray, neck: str, tilt_max: float) -> Kept:
    """Turn frames to face forward and read their seven unit vectors.

    A frame counts under the first cause that applies to it: not finite, a pelvis line that is
    nearly vertical or has no length, a bone without length, a torso tilted too far.

    Args:
        points: joint positions [m], (n, 10, 3), z up.
        neck: skeleton.NECKS.
        tilt_max: largest angle between hip-to-neck and the vertical [rad].
    """
    points = np.asarray(points, float)
    finite = np.isfinite(points).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):  # inf - inf in frames that are about to be dropped
        turned, heading, level = face_forward(points)
        x, has_bones = features(turned, neck)
        has_heading = level >= LEVEL_MIN
        upright = np.arccos(np.clip(x[:, 2], -1.0, 1.0)) <= tilt_max
    dropped = {}
    left = np.ones(len(points), bool)
    causes = (
        ("not_finite", finite),
        ("pelvis", has_heading),
        ("bone", has_bones),
        ("tilt", upright),
    )
    for cause, good in causes:
        dropped[cause] = int((left & ~good).sum())
        left &= good
    rows = np.flatnonzero(left)
    return Kept(rows, x[rows], heading[rows], dropped)


class ClipFrames(NamedTuple):
    """The usable frames of one clip."""

    name: str
    fps: float  # [Hz], of the clip or as asked for
    total: int  # frames that there were
    frame: np.ndarray  # int (m,), numbers of the usable ones
    time: np.ndarray  # [s], (m,), from the clip's first frame, usable or not
    x: np.ndarray  # (m, 21), facing forward
    heading: np.ndarray | None  # [rad], (m,), the yaw that was taken out; None: not known
    dropped: dict[str, int]  # cause -> frames
    reading: Reading | None = None  # how the file was understood, where that was open

    @property
    def gap(self) -> float:
        """Longest time between two usable frames [s]; 0 if there is only one."""
        return float(np.diff(self.time).max(initial=0.0))


def refuse_minority(path: Path | str, frames: ClipFrames) -> None:
    """Refuse a clip of which most frames were left out.

    Raises:
        ClipError: fewer than half of its frames can be used; names the causes.
    """
    kept = len(frames.x)
    if 2 * kept < frames.total:
        raise ClipError(
            f"{path}: only {kept} of {frames.total} frames can be used "
            f"({_causes(frames.dropped)}); another axis may be up (--axes), or accept it with "
            "--accept-minority"
        )


def _causes(dropped: dict[str, int]) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in dropped.items() if count)


def read_frames(
    path: Path | str,
    neck: str,
    tilt_max: float = TILT_MAX,
    fps: float | None = None,
    rate: float | None = None,
    how: How | None = None,
) -> ClipFrames:
    """Read a motion file and its seven vectors, frame by frame.

    Args:
        path: see s3le.human.read.read_clip.
        neck: skeleton.NECKS, as the robot has it (Robot.neck).
        tilt_max: frames whose torso leans farther from the vertical are left out [deg].
        fps: frames per second [Hz], instead of the file's own.
        rate: frames per second to resample to [Hz]; None: the clip's own frames.
        how: what is known of keypoints.

    Raises:
        ClipError: the file cannot be read, or not one frame of it can be used.
        ParameterError: a rate is none, neck is unknown, or how does not fit the file.
    """
    clip = read_clip(path, fps, how)
    if rate is not None:
        clip = resample(clip, rate)
    kept = skeletons(clip.points, neck, radians(tilt_max))
    if not len(kept.rows):
        causes = _causes(kept.dropped)
        raise ClipError(f"{path}: not one of {len(clip.points)} frames can be used ({causes})")
    return ClipFrames(
        clip.name,
        clip.fps,
        len(clip.points),
        kept.rows,
        kept.rows / clip.fps,
        kept.x,
        kept.heading,
        kept.dropped,
        clip.reading,
    )
