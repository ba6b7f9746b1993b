"""Motions and the human they follow, at any moment: what a viewer or a film asks of files.

A motion is read as `s3le audit` reads it. Between two of its rows the joints move straight, so
that is how a moment between them is shown; before the first and after the last row it stands.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ClipError, TrajectoryError
from s3le.human.keypoints import how as reading
from s3le.human.keypoints.how import How
from s3le.human.origin import CLIP, CLIP_HASH
from s3le.human.read import digest
from s3le.human.skeletons import read_frames
from s3le.motion import files
from s3le.motion.fit import MOVING, fit
from s3le.motion.trajectory import Trajectory
from s3le.robot.robot import Robot
from s3le.robot.wholebody import with_joints

ON_ROW = 1e-7  # [s], a moment this close to a row is that row
TILT_MAX = 89.0  # [deg]; what is shown is not what was fit to be followed
LONGEST = 200_000  # moments of one film or viewing; an hour at 55 Hz


class Shown(NamedTuple):
    """One motion of one robot."""

    label: str
    path: Path
    robot: Robot
    trajectory: Trajectory  # its joints in the robot's order
    notes: list[str]  # what a person should know about it


class Human(NamedTuple):
    """The human in the time of the motions."""

    label: str
    time: np.ndarray  # [s], (m,), rising
    x: np.ndarray  # (m, 21)


def read(
    path: Path,
    robot: Robot,
    fps: float | None = None,
    joints: list[str] | None = None,
    degrees: bool = False,
) -> Shown:
    """Read one motion file of a robot.

    Raises:
        TrajectoryError: what the audit's reader refuses.
        RobotError: a joint moves that the robot file holds still, and cannot move in the model.
    """
    return of(files.read(path, fps, joints), path, robot, degrees)


def of(trajectory: Trajectory, path: Path, robot: Robot, degrees: bool = False) -> Shown:
    """The motion that a file's trajectory is, of a robot; see read.

    Joints of the URDF that the robot holds still and that move all the same, as legs do that
    others move, are shown as they move; bodies are measured with them.
    """
    fitted = fit(trajectory, robot, degrees, (MOVING,))
    own, others = fitted.trajectory, fitted.others
    if others is None:
        return Shown(path.stem, path, robot, own, fitted.notes)
    wide = with_joints(robot, others.joints)
    found = dict(zip(own.joints, own.q.T, strict=True))
    found |= dict(zip(others.joints, others.q.T, strict=True))
    q = np.stack([found[name] for name in wide.joint_names], axis=1)
    whole = replace(own, joints=tuple(wide.joint_names), q=q, v=None)
    return Shown(path.stem, path, wide, whole, fitted.notes)


def named(shown: list[Shown]) -> list[Shown]:
    """The same with labels that differ, as far into their paths as need be."""
    for depth in range(1, 1 + max((len(s.path.resolve().parts) for s in shown), default=0)):
        labels = ["/".join(s.path.resolve().with_suffix("").parts[-depth:]) for s in shown]
        if len(set(labels)) == len(labels):
            break
    else:
        labels = [f"{s.label} ({i})" for i, s in enumerate(shown, 1)]
    return [s._replace(label=label) for s, label in zip(shown, labels, strict=True)]


def recorded_clip(shown: Shown) -> tuple[Path | None, str]:
    """The clip that a motion says it was made from, and what is to be said about it.

    Returns:
        Pair (path, words): no path where the file names none or it is not there; the words say
        which, or that the clip has changed since, or nothing.
    """
    about = shown.trajectory.about
    name = about.get(CLIP)
    if not isinstance(name, str):
        return None, f"{shown.path} names no clip, so there is no human; give one with --human"
    path = shown.path.parent / name
    try:
        same = digest(path) == about.get(CLIP_HASH)
    except OSError as error:
        why = error.strerror or str(error)
        return None, f"the human of {shown.path}, {path}: {why}; give the clip with --human"
    except ValueError:  # a name that no file has
        return None, f"{shown.path} names a clip that no file can be; give it with --human"
    return path, "" if same else f"{path} has changed since {shown.path} was made from it"


def human(path: Path, shown: Shown, how: How | None = None) -> Human:
    """The human of a clip in the time of a motion.

    Args:
        path: the clip.
        shown: the motion; the clip that it was made from is read as it was then.
        how: what is known of keypoints, instead of what the motion says of its clip.

    Raises:
        ClipError: the clip cannot be read, or it lies outside the motion's time.
    """
    about = shown.trajectory.about
    how = how or How()
    if how == How() and _is_recorded(path, shown):
        how = reading.recorded(about)
    fps = _number(about, "clip_fps")
    frames = read_frames(path, shown.robot.neck, TILT_MAX, fps, how=how)
    time = frames.time + (_number(about, "clip_time_offset_s") or 0.0)
    if time[0] > shown.trajectory.time[-1] + 1.0 or time[-1] < shown.trajectory.time[0] - 1.0:
        raise ClipError(
            f"{path}: lasts from {time[0]:.2f} to {time[-1]:.2f} s, the motion {shown.path} from "
            f"{shown.trajectory.time[0]:.2f} to {shown.trajectory.time[-1]:.2f} s"
        )
    return Human(frames.name, time, frames.x)


def _is_recorded(path: Path, shown: Shown) -> bool:
    """Whether a motion says that it was made from this clip."""
    name = shown.trajectory.about.get(CLIP)
    try:
        return isinstance(name, str) and (shown.path.parent / name).samefile(path)
    except (OSError, ValueError):
        return False


def _number(about: Any, key: str) -> float | None:
    value = about.get(key)
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None


def poses(shown: Shown, times: np.ndarray) -> np.ndarray:
    """Joint angles [rad] at moments [s], (n, n_dof)."""
    time, q = shown.trajectory.time, shown.trajectory.q
    return np.stack([np.interp(times, time, q[:, j]) for j in range(q.shape[1])], axis=1)


def modes(shown: Shown, times: np.ndarray) -> np.ndarray | None:
    """How the row that each moment is, or leads to, was obtained: str (n,); None: not said."""
    if shown.trajectory.mode is None:
        return None
    return shown.trajectory.mode[upcoming(shown, times)]


def upcoming(shown: Shown, times: np.ndarray) -> np.ndarray:
    """The row that each moment is, or leads to, int (n,)."""
    row = np.searchsorted(shown.trajectory.time, np.asarray(times) - ON_ROW)
    return np.minimum(row, len(shown.trajectory.time) - 1)


def skeletons(seen: Human, times: np.ndarray) -> np.ndarray:
    """The human at moments, (n, 21): its last usable frame until then, or else its first."""
    row = np.searchsorted(seen.time, np.asarray(times) + ON_ROW, side="right") - 1
    return seen.x[np.maximum(row, 0)]


def moments(
    shown: list[Shown],
    rate: float,
    begin: float | None = None,
    end: float | None = None,
    exact: bool = False,
) -> np.ndarray:
    """Moments [s] that cover all motions: rows of the first where they are no denser than rate.

    Args:
        shown: the motions.
        rate: moments per second [Hz].
        begin, end: part of the motions' time [s].
        exact: at that rate, whatever the rows are.

    Raises:
        TrajectoryError: nothing lies between begin and end, or more than LONGEST.
    """
    first = min(s.trajectory.time[0] for s in shown) if begin is None else begin
    last = max(s.trajectory.time[-1] for s in shown) if end is None else end
    low, high = (f(s.trajectory.time[i] for s in shown) for f, i in ((min, 0), (max, -1)))
    if not first <= last or last < low or first > high:
        raise TrajectoryError(
            f"nothing to show from {first:g} to {last:g} s; the motion lasts from {low:g} to "
            f"{high:g} s"
        )
    if not (last - first) * rate < LONGEST:
        raise TrajectoryError(
            f"{(last - first) * rate:.0f} moments at {rate:g} Hz, at most {LONGEST} are shown; "
            "show a part of it with --from and --to"
        )
    own = shown[0].trajectory
    if not exact and own.rate is not None and own.rate <= rate:
        times = own.time[(own.time >= first - ON_ROW) & (own.time <= last + ON_ROW)]
        if len(times) and times[0] <= first + ON_ROW and times[-1] >= last - 1.0 / rate:
            return np.array(times)
    return first + np.arange(int((last - first) * rate + 1e-6) + 1) / rate
