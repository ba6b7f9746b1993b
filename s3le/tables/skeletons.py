"""Table skeletons: the human motion as the method sees it."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import FRAME_KEY, Column, Table, at_least, unit_bones, vector

SKELETONS = Table(
    name="skeletons",
    stage="skeletons",
    grain="one frame of one clip at the common rate",
    key=("clip", "frame"),
    columns=FRAME_KEY
    | {
        "time": Column(pl.Float64(), "s", "time in the clip"),
        "heading": Column(pl.Float64(), "rad", "yaw that was taken out to face forward"),
        "x": Column(vector(DIM), "-", "seven unit vectors, x forward, y left, z up"),
    },
    rules={
        "known_split": pl.col("split").is_in(["train", "test", "heldout"]),
        "one_split_per_clip": pl.col("split").n_unique().over("clip") == 1,
        "time_is_a_number": at_least("time", 0.0),
        "unit_vectors": unit_bones("x"),
    },
    robot=False,
)
