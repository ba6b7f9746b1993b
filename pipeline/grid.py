"""Stage `grid`: S3LE and LWL2 looked up in every pool by every metric -> reports/grid.csv."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, launch
from s3le.human import splits
from s3le.human.tables import SKELETONS
from s3le.learn.table import index
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.study import grid
from s3le.study.tables import ground_truth

ROBOT = Path("data/robot")
DATA = Path("data")
OUT = Path("reports/grid.csv")
STORED = {"lwl2": "lwl2_all", "s3le": "s3le"}  # whose index holds the largest pool


@dataclass(frozen=True, kw_only=True)
class Params:
    """Nothing to choose: every pool and every metric is tried."""

    section: ClassVar[str] = "grid"


def main() -> None:
    """Look every test frame up in each pool by each metric."""
    robot = Robot.read(ROBOT)
    n_dof, margin = robot.n_dof, robot.margin
    frames = tables.read(SKELETONS, DATA / "skeletons.parquet")
    rows = splits.test_rows(frames)
    frames = {column: values[rows] for column, values in frames.items()}
    truth = tables.read(ground_truth(n_dof, margin), DATA / "ground_truth.parquet", robot.tag)
    stored = {}
    for model, entry in STORED.items():
        path = DATA / f"index-{entry}.parquet"
        latent = int(tables.read_note(path, "latent", f"index@{entry}"))
        stored[model] = tables.read(index(n_dof, margin, latent), path, robot.tag)
    models = {name: DATA / f"model-{name}.safetensors" for name in STORED}
    with bar(len(grid.CELLS), "pools and metrics", unit="look-ups") as progress:
        found = grid.table(robot, frames, truth, stored, models, progress)
    documents.write_csv(found, OUT)


if __name__ == "__main__":
    launch(main, "grid")
