"""Tuples from motion capture: relaxed inverse kinematics, then projection (paper, Sec. IV-B)."""

import numpy as np

from s3le.human.splits import train_rows
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.tuples import ik
from s3le.tuples.certified import certificate, projection_counts, projection_summary
from s3le.tuples.tables import HOW
from s3le.types import Columns, Progress


def pair(
    robot: Robot,
    frames: Columns,
    count: int,
    ridge: float,
    progress: Progress | None = None,
    projection: str = "nearest",
) -> tuple[Columns, dict]:
    """Tuples (x~, x-bar, q~, q-bar) from the frames of training clips (Sec. IV-B).

    Args:
        robot: the robot.
        frames: columns of table skeletons; `count` of its training frames are taken, evenly.
        count: tuples wanted; all training frames where there are fewer.
        ridge: see ik.relaxed_poses.
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
    q_relaxed, residual = ik.relaxed_poses(robot, x, ridge, progress)
    projected = batch.project(robot.chain, robot.anchor, q_relaxed, robot.margin, kind=projection)
    columns = {
        "clip": frames["clip"][train],
        "frame": frames["frame"][train],
        "residual": residual,
        "x_relaxed": x,
        "x_feasible": batch.skeletons(robot.chain, projected.q),
        "q_relaxed": q_relaxed,
        "q_feasible": projected.q,
        "projection": np.array(HOW)[projected.how],
    } | certificate(robot, projected.q, progress)
    counts = {"rows": len(x), "residual_mean": float(residual.mean())}
    return columns, counts | projection_summary(projection_counts(robot, q_relaxed, projected))
