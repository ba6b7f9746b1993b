"""Poses drawn from the robot's kinematics alone, no mocap (paper, Sec. IV-C).

Tilde marks relaxed, bar marks feasible: q_relaxed is q~, q_feasible is q-bar [rad].
Nothing here opens a file or reads a clock; randomness arrives as numbers or as a Generator.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError, RobotError
from s3le.kernels import batch
from s3le.kernels.batch import Projection
from s3le.robot.robot import Robot

BLOCK = 4096  # poses drawn at a time by rejection; a constant, so that fewer rows are a prefix
Project = Callable[[np.ndarray], Projection]


class Tuples(NamedTuple):
    """Kinematic tuples, one a row."""

    q_relaxed: np.ndarray  # q~ [rad], (n, n_dof)
    x_relaxed: np.ndarray  # x~ = FK(q~), (n, 21)
    q_feasible: np.ndarray  # q-bar = Proj_Q(q~) [rad], (n, n_dof)
    x_feasible: np.ndarray  # x-bar = FK(q-bar), (n, 21)
    mix: np.ndarray  # share of x~ in x', (n,)
    x_mixed: np.ndarray  # x', (n, 21)
    how: np.ndarray  # uint8 (n,), kernels.batch codes


def relaxed_limits(
    lower: np.ndarray, upper: np.ndarray, alpha: float
) -> tuple[np.ndarray, np.ndarray]:
    """Widen every joint range by alpha/2 of its own width at each end.

        l' = l - alpha/2 (u - l)        u' = u + alpha/2 (u - l)

    Source: paper, Sec. IV-C, "alpha-relaxed joint range".

    Args:
        lower: l, joint minima [rad], shape (n_dof,).
        upper: u, joint maxima [rad], shape (n_dof,).
        alpha: relaxation [-], at least 0; 0 returns the robot's own limits.

    Returns:
        Pair (l', u') [rad], each float64 of shape (n_dof,).

    Raises:
        ParameterError: alpha is negative or not finite.
    """
    if not 0.0 <= alpha < np.inf:
        raise ParameterError(f"alpha must be finite and >= 0, got {alpha!r}")
    slack = alpha / 2.0 * (upper - lower)
    return lower - slack, upper + slack


def mixup(
    x_relaxed: np.ndarray, x_feasible: np.ndarray, mix: np.ndarray, renormalise: bool
) -> np.ndarray:
    """Auxiliary relaxed skeletons x' = mix x~ + (1 - mix) x-bar (Sec. IV-C), (n, 21).

    Args:
        x_relaxed: x~, (n, 21).
        x_feasible: x-bar, (n, 21).
        mix: share of x~ in [0, 1], (n,); the paper calls it beta.
        renormalise: give every bone of x' unit length again; the paper does not.
    """
    mixed = mix[:, None] * x_relaxed + (1.0 - mix[:, None]) * x_feasible
    if renormalise:
        bones = mixed.reshape(len(mixed), 7, 3)
        # Opposite bones can cancel; such a bone keeps its (zero) length instead of becoming NaN.
        length = np.linalg.norm(bones, axis=2, keepdims=True)
        mixed = (bones / np.where(length > 1e-9, length, 1.0)).reshape(mixed.shape)
    return mixed


def projector(robot: Robot, kind: str = "nearest") -> Project:
    """Proj_Q for whole batches.

    Args:
        robot: whose poses.
        kind: one of kernels.batch.PROJECTIONS.
    """
    return lambda q: batch.project(robot.chain, robot.anchor, q, robot.margin, kind=kind)


def tuples(
    robot: Robot, q_relaxed: np.ndarray, mix: np.ndarray, renormalise: bool, project: Project
) -> Tuples:
    """Complete relaxed poses to tuples: project them, read skeletons, mix (Sec. IV-C).

    Args:
        robot: the robot.
        q_relaxed: q~ [rad], (n, n_dof).
        mix: share of x~ in x', (n,).
        renormalise: see mixup.
        project: see projector.
    """
    projected = project(q_relaxed)
    x_relaxed = batch.skeletons(robot.chain, q_relaxed)
    x_feasible = batch.skeletons(robot.chain, projected.q)
    x_mixed = mixup(x_relaxed, x_feasible, mix, renormalise)
    return Tuples(q_relaxed, x_relaxed, projected.q, x_feasible, mix, x_mixed, projected.how)


def draw_feasible(
    robot: Robot, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, int, int]:
    """Feasible poses, uniform over the feasible part of the joint box, by rejection.

    Fewer poses from an equal generator are the first of them.

    Returns:
        Triple (q, accepted, drawn): q (count, n_dof) [rad]; poses accepted of those drawn, of
        which the last may be left over.

    Raises:
        RobotError: fewer than one pose in 10,000 is feasible, so that sampling would not end.
    """
    kept: list[np.ndarray] = []
    have = drawn = 0
    while have < count:
        q = rng.uniform(robot.lower, robot.upper, (BLOCK, robot.n_dof))
        good = q[batch.clearances(robot.chain, q) >= robot.margin]
        kept.append(good)
        drawn += len(q)
        have += len(good)
        if drawn >= 100_000 and have < drawn / 10_000:
            raise RobotError(
                f"robot {robot.name}: only {have} of {drawn} random poses feasible; "
                "look at its watched pairs (data/robot/pairs.parquet)"
            )
    return np.concatenate(kept)[:count], have, drawn
