"""The independent check as columns of a table, and what a batch of projections amounted to."""

import numpy as np

from s3le.kernels import batch
from s3le.kernels.batch import Progress
from s3le.machine import Machine

Columns = dict[str, np.ndarray]


def certificate(machine: Machine, q: np.ndarray, progress: Progress | None = None) -> Columns:
    """The certificate columns of feasible poses.

    Raises:
        CertificateError: some pose is not feasible.
    """
    report = machine.certifier().require(q, machine.margin, progress)
    return {"clearance": report.clearance, "limit_margin": report.limit_margin}


def projection_counts(
    machine: Machine, q_relaxed: np.ndarray, projected: batch.Projection
) -> dict[str, float | int]:
    """What Proj_Q did: how many rows came about how, and how far the joints moved [rad]."""
    clipped = np.clip(q_relaxed, machine.robot.lower, machine.robot.upper)
    collided = batch.clearances(machine.chain, clipped) < machine.margin
    moved = np.linalg.norm(projected.q - clipped, axis=1)
    many = bool(collided.any())
    return {
        "feasible": int((projected.how == batch.SAME).sum()),
        "solved": int((projected.how == batch.SOLVED).sum()),
        "fallback": int((projected.how == batch.FALLBACK).sum()),
        "collided": int(collided.sum()),
        "moved_mean_rad": float(moved[collided].mean()) if many else 0.0,
        "moved_median_rad": float(np.median(moved[collided])) if many else 0.0,
    }
