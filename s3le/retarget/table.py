"""Table stored_poses: what a retargeter looks up, no more than it needs."""

import polars as pl

from s3le.store.schema import CERTIFICATE, Column, Table, certified, finite, vector


def stored_poses(n_dof: int, margin: float) -> Table:
    """Contract of an exported retargeter's poses."""
    return Table(
        name="stored_poses",
        stage="export",
        grain="one feasible pose that can be found",
        key=("row",),
        columns={
            "row": Column(pl.Int32(), "-", "number from 0; that of the index it was taken from"),
            "q": Column(vector(n_dof), "rad", "joint angles"),
        }
        | CERTIFICATE,
        rules={"pose_is_finite": finite("q")} | certified(margin),
    )
