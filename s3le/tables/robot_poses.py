"""Table robot_poses: the robot domain D_Y, feasible poses without a partner."""

import polars as pl

from s3le.tables.pose import pose, sound
from s3le.tables.schema import Column, Table, certified


def robot_poses(n_dof: int, margin: float) -> Table:
    """Contract of the feasible poses without correspondence, D_Y."""
    return Table(
        name="robot_poses",
        stage="poses",
        grain="one feasible pose, uniform over the feasible set",
        key=("row",),
        columns={"row": Column(pl.Int32(), "-", "number from 0")} | pose(n_dof),
        rules=sound() | certified(margin),
    )
