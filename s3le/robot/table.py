"""Table robot_pairs: which pairs of bodies are watched, and why the others are not."""

import polars as pl

from s3le.store.schema import Column, Table

ROBOT_PAIRS = Table(
    name="robot_pairs",
    stage="robot",
    grain="one pair of the robot's bodies",
    key=("body_a", "body_b"),
    columns={
        "body_a": Column(pl.String(), "-", "first body"),
        "body_b": Column(pl.String(), "-", "second body"),
        "kind": Column(pl.String(), "-", "what they are, e.g. limb-trunk"),
        "watched": Column(pl.Boolean(), "-", "whether the pair counts for clearance"),
        "reason": Column(pl.String(), "-", "why it is watched or not"),
        "anchor_clearance": Column(pl.Float64(), "m", "signed distance at the anchor pose"),
    },
    rules={"measured": pl.col("anchor_clearance").is_finite()},
)
