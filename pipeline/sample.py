"""Stage `sample`: the robot alone -> data/kinematic_pairs.parquet (Sec. IV-C)."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le import machine, rng, sampling, store
from s3le.tables.kinematic_pairs import kinematic_pairs

ROBOT = Path("data/robot")
OUT = Path("data/kinematic_pairs.parquet")
COUNTS = Path("data/counts/sample.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How far limits are relaxed, and how many tuples are drawn."""

    section: ClassVar[str] = "sample"
    alpha: float = knob("joint-limit relaxation [-]", at_least=0, at_most=10, shared=True)
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    rows: int = knob("tuples to draw", at_least=1, at_most=2_000_000_000)
    renormalise_mix: bool = knob("give the bones of x' unit length")


def main() -> None:
    """Draw relaxed poses, project them, mix their skeletons, certify, write."""
    params = read(Params)
    robot = machine.read(ROBOT)
    stream = rng.stream(params.seed, Params.section)
    with bar(2 * params.rows, "kinematic pairs") as progress:
        columns, counts = sampling.kinematic_pairs(
            robot, params.rows, params.alpha, params.renormalise_mix, stream, progress
        )
    table = kinematic_pairs(robot.robot.n_dof, robot.margin)
    store.write(columns, table, OUT, robot.tag)
    store.write_json(counts, COUNTS)


if __name__ == "__main__":
    launch(main, "sample")
