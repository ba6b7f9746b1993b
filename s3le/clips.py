"""Clips as rows: every source's files read into one array, in the order of the source."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import ClipError
from s3le.kernels.batch import Progress
from s3le.mocap import sources
from s3le.mocap.read import read_clip
from s3le.mocap.sources import Sources

BUILT_IN = ("demo", "cmu")


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
        FetchError, ClipError: see s3le.mocap.sources.
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
