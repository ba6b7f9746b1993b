"""A clip brought into another tool's motion: its legs and root, our arms, one proof of all.

The rows are the other file's. The human is brought to them in time, the poses wanted are planned
as those of any clip, and what comes of it is treated as `s3le guard` treats a whole-body motion:
the nearest one that is certified with all joints moving, and where the others leave no way, steps
that are forced, listed, and claimed of by nobody.
"""

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from s3le.errors import ParameterError
from s3le.guard import clean, forced, moved
from s3le.guard.claim import claim
from s3le.guard.layouts.episode import Episode
from s3le.guard.layouts.numbers import Numbers
from s3le.human.skeletons import ClipFrames
from s3le.motion import rates, trajectory
from s3le.retarget import ahead
from s3le.retarget.clip import FROM_CLIP, IDENTITY, Result
from s3le.retarget.follow import Followed, turned
from s3le.retarget.others import Other, Read
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter
from s3le.retarget.summary import headings, summarise
from s3le.robot.robot import Robot
from s3le.safety.audit import Report
from s3le.skeleton import DIM
from s3le.types import Progress

BEYOND = "beyond"  # mode of a row before the clip begins or after it ends


def at_rows(frames: ClipFrames, read: Read, offset: float) -> tuple[ClipFrames, slice]:
    """The human at the rows of another file, bones turning evenly from frame to frame.

    Args:
        frames: the clip.
        read: the other file.
        offset: when the clip begins, after the file's first row [s].

    Returns:
        The clip as if its frames were those rows of the file that lie in it, within half a frame
        at its ends, times from the clip's first frame; and which rows these are.

    Raises:
        ParameterError: none does.
    """
    begin, end = frames.time[0], frames.time[-1]
    own = read.time - (read.time[0] + offset)
    slack = 0.5 / frames.fps
    rows = np.flatnonzero((own >= begin - slack) & (own <= end + slack))
    if not len(rows):
        raise ParameterError(
            f"{frames.name}: lies at {begin + offset:.2f} to {end + offset:.2f} s of {read.name}, "
            f"which has no row there (0 to {own[-1] - own[0]:.2f} s); give another --offset"
        )
    inside = slice(int(rows[0]), int(rows[-1]) + 1)
    at = np.clip(own[inside], begin, end)
    after = np.clip(np.searchsorted(frames.time, at), 1, max(len(frames.time) - 1, 1))
    if len(frames.time) == 1:
        x = frames.x.repeat(len(at), axis=0)
    else:
        t, bones = frames.time, frames.x.reshape(-1, 7, 3)
        share = (at - t[after - 1]) / (t[after] - t[after - 1])
        x = turned(bones[after - 1], bones[after], share[:, None, None]).reshape(-1, DIM)
        for edge, frame in ((0.0, after - 1), (1.0, after)):  # frames themselves, to the bit
            x[share == edge] = frames.x[frame[share == edge]]
    fps = read.rate or frames.fps
    seen = frames._replace(fps=fps, frame=np.arange(len(at)), time=at, x=x, heading=None)
    return seen, inside


def convert_among(
    retargeter: Retargeter,
    frames: ClipFrames,
    read: Read,
    other: Other,
    *,
    about: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Result:
    """Retarget a clip into another file's motion, and check all that comes out.

    Args:
        retargeter: the one to follow it.
        frames: the clip.
        read: the other file's motion.
        other: which file that is.
        about: further words for the file's metadata.
        progress: called with numbers of frames done.

    Returns:
        The motion of ours and of the file's other joints. Where steps are forced its certificate
        does not hold, and the summary lists them.

    Raises:
        CertificateError: no motion was found that keeps our limits, speeds and accelerations.
        ParameterError: not one row of the file lies in the clip.
        S3leError: whatever the retargeter refuses.
    """
    robot, m = retargeter.robot, len(read.time)
    seen, inside = at_rows(_usable(frames, robot), read, other.offset)
    seen = seen._replace(x=robot.seen(seen.x))
    step = 1.0 / (read.rate or frames.fps)
    dt = np.diff(read.time, prepend=read.time[0] - step)
    told = ahead.share(progress, 2 * m + clean.work(m), len(frames.x))
    found = ahead.want(retargeter, seen.x, dt[inside], None, told)
    told(m - len(seen.x))
    last = len(seen.x) - 1
    _, wanted, mode, _, seconds = (
        part[np.clip(np.arange(m) - inside.start, 0, last)] for part in found
    )
    began = clock.perf_counter()
    planner = retargeter.planner(curved=False)
    plan = planner.plan(np.cumsum(dt), wanted, skeleton=True, progress=told)

    most = dict(zip(robot.joint_names, retargeter.most.acceleration.tolist(), strict=True))
    own = retargeter.settings
    its, asked = claim(robot, None, own.speed_factor, most, straight=True, jerk=own.jerk)
    guard = clean.Guard(its, replace(asked, between=own.between))
    numbers = Numbers(
        tuple(np.ascontiguousarray(column) for column in plan.q.T), (False,) * robot.n_dof,
        plan.q, robot.lower, robot.upper,
    )  # fmt: skip
    episode = Episode(frames.name, read.time, plan.q, [], numbers, others=read.others)
    made = guard.nearest(episode, told)
    seconds = seconds + (clock.perf_counter() - began) / m

    if inside.start:
        mode[inside.start] = Mode.REFINED  # no start: the robot is there before
    ahead.mark(mode, made.q, wanted)
    words = mode.astype(object)
    words[: inside.start], words[inside.stop :] = BEYOND, BEYOND
    for run in made.forced:
        words[run.first : run.last + 1] = Mode.FORCED
    words = words.astype(str)
    offset = float(read.time[0]) + other.offset
    certificate = guard.certificate([episode], [made.after])
    notes: dict[str, Any] = {
        "robot": robot.name,
        "robot_hash": robot.digest,
        "clip": frames.name,
        "clip_fps": frames.fps,
        **(frames.reading.how.about() if frames.reading else {}),
        "clip_time_offset_s": offset,
        "rate": read.rate,
        "heading": IDENTITY if frames.heading is None else FROM_CLIP,
        "others_file": other.shown,
        "others_sha256": other.sha256,
    }
    if made.forced:
        certificate["forced"] = forced.tree([("", run) for run in made.forced])
    notes |= {"certificate": certificate, **(about or {})}
    motion = trajectory.make(
        frames.name, [*robot.joint_names, *read.joints], read.time, np.hstack([made.q, read.q]),
        made.after.clearance, words, notes | read.about(),
        heading=headings(frames, read.time - offset),
    )  # fmt: skip
    tally = moved.tally([plan.q], [made.q], robot.joint_names)
    rows = rates.as_given(read.time, made.q)
    followed = Followed(
        seen.time, made.q[inside], words, made.after.clearance[inside],
        np.full(len(seen.x), np.nan), *(np.full(len(seen.x), np.nan),) * 2, seconds[inside],
        np.full(made.q[inside].shape, np.nan), 0, 0.0,
    )  # fmt: skip
    summary = {
        **notes,
        **summarise(robot, seen, seen, followed, rows, made.after, own.jerk),
        "given": {
            "joints": [] if read.others is None else list(read.others.joints),
            "breaks": forced.breaks([made.after]),
        },
        "gave_way": {key: value for key, value in tally.items() if key != "bins"},
        "certified": _certified(made.after, made.forced),
    }
    if made.forced:
        summary["forced"] = certificate["forced"]
    return Result(replace(motion, root=read.root), summary)


def told(frames: ClipFrames, read: Read, offset: float) -> list[str]:
    """Sentences on what of the clip, or of the file, has no counterpart."""
    begin, end = frames.time[0] + offset, frames.time[-1] + offset  # from the file's first row
    time, slack, notes = read.time - read.time[0], 0.5 / frames.fps, []
    if early := int((time < begin - slack).sum()):
        notes.append(f"{read.name} begins {begin:.2f} s before the clip: its first {early} rows "
                     "have the clip's first pose")  # fmt: skip
    if late := int((time > end + slack).sum()):
        notes.append(f"{read.name} goes on {time[-1] - end:.2f} s beyond the clip: its last {late} "
                     "rows keep the clip's last pose")  # fmt: skip
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for cut, what in ((-begin, "before it begins"), (end - time[-1], "after it ends")):
        if cut > max(slack, step):
            notes.append(f"{cut:.2f} s of the clip lie {what} in {read.name}, and are left out")
    return notes


def _usable(frames: ClipFrames, robot: Robot) -> ClipFrames:
    """The frames that a robot can follow.

    Raises:
        ParameterError: there is none.
    """
    x = robot.seen(frames.x)
    bones = x.reshape(-1, 7, 3)
    good = np.isfinite(bones).all(axis=(1, 2)) & (bones != 0.0).any(axis=2).all(axis=1)
    if not good.any():
        raise ParameterError(f"{frames.name}: has no frame with seven finite vectors")
    return frames._replace(x=x[good], time=frames.time[good], frame=frames.frame[good])


def _certified(report: Report, runs: Sequence[forced.Forced]) -> dict[str, Any]:
    """How much of a motion is certified."""
    bad = {row for run in runs for row in range(run.first, run.last + 1)}
    by_name = {check.name: check for check in report.checks}
    poses, paths = by_name["poses"], by_name["paths"]
    return {
        "poses": poses.total - poses.broken,
        "paths": paths.total - paths.broken,
        "share": 1.0 - len(bad) / report.rows,
        "proven_bound_m": report.bound if np.isfinite(report.bound) else None,
    }
