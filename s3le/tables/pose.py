"""What every table of single poses shares."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import CERTIFICATE, Column, finite, unit_bones, vector


def pose(n_dof: int) -> dict[str, Column]:
    """Columns of a pose with its skeleton and its certificate."""
    return {
        "q": Column(vector(n_dof), "rad", "joint angles"),
        "x": Column(vector(DIM), "-", "FK(q)"),
    } | CERTIFICATE


def sound() -> dict[str, pl.Expr]:
    """Rules of any pose, feasible or not."""
    return {"pose_is_finite": finite("q"), "unit_vectors": unit_bones("x")}
