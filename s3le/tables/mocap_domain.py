"""Table mocap_domain: human skeletons without a robot pose, to learn the human's latent space."""

import polars as pl

from s3le.skeleton import DIM
from s3le.tables.schema import Column, Table, unit_bones, vector

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
