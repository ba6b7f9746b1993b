"""Stage `coverage`: how near each sampler's poses come to people -> reports/coverage.csv."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le.human.tables import SKELETONS
from s3le.kernels.batch import PROJECTIONS
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.study import coverage
from s3le.tuples.samplers import SAMPLERS
from s3le.tuples.tables import mocap_pairs

ROBOT = Path("data/robot")
DATA = Path("data")
OUT = Path("reports/coverage.csv")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How many poses are compared."""

    section: ClassVar[str] = "coverage"
    alpha: float = knob("joint-limit relaxation [-]", at_least=0, at_most=10, shared=True)
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    projection: str = knob("how Proj_Q works", one_of=PROJECTIONS, shared=True)
    rows: int = knob("poses of each sampler", at_least=1, at_most=2_000_000)


def main() -> None:
    """Draw poses with every sampler and measure them against people none of them has seen."""
    params = read(Params)
    robot = Robot.read(ROBOT)
    table = mocap_pairs(robot.n_dof, robot.margin)
    pairs = tables.read(table, DATA / "mocap_pairs.parquet", robot.tag, ["x_feasible"])
    frames = tables.read(SKELETONS, DATA / "skeletons.parquet")
    with bar(2 * len(SAMPLERS) * params.rows, "coverage") as progress:
        rows = coverage.table(
            robot,
            frames,
            pairs["x_feasible"],
            params.rows,
            params.alpha,
            params.seed,
            progress,
            params.projection,
        )
    documents.write_csv(rows, OUT)


if __name__ == "__main__":
    launch(main, "coverage")
