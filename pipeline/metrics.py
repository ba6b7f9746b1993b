"""Stage `metrics`: every stage's figures -> reports/metrics.json and run.json, two tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say
from s3le.learn.methods import ENTRIES, label
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.study import metrics
from s3le.study.tables import ground_truth

ROBOT = Path("data/robot")
COUNTS = Path("data/counts")
TRUTH = Path("data/ground_truth.parquet")
OUT = Path("reports/metrics.json")  # the few that runs are compared by
RUN = Path("reports/run.json")  # all of them
COVERAGE = Path("reports/coverage.csv")
METHODS = Path("reports/methods.csv")
MOTIONS = Path("reports/motions.csv")


@dataclass(frozen=True, kw_only=True)
class Params:
    """What the run is called by."""

    section: ClassVar[str] = "metrics"
    clips: str = knob("which clips", shared=True)


def main() -> None:
    """Merge what the stages counted into one tree of metrics and one row a motion."""
    params = read(Params)
    robot = Robot.read(ROBOT)
    stages = ("skeletons", "pair", "sample", "poses")
    tree, table, motions = metrics.merge(
        robot,
        params.clips,
        {stage: documents.read_json(COUNTS / f"{stage}.json", stage) for stage in stages},
        tables.read(ground_truth(robot.n_dof, robot.margin), TRUTH, robot.tag),
        {e: documents.read_json(COUNTS / f"evaluate-{e}.json", f"evaluate@{e}") for e in ENTRIES},
        documents.read_csv(COVERAGE, "coverage"),
        documents.read_json(COUNTS / "synthetic.json", "synthetic"),
    )
    documents.write_json(tree, RUN)
    documents.write_json(metrics.compared(tree), OUT)
    documents.write_csv(table, METHODS)
    documents.write_csv(motions, MOTIONS)
    for split, part in tree["splits"].items():
        say(f"{split}: mean cosine distance to the ground truth, collisions")
        for name, found in part["methods"].items():
            words = label(name, found["proposed_by"])
            say(f"  {words:42s} {found['to_truth']:.4f}  {found['collision_rate']:6.1%}")


if __name__ == "__main__":
    launch(main, "metrics")
