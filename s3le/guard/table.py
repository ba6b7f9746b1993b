"""Tables guard and motions: what became of each file of a data set, and what came of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

from s3le.guard.folder import CERTIFIED, MADE, Record
from s3le.store import tables
from s3le.store.schema import CERTIFICATE, Column, Table, certified, finite, vector

KINDS = ("limits", "velocities", "accelerations", "stops", "poses", "paths")
_GOOD = pl.col("status").is_in([CERTIFIED, MADE])


def guard(margin: float) -> Table:
    """Contract of the table.

    Args:
        margin: clearance that is claimed of every pose [m].
    """
    broken = {
        f"broken_{kind}": Column(
            pl.Int64(),
            "-",
            "rows without a proven way to rest; null: not asked"
            if kind == "stops"
            else f"{kind} that did not hold in the file as it was",
        )
        for kind in KINDS
    }
    return Table(
        name="guard",
        stage="dataset",
        grain="one motion file, or folder that is one",
        key=("file",),
        columns={
            "file": Column(pl.String(), "-", "path below what was given"),
            "status": Column(
                pl.String(),
                "-",
                "certified (already), made certified, forced, refused or unreadable",
            ),
            "why": Column(pl.String(), "-", "there is no result, or steps are forced"),
            "episodes": Column(pl.Int64(), "-", "motions in the file"),
            "frames": Column(pl.Int64(), "-", "rows of all its motions"),
            "seconds": Column(pl.Float64(), "s", "length of all its motions"),
            **broken,
            "touched": Column(pl.Float64(), "-", "share of rows with an angle that is another"),
            "moved": Column(pl.Float64(), "-", "share of rows with a joint over 0.05 deg off"),
            "median_deg": Column(pl.Float64(), "deg", "over those rows, of the joint farthest off"),
            "p95_deg": Column(pl.Float64(), "deg", "the same, 95th percentile"),
            "most_deg": Column(pl.Float64(), "deg", "the same, most"),
            "joint": Column(pl.String(), "-", "that moved farthest; empty: none did"),
            "left_broken": Column(pl.Int64(), "-", "of all kinds, in the result"),
            "clearance": Column(pl.Float64(), "m", "least of a pose of the result, by coal"),
            "bound": Column(pl.Float64(), "m", "proven of all its paths; null: it has none"),
            "input_sha256": Column(pl.String(), "-", "of the file"),
            "output_sha256": Column(pl.String(), "-", "of the result"),
        },
        rules={
            "a_result_is_whole": ~_GOOD | (pl.col("left_broken") == 0),
            "a_result_keeps_its_margin": ~_GOOD | (pl.col("clearance") >= margin),
            "what_is_missing_has_a_reason": _GOOD | (pl.col("why") != ""),
        },
    )


def motions(n_dof: int, margin: float) -> Table:
    """Contract of a data set of motions.

    Args:
        n_dof: moving joints of the robot.
        margin: clearance that every pose keeps [m].
    """
    return Table(
        name="motions",
        stage="dataset",
        grain="one row of a certified motion",
        key=("file", "episode", "row"),
        columns={
            "file": Column(pl.String(), "-", "where the motion comes from, as in table guard"),
            "episode": Column(pl.Int32(), "-", "number of the motion in its file, from 0"),
            "row": Column(pl.Int32(), "-", "number in its motion, from 0"),
            "time": Column(pl.Float64(), "s", "in its motion"),
            "q": Column(vector(n_dof), "rad", "joint angles; note `joints` has their names"),
        }
        | CERTIFICATE,
        rules={"pose_is_finite": finite("q")} | certified(margin),
    )


def write(records: Sequence[Record], margin: float, robot: str, path: Path) -> None:
    """Write the table of records that are no mere looks.

    Args:
        records: in the order of the rows.
        margin: see guard.
        robot: tag of the robot (Robot.tag).
        path: where.

    Raises:
        TableError: a record breaks the contract.
    """
    table = guard(margin)
    schema = {name: column.dtype for name, column in table.columns.items()}
    frame = pl.DataFrame([row(record) for record in records], schema=schema, orient="row")
    tables.write(frame, table, path, robot)


def broken(checks: dict[str, Any]) -> dict[str, int]:
    """How many of each kind did not hold."""
    return {kind: checks[kind]["broken"] for kind in KINDS if kind in checks}


def row(record: Record) -> dict[str, Any]:
    """One row of the table; what is not known is null."""
    made: dict[str, Any] = {
        "file": record.piece.name, "status": record.status, "why": record.why,
    }  # fmt: skip
    said = record.summary
    if not said:
        return made
    moved, joints = said["moved"], said["moved"]["joints"]
    return made | {
        "episodes": said["episodes"],
        "frames": said["frames"],
        "seconds": said["seconds"],
        **{f"broken_{kind}": count for kind, count in broken(said["before"]).items()},
        "touched": moved["touched"] / moved["frames"],
        "moved": moved["moved"] / moved["frames"],
        "median_deg": moved["median_deg"],
        "p95_deg": moved["p95_deg"],
        "most_deg": moved["most_deg"],
        "joint": joints[0]["joint"] if joints else "",
        "left_broken": sum(broken(said["after"]).values()),
        "clearance": said["certificate"]["poses"]["least_clearance_m"],
        "bound": said["certificate"]["paths"]["bound_m"],
        "input_sha256": said["input_sha256"],
        "output_sha256": said["output_sha256"],
    }
