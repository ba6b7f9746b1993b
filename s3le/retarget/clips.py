"""Table retarget: what became of each clip of a data set, and all of them in one line."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from s3le.retarget.rows import Mode
from s3le.store import sidecar, tables
from s3le.store.schema import Column, Table, at_least

CERTIFIED, FORCED, REFUSED, UNREADABLE = "certified", "forced", "refused", "unreadable"
LIMITED = (  # the robot is not where the human has it
    Mode.PLANNED, Mode.LIMITED, Mode.SHORTENED, Mode.DETOUR, Mode.BRAKED, Mode.HELD, Mode.HALTED,
)  # fmt: skip
_GOOD = pl.col("status") == CERTIFIED


class Record(NamedTuple):
    """What became of one clip."""

    path: Path  # as given
    file: str  # the same, from the folder of results
    status: str  # CERTIFIED; FORCED: but for steps for which given joints leave no way;
    # REFUSED: no motion was found that holds; UNREADABLE
    kept: bool  # an earlier run had made it
    summary: dict[str, Any]  # see outputs.write; empty where there is none
    why: str  # there is none, or steps of it are forced; else empty
    notes: tuple[str, ...] = ()  # what was assumed of the clip, for people


def retarget(between: float) -> Table:
    """Contract of the table.

    Args:
        between: clearance that is proven of every path [m], and the least of a row on one.
    """
    return Table(
        name="retarget",
        stage="dataset",
        grain="one clip",
        key=("file",),
        columns={
            "file": Column(pl.String(), "-", "the clip, from the folder of results"),
            "status": Column(pl.String(), "-", "certified, forced, refused or unreadable"),
            "why": Column(pl.String(), "-", "there is no result, or it is forced; else empty"),
            "frames": Column(pl.Int64(), "-", "of the clip"),
            "dropped": Column(pl.Int64(), "-", "frames that could not be used"),
            "rows": Column(pl.Int64(), "-", "poses of the result"),
            "seconds": Column(pl.Float64(), "s", "length of the result"),
            "mean": Column(pl.Float64(), "-", "mean cosine distance to the human, over frames"),
            "p95": Column(pl.Float64(), "-", "the same, 95th percentile"),
            "largest": Column(pl.Float64(), "-", "the same, largest"),
            "limited": Column(
                pl.Int64(), "-", "frames that limits in time or other bodies kept from it"
            ),
            "clearance": Column(pl.Float64(), "m", "least of a pose of the result, by coal"),
            "bound": Column(pl.Float64(), "m", "proven of all its paths; null: it has none"),
            "milliseconds": Column(pl.Float64(), "ms", "a frame took in the mean"),
            "input_sha256": Column(pl.String(), "-", "of all that the clip is read from"),
            "output_sha256": Column(pl.String(), "-", "of the result's Parquet file"),
        },
        rules={
            "a_result_keeps_its_clearance": ~_GOOD | at_least("clearance", between),
            "its_paths_are_proven": ~_GOOD | (pl.col("rows") < 2) | at_least("bound", between),
            "what_is_missing_has_a_reason": _GOOD | (pl.col("why") != ""),
        },
    )


def write(records: Sequence[Record], between: float, robot: str, path: Path) -> None:
    """Write the table.

    Args:
        records: in the order of the rows.
        between: see retarget.
        robot: tag of the robot (Robot.tag).
        path: where.

    Raises:
        TableError: a record breaks the contract.
    """
    table = retarget(between)
    schema = {name: column.dtype for name, column in table.columns.items()}
    frame = pl.DataFrame([row(record) for record in records], schema=schema, orient="row")
    tables.write(frame, table, path, robot)


def row(record: Record) -> dict[str, Any]:
    """One row of the table; what is not known is null.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: the summary is not whole.
    """
    made: dict[str, Any] = {"file": record.file, "status": record.status, "why": record.why}
    said = record.summary
    if not said:
        return made
    modes, held = said["modes"], said[sidecar.OUTPUT]
    return made | {
        "frames": int(said["frames"]["clip"]),
        "dropped": sum(said["frames"]["dropped"].values()),
        "rows": int(said["rows"]["written"]),
        "seconds": float(said["rows"]["seconds"]),
        **{name: float(said["to_human"][name]) for name in ("mean", "p95", "largest")},
        "limited": sum(modes.get(mode, 0) for mode in LIMITED),
        "clearance": float(said["clearance_m"]["least"]),
        "bound": said["certified"]["proven_bound_m"],
        "milliseconds": float(said["milliseconds_per_frame"]["mean"]),
        "input_sha256": said[sidecar.INPUT],
        "output_sha256": held[f"{said['clip']}.parquet"],
    }


def total(records: Sequence[Record]) -> str:
    """All clips in one line."""
    rows = [row(record) for record in records if record.summary]
    poses, frames = (sum(each[name] for each in rows) for name in ("rows", "frames"))
    words = [f"{len(records)} clips, {frames} frames, {poses} poses certified"]
    if rows:
        used = [each["frames"] - each["dropped"] for each in rows]
        mean = sum(n * each["mean"] for n, each in zip(used, rows, strict=True)) / sum(used)
        least = min(each["clearance"] for each in rows)
        limited = sum(each["limited"] for each in rows)
        words += [
            f"{sum(each['seconds'] for each in rows):.1f} s",
            f"to the human {mean:.4f} (largest {max(each['largest'] for each in rows):.4f})",
            f"clearance at least {least * 1e3:.2f} mm",
            f"{100 * limited / sum(used):.1f} % limited",
        ]
    counts = {
        "frames dropped": sum(each["dropped"] for each in rows),
        "kept": sum(record.kept for record in records),
        **{
            status: sum(record.status == status for record in records)
            for status in (FORCED, REFUSED, UNREADABLE)
        },
    }
    return ", ".join([*words, *(f"{count} {what}" for what, count in counts.items() if count)])
