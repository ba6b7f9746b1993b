"""A clip followed from beginning to end: a robot's motion, checked before anyone sees it.

The retargeter says that every pose and path is certified; here all that is going to be written is
audited again (s3le.safety.audit), and a motion that does not hold is refused.
"""

import time as clock
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.following import Follower
from s3le.human.skeletons import ClipFrames
from s3le.kernels import batch
from s3le.motion import rates, trajectory
from s3le.motion.rates import Emission
from s3le.motion.trajectory import BETWEEN, Trajectory
from s3le.robot.robot import Robot
from s3le.safety import audit
from s3le.skeleton import BONES, cosine_distance
from s3le.types import Progress

FROM_CLIP, IDENTITY = "from the clip", "identity"  # where a motion's heading comes from
START, LEAD_IN = "start", "lead_in"  # beside the retargeter's own modes
LONGEST_LEAD_IN = 600.0  # [s]



class Followed(NamedTuple):
    """Poses of the robot, one a frame."""

    time: np.ndarray  # [s], (n,), of the file
    q: np.ndarray  # [rad], (n, n_dof)
    mode: np.ndarray  # str (n,)
    seconds: np.ndarray  # [s], (n,), what each took; NaN: not measured on its own
    clip_from: int  # first row that belongs to the clip
    offset: float  # [s], time in the file minus time in the clip


def follow(
    follower: Follower, frames: ClipFrames, look_ahead: bool, lead_in: float, progress: Progress
) -> Followed:
    """Let a retargeter follow a clip.

    Args:
        follower: the retargeter.
        frames: the clip.
        look_ahead: give it the whole clip at once, not frame by frame.
        lead_in: time to move from the robot's anchor to the first frame [s]; 0: start there.
        progress: called with numbers of frames done.

    Raises:
        ParameterError: lead_in is negative, too long, or given together with look_ahead.
        S3leError: whatever the retargeter refuses.
    """
    if not 0.0 <= lead_in <= LONGEST_LEAD_IN:
        raise ParameterError(f"lead-in must be in [0, {LONGEST_LEAD_IN:g}] s, got {lead_in!r}")
    if look_ahead:
        if lead_in:
            raise ParameterError("lead-in goes frame by frame; leave out look-ahead")
        began = clock.perf_counter()
        q, mode = follower.batch(frames.x, frames.time)
        each = (clock.perf_counter() - began) / len(frames.x)
        if progress:
            progress(len(frames.x))
        return Followed(frames.time, q, mode, np.full(len(q), each), 0, 0.0)
    times, x, lead = frames.time, frames.x, 0
    q, mode, seconds = [], [], []
    if lead_in:
        anchor = follower.robot.anchor
        lead = max(1, round(lead_in * frames.fps))
        ahead = approach(batch.skeletons(follower.robot.chain, anchor[None])[0], x[0], lead)
        x = np.concatenate([ahead, x])
        times = np.concatenate(
            [np.arange(1, lead + 1), lead + 1 + (times - times[0]) * frames.fps]
        ) / frames.fps  # fmt: skip
        q, mode, seconds = [anchor], [START], [np.nan]
        follower.start(anchor)
    else:
        follower.start(None)
    previous = times[0] - 1.0 / frames.fps
    for i, (frame, now) in enumerate(zip(x, times, strict=True)):
        began = clock.perf_counter()
        answer = follower.step(frame, now - previous)
        seconds.append(clock.perf_counter() - began)
        q.append(answer.q)
        mode.append(LEAD_IN if i < lead else answer.mode)
        previous = now
        if progress and i >= lead:
            progress(1)
    if lead:
        times = np.concatenate([[0.0], times])
    clip_from = lead + 1 if lead else 0
    offset = float(times[clip_from] - frames.time[0]) if lead else 0.0
    return Followed(times, np.array(q), np.array(mode, str), np.array(seconds), clip_from, offset)


def approach(x_from: np.ndarray, x_to: np.ndarray, count: int) -> np.ndarray:
    """Skeletons that lead from one to another, slow at both ends, neither included, (count, 21).

    Each bone turns through the plane of its two directions; one that must turn about goes by any.
    """
    s = np.arange(1, count + 1)[:, None, None] / (count + 1)
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)  # least jerk
    a, b = x_from.reshape(1, 7, 3), x_to.reshape(1, 7, 3)
    angle = np.arccos(np.clip((a * b).sum(axis=2, keepdims=True), -1.0, 1.0))
    aside = b - (a * b).sum(axis=2, keepdims=True) * a
    least = np.abs(a).argmin(axis=2)[..., None]
    other = np.cross(a, np.eye(3)[least[..., 0]])
    aside = np.where(np.linalg.norm(aside, axis=2, keepdims=True) > 1e-6, aside, other)
    aside = aside / np.linalg.norm(aside, axis=2, keepdims=True)
    turned = np.cos(s * angle) * a + np.sin(s * angle) * aside
    return (turned / np.linalg.norm(turned, axis=2, keepdims=True)).reshape(count, -1)


class Converted(NamedTuple):
    """What is written for one clip."""

    trajectory: Trajectory
    summary: dict[str, Any]


def convert(
    follower: Follower,
    frames: ClipFrames,
    *,
    rate: float | None = None,
    even: bool = False,
    lead_in: float = 0.0,
    look_ahead: bool = False,
    optimum: int = 0,
    about: Mapping[str, Any] | None = None,
    progress: Progress = None,
) -> Converted:
    """Retarget a clip and check all that comes out.

    Args:
        follower: the retargeter.
        frames: the clip.
        rate: rows per second [Hz], see emission.at_rate; None: a row a usable frame.
        even: rows at the rate, or at the clip's own, and none between them.
        lead_in, look_ahead: see follow.
        optimum: starts of a constrained optimisation of every frame to compare with; 0: none.
        about: further words for the file's metadata.
        progress: called with numbers of frames done.

    Raises:
        CertificateError: the motion does not hold; says where first.
        ParameterError: it cannot be told in even rows, or the rate is out of its range.
        S3leError: whatever the retargeter refuses.
    """
    robot = follower.robot
    if rate is not None:
        rates.check_rate(rate)  # before the work
    frames = frames._replace(x=robot.seen(frames.x))
    made = follow(follower, frames, look_ahead, lead_in, progress)
    shape = (len(made.time), robot.n_dof)
    if made.q.shape != shape or made.mode.shape != shape[:1]:
        raise CertificateError(f"{frames.name}: the retargeter gave {made.q.shape}, not {shape}")
    wanted = audit.demands(
        robot,
        margin_between=follower.margin_between,
        velocity=dict(zip(robot.joint_names, follower.velocity.tolist(), strict=True)),
    )
    rate = frames.fps if even and rate is None else rate
    rows = _rows(robot, frames.name, made, rate, even, wanted.margin_between)
    margin = np.where(rows.corner >= 0, wanted.margin, wanted.margin_between)
    report = audit.audit(robot, rows.time, rows.q, wanted, margin)
    if not report.holds:
        raise CertificateError(f"{frames.name}: refused, {report.complaint}")
    mode = np.where(
        (rows.corner >= 0) | (rows.next < made.clip_from), made.mode[rows.next], BETWEEN
    )
    certificate = audit.certificate(robot, wanted, report)
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
    if optimum:
        summary["to_optimum"] = _to_optimum(robot, frames, made, optimum)
    return Converted(motion, summary)


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


def headings(frames: ClipFrames, time: np.ndarray) -> np.ndarray:
    """The yaw of the human that its features dropped, at moments of the clip.

    Between two frames it goes straight; before the first and after the last one it stands. It is
    the human's: no limit of the robot and no proof is about it.

    Args:
        frames: the clip.
        time: moments [s], (n,), in the clip's own time.

    Returns:
        Angles about z [rad], (n,), 0 where the clip faces x, unwrapped from frame to frame; all 0
        where the clip has none.
    """
    if frames.heading is None:
        return np.zeros(len(time))
    return np.interp(time, frames.time, np.unwrap(frames.heading))


def summarise(
    robot: Robot,
    frames: ClipFrames,
    made: Followed,
    rows: Emission,
    report: audit.Report,
) -> dict[str, Any]:
    """What a person or a table wants to know of one clip."""
    q = made.q[made.clip_from :]
    x = batch.skeletons(robot.chain, q)
    bones = 1.0 - (x * frames.x).reshape(-1, 7, 3).sum(axis=2)  # (n, 7)
    words, counts = np.unique(made.mode, return_counts=True)
    taken = made.seconds[made.clip_from :] * 1e3
    return {
        **({"reading": frames.reading.summary()} if frames.reading else {}),
        "frames": {
            "clip": frames.total,
            "followed": len(frames.x),
            "dropped": frames.dropped,
            "longest_gap_s": frames.gap,
        },
        "rows": {
            "written": len(rows.time),
            "seconds": float(rows.time[-1] - rows.time[0]),
            "lead_in": made.clip_from,
            "corners_cut_and_proven": rows.cut,
            "corners_kept_as_rows": rows.kept,
        },
        "to_human": {
            **_spread(cosine_distance(x, frames.x, robot.followed)),
            "bones": {
                bone: mean
                for bone, mean in zip(BONES, bones.mean(axis=0).tolist(), strict=True)
                if bone in robot.vectors
            },
        },
        "clearance_m": {"least": report.least, "mean": float(report.clearance.mean())},
        "speed_rad_s": {
            "highest": report.fastest,
            "of_limit": _of_limit(robot, made, report),
        },
        "certified": {
            "poses": len(rows.time),
            "paths": max(len(rows.time) - 1, 0),
            "share": 1.0,  # what is not is not written
            "proven_bound_m": report.bound if len(rows.time) > 1 else None,
        },
        "modes": dict(zip(words.tolist(), counts.tolist(), strict=True)),
        "still": int((np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) == 0.0).sum()),
        "jerk": {
            "joints_rad_s3": _jerk(q, frames),
            "bones_robot_s3": _jerk(x, frames),
            "bones_human_s3": _jerk(frames.x, frames),
        },
        "milliseconds_per_frame": {
            "p50": float(np.percentile(taken, 50)),
            "p90": float(np.percentile(taken, 90)),
            "p99": float(np.percentile(taken, 99)),
            "longest": float(taken.max()),
            "mean": float(taken.mean()),
        },
    }


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "largest": float(values.max()),
    }


def _of_limit(robot: Robot, made: Followed, report: audit.Report) -> float | None:
    """Highest speed as a share of its limit; None where nothing moves or no limit is known."""
    worst = next(check for check in report.checks if check.name == "velocities").worst
    found = worst[0].value / worst[0].wanted if worst else 0.0
    return float(found) if np.isfinite(found) else None


def _jerk(values: np.ndarray, frames: ClipFrames) -> dict[str, float] | None:
    """Mean and largest third difference over time cubed, over runs of frames without a gap."""
    if len(values) < 4:
        return None
    third = np.abs(np.diff(values, n=3, axis=0)) * frames.fps**3
    third = third[np.diff(frames.frame)[:-2] + np.diff(frames.frame)[1:-1]
                  + np.diff(frames.frame)[2:] == 3]  # fmt: skip
    return {"mean": float(third.mean()), "largest": float(third.max())} if len(third) else None


def _to_optimum(
    robot: Robot, frames: ClipFrames, made: Followed, starts: int
) -> dict[str, float]:
    """How far each frame's pose is from the best feasible one that optimisation finds."""
    from s3le import rng
    from s3le.tuples.ik import ground_truth

    best, to_human = ground_truth(robot, frames.x, starts, 1e-4, rng.stream(0, "optimum"))
    x = batch.skeletons(robot.chain, made.q[made.clip_from :])
    best_x = batch.skeletons(robot.chain, best)
    distance = cosine_distance(x, best_x, robot.followed)
    return {**_spread(distance), "optimum_to_human": float(to_human.mean())}
