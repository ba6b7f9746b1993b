"""Optimisation-based retargeting: the relaxed pose of a human frame, and the ground truth.

Both minimise the sum of the seven cosine distances plus a small pull towards the middle of the
joint ranges, which settles what the seven vectors leave open (a straight arm's yaw).
"""

import numpy as np

from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance
from s3le.types import Progress

TURN = 2.0 * np.pi


def relaxed_poses(
    robot: Robot, x: np.ndarray, ridge: float, progress: Progress | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """q~ by inverse kinematics without joint limits and without collisions (Sec. IV-B).

    Each angle is then replaced by its equivalent, whole turns away, that violates the joint's
    range least: the same pose, nearest to what the robot can do.

    Args:
        robot: the robot.
        x: human skeletons, (n, 21).
        ridge: weight of the pull towards mid-range, > 0.
        progress: called with numbers of rows done.

    Returns:
        Pair (q, residual): q (n, n_dof) [rad]; residual (n,), mean cosine distance of FK(q) to x.
    """
    middle = (robot.lower + robot.upper) / 2
    starts = np.stack([middle, robot.anchor])
    found = batch.follow(
        robot.chain,
        x,
        np.broadcast_to(starts, (len(x), *starts.shape)),
        middle,
        ridge,
        robot.margin,
        False,
        progress,
    )
    q = nearest_turn(found.q, robot.lower, robot.upper)
    return q, cosine_distance(batch.skeletons(robot.chain, q), x, robot.followed)


def nearest_turn(q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Each angle shifted by whole turns to violate [lower, upper] least, (n, n_dof) [rad]."""
    middle = (lower + upper) / 2
    return q - TURN * np.round((q - middle) / TURN)


def ground_truth(
    robot: Robot,
    x: np.ndarray,
    starts: int,
    ridge: float,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Feasible pose nearest to each human skeleton: with limits and collisions, best of several.

    Starts are the anchor, the projection of the relaxed solution, and feasible random poses.

    Args:
        robot: the robot.
        x: human skeletons, (n, 21).
        starts: number of starts, at least 2.
        ridge: weight of the pull towards mid-range, > 0.
        rng: draws the random starts, the same for every frame.
        progress: called with numbers of rows done.

    Returns:
        Pair (q, distance): q (n, n_dof) [rad], feasible by the kernels; distance (n,), mean
        cosine distance of FK(q) to x.
    """
    relaxed, _ = relaxed_poses(robot, x, ridge)
    first = batch.project(robot.chain, robot.anchor, relaxed, robot.margin).q
    drawn = rng.uniform(robot.lower, robot.upper, (max(starts - 2, 0), robot.n_dof))
    drawn = batch.project(robot.chain, robot.anchor, drawn, robot.margin).q
    common = np.concatenate([robot.anchor[None], drawn])
    all_starts = np.concatenate(
        [first[:, None], np.broadcast_to(common, (len(x), *common.shape))], axis=1
    )
    middle = (robot.lower + robot.upper) / 2
    found = batch.follow(robot.chain, x, all_starts, middle, ridge, robot.margin, True, progress)
    # A start is feasible itself, so a frame that no solve improved keeps its projected pose.
    q = np.where(found.feasible[:, None], found.q, first)
    return q, cosine_distance(batch.skeletons(robot.chain, q), x, robot.followed)
