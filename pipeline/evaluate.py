"""Stage `evaluate@ENTRY`: test frames retargeted -> data/retargeted-ENTRY.parquet, figures."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, launch
from s3le.human import splits
from s3le.human.tables import SKELETONS
from s3le.learn import methods
from s3le.learn.table import index
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.study import comparison
from s3le.study.tables import ground_truth, retargeted

ROBOT = Path("data/robot")
DATA = Path("data")
SKELETON_ROWS = Path("data/skeletons.parquet")
TRUTH = Path("data/ground_truth.parquet")
RETARGETER = Path("data/retargeter")
FIGURES = Path("data/counts")


@dataclass(frozen=True, kw_only=True)
class Params:
    """Nothing to choose: an index and a retargeter say themselves how they work."""

    section: ClassVar[str] = "evaluate"


def main(name: str) -> None:
    """Retarget every test frame with one entry; check and score every pose and every path."""
    entry = methods.entry(name)
    robot = Robot.read(ROBOT)
    n_dof = robot.n_dof
    frames = tables.read(SKELETONS, SKELETON_ROWS)
    truth = tables.read(ground_truth(n_dof, robot.margin), TRUTH, robot.tag)
    rows = splits.test_rows(frames)
    frames = {column: values[rows] for column, values in frames.items()}
    pool = metric = None
    if entry.pool:
        stored = DATA / f"index-{name}.parquet"
        stage = f"index@{name}"
        metric = tables.read_note(stored, "metric", stage)
        latent = int(tables.read_note(stored, "latent", stage))
        pool = tables.read(index(n_dof, robot.margin, latent), stored, robot.tag)
    model = DATA / f"model-{entry.model}.safetensors" if entry.model else None
    with bar(2 * len(rows), name) as progress:
        if entry.online:
            answered = comparison.followed(robot, name, RETARGETER, frames, progress)
        else:
            x = frames["x"]
            answered = comparison.stored(robot, entry, x, pool, model, metric, progress)
        columns, figures = comparison.judge(robot, name, entry, frames, truth, answered, progress)
    tables.write(columns, retargeted(n_dof), DATA / f"retargeted-{name}.parquet", robot.tag)
    documents.write_json(figures, FIGURES / f"evaluate-{name}.json")


if __name__ == "__main__":
    launch(main, "evaluate")
