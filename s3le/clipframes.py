"""Any motion file as skeletons in time, for use outside the pipeline; the same functions as in it.

Frames that cannot be used (s3le.motion.skeletons) are left out and counted. The others keep their
own times, so a gap shows as a longer step in time: whoever follows them moves from the last
usable frame to the next in as long as the human took.
"""

from math import radians
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le import motion
from s3le.errors import ClipError
from s3le.mocap.clip import Reading, resample
from s3le.mocap.keypoints.how import How
from s3le.mocap.read import read_clip

TILT_MAX = 60.0  # [deg], as params.yaml has it for the pipeline


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


def read(
    path: Path | str,
    neck: str,
    tilt_max: float = TILT_MAX,
    fps: float | None = None,
    rate: float | None = None,
    how: How | None = None,
) -> ClipFrames:
    """Read a motion file and its seven vectors, frame by frame.

    Args:
        path: see s3le.mocap.read.read_clip.
        neck: skeleton.NECKS, as the robot has it (Machine.neck).
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
    kept = motion.skeletons(clip.points, neck, radians(tilt_max))
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
