"""Tables of robot poses and of tuples (x~, x-bar, q~, q-bar), and what they share."""

import polars as pl

from s3le.skeleton import DIM
from s3le.store.schema import (
    CERTIFICATE,
    Column,
    Table,
    at_least,
    certified,
    finite,
    unit_bones,
    vector,
)


def pose(n_dof: int) -> dict[str, Column]:
    """Columns of a pose with its skeleton and its certificate."""
    return {
        "q": Column(vector(n_dof), "rad", "joint angles"),
        "x": Column(vector(DIM), "-", "FK(q)"),
    } | CERTIFICATE


def sound() -> dict[str, pl.Expr]:
    """Rules of any pose, feasible or not."""
    return {"pose_is_finite": finite("q"), "unit_vectors": unit_bones("x")}


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
