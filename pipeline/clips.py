"""Stage `clips`: motion files, fetched if need be -> data/mocap_points.parquet."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read, say
from s3le.human import dataset
from s3le.human.tables import MOCAP_POINTS
from s3le.store import tables

CLIPS = Path("data/clips")
CACHE = Path("data/downloads")
OUT = Path("data/mocap_points.parquet")


@dataclass(frozen=True, kw_only=True)
class Params:
    """Which clips, and from where."""

    section: ClassVar[str] = "clips"
    clips: str = knob("demo, cmu, or a folder with train/ and test/", shared=True)
    clips_missing: str = knob("when one cannot be read", one_of=("stop", "skip"), shared=True)
    clips_mirror: str = knob("address or folder of CMU's files", shared=True)


def main() -> None:
    """Find the clips, read them all, write their joint positions."""
    params = read(Params)
    found = dataset.find(params.clips, CLIPS, CACHE, params.clips_mirror, params.clips_missing)
    for line in found.left_out:
        say(f"left out: {line}")
    with bar(len(found.clips), "reading clips", unit="clips", wait="") as progress:
        frames, lost = dataset.load(found, progress, params.clips_missing)
    for line in lost:
        say(f"left out: {line}")
    tables.write(frames._asdict(), MOCAP_POINTS, OUT)


if __name__ == "__main__":
    launch(main, "clips")
