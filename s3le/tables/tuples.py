"""What both tables of tuples (x~, x-bar, q~, q-bar) share."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import (
    CERTIFICATE,
    Column,
    certified,
    finite,
    unit_bones,
    vector,
)

HOW = ["feasible already", "solved", "fallback"]  # in the order of kernels.batch's codes


def columns(n_dof: int, x_relaxed: str) -> dict[str, Column]:
    """Columns of a tuple; x_relaxed says where x~ comes from."""
    return {
        "x_relaxed": Column(vector(DIM), "-", x_relaxed),
        "x_feasible": Column(vector(DIM), "-", "x-bar = FK(q-bar)"),
        "q_relaxed": Column(vector(n_dof), "rad", "q~, may break limits or collide"),
        "q_feasible": Column(vector(n_dof), "rad", "q-bar = Proj_Q(q~)"),
        "projection": Column(pl.String(), "-", "how Proj_Q came about: " + ", ".join(HOW)),
    } | CERTIFICATE


def rules(margin: float) -> dict[str, pl.Expr]:
    """Rules of a tuple whose feasible pose keeps margin [m]."""
    return certified(margin) | {
        "relaxed_pose_is_finite": finite("q_relaxed"),
        "feasible_pose_is_finite": finite("q_feasible"),
        "relaxed_unit_vectors": unit_bones("x_relaxed"),
        "feasible_unit_vectors": unit_bones("x_feasible"),
        "known_projection": pl.col("projection").is_in(HOW),
    }
