"""Does a robot file make sense: left on the left, up above, elbows that bend; which bones move.

Kinematics in plain arrays over many poses, for questions that are asked before anything is
computed with the robot; it shares nothing with pinocchio or the kernels.
"""

import numpy as np

from s3le.errors import RobotError
from s3le.robot.description import ARMS
from s3le.robot.model import Geometry

BENDS = np.radians(15.0)  # [rad], range that an elbow must have at least
TURNS = np.radians(3.0)  # [rad], a bone that turns less stands still for this project
_POSES = 400


def poses(robot: Geometry, count: int = _POSES) -> np.ndarray:
    """Poses uniform in the limits, the anchor first; always the same, (count, n_dof) [rad]."""
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (count, robot.n_dof))
    q[0] = robot.anchor
    return q


def points(robot: Geometry, q: np.ndarray) -> dict[str, np.ndarray]:
    """Skeleton points of poses (n, n_dof), by role (n, 3) [m], x forward, y left, z up."""
    R = [np.broadcast_to(np.eye(3), (len(q), 3, 3))]
    p = [np.zeros((len(q), 3))]
    for joint, angle in zip(robot.joints, q.T, strict=True):
        x, y, z = joint.axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(angle)[:, None, None] * K
        turn = turn + (1.0 - np.cos(angle))[:, None, None] * (K @ K)
        before = joint.parent + 1
        p.append(p[before] + R[before] @ joint.translation)
        R.append(R[before] @ joint.rotation @ turn)
    return {
        role: (p[at.joint + 1] + R[at.joint + 1] @ at.offset) @ robot.base_rotation.T
        for role, at in robot.points.items()
    }


def refuse_nonsense(robot: Geometry) -> None:
    """Refuse points that cannot be meant.

    Raises:
        RobotError: left and right are swapped, the neck lies below the hip, or an elbow does not
            bend; says what to change.
    """
    file = robot.description.source
    at = points(robot, poses(robot))
    arms = [side for side, arm in ARMS.items() if all(role in at for role in arm)]
    if len(arms) == 2 and not at["r_shoulder"][0, 1] < at["l_shoulder"][0, 1]:
        raise RobotError(
            f"{file}: r_shoulder lies to the left of l_shoulder; swap the points of the left and "
            "the right arm, or turn base_rpy by 3.14159 about z if the robot faces backwards"
        )
    top = np.mean([at[f"{side}_shoulder"][0] for side in arms], axis=0)
    if not top[2] > at["hip"][0, 2]:
        raise RobotError(
            f"{file}: at the anchor the shoulders lie below the hip; base_rpy must bring z up, "
            "or another point is the hip"
        )
    for side in arms:
        upper = at[f"{side}_elbow"] - at[f"{side}_shoulder"]
        lower = at[f"{side}_hand"] - at[f"{side}_elbow"]
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = (upper * lower).sum(axis=1)
            cosine /= np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
        bend = np.arccos(np.clip(cosine, -1.0, 1.0))
        if not np.ptp(bend) >= BENDS:  # catches NaN; a bone without length is told elsewhere
            if not np.isfinite(bend).all():
                continue
            raise RobotError(
                f"{file}: {side}_elbow cannot bend: the angle between upper arm and forearm stays "
                f"within {np.degrees(bend.min()):.0f} to {np.degrees(bend.max()):.0f} deg; choose "
                "the joint that bends as elbow, put it into joints, and look at its limits"
            )


def turning(bones: np.ndarray) -> np.ndarray:
    """Which bones turn at all, bool (k,).

    Args:
        bones: not normalised, (n, k, 3) [m], over many poses.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = bones / np.linalg.norm(bones, axis=2, keepdims=True)  # NaN, no length: it turns
    mean = unit.mean(axis=0)
    size = np.linalg.norm(mean, axis=1)
    mean = mean / np.maximum(size, 1e-12)[:, None]
    off = np.linalg.norm(unit - mean, axis=2).max(axis=0)  # chord
    return ~((off <= TURNS) & (size > 0.5))
