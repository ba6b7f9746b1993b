"""Tables of single feasible poses: robot-domain samples, ground truth, index, retargeted motion."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import (
    CERTIFICATE,
    FRAME_KEY,
    Column,
    Table,
    at_least,
    certified,
    finite,
    unit_bones,
    vector,
)

POOLS = ("mocap_pairs", "robot_poses", "kinematic_pairs")


def _pose(n_dof: int) -> dict[str, Column]:
    return {
        "q": Column(vector(n_dof), "rad", "joint angles"),
        "x": Column(vector(DIM), "-", "FK(q)"),
    } | CERTIFICATE


def _sound() -> dict[str, pl.Expr]:
    return {"pose_is_finite": finite("q"), "unit_vectors": unit_bones("x")}


def robot_poses(n_dof: int, margin: float) -> Table:
    """Contract of the feasible poses without correspondence, D_Y."""
    return Table(
        name="robot_poses",
        stage="poses",
        grain="one feasible pose, uniform over the feasible set",
        key=("row",),
        columns={"row": Column(pl.Int32(), "-", "number from 0")} | _pose(n_dof),
        rules=_sound() | certified(margin),
    )


def ground_truth(n_dof: int, margin: float) -> Table:
    """Contract of the best pose that optimisation finds for each test frame."""
    return Table(
        name="ground_truth",
        stage="truth",
        grain="one test frame and the feasible pose nearest to it",
        key=("clip", "frame"),
        columns=FRAME_KEY
        | {"to_human": Column(pl.Float64(), "-", "mean cosine distance to the human")}
        | _pose(n_dof),
        rules=_sound() | certified(margin) | {"solved": at_least("to_human", 0.0)},
    )


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
        | _pose(n_dof),
        rules=_sound()
        | certified(margin)
        | {"latent_is_finite": finite("z"), "known_source": pl.col("source").is_in(POOLS)},
    )


def retargeted(n_dof: int) -> Table:
    """Contract of what a method returns; not certified, for the baseline ALE decodes freely."""
    return Table(
        name="retargeted",
        stage="evaluate",
        grain="one test frame under one method",
        key=("method", "clip", "frame"),
        columns={"method": Column(pl.String(), "-", "entry of the comparison")}
        | FRAME_KEY
        | {
            "time": Column(pl.Float64(), "s", "time in the clip"),
            "row": Column(pl.Int32(), "-", "row of the index; -1 where nothing is looked up"),
            "to_truth": Column(pl.Float64(), "-", "mean cosine distance to the ground truth"),
            "to_human": Column(pl.Float64(), "-", "mean cosine distance to the human"),
        }
        | _pose(n_dof),
        rules=_sound()
        | {
            "measured": at_least("to_truth", 0.0) & at_least("to_human", 0.0),
            "checked": pl.col("clearance").is_finite() & pl.col("limit_margin").is_finite(),
        },
    )
