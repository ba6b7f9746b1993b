"""Stage `poses`: the robot alone -> data/robot_poses.parquet, feasible poses without a partner."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le import machine, rng, sampling, store
from s3le.tables.robot_poses import robot_poses

ROBOT = Path("data/robot")
OUT = Path("data/robot_poses.parquet")
COUNTS = Path("data/counts/poses.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How many poses."""

    section: ClassVar[str] = "poses"
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    rows: int = knob("feasible poses to draw", at_least=1, at_most=2_000_000_000)


def main() -> None:
    """Draw feasible poses, certify, write."""
    params = read(Params)
    robot = machine.read(ROBOT)
    stream = rng.stream(params.seed, Params.section)
    with bar(2 * params.rows, "robot poses") as progress:
        columns, counts = sampling.robot_poses(robot, params.rows, stream, progress)
    store.write(columns, robot_poses(robot.robot.n_dof, robot.margin), OUT, robot.tag)
    store.write_json(counts, COUNTS)


if __name__ == "__main__":
    launch(main, "poses")
