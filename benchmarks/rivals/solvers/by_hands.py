"""What GR00T's decoupled_wbc does, from its published settings: pink on two hand poses.

Hand tasks of cost 8 in position and 2 in orientation, damping 3; a weighted posture task of cost
0.01 and damping 1; three programs of 0.05 s a frame, within joint limits; no speed limit of its
own, no collisions. Joints that its weights do not know weigh 1. The rotation of a hand is
plain.Goal's, for clips have no palms.
"""

from collections.abc import Callable

import numpy as np
import pink
import pinocchio as pin
from pink.tasks import FrameTask, PostureTask
from plain import HANDS, POINTS, Goal, Plain

from solvers import versions
from solvers.by_pink import model_of

POSTURE = {  # part of a joint's name -> weight
    "waist_pitch": 10.0, "waist_yaw": 2.0, "waist_roll": 10.0, "shoulder_pitch": 4.0,
    "shoulder_roll": 3.0, "shoulder_yaw": 0.1, "elbow": 3.0,
    "WaistSag": 10.0, "WaistYaw": 2.0, "WaistLat": 10.0, "ShSag": 4.0, "ShLat": 3.0,
    "ShYaw": 0.1, "Elbj": 3.0,
}  # fmt: skip
STEP, STEPS = 0.05, 3  # [s], of a frame


def about() -> dict[str, str]:
    """Versions."""
    return versions("pin-pink", "pin", "daqp", "qpsolvers")


class _Weighted(PostureTask):
    """A posture task with a weight for each joint."""

    def __init__(self, weights: np.ndarray, **how: float) -> None:
        super().__init__(**how)
        self._weights = weights

    def compute_error(self, configuration: pink.Configuration) -> np.ndarray:
        return self._weights * super().compute_error(configuration)

    def compute_jacobian(self, configuration: pink.Configuration) -> np.ndarray:
        return self._weights[:, None] * super().compute_jacobian(configuration)


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame."""
    model, _, names = model_of(robot, speed=False)
    data = model.createData()
    tasks = [
        FrameTask(names[POINTS[row]], position_cost=8.0, orientation_cost=2.0, lm_damping=3.0)
        for row in HANDS
    ]
    weights = np.array(
        [next((w for part, w in POSTURE.items() if part in name), 1.0) for name in robot.names]
    )
    stay = _Weighted(weights, cost=0.01, lm_damping=1.0)
    stay.set_target(np.clip(np.zeros(len(weights)), robot.lower, robot.upper))

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        at = pink.Configuration(model, data, q)
        for task, row, turn in zip(tasks, HANDS, goal.turns, strict=True):
            task.set_target(pin.SE3(turn, goal.points[row]))
        for _ in range(STEPS):
            v = pink.solve_ik(at, [*tasks, stay], STEP, "daqp")
            at = pink.Configuration(model, data, np.clip(at.q + v * STEP, robot.lower, robot.upper))
        return at.q.copy()

    return solve
