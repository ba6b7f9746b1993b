"""Stage `poses`: the robot alone -> data/robot_poses/, feasible poses without a partner."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say, shards_bar
from s3le.robot.robot import Robot
from s3le.store import documents
from s3le.tuples.engine import run
from s3le.tuples.shards import PoseShards

ROBOT = Path("data/robot")
OUT = Path("data/robot_poses")
COUNTS = Path("data/counts/poses.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How many poses, and where they are made."""

    section: ClassVar[str] = "poses"
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    shard_rows: int = knob("rows of a shard", at_least=1, at_most=10_000_000, shared=True)
    executor: str = knob("who makes the shards", one_of=run.EXECUTORS, shared=True)
    workers: int = knob("local processes; 0: all", at_least=0, at_most=10_000, shared=True)
    ray_address: str = knob("of a Ray cluster", shared=True)
    rows: int = knob("feasible poses to draw", at_least=1, at_most=2_000_000_000)


def main() -> None:
    """Draw feasible poses, certify, write."""
    params = read(Params)
    task = PoseShards(
        files=Robot.read(ROBOT).to_bytes(), seed=params.seed, shard_rows=params.shard_rows
    )
    where = run.Where(
        executor=params.executor, workers=params.workers, ray_address=params.ray_address
    )
    with shards_bar(params.rows, "robot poses") as progress:
        counts = run.produce(task, params.rows, OUT, where, progress, say)
    share = counts["accepted"] / counts["drawn"]
    documents.write_json({"rows": counts["rows"], "accepted_share": share}, COUNTS)


if __name__ == "__main__":
    launch(main, "poses")
