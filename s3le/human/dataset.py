"""The clips of a study as rows: files found and read, brought to one rate, made a domain."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ClipError
from s3le.human import sources
from s3le.human.clip import Clip, resample
from s3le.human.read import read_clip
from s3le.human.skeletons import skeletons
from s3le.human.sources import Sources
from s3le.skeleton import POINTS, mirror_points
from s3le.types import Progress


class Frames(NamedTuple):
    """All frames of all clips, one a row."""

    split: np.ndarray  # str (n,)
    clip: np.ndarray  # str (n,)
    frame: np.ndarray  # int32 (n,)
    fps: np.ndarray  # [Hz], (n,)
    points: np.ndarray  # [m], (n, 30): ten points, ordered as skeleton.POINTS


def find(clips: str, folder: Path, cache: Path, mirror: str, missing: str) -> Sources:
    """The clips that params.yaml asks for.

    Args:
        clips: "demo", "cmu", or a folder with train and test subfolders, relative to `folder`.
        folder: where the manifests of the built-in ones are.
        cache: where downloads are kept.
        mirror: address or folder that CMU's files are taken from.
        missing: "stop" or "skip" when a trial cannot be had.

    Raises:
        FetchError, ClipError: see s3le.human.sources.
    """
    if clips == "demo":
        return sources.demo(folder / "demo" / "manifest.csv", cache / "demo")
    if clips == "cmu":
        manifest = folder / "cmu" / "manifest.csv"
        how = "refuse" if missing == "stop" else "skip"
        return sources.cmu(manifest, cache / "cmu", mirror, missing=how)
    return sources.folder(folder / clips)


def load(
    found: Sources, progress: Progress | None = None, missing: str = "stop"
) -> tuple[Frames, list[str]]:
    """Read every clip.

    Args:
        found: which clips.
        progress: called with how many more are read.
        missing: "stop" at the first file that cannot be read, or "skip" it.

    Returns:
        Pair (frames, left_out): all rows, and a sentence for each file that was skipped.

    Raises:
        ClipError: the first file that cannot be read, and where in it; with "skip" where a split
            has no other.
    """
    parts, lost = [], {}
    for source in found.clips:
        if progress:
            progress(1)
        try:
            clip = read_clip(source.path, source.fps)
        except ClipError as refusal:
            if missing == "stop":
                raise
            lost[source] = str(refusal)
            continue
        n = len(clip.points)
        parts.append(
            Frames(
                np.full(n, source.split),
                np.full(n, source.clip),
                np.arange(n, dtype=np.int32),
                np.full(n, clip.fps),
                clip.points.reshape(n, -1),
            )
        )
    for split in {source.split: None for source in found.clips}:
        here = [source for source in found.clips if source.split == split]
        if all(source in lost for source in here):
            raise ClipError(f"not one of {len(here)} clips of '{split}' can be read; first: "
                            f"{lost[here[0]]}")  # fmt: skip
    frames = Frames(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    return frames, list(lost.values())


class Domain(NamedTuple):
    """Skeletons of the mocap domain, D_X."""

    x: np.ndarray  # (n, 21)
    origin: np.ndarray  # int (n,), which given frame a row comes from
    kind: np.ndarray  # str (n,): raw, mirrored or noisy


def domain(
    points: np.ndarray,
    neck: str,
    tilt_max: float,
    count: int,
    noise: float,
    rng: np.random.Generator,
) -> Domain:
    """Up to `count` human skeletons: recorded frames, their mirror images, then noisy copies.

    Noise is added to joint positions, as the authors do, so short bones wobble more.

    Args:
        points: recorded joint positions [m] at their own rate, (n, 10, 3).
        neck, tilt_max: see skeletons.
        count: rows wanted.
        noise: standard deviation of the noise on each coordinate [m].
        rng: where the noise comes from.
    """
    kept = skeletons(points, neck, tilt_max)
    if len(kept.rows) > count:  # more than wanted: thin evenly
        pick = np.linspace(0, len(kept.rows) - 1, count).round().astype(int)
        kept = kept._replace(rows=kept.rows[pick], x=kept.x[pick])
    recorded = points[kept.rows]
    parts = [(kept.x, kept.rows, "raw")]
    room = count - len(kept.rows)
    if room > 0 and len(recorded):
        mirrored = skeletons(mirror_points(recorded), neck, tilt_max)
        take = mirrored.rows[:room]
        parts.append((mirrored.x[: len(take)], kept.rows[take], "mirrored"))
        room -= len(take)
    both = np.concatenate([recorded, mirror_points(recorded)])
    origin = np.concatenate([kept.rows, kept.rows])
    while room > 0 and noise > 0.0 and len(both):
        drawn = rng.integers(len(both), size=room)
        shaken = both[drawn] + rng.normal(0.0, noise, (room, len(POINTS), 3))
        noisy = skeletons(shaken, neck, np.pi)  # noise alone must not decide what is upright
        parts.append((noisy.x, origin[drawn[noisy.rows]], "noisy"))
        room -= len(noisy.rows)
    return Domain(
        np.concatenate([x for x, _, _ in parts]),
        np.concatenate([rows for _, rows, _ in parts]),
        np.concatenate([np.full(len(x), kind) for x, _, kind in parts]),
    )


class Motion(NamedTuple):
    """Skeletons of many clips at a common rate, one frame a row, and what was dropped."""

    split: np.ndarray  # str (n,)
    clip: np.ndarray  # str (n,)
    frame: np.ndarray  # int32 (n,), number at the common rate; dropped frames leave gaps
    time: np.ndarray  # [s], (n,)
    heading: np.ndarray  # [rad], (n,)
    x: np.ndarray  # (n, 21)


def at_rate(
    points: dict[str, np.ndarray], rate: float, neck: str, tilt_max: float
) -> tuple[Motion, dict[str, dict[str, int]]]:
    """Resample every clip and read its skeletons.

    Args:
        points: columns of table mocap_points.
        rate: frames per second [Hz].
        neck, tilt_max: see skeletons.

    Returns:
        Pair (motion, counts): counts[split] = clips, frames kept, frames dropped by cause, and
        clips of which no frame was left.

    Raises:
        ClipError: not one frame of all clips can be used.
    """
    parts: list[Motion] = []
    counts: dict[str, dict[str, int]] = {}
    for clip, rows in _clips(points["split"], points["clip"]):
        split, fps = str(points["split"][rows][0]), float(points["fps"][rows][0])
        positions = points["points"][rows].reshape(-1, len(POINTS), 3)
        sampled = resample(Clip(clip, fps, positions), rate)
        kept = skeletons(sampled.points, neck, tilt_max)
        tally = counts.setdefault(split, {"clips": 0, "frames": 0})
        tally["clips"] += 1
        tally["frames"] += len(kept.rows)
        for cause, frames in kept.dropped.items():
            tally[f"dropped_{cause}"] = tally.get(f"dropped_{cause}", 0) + frames
        tally["empty_clips"] = tally.get("empty_clips", 0) + (not len(kept.rows))
        n = len(kept.rows)
        parts.append(
            Motion(
                np.full(n, split),
                np.full(n, clip),
                kept.rows.astype(np.int32),
                kept.rows / rate,
                kept.heading,
                kept.x,
            )
        )
    motion = Motion(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    if not len(motion.x):
        raise ClipError(f"no frame of any clip is usable: {counts}")
    return motion, counts


def _clips(splits: np.ndarray, names: np.ndarray) -> Iterator[tuple[str, slice]]:
    """Each clip's name and its rows, which are consecutive; one name in two splits is two clips."""
    changes = (names[1:] != names[:-1]) | (splits[1:] != splits[:-1])
    starts = np.flatnonzero(np.r_[True, changes])
    for begin, end in zip(starts, np.r_[starts[1:], len(names)], strict=True):
        yield str(names[begin]), slice(int(begin), int(end))


def training_domain(
    points: dict[str, np.ndarray],
    neck: str,
    tilt_max: float,
    count: int,
    noise: float,
    rng: np.random.Generator,
) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Columns of table mocap_domain from the training clips alone, and rows of each kind.

    Args:
        points: columns of table mocap_points.
        neck, tilt_max, count, noise, rng: see domain.

    Raises:
        ClipError: there is no training clip.
    """
    train = points["split"] == "train"
    if not train.any():
        raise ClipError("there is no training clip; put some into the split 'train'")
    positions = points["points"][train].reshape(-1, len(POINTS), 3)
    made = domain(positions, neck, tilt_max, count, noise, rng)
    columns = {
        "row": np.arange(len(made.x), dtype=np.int32),
        "clip": points["clip"][train][made.origin],
        "kind": made.kind,
        "x": made.x,
    }
    return columns, {kind: int((made.kind == kind).sum()) for kind in ("raw", "mirrored", "noisy")}
