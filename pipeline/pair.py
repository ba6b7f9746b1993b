"""Stage `pair`: training frames -> data/mocap_pairs.parquet, by inverse kinematics (Sec. IV-B)."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le.human import splits
from s3le.human.tables import SKELETONS
from s3le.kernels.batch import PROJECTIONS
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.tuples import pairing
from s3le.tuples.tables import mocap_pairs

ROBOT = Path("data/robot")
SKELETON_ROWS = Path("data/skeletons.parquet")
OUT = Path("data/mocap_pairs.parquet")
COUNTS = Path("data/counts/pair.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How many tuples, and how the pose is settled."""

    section: ClassVar[str] = "pair"
    projection: str = knob("how Proj_Q works", one_of=PROJECTIONS, shared=True)
    rows: int = knob("tuples to make", at_least=1)
    ridge: float = knob("pull towards mid-range [-]", at_least=1e-9, at_most=1)


def main() -> None:
    """Retarget training frames without limits and collisions, then project."""
    params = read(Params)
    robot = Robot.read(ROBOT)
    frames = tables.read(SKELETONS, SKELETON_ROWS)
    count = len(splits.train_rows(frames, params.rows))
    with bar(2 * count, "mocap pairs") as progress:
        columns, counts = pairing.pair(
            robot, frames, count, params.ridge, progress, params.projection
        )
    table = mocap_pairs(robot.n_dof, robot.margin)
    tables.write(columns, table, OUT, robot.tag)
    documents.write_json(counts, COUNTS)


if __name__ == "__main__":
    launch(main, "pair")
