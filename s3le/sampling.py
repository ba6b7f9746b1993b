"""Poses drawn from the robot's kinematics alone, no mocap (paper, Sec. IV-C).

Tilde marks relaxed, bar marks feasible: q_relaxed is q~, q_feasible is q-bar [rad].
Nothing here opens a file or reads a clock; randomness arrives as a Generator.
"""

from typing import NamedTuple

import numpy as np

from s3le.certified import Columns, certificate, projection_counts
from s3le.errors import ParameterError, RobotError
from s3le.kernels import batch
from s3le.kernels.batch import Progress
from s3le.machine import Machine
from s3le.tables.tuples import HOW


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


def draw_tuples(
    machine: Machine,
    count: int,
    alpha: float,
    renormalise: bool,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Tuples:
    """Sample relaxed poses uniformly and project them (Sec. IV-C).

    Args:
        machine: the robot.
        count: tuples to draw.
        alpha: relaxation of the joint ranges [-].
        renormalise: see mixup.
        rng: where poses and mix come from.
        progress: called with numbers of rows done.
    """
    robot = machine.robot
    low, high = relaxed_limits(robot.lower, robot.upper, alpha)
    q_relaxed = rng.uniform(low, high, (count, robot.n_dof))
    mix = rng.uniform(0.0, 1.0, count)
    projected = batch.project(machine.chain, robot.anchor, q_relaxed, machine.margin, progress)
    x_relaxed = batch.skeletons(machine.chain, q_relaxed)
    x_feasible = batch.skeletons(machine.chain, projected.q)
    return Tuples(
        q_relaxed,
        x_relaxed,
        projected.q,
        x_feasible,
        mix,
        mixup(x_relaxed, x_feasible, mix, renormalise),
        projected.how,
    )


def draw_feasible(
    machine: Machine, count: int, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[np.ndarray, float]:
    """Feasible poses, uniform over the feasible part of the joint box, by rejection.

    Returns:
        Pair (q, share): q (count, n_dof) [rad]; share of drawn poses that were feasible.

    Raises:
        RobotError: fewer than one pose in 10,000 is feasible, so that sampling would not end.
    """
    robot = machine.robot
    kept: list[np.ndarray] = []
    have = drawn = 0
    while have < count:
        q = rng.uniform(robot.lower, robot.upper, (max(count, 1000), robot.n_dof))
        good = q[batch.clearances(machine.chain, q) >= machine.margin]
        drawn += len(q)
        if drawn >= 100_000 and (have + len(good)) < drawn / 10_000:
            raise RobotError(
                f"robot {robot.name}: only {have + len(good)} of {drawn} random poses feasible; "
                "look at its watched pairs (data/robot/pairs.parquet)"
            )
        if progress:
            progress(min(len(good), count - have))
        kept.append(good)
        have += len(good)
    return np.concatenate(kept)[:count], have / drawn


def kinematic_pairs(
    machine: Machine,
    count: int,
    alpha: float,
    renormalise: bool,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[Columns, dict]:
    """Columns of table kinematic_pairs and counts for the metrics; see draw_tuples.

    Raises:
        CertificateError: a projected pose is not feasible.
    """
    drawn = draw_tuples(machine, count, alpha, renormalise, rng, progress)
    columns = {
        "row": np.arange(count, dtype=np.int32),
        "mix": drawn.mix,
        "x_mixed": drawn.x_mixed,
        "x_relaxed": drawn.x_relaxed,
        "x_feasible": drawn.x_feasible,
        "q_relaxed": drawn.q_relaxed,
        "q_feasible": drawn.q_feasible,
        "projection": np.array(HOW)[drawn.how],
    } | certificate(machine, drawn.q_feasible, progress)
    projected = batch.Projection(drawn.q_feasible, drawn.how)
    counts = {"rows": count, "alpha": alpha}
    return columns, counts | projection_counts(machine, drawn.q_relaxed, projected)


def robot_poses(
    machine: Machine, count: int, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[Columns, dict]:
    """Columns of table robot_poses and counts; see draw_feasible.

    Raises:
        CertificateError: a pose is not feasible by the independent check.
    """
    q, share = draw_feasible(machine, count, rng, progress)
    columns = {
        "row": np.arange(count, dtype=np.int32),
        "q": q,
        "x": batch.skeletons(machine.chain, q),
    } | certificate(machine, q, progress)
    return columns, {"rows": count, "accepted_share": share}
