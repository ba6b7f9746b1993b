"""Stage `grid`: S3LE and LWL2 looked up in every pool by every metric -> reports/grid.csv."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, launch
from s3le import grid, machine, splits, store
from s3le.tables.ground_truth import ground_truth
from s3le.tables.index import index
from s3le.tables.skeletons import SKELETONS

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
    robot = machine.read(ROBOT)
    n_dof, margin = robot.robot.n_dof, robot.margin
    frames = store.read(SKELETONS, DATA / "skeletons.parquet")
    rows = splits.test_rows(frames)
    frames = {column: values[rows] for column, values in frames.items()}
    truth = store.read(ground_truth(n_dof, margin), DATA / "ground_truth.parquet", robot.tag)
    stored = {}
    for model, entry in STORED.items():
        path = DATA / f"index-{entry}.parquet"
        latent = int(store.read_note(path, "latent", f"index@{entry}"))
        stored[model] = store.read(index(n_dof, margin, latent), path, robot.tag)
    models = {name: DATA / f"model-{name}.safetensors" for name in STORED}
    with bar(len(grid.CELLS), "pools and metrics", unit="look-ups") as progress:
        found = grid.table(robot, frames, truth, stored, models, progress)
    store.write_csv(found, OUT)


if __name__ == "__main__":
    launch(main, "grid")
