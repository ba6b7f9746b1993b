"""What a person or a table wants to know of one retargeted clip."""

from typing import Any

import numpy as np

from s3le.human.skeletons import ClipFrames
from s3le.kernels import batch
from s3le.motion.rates import Emission
from s3le.plan import gentle
from s3le.retarget.follow import Followed
from s3le.robot.robot import Robot
from s3le.safety import audit
from s3le.skeleton import BONES, cosine_distance


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
    clip: ClipFrames,
    frames: ClipFrames,
    made: Followed,
    rows: Emission,
    report: audit.Report,
    jerk: float,
) -> dict[str, Any]:
    """What a person or a table wants to know of one clip.

    Args:
        robot: the robot.
        clip: as it was read.
        frames: as it was followed; not finite where nobody is seen.
        made, rows, report: what came of it.
        jerk: that was aimed at [rad/s^3]; 0: none.
    """
    seen = np.isfinite(frames.x).all(axis=1)
    frames = frames._replace(x=frames.x[seen], frame=frames.frame[seen])
    q = made.q[made.clip_from :][seen]
    x = batch.skeletons(robot.chain, q)
    bones = 1.0 - (x * frames.x).reshape(-1, 7, 3).sum(axis=2)  # (n, 7)
    words, counts = np.unique(made.mode, return_counts=True)
    speeds = None if np.isnan(made.v).any() else made.v
    taken = made.seconds[made.clip_from :] * 1e3
    return {
        **({"reading": clip.reading.summary()} if clip.reading else {}),
        "frames": {
            "clip": clip.total,
            "followed": len(clip.x),
            "dropped": clip.dropped,
            "longest_gap_s": clip.gap,
        },
        "rows": {
            "written": len(rows.time),
            "seconds": float(rows.time[-1] - rows.time[0]),
            "lead_in": made.clip_from,
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
            "stops": len(rows.time) if rows.v is not None else None,
            "share": 1.0,  # what is not is not written
            "proven_bound_m": report.bound if len(rows.time) > 1 else None,
        },
        "modes": dict(zip(words.tolist(), counts.tolist(), strict=True)),
        "still": int((np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) == 0.0).sum()),
        "jerk": {
            "joints_rad_s3": _jerk(q, frames),
            "bones_robot_s3": _jerk(x, frames),
            "bones_human_s3": _jerk(frames.x, frames),
            "planned": gentle.about([(made.time, made.q, speeds)], jerk),
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
