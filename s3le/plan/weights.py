"""What it costs a joint to be off, and what it costs a skeleton."""

import numpy as np

from s3le.robot.robot import Robot
from s3le.safety.swept import swept
from s3le.skeleton import BONES

TRUNK, RIDGE = 10.0, 0.01  # of a file: weight of the trunk's direction beside the other bones',
# and of a joint [1/rad^2] beside the skeleton
STREAM_TRUNK, STREAM_RIDGE = 20.0, 0.1  # of a stream, which cannot prepare for what comes
_LEAST = 0.02  # of the mean weight, so that no joint is free


def of_joints(robot: Robot) -> np.ndarray:
    """A weight for each joint, (n, n), diagonal, of mean 1: its squared reach.

    The reach is how far the farthest point of a body that the joint carries can be from its axis:
    what a radian of it moves. So trunks are dear and wrists are cheap.
    """
    reach = swept(robot.chain).radius.max(axis=0, initial=0.0)  # (n,) [m]
    weight = reach**2 if reach.any() else np.ones(robot.n_dof)
    weight = weight / weight.mean()
    return np.diag(np.maximum(weight, _LEAST))


def of_bones(robot: Robot, trunk: float = TRUNK) -> np.ndarray:
    """A weight for each component of a skeleton, (21,): 1, `trunk`, or 0 if not followed."""
    weight = np.ones(len(BONES))
    weight[0] = trunk
    if robot.followed is not None:
        weight[~robot.followed] = 0.0
    return np.repeat(weight, 3)
