"""The latent spaces of a run, brought down to what a picture can show."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from s3le.human.splits import test_rows
from s3le.learn import artifact
from s3le.report.spaces import Space
from s3le.robot.robot import Robot
from s3le.types import Columns

POSES, FRAMES = 4000, 300  # points drawn at most, evenly out of what there is


def spaces(
    robot: Robot, frames: Columns, truth: Columns, poses: Columns, models: Mapping[str, Path]
) -> list[Space]:
    """The latents of robot poses, test frames and their ground truth under each model.

    A latent space is shown in the two directions in which the latents of robot poses vary most.

    Args:
        robot: the robot.
        frames: columns of table skeletons.
        truth: columns of table ground_truth, one row for each test frame, in the same order.
        poses: columns of table robot_poses.
        models: trained models by method.

    Returns:
        One Space a model.

    Raises:
        ModelError: a model is missing, damaged, or of another robot.
    """
    rows = test_rows(frames)
    shown = _evenly(len(rows), FRAMES)
    human = frames["x"][rows][shown]
    motions, motion = np.unique(frames["clip"][rows][shown], return_inverse=True)
    q = poses["q"][_evenly(len(poses["q"]), POSES)]
    found = []
    for method, path in models.items():
        net, _ = artifact.load_model(path, method=method, robot_hash=robot.tag)
        stored = artifact.encode_q(net, q).astype(float)
        z_x = artifact.encode_x(net, human).astype(float)
        z_q = artifact.encode_q(net, truth["q"][shown]).astype(float)
        plane, rank = principal(stored)
        apart = float(np.sqrt(((z_x - z_q) ** 2).sum(axis=1).mean() / stored.var(axis=0).sum()))
        centre = stored.mean(axis=0)
        of_q, of_x, of_truth = ((z - centre) @ plane for z in (stored, z_x, z_q))
        found.append(Space(method, of_q, of_x, of_truth, motion, motions.tolist(), rank, apart))
    return found


def principal(z: np.ndarray) -> tuple[np.ndarray, float]:
    """The two directions of greatest variance, and how many directions are used at all.

    Args:
        z: latents, (n, d) with d at least 2.

    Returns:
        Pair (plane, rank): plane (d, 2), orthonormal, each column's largest entry positive; rank
        the effective number of dimensions, trace(C)^2 / trace(C^2) of the covariance C, in [1, d].
    """
    values, vectors = np.linalg.eigh(np.cov(z.T))
    plane = vectors[:, [-1, -2]]
    plane = plane * np.sign(plane[np.abs(plane).argmax(axis=0), [0, 1]])
    return plane, float(values.sum() ** 2 / (values**2).sum())


def _evenly(n: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))
