"""SEW-Mimic from a user's clone of chase6305/SEW-mimic-retargeting: closed-form arms.

Each arm's first four joints bring its upper arm and its forearm along the human's; the wrist is the
human's to turn, and these robots hold theirs, so three wrist joints that turn freely are put at its
end and thrown away. The waist stays at its anchor. No speeds, no collisions; where no closed-form
solution lies within the limits it raises, and the robot stays where it is. The method is patented
by its authors; this calls their readers' code and holds none of it.
"""

from collections.abc import Callable

import numpy as np
from plain import POINTS, Goal, Plain

from solvers import versions

ARMS = (("r_shoulder", "r_elbow", "r_hand"), ("l_shoulder", "l_elbow", "l_hand"))
FREE = 3.2  # [rad], range of a joint that is thrown away


def about() -> dict[str, str]:
    """Versions."""
    import sew_mimic

    return {"sew_mimic": sew_mimic.__version__} | versions("numpy")


class _Arm:
    """One arm as SEW-Mimic wants it."""

    def __init__(self, robot: Plain, roles: tuple[str, str, str]) -> None:
        from sew_mimic import Serial7DoF

        self.joints = _path(robot, robot.points[roles[2]].joint)[-4:]
        if len(self.joints) != 4:
            raise ValueError(f"{robot.name}: SEW-Mimic wants four joints from shoulder to hand")
        at, (turn, _) = robot.where(robot.anchor), robot.frames(robot.anchor)
        carrier = robot.joints[self.joints[0]].parent
        self.base = turn[carrier] if carrier >= 0 else np.eye(3)
        forearm = turn[self.joints[-1]].T @ _unit(at[roles[2]] - at[roles[1]])
        across = _unit(np.cross(forearm, np.eye(3)[np.abs(forearm).argmin()]))
        axes = [robot.joints[j].axis for j in self.joints] + [forearm, across, forearm]
        # The third axis is taken to point along the upper arm; a joint may turn about it backwards.
        third = turn[self.joints[2]] @ axes[2]
        backwards = third @ (at[roles[1]] - at[roles[0]]) < 0.0
        self.sign = np.array([1.0, 1.0, -1.0 if backwards else 1.0, 1.0])
        axes[2] = self.sign[2] * axes[2]
        turns = [robot.joints[j].rotation for j in self.joints] + [np.eye(3)] * 3
        lower = [robot.joints[j].lower for j in self.joints] + [-FREE] * 3
        upper = [robot.joints[j].upper for j in self.joints] + [FREE] * 3
        if backwards:
            lower[2], upper[2] = -upper[2], -lower[2]
        self.chain = Serial7DoF(np.array(axes), np.array(turns), np.array(lower), np.array(upper))
        self.roles = tuple(POINTS.index(role) for role in roles)


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame."""
    from sew_mimic import get_backend

    backend = get_backend(settings.get("backend", "python"))
    arms = [_Arm(robot, roles) for roles in ARMS]

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        made = q.copy()
        for arm in arms:
            points = goal.points[list(arm.roles)] @ arm.base  # into the frame that carries the arm
            here = np.concatenate([arm.sign * q[arm.joints], np.zeros(3)])
            hand = arm.chain.tool_orientation(here)
            found = backend.solve(arm.chain, here, *points, hand)[:4]
            made[arm.joints] = arm.sign * found
        return made

    return solve


def _path(robot: Plain, joint: int) -> list[int]:
    """Joints from the base to one, itself the last."""
    path = []
    while joint >= 0:
        path.append(joint)
        joint = robot.joints[joint].parent
    return path[::-1]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)
