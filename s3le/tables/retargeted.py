"""Table retargeted: what a method makes of the test clips."""

import polars as pl

from s3le.tables.pose import pose, sound
from s3le.tables.schema import FRAME_KEY, Column, Table, at_least

# How a row was obtained: by a decoder, or as s3le.retarget.mode says it.
MODES = (
    "decoded", "start", "refined", "lookup", "limited", "shortened", "detour", "held", "lead_in",
    "dropped", "eased",
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
