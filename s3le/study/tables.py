"""Tables of the comparison: the ground truth, what each method answers, the synthetic example."""

import polars as pl

from s3le.store.schema import FRAME_KEY, Column, Table, at_least, certified, finite, vector
from s3le.tuples.tables import pose, sound


def ground_truth(n_dof: int, margin: float) -> Table:
    """Contract of the best pose that optimisation finds for each test frame."""
    return Table(
        name="ground_truth",
        stage="truth",
        grain="one test frame and the feasible pose nearest to it",
        key=("clip", "frame"),
        columns=FRAME_KEY
        | {"to_human": Column(pl.Float64(), "-", "mean cosine distance to the human")}
        | pose(n_dof),
        rules=sound() | certified(margin) | {"solved": at_least("to_human", 0.0)},
    )


MODES = (
    "decoded", "start", "refined", "lookup", "planned", "limited", "shortened", "detour", "braked",
    "held", "halted", "lead_in", "dropped",
)  # fmt: skip


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
            "row": Column(pl.Int32(), "-", "row of the index that answers; -1 where none does"),
            "mode": Column(pl.String(), "-", "lookup, decoded, or how a stream came to it"),
            "to_truth": Column(pl.Float64(), "-", "mean cosine distance to the ground truth"),
            "to_human": Column(pl.Float64(), "-", "mean cosine distance to the human"),
        }
        | pose(n_dof),
        rules=sound()
        | {
            "known_mode": pl.col("mode").is_in(MODES),
            "measured": at_least("to_truth", 0.0) & at_least("to_human", 0.0),
            "checked": pl.col("clearance").is_finite() & pl.col("limit_margin").is_finite(),
        },
    )


SYNTHETIC = Table(
    name="synthetic",
    stage="synthetic",
    grain="one point of Relaxed X under the map learnt with, or without, NT-Xent",
    key=("nt_xent", "row"),
    columns={
        "nt_xent": Column(pl.Boolean(), "-", "trained with NT-Xent"),
        "row": Column(pl.Int32(), "-", "number from 0"),
        "kind": Column(pl.String(), "-", "grid: to measure with; glue: of a pair trained on"),
        "x": Column(vector(2), "-", "the point of Relaxed X"),
        "x_true": Column(vector(2), "-", "Proj_X(x), in Feasible X"),
        "y_true": Column(vector(2), "-", "the y of Proj_X(x): what the map should answer"),
        "x_answer": Column(vector(2), "-", "the point of Feasible X that the answer belongs to"),
        "y_answer": Column(vector(2), "-", "what the map answers: a stored y"),
    },
    rules={
        "known_kind": pl.col("kind").is_in(["grid", "glue"]),
        **{
            f"{name}_is_finite": finite(name)
            for name in ("x", "x_true", "y_true", "x_answer", "y_answer")
        },
    },
    robot=False,
)
