"""Table mocap_points: what the clips say, in one frame of reference, at their own rate."""

import polars as pl

from s3le.skeleton import POINTS
from s3le.tables.schema import FRAME_KEY, Column, Table, at_least, vector

MOCAP_POINTS = Table(
    name="mocap_points",
    stage="clips",
    grain="one frame of one clip at the clip's own rate",
    key=("clip", "frame"),
    columns=FRAME_KEY
    | {
        "fps": Column(pl.Float64(), "Hz", "the clip's own rate"),
        "points": Column(
            vector(3 * len(POINTS)),
            "m",
            "joint positions, x forward, y left, z up: "
            + ", ".join(POINTS)
            + "; NaN where unknown",
        ),
    },
    rules={
        "known_split": pl.col("split").is_in(["train", "test", "heldout"]),
        "one_split_per_clip": pl.col("split").n_unique().over("clip") == 1,
        "has_a_rate": at_least("fps", 1e-3),
    },
    robot=False,
)
