"""Stage `sample`: the robot alone -> data/kinematic_pairs/, in shards (Sec. IV-C)."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say, shards_bar
from s3le.kernels.batch import PROJECTIONS
from s3le.robot.robot import Robot
from s3le.store import documents
from s3le.tuples.certified import projection_summary
from s3le.tuples.engine import run
from s3le.tuples.samplers import SAMPLERS
from s3le.tuples.shards import TupleShards

ROBOT = Path("data/robot")
OUT = Path("data/kinematic_pairs")
COUNTS = Path("data/counts/sample.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How far limits are relaxed, how many tuples are drawn, and where."""

    section: ClassVar[str] = "sample"
    alpha: float = knob("joint-limit relaxation [-]", at_least=0, at_most=10, shared=True)
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    projection: str = knob("how Proj_Q works", one_of=PROJECTIONS, shared=True)
    shard_rows: int = knob("rows of a shard", at_least=1, at_most=10_000_000, shared=True)
    executor: str = knob("who makes the shards", one_of=run.EXECUTORS, shared=True)
    workers: int = knob("local processes; 0: all", at_least=0, at_most=10_000, shared=True)
    ray_address: str = knob("of a Ray cluster", shared=True)
    sampler: str = knob("where relaxed poses are drawn from", one_of=SAMPLERS)
    rows: int = knob("tuples to draw", at_least=1, at_most=2_000_000_000)
    renormalise_mix: bool = knob("give the bones of x' unit length")


def main() -> None:
    """Draw relaxed poses, project them, mix their skeletons, certify, write."""
    params = read(Params)
    task = TupleShards(
        files=Robot.read(ROBOT).to_bytes(),
        sampler=params.sampler,
        alpha=params.alpha,
        renormalise_mix=params.renormalise_mix,
        seed=params.seed,
        shard_rows=params.shard_rows,
        projection=params.projection,
    )
    where = run.Where(
        executor=params.executor,
        workers=params.workers,
        ray_address=params.ray_address,
    )
    with shards_bar(params.rows, "kinematic pairs") as progress:
        counts = run.produce(task, params.rows, OUT, where, progress, say)
    documents.write_json(projection_summary(counts) | {"alpha": params.alpha}, COUNTS)


if __name__ == "__main__":
    launch(main, "sample")
