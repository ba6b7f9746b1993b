"""What it costs a joint to be off, and what it costs a skeleton."""

import numpy as np

from s3le.errors import ParameterError
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


def of_rows(weight: np.ndarray, m: int, n: int) -> np.ndarray:
    """Weights of n joints in a motion of m rows, (1, n, n), for all of them, or (m, n, n).

    Raises:
        ParameterError: they have another shape, (n, n) aside, or are not finite.
    """
    weight = np.ascontiguousarray(weight, float)
    weight = weight[None] if weight.ndim == 2 else weight
    if weight.shape not in ((1, n, n), (m, n, n)) or not np.isfinite(weight).all():
        raise ParameterError(f"weights must be finite, ({n}, {n}) or one a row, got {weight.shape}")
    return weight


def of_bones(robot: Robot, trunk: float = TRUNK) -> np.ndarray:
    """A weight for each component of a skeleton, (21,): 1, `trunk`, or 0 if not followed."""
    weight = np.ones(len(BONES))
    weight[0] = trunk
    if robot.followed is not None:
        weight[~robot.followed] = 0.0
    return np.repeat(weight, 3)
