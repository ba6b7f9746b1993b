"""Tables of human motion: what the clips say, what the method sees, what it learns from."""

import polars as pl

from s3le.skeleton import DIM, POINTS
from s3le.store.schema import FRAME_KEY, Column, Table, at_least, unit_bones, vector

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

MOCAP_DOMAIN = Table(
    name="mocap_domain",
    stage="skeletons",
    grain="one human skeleton of a training clip, as recorded or augmented",
    key=("row",),
    columns={
        "row": Column(pl.Int32(), "-", "number from 0"),
        "clip": Column(pl.String(), "-", "training clip it comes from"),
        "kind": Column(pl.String(), "-", "raw, mirrored or noisy"),
        "x": Column(vector(DIM), "-", "seven unit vectors"),
    },
    rules={
        "known_kind": pl.col("kind").is_in(["raw", "mirrored", "noisy"]),
        "unit_vectors": unit_bones("x"),
    },
    robot=False,
)
