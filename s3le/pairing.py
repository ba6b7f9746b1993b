"""Tuples from motion capture: relaxed inverse kinematics, then projection (paper, Sec. IV-B)."""

import numpy as np

from s3le import retargeting
from s3le.certified import Columns, certificate, projection_counts, projection_summary
from s3le.kernels import batch
from s3le.kernels.batch import Progress
from s3le.machine import Machine
from s3le.splits import train_rows
from s3le.tables.tuples import HOW


def pair(
    machine: Machine,
    frames: Columns,
    count: int,
    ridge: float,
    progress: Progress | None = None,
    projection: str = "nearest",
) -> tuple[Columns, dict]:
    """Tuples (x~, x-bar, q~, q-bar) from the frames of training clips (Sec. IV-B).

    Args:
        machine: the robot.
        frames: columns of table skeletons; `count` of its training frames are taken, evenly.
        count: tuples wanted; all training frames where there are fewer.
        ridge: see retargeting.relaxed_poses.
        progress: called with numbers of rows done, twice a row (solved, certified).
        projection: one of kernels.batch.PROJECTIONS.

    Returns:
        Pair (columns of table mocap_pairs, counts for the metrics).

    Raises:
        ClipError: there is no training frame.
        CertificateError: a projected pose is not feasible.
    """
    train = train_rows(frames, count)
    x = frames["x"][train]
    q_relaxed, residual = retargeting.relaxed_poses(machine, x, ridge, progress)
    projected = batch.project(
        machine.chain, machine.robot.anchor, q_relaxed, machine.margin, kind=projection
    )
    columns = {
        "clip": frames["clip"][train],
        "frame": frames["frame"][train],
        "residual": residual,
        "x_relaxed": x,
        "x_feasible": batch.skeletons(machine.chain, projected.q),
        "q_relaxed": q_relaxed,
        "q_feasible": projected.q,
        "projection": np.array(HOW)[projected.how],
    } | certificate(machine, projected.q, progress)
    counts = {"rows": len(x), "residual_mean": float(residual.mean())}
    return columns, counts | projection_summary(projection_counts(machine, q_relaxed, projected))
