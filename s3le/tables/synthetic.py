"""Table synthetic: the maps that the synthetic example learns, point by point."""

import polars as pl

from s3le.tables.schema import Column, Table, finite, vector

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
