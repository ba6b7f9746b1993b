"""A clip followed from beginning to end: a robot's motion, checked before anyone sees it.

The retargeter says that every pose and path is certified; here all that is going to be written is
audited again (s3le.safety.audit), and a motion that does not hold is refused.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.human.keypoints.how import How
from s3le.human.skeletons import TILT_MAX, ClipFrames, read_frames
from s3le.motion import rates, trajectory
from s3le.motion.rates import Emission
from s3le.motion.trajectory import BETWEEN, Trajectory
from s3le.retarget.follow import Followed, follow, turned
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter
from s3le.retarget.summary import headings, summarise
from s3le.safety import audit
from s3le.types import Progress

_GAP = 1.5  # steps of a clip, from which on frames are missing between two
FROM_CLIP, IDENTITY = "from the clip", "identity"  # where a motion's heading comes from


class Result(NamedTuple):
    """What became of one clip."""

    motion: Trajectory
    summary: dict[str, Any]


def retarget_clip(
    path: Path | str,
    retargeter: Retargeter,
    *,
    fps: float | None = None,
    tilt_max: float = TILT_MAX,
    how: How | None = None,
    rate: float | None = None,
    lead_in: float = 0.0,
    progress: Progress | None = None,
) -> Result:
    """Retarget one motion file; what `s3le retarget` does with it.

    Args:
        path: see s3le.human.read.read_clip.
        retargeter: the one to follow it.
        fps: frames per second [Hz], instead of the file's own.
        tilt_max: frames whose torso leans farther from the vertical are left out [deg].
        how: what is known of keypoints.
        rate, lead_in, progress: see convert.

    Raises:
        ClipError: the file cannot be read, or not one frame of it can be used.
        CertificateError: the motion does not hold; says where first.
        ParameterError: an argument is out of its range.
    """
    frames = read_frames(path, retargeter.robot.neck, tilt_max, fps, how=how)
    return convert(retargeter, frames, rate=rate, lead_in=lead_in, progress=progress)


def convert(
    retargeter: Retargeter,
    frames: ClipFrames,
    *,
    rate: float | None = None,
    even: bool = False,
    lead_in: float = 0.0,
    about: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Result:
    """Retarget a clip and check all that comes out.

    Args:
        retargeter: the one to follow it.
        frames: the clip.
        rate: rows per second [Hz], see motion.rates; None: a row a usable frame.
        even: rows at the clip's own rate where none is asked for, also where frames are missing.
        lead_in: time to move from the robot's anchor to the first frame [s]; 0: start there.
        about: further words for the file's metadata.
        progress: called with numbers of frames done.

    Raises:
        CertificateError: the motion does not hold; says where first.
        ParameterError: the rate is out of its range.
        S3leError: whatever the retargeter refuses.
    """
    robot = retargeter.robot
    if rate is not None:
        rates.check_rate(rate)  # before the work
    frames = frames._replace(x=robot.seen(frames.x))
    rate = frames.fps if even and rate is None else rate
    pace = frames.fps if rate is None else rates.planned(rate, frames.fps)
    # A clip whose frames are as its rate says gets all of them, also those that are missing.
    shown = frames
    if rate is not None or rates.on_grid(frames.time, pace):
        shown = _on_grid(frames, pace)
    unseen = _unseen(frames, shown.time)
    made = follow(
        retargeter, shown.x, shown.time, fps=shown.fps, lead_in=lead_in, progress=progress
    )
    made.mode[made.clip_from :][unseen] = Mode.DROPPED
    shown = shown._replace(x=np.where(unseen[:, None], np.nan, shown.x))
    shape = (len(made.time), robot.n_dof)
    if made.q.shape != shape or made.v.shape != shape or made.mode.shape != shape[:1]:
        raise CertificateError(f"{frames.name}: the retargeter gave {made.q.shape}, not {shape}")
    most = retargeter.most
    wanted = audit.demands(
        robot,
        margin_between=retargeter.settings.between,
        velocity=dict(zip(robot.joint_names, retargeter.speed.tolist(), strict=True)),
        acceleration=dict(zip(robot.joint_names, most.acceleration.tolist(), strict=True)),
    )
    rows = _rows(frames.name, made, rate)
    own = rows.own >= 0
    margin = np.where(own, wanted.margin, wanted.margin_between)
    report = audit.audit(robot, rows.time, rows.q, wanted, margin, v=rows.v)
    if not report.holds:
        raise CertificateError(f"{frames.name}: refused, {report.complaint}")
    mode = np.where(own | (rows.next < made.clip_from), made.mode[rows.next], BETWEEN)
    certificate = audit.certificate(robot, wanted, report, v=True)
    words = {
        "robot": robot.name,
        "robot_hash": robot.digest,
        "clip": frames.name,
        "clip_fps": frames.fps,
        **(frames.reading.how.about() if frames.reading else {}),
        "clip_time_offset_s": made.offset,
        "rate": rate,
        "heading": IDENTITY if frames.heading is None else FROM_CLIP,
        "certificate": certificate,
        **(about or {}),
    }
    motion = trajectory.make(
        frames.name, robot.joint_names, rows.time, rows.q, report.clearance, mode, words,
        heading=headings(frames, rows.time - made.offset), v=rows.v,
    )  # fmt: skip
    summary = {
        **{key: value for key, value in words.items() if key != "certificate"},
        "certificate": certificate,
        **summarise(robot, frames, shown, made, rows, report, retargeter.settings.jerk),
    }
    return Result(motion, summary)


def _rows(name: str, made: Followed, rate: float | None) -> Emission:
    """The rows to be written of a clip that was followed."""
    if rate is None:
        return rates.as_given(made.time, made.q, made.v)
    try:
        return rates.at_rate(made.time, made.q, made.v, rate)
    except ParameterError as refusal:
        raise ParameterError(f"{name}: {refusal}") from None


def _on_grid(frames: ClipFrames, rate: float) -> ClipFrames:
    """A clip with a frame wherever one would be at a rate [Hz], seen between its own if it is not.

    Where frames are missing, people are taken to go from the last to the next.
    """
    time, bones = frames.time, frames.x.reshape(-1, 7, 3)
    count = int(np.floor((time[-1] - time[0]) * rate + rates.ON_ROW)) + 1
    moments = time[0] + np.arange(count) / rate
    left = np.clip(np.searchsorted(time, moments, side="right") - 1, 0, max(len(time) - 2, 0))
    right = np.minimum(left + 1, len(time) - 1)
    step = np.maximum(time[right] - time[left], 1e-9)
    share = np.clip((moments - time[left]) / step, 0.0, 1.0)
    a, b = bones[left], bones[right]
    x = np.where(share[:, None, None] < 0.5, a, b)
    between = (share > rates.ON_ROW) & (share < 1.0 - rates.ON_ROW)
    between &= np.isfinite(a).all(axis=(1, 2)) & np.isfinite(b).all(axis=(1, 2))
    x[between] = turned(a[between], b[between], share[between, None, None])
    numbers = np.arange(count, dtype=frames.frame.dtype)
    return frames._replace(x=x.reshape(count, -1), time=moments, fps=rate, frame=numbers)


def _unseen(frames: ClipFrames, moments: np.ndarray) -> np.ndarray:
    """At which moments nobody is seen, for frames are missing there; bool."""
    near = np.clip(np.searchsorted(frames.time, moments), 1, max(len(frames.time) - 1, 1))
    before = frames.time[near - 1]
    after = frames.time[np.minimum(near, len(frames.time) - 1)]
    off = np.minimum(np.abs(moments - before), np.abs(after - moments))
    return (off > 1e-6) & (after - before > _GAP / frames.fps)
