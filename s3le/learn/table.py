"""Table index: the poses a method stores, with the latents that are searched."""

import polars as pl

from s3le.store.schema import Column, Table, certified, finite
from s3le.tuples.tables import pose, sound

POOLS = ("mocap_pairs", "robot_poses", "kinematic_pairs")


def index(n_dof: int, margin: float, latent: int) -> Table:
    """Contract of a method's stored poses and their latents."""
    return Table(
        name="index",
        stage="index",
        grain="one feasible pose of the method's pool and its latent",
        key=("row",),
        columns={
            "row": Column(pl.Int32(), "-", "number from 0; ties go to the lowest"),
            "source": Column(pl.String(), "-", "table that the pose comes from"),
            "source_row": Column(pl.Int32(), "-", "its row there"),
            "z": Column(pl.Array(pl.Float32, latent), "-", "latent that is searched"),
        }
        | pose(n_dof),
        rules=sound()
        | certified(margin)
        | {"latent_is_finite": finite("z"), "known_source": pl.col("source").is_in(POOLS)},
    )
