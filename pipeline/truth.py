"""Stage `truth`: test frames -> data/ground_truth.parquet, the best pose optimisation finds."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le import rng
from s3le.human import splits
from s3le.human.tables import SKELETONS
from s3le.robot.robot import Robot
from s3le.store import tables
from s3le.study import truth
from s3le.study.tables import ground_truth

ROBOT = Path("data/robot")
SKELETON_ROWS = Path("data/skeletons.parquet")
OUT = Path("data/ground_truth.parquet")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How hard to search."""

    section: ClassVar[str] = "truth"
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    starts: int = knob("starts of each solve", at_least=2, at_most=1000)
    ridge: float = knob("pull towards mid-range [-]", at_least=1e-9, at_most=1)


def main() -> None:
    """Retarget every test frame with limits and collisions, from several starts."""
    params = read(Params)
    robot = Robot.read(ROBOT)
    frames = tables.read(SKELETONS, SKELETON_ROWS)
    stream = rng.stream(params.seed, Params.section)
    with bar(2 * len(splits.test_rows(frames)), "ground truth") as progress:
        columns = truth.ground_truth(robot, frames, params.starts, params.ridge, stream, progress)
    tables.write(columns, ground_truth(robot.n_dof, robot.margin), OUT, robot.tag)


if __name__ == "__main__":
    launch(main, "truth")
