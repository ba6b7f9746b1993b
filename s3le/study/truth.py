"""Ground truth: for every test frame the best feasible pose that optimisation finds (Sec. V-C)."""

import numpy as np

from s3le.human.splits import test_rows
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.tuples import ik
from s3le.tuples.certified import certificate
from s3le.types import Columns, Progress


def ground_truth(
    robot: Robot,
    frames: Columns,
    starts: int,
    ridge: float,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Columns:
    """Columns of table ground_truth for every frame that is not of a training clip.

    Raises:
        ClipError: there is no such frame.
        CertificateError: a pose is not feasible.
    """
    rows = test_rows(frames)
    q, distance = ik.ground_truth(robot, frames["x"][rows], starts, ridge, rng, progress)
    return (
        {name: frames[name][rows] for name in ("split", "clip", "frame")}
        | {"to_human": distance, "q": q, "x": batch.skeletons(robot.chain, q)}
        | certificate(robot, q, progress)
    )
