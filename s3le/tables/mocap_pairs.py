"""Table mocap_pairs: tuples that inverse kinematics makes from human frames (Sec. IV-B)."""

import polars as pl

from s3le.tables.schema import Column, Table, at_least
from s3le.tables.tuples import columns, rules


def mocap_pairs(n_dof: int, margin: float) -> Table:
    """Contract of the tuples that inverse kinematics makes from human frames (Sec. IV-B)."""
    return Table(
        name="mocap_pairs",
        stage="pair",
        grain="one human frame of a training clip with its relaxed and feasible pose",
        key=("clip", "frame"),
        columns={
            "clip": Column(pl.String(), "-", "training clip"),
            "frame": Column(pl.Int32(), "-", "frame in table skeletons"),
            "residual": Column(pl.Float64(), "-", "mean cosine distance between x~ and FK(q~)"),
        }
        | columns(n_dof, "x~, the human skeleton"),
        rules=rules(margin) | {"solved": at_least("residual", 0.0)},
    )
