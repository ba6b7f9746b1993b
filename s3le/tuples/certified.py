"""The independent check as columns of a table, and what a batch of projections amounted to."""

import numpy as np

from s3le.kernels import batch
from s3le.robot.certificate import Certifier
from s3le.robot.robot import Robot
from s3le.types import Columns, Progress


def certificate(
    robot: Robot,
    q: np.ndarray,
    progress: Progress | None = None,
    checker: Certifier | None = None,
) -> Columns:
    """The certificate columns of feasible poses.

    Args:
        robot: whose poses they are.
        q: poses [rad], (n, n_dof).
        progress: called with numbers of rows done.
        checker: one of this thread's own; None: a fresh one.

    Raises:
        CertificateError: some pose is not feasible.
    """
    report = (checker or robot.certifier()).require(q, robot.margin, progress)
    return {"clearance": report.clearance, "limit_margin": report.limit_margin}


def projection_counts(
    robot: Robot, q_relaxed: np.ndarray, projected: batch.Projection
) -> dict[str, float | int]:
    """What Proj_Q did, in numbers that can be summed over batches.

    Rows by how they came about ("feasible", "solved", "fallback"), rows whose clipped pose
    collided, and how far the joints of those moved [rad], summed.
    """
    clipped = np.clip(q_relaxed, robot.lower, robot.upper)
    collided = batch.clearances(robot.chain, clipped) < robot.margin
    moved = np.linalg.norm(projected.q - clipped, axis=1)
    return {
        "rows": len(q_relaxed),
        "feasible": int((projected.how == batch.SAME).sum()),
        "solved": int((projected.how == batch.SOLVED).sum()),
        "fallback": int((projected.how == batch.FALLBACK).sum()),
        "collided": int(collided.sum()),
        "moved_rad": float(moved[collided].sum()),
    }


def projection_summary(counts: dict[str, float | int]) -> dict[str, float | int]:
    """The same for the metrics: shares and the mean movement instead of the sum."""
    summary = {name: value for name, value in counts.items() if name != "moved_rad"}
    return summary | {
        "fallback_share": counts["fallback"] / counts["rows"],
        "moved_mean_rad": counts["moved_rad"] / max(counts["collided"], 1),
    }
