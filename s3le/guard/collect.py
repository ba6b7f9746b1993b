"""Certified motions of many files as one table, and what the guard did in a few numbers."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import CertificateError
from s3le.guard import folder, places
from s3le.guard.folder import Record
from s3le.guard.layouts import lerobot_new
from s3le.guard.moved import pooled
from s3le.guard.table import KINDS, broken, motions
from s3le.guard.task import Cleaning, Reading
from s3le.robot.robot import Robot
from s3le.store import tables
from s3le.tuples.engine import run


def write(records: Sequence[Record], reading: Reading, robot: Robot, path: Path) -> None:
    """Write the motions of all results as one table; each pose is measured by coal once more.

    Args:
        records: what became of files; those without a result are passed over.
        reading: how the files were read.
        robot: of the claim.
        path: where.

    Raises:
        CertificateError: no file has a result, or a pose is not feasible.
        TableError: the rows break the contract.
        TrajectoryError: a result cannot be read.
    """
    parts: list[dict[str, Any]] = []
    checker = robot.certifier()
    for record in records:
        if not record.good:
            continue
        layout = reading.open(record.piece.target, robot)
        for number, one in enumerate(layout.episodes):
            report = checker.require(one.q, robot.margin)
            parts.append(
                {
                    "file": np.full(len(one.q), record.piece.name),
                    "episode": np.full(len(one.q), number),
                    "row": np.arange(len(one.q)),
                    "time": one.time,
                    "q": one.q,
                    "clearance": report.clearance,
                    "limit_margin": report.limit_margin,
                }
            )
    if not parts:
        raise CertificateError(f"{path}: none of {len(records)} files has a motion that holds")
    table = motions(robot.n_dof, robot.margin)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in table.columns}
    tables.write(whole, table, path, robot.tag, {"joints": ",".join(robot.joint_names)})


def write_lerobot(
    records: Sequence[Record],
    reading: Reading,
    robot: Robot,
    cleaning: Callable[[tuple[str, ...], tuple[str, ...]], Cleaning],
    shelf: Path,
    target: Path,
) -> None:
    """Write the motions of all results as a LeRobot folder, certified as its float32 have them.

    Args:
        records, reading, robot: as write.
        cleaning: makes the task of files and their hashes, see folder.process.
        shelf: where the folder lies while nothing is proven of it.
        target: where it goes, with its summary beside it.

    Raises:
        TrajectoryError: the motions are not all at one rate.
        CertificateError: no motion was found that holds in float32.
    """
    motions = [
        lerobot_new.Motion(record.piece.name, one.time - one.time[0], one.q)
        for record in records
        if record.good
        for one in reading.open(record.piece.target, robot).episodes
    ]
    lerobot_new.create(shelf, motions, robot.joint_names, robot.name)
    sidecar = target.with_name(target.name + places.SIDECAR)
    piece = places.Piece(target.name, shelf, target, sidecar)
    for record in folder.process([piece], robot, cleaning, run.Where(workers=1)):
        if not record.good:
            raise CertificateError(record.why)


def metrics(records: Sequence[Record]) -> dict[str, Any]:
    """What the guard did, in numbers that runs are compared by."""
    read = [record.summary for record in records if record.summary]
    moved = pooled([said["moved"] for said in read])
    frames = moved["frames"]
    return {
        "files": len(records),
        "without_a_motion": sum(not record.good for record in records),
        "frames": frames,
        "seconds": sum(said["seconds"] for said in read),
        "touched": moved["touched"] / max(frames, 1),
        "moved": moved["moved"] / max(frames, 1),
        **{key: moved[key] for key in ("median_deg", "p95_deg", "most_deg")},
        "broken_before": {
            kind: sum(broken(said["before"]).get(kind, 0) for said in read) for kind in KINDS
        },
        "left_broken": sum(sum(broken(said["after"]).values()) for said in read),
    }
