"""The same motion seen by several cameras at once: how nearly do they give the same robot motion?

    python benchmarks/cameras.py FOLDER [--tilts tilts.csv] [--visibility 0.1]

FOLDER holds videos that begin at the same moment and have the same rate. Each is estimated and
retargeted on its own; then every two are compared frame by frame, where both know the person, by
the mean cosine distance over seven bones (0.06 is 20 degrees on every bone), facing forward: of the
skeletons, and of the certified robots' own seven vectors. *shuffled* is what two unrelated frames
of these motions come to. --tilts names what is known of the cameras: a CSV with video, pitch,
roll [deg], pitch empty where it is to be estimated.
"""

import csv
import tempfile
from itertools import combinations
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from s3le.errors import ParameterError
from s3le.human.skeletons import read_frames
from s3le.kernels import batch
from s3le.retarget.stream import Retargeter
from s3le.skeleton import cosine_distance
from s3le.video import convert, process
from s3le.video.convert import Choices


class Side(NamedTuple):
    """One camera's view of the motion."""

    name: str
    frame: np.ndarray  # int (m,), those known
    human: np.ndarray  # (m, 21)
    robot: np.ndarray  # (m, 21)
    about: dict


def main(
    folder: Annotated[Path, typer.Argument(help="videos of one motion")],
    model: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    tilts: Annotated[Path | None, typer.Option(help="CSV: video, pitch, roll [deg]")] = None,
    visibility: Annotated[float, typer.Option(help="see s3le video")] = Choices.visibility,
) -> None:
    """Print the tables."""
    videos = sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() != ".csv")
    if len(videos) < 2:
        raise ParameterError(f"{folder}: {len(videos)} videos, at least two are compared")
    known = _tilts(tilts)
    retargeter = Retargeter.load(model)
    sides = []
    for path in videos:
        with process.Process(process.interpreter()) as estimator:
            looked = convert.look(path, estimator)
        pitch, roll = known.get(path.name, (None, 0.0))
        made = convert.skeletons(looked, Choices(pitch=pitch, roll=roll, visibility=visibility))
        sides.append(_side(path, made, retargeter))
        about = made.about
        print(
            f"{path.name}: {about['rows_by_status']}, camera down {about['choices']['pitch']:.1f} "
            f"roll {roll:.1f} deg, robot to skeleton "
            f"{cosine_distance(sides[-1].human, sides[-1].robot).mean():.4f}"
        )
    if len({round(side.about["choices"]["rate"], 3) for side in sides}) > 1:
        raise ParameterError(f"{folder}: the videos have different rates; frames cannot be paired")
    _table(sides)


def _tilts(path: Path | None) -> dict[str, tuple[float | None, float]]:
    if path is None:
        return {}
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {
        row["video"]: (float(row["pitch"]) if row["pitch"] else None, float(row["roll"] or 0.0))
        for row in rows
    }


def _side(path: Path, made: convert.Skeletons, retargeter: Retargeter) -> Side:
    with tempfile.TemporaryDirectory() as scratch:
        clip = Path(scratch) / f"{path.stem}.parquet"
        convert.write(made, clip)
        frames = read_frames(clip, retargeter.robot.neck)
    done = clip.convert(retargeter, frames).motion
    rows = np.searchsorted(done.time, frames.time - 1e-6)
    robot = batch.skeletons(retargeter.robot.chain, done.q[rows])
    return Side(path.name, frames.frame, frames.x, robot, made.about)


def _table(sides: list[Side]) -> None:
    print(f"{'':26}{'frames':>8}{'skeletons':>11}{'median':>8}{'robots':>9}{'median':>8}")
    means = []
    for a, b in combinations(sides, 2):
        _, i, j = np.intersect1d(a.frame, b.frame, return_indices=True)
        if not len(i):
            print(f"{a.name} {b.name}: no frame that both know")
            continue
        human = cosine_distance(a.human[i], b.human[j])
        robot = cosine_distance(a.robot[i], b.robot[j])
        means.append((human.mean(), np.median(human), robot.mean(), np.median(robot)))
        numbers = "".join(f"{v:{w}.4f}" for v, w in zip(means[-1], (11, 8, 9, 8), strict=True))
        print(f"{a.name + ' ' + b.name:26}{len(i):8}{numbers}")
    mean = np.mean(means, axis=0)
    numbers = "".join(f"{v:{w}.4f}" for v, w in zip(mean, (11, 8, 9, 8), strict=True))
    print(f"{'mean of pairs':26}{'':8}{numbers}")
    rng = np.random.default_rng(0)
    human, robot = (np.concatenate([getattr(s, k) for s in sides]) for k in ("human", "robot"))
    other = rng.permutation(len(human))
    far = [cosine_distance(x, x[other]).mean() for x in (human, robot)]
    print(f"{'shuffled':34}{far[0]:11.4f}{'':8}{far[1]:9.4f}")


if __name__ == "__main__":
    typer.run(main)
