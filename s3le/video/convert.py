"""A video to ten points in time, with every frame that is not used counted by its reason."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from math import degrees, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ParameterError, VideoError
from s3le.human import points_parquet
from s3le.human.clip import check_rate
from s3le.video import track
from s3le.video.decode import Video
from s3le.video.estimator import Estimator
from s3le.video.smooth import Sampled, at_rate

MOST_RATE = 60.0  # [Hz] unless asked for more
STANDING = 10  # frames that an estimate of the camera's pitch needs
WHY = ("seen", "filled", "hidden", "nobody", "cut", "jump", "flip", "gap")  # words of `status`


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What one may choose.

    Attributes:
        pitch: angle by which the camera looks down [deg]; None: from frames in which the person
            stands.
        roll: angle by which what is upright leans to the right in the image [deg].
        visibility: below which a joint is not used, in [0, 1].
        fill: longest hole that is filled [s].
        smooth: frequency of which the filter leaves 71 % [Hz]; 0: no filter.
        rate: frames per second of the result [Hz]; None: the video's mean, at most MOST_RATE.
    """

    pitch: float | None = None
    roll: float = 0.0
    visibility: float = 0.1
    fill: float = 0.2
    smooth: float = 6.0
    rate: float | None = None

    def check(self) -> None:
        """Refuse what cannot be meant.

        Raises:
            ParameterError: names the choice and its range.
        """
        ranges = {"visibility": (0.0, 1.0), "fill": (0.0, 10.0), "smooth": (0.0, 1000.0)}
        ranges["roll"] = (-180.0, 180.0)
        if self.pitch is not None:
            ranges["pitch"] = (-90.0, 90.0)
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:  # NaN is not
                raise ParameterError(f"{name} must be in [{low:g}, {high:g}], got {value!r}")
        if self.rate is not None:
            check_rate(self.rate, "rate")


class Looked(NamedTuple):
    """What an estimator said of every frame of a video."""

    time: np.ndarray  # [s], (n,), from the first frame looked at
    joints: np.ndarray  # (n, 12, 6), see estimator.Estimator
    change: np.ndarray  # (n,), see estimator.Picture
    about: dict[str, Any]  # the video and the estimator


class Skeletons(NamedTuple):
    """A video's person in time."""

    fps: float  # [Hz]
    time: np.ndarray  # [s], (m,)
    points: np.ndarray  # [m], (m, 10, 3), z up; NaN where a point is not known
    visibility: np.ndarray  # (m,), of the least visible joint; NaN: nobody
    status: np.ndarray  # str (m,), of WHY
    about: dict[str, Any]  # JSON-able: the video, the estimator, the choices, what was counted


def look(
    path: Path | str,
    estimator: Estimator,
    progress: Callable[[int], object] | None = None,
    begin: float | None = None,
    end: float | None = None,
) -> Looked:
    """Show every frame of a video to an estimator.

    Args:
        path: the video.
        estimator: see estimator.Estimator.
        progress: called with numbers of frames done.
        begin, end: see decode.Video.

    Raises:
        VideoError: the video cannot be read, or the estimator cannot go on.
    """
    video, time, change, joints = Video(path, begin, end), [], [], []

    def pictures() -> Iterator[np.ndarray]:
        for picture in video.pictures():
            time.append(picture.time)
            change.append(picture.change)
            yield picture.rgb

    for answer in estimator.joints(pictures()):
        joints.append(answer)
        if progress:
            progress(1)
    at = np.array(time) - time[0]
    steps = np.diff(at)
    with Path(path).open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    about = {
        "video": Path(path).name,
        "video_sha256": digest,
        "video_from_s": begin,
        "video_to_s": end,
        "estimator": estimator.name,
        "width": video.size[0],
        "height": video.size[1],
        "turned_deg": 90 * video.rotation,
        "frames": len(at),
        "seconds": float(at[-1]),
        "mean_fps": float((len(at) - 1) / at[-1]) if len(at) > 1 else None,
        "longest_step_s": float(steps.max(initial=0.0)),
        "shortest_step_s": float(steps.min(initial=at[-1])),
        "damaged_packets": video.damaged,
        "frames_out_of_order": video.late,
        "frames_without_time": video.untimed,
    }
    return Looked(at, np.stack(joints), np.array(change), about)


def skeletons(looked: Looked, choices: Choices, path: Path | str = "the video") -> Skeletons:
    """Judge the frames, break the thread where it is broken, fill, filter, resample.

    Args:
        looked: of `look`.
        choices: see Choices.
        path: of the video, for messages.

    Raises:
        VideoError: a single frame, or not one in which the upper body can be seen.
        ParameterError: a choice is out of its range.
    """
    choices.check()
    time, joints = looked.time, looked.joints
    if len(time) < 2:
        raise VideoError(f"{path}: a single frame is no motion")
    there = track.seen(joints)
    if not there.any():
        raise VideoError(f"{path}: nobody is seen in any of its {len(time)} frames")
    pitch, standing = _pitch(joints, choices)
    points = track.ten_points(joints, choices.visibility, pitch, radians(choices.roll))
    whole = np.isfinite(points).all(axis=(1, 2))
    least = np.where(there, joints[:, track.UPPER, 3].min(axis=1), np.nan)
    broken = track.breaks(time, joints, looked.change)
    why = np.full(len(time), "seen", "<U6")
    why[~whole] = "hidden"
    why[~there] = "nobody"
    for name in ("flip", "jump", "cut"):
        why[getattr(broken, name)] = name
    points[broken.ends | broken.flip] = np.nan
    if not (why == "seen").any():
        raise VideoError(
            f"{path}: arms, shoulders and hips are never all visible to {choices.visibility:g} "
            f"(at best {np.nanmax(least):.2f}); film the whole upper body, or lower --visibility"
        )
    own = float(looked.about["mean_fps"])
    rate = min(own, MOST_RATE) if choices.rate is None else choices.rate
    check_rate(rate, f"{path}: its rate")
    most = points_parquet.MOST_ROWS
    if time[-1] * rate > most:
        raise VideoError(
            f"{path}: lasts {time[-1]:.3g} s by its own times, at {rate:g} Hz that is "
            f"{time[-1] * rate:.3g} rows, at most {most}; take a part of it, or a lower rate"
        )
    made = at_rate(time, points, np.cumsum(broken.ends), rate, choices.fill, choices.smooth)
    status, visibility = _status(made, time, why, least)
    known = np.isfinite(made.points).all(axis=(1, 2))
    if not known.any():
        raise VideoError(f"{path}: no frame at {rate:g} Hz is near one that was seen; raise --rate")
    about = looked.about | {
        "choices": asdict(choices) | {"pitch": degrees(pitch), "rate": rate},
        "pitch_from": standing,
        "frames_with_person": int(there.sum()),
        "cuts": int(broken.cut.sum()),
        "jumps": int(broken.jump.sum()),
        "flips": int((np.diff(broken.flip.astype(int), prepend=0) > 0).sum()),
        "frames_by_status": {name: int((why == name).sum()) for name in WHY if (why == name).any()},
        "rows": len(made.time),
        "rows_by_status": {n: int((status == n).sum()) for n in WHY if (status == n).any()},
        **_gaps(known, rate),
    }
    return Skeletons(rate, made.time, made.points, visibility, status, about)


def write(made: Skeletons, path: Path) -> None:
    """Write skeletons as a file that every command reads as a clip; see human.points_parquet."""
    points_parquet.write(
        path, made.fps, made.time, made.points, made.visibility, made.status, made.about
    )


def _pitch(joints: np.ndarray, choices: Choices) -> tuple[float, str]:
    """The camera's pitch [rad], and where it comes from."""
    if choices.pitch is not None:
        return radians(choices.pitch), "given"
    stood = track.standing_pitch(joints, choices.visibility, radians(choices.roll))
    if stood.frames < STANDING:
        return 0.0, (
            f"taken as level: in {stood.frames} frames somebody stands upright with legs and "
            f"shoulders in sight, {STANDING} are needed"
        )
    return stood.angle, (
        f"the lean of the body in {stood.frames} frames in which somebody stands, "
        f"half of them within {degrees(stood.spread):.1f} deg of it"
    )


def _status(
    made: Sampled, time: np.ndarray, why: np.ndarray, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of each row: a word of WHY, and the visibility in the frame that is nearest."""
    middle = (time[1:] + time[:-1]) / 2.0
    near = np.searchsorted(middle, made.time)
    known = np.isfinite(made.points).all(axis=(1, 2))
    usual = float(np.median(np.diff(time)))
    far = np.abs(made.time - time[near]) > usual
    status = np.where((why[near] == "seen") | far, "gap", why[near])
    status = np.where(known, np.where(made.filled, "filled", "seen"), status)
    return status, np.where(far, np.nan, least[near])


def _gaps(known: np.ndarray, rate: float) -> dict[str, Any]:
    """Stretches without a whole skeleton between two with one."""
    rows = np.flatnonzero(known)
    missing = np.diff(rows) - 1
    return {"gaps": int((missing > 0).sum()), "longest_gap_s": float(missing.max(initial=0) / rate)}
