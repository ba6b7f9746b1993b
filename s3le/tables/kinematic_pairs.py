"""Table kinematic_pairs: tuples that come from the robot alone (Sec. IV-C)."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import Column, Table, finite, vector
from s3le.tables.tuples import columns, rules


def kinematic_pairs(n_dof: int, margin: float) -> Table:
    """Contract of the tuples that come from the robot alone (Sec. IV-C)."""
    return Table(
        name="kinematic_pairs",
        stage="sample",
        grain="one relaxed pose of the robot, its projection and its mixed skeleton",
        key=("row",),
        columns={
            "row": Column(pl.Int32(), "-", "number from 0"),
            "mix": Column(pl.Float64(), "-", "share of x~ in x', uniform in [0, 1]"),
            "x_mixed": Column(vector(DIM), "-", "x' = mix x~ + (1 - mix) x-bar"),
        }
        | columns(n_dof, "x~ = FK(q~)"),
        rules=rules(margin)
        | {
            "mix_is_a_share": pl.col("mix").is_between(0.0, 1.0) & pl.col("mix").is_finite(),
            "mixed_skeleton_is_finite": finite("x_mixed"),
        },
    )
