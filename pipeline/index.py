"""Stage `index@ENTRY`: a model and its pool of feasible poses -> data/index-ENTRY.parquet."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read
from s3le.learn import methods, pool
from s3le.learn.table import index
from s3le.robot.robot import Robot
from s3le.search.metrics import LATENT_METRICS
from s3le.store import tables
from s3le.tuples.tables import kinematic_pairs, mocap_pairs, robot_poses

ROBOT = Path("data/robot")
DATA = Path("data")
TABLES = {
    "mocap_pairs": mocap_pairs,
    "robot_poses": robot_poses,
    "kinematic_pairs": kinematic_pairs,
}
PLACE = {  # one file, or a folder of shards
    "mocap_pairs": "mocap_pairs.parquet",
    "robot_poses": "robot_poses",
    "kinematic_pairs": "kinematic_pairs",
}


@dataclass(frozen=True, kw_only=True)
class Params:
    """How neighbours are measured; what is stored follows from the entry (learn/methods.py)."""

    section: ClassVar[str] = "index"
    metric_s3le: str = knob("distance between latents, d_Y of eq. (dlu)", one_of=LATENT_METRICS)
    metric_lwl2: str = knob("the same for LWL2", one_of=LATENT_METRICS)
    with_pairs: bool = knob("store the poses of the mocap pairs too")


def main(name: str) -> None:
    """Encode every pose of the entry's pool and store it with its latent."""
    params = read(Params)
    entry = methods.entry(name)
    names = pool.tables(name, params.with_pairs)
    robot = Robot.read(ROBOT)
    n_dof = robot.n_dof
    stored = {
        part: tables.read(
            TABLES[part](n_dof, robot.margin), DATA / PLACE[part], robot.tag, pool.columns(part)
        )
        for part in names
    }
    model = DATA / f"model-{entry.model}.safetensors" if entry.model else None
    columns, latent = pool.stored(robot, entry, stored, model)
    table = index(n_dof, robot.margin, latent)
    # Between skeletons L2 is it: its square is 14 times the mean cosine distance.
    metric = {"s3le": params.metric_s3le, "lwl2": params.metric_lwl2}.get(entry.model, "l2")
    note = {"metric": metric, "latent": str(latent)}
    tables.write(columns, table, DATA / f"index-{name}.parquet", robot.tag, note)


if __name__ == "__main__":
    launch(main, "index")
