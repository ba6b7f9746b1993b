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
from s3le.retarget.follow import Followed, follow
from s3le.retarget.stream import Retargeter
from s3le.retarget.summary import headings, summarise
from s3le.robot.robot import Robot
from s3le.safety import audit
from s3le.types import Progress

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
        even: rows at the rate, or at the clip's own, and none between them.
        lead_in: time to move from the robot's anchor to the first frame [s]; 0: start there.
        about: further words for the file's metadata.
        progress: called with numbers of frames done.

    Raises:
        CertificateError: the motion does not hold; says where first.
        ParameterError: it cannot be told in even rows, or the rate is out of its range.
        S3leError: whatever the retargeter refuses.
    """
    robot = retargeter.robot
    if rate is not None:
        rates.check_rate(rate)  # before the work
    frames = frames._replace(x=robot.seen(frames.x))
    made = follow(
        retargeter, frames.x, frames.time, fps=frames.fps, lead_in=lead_in, progress=progress
    )
    shape = (len(made.time), robot.n_dof)
    if made.q.shape != shape or made.mode.shape != shape[:1]:
        raise CertificateError(f"{frames.name}: the retargeter gave {made.q.shape}, not {shape}")
    wanted = audit.demands(
        robot,
        margin_between=retargeter.settings.between,
        velocity=dict(zip(robot.joint_names, retargeter.speed.tolist(), strict=True)),
    )
    rate = frames.fps if even and rate is None else rate
    rows = _rows(robot, frames.name, made, rate, even, wanted.margin_between)
    margin = np.where(rows.corner >= 0, wanted.margin, wanted.margin_between)
    report = audit.audit(robot, rows.time, rows.q, wanted, margin)
    if not report.holds:
        raise CertificateError(f"{frames.name}: refused, {report.complaint}")
    # Of the rows that were followed; those put between two of them lie on the straight path.
    hard = audit.accelerations(robot, made.time, made.q, retargeter.most.acceleration)
    if hard.first:
        raise CertificateError(f"{frames.name}: refused, {audit.say(hard.name, hard.first)}")
    mode = np.where(
        (rows.corner >= 0) | (rows.next < made.clip_from), made.mode[rows.next], BETWEEN
    )
    certificate = audit.certificate(robot, wanted, report) | {
        "acceleration_rad_s2": {
            name: float(limit) if np.isfinite(limit) else None
            for name, limit in zip(robot.joint_names, retargeter.most.acceleration, strict=True)
        }
    }
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
        heading=headings(frames, rows.time - made.offset),
    )  # fmt: skip
    summary = {
        **{key: value for key, value in words.items() if key != "certificate"},
        "certificate": certificate,
        **summarise(robot, frames, made, rows, report),
    }
    return Result(motion, summary)


def _rows(
    robot: Robot, name: str, made: Followed, rate: float | None, even: bool, between: float
) -> Emission:
    """The rows to be written of a clip that was followed."""
    if rate is None:
        return rates.as_given(made.time, made.q)
    sample = rates.evenly if even else rates.at_rate
    try:
        return sample(robot, made.time, made.q, rate, between)
    except ParameterError as refusal:
        raise ParameterError(f"{name}: {refusal}") from None
