"""Table ground_truth: what optimisation can do for each test frame."""

import polars as pl

from s3le.tables.pose import pose, sound
from s3le.tables.schema import FRAME_KEY, Column, Table, at_least, certified


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
