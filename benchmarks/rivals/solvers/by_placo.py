"""placo: whole-body inverse kinematics as quadratic programs, in C++.

Settings: `solves`, programs a frame; `collisions`, its self-collision constraint: "hard", "soft" or
"" (off); `trigger` [m], from where on a pair is looked at; `speed`, its limit of joint speeds;
`regularization`, weight of standing still.
"""

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import placo
from plain import POINTS, Goal, Plain, Writer

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("placo", "pin", "eiquadprog")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    written, solves = Writer(robot).pieces, int(settings.get("solves", 1))
    with TemporaryDirectory() as folder:
        (Path(folder) / "robot.urdf").write_text(written.text, encoding="utf-8")
        pairs = [[written.bodies[a], written.bodies[b]] for a, b in robot.watched]
        listed = Path(folder) / "pairs.json"
        listed.write_text(json.dumps(pairs), encoding="utf-8")
        model = placo.RobotWrapper(folder, placo.Flags.ignore_collisions * 0)
        model.load_collision_pairs(str(listed))
    solver = placo.KinematicsSolver(model)
    solver.mask_fbase(True)
    solver.dt = dt / solves
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(bool(settings.get("speed", True)))
    tasks = []
    for role in POINTS:
        task = solver.add_position_task(written.points[role], np.zeros(3))
        task.configure(role, "soft", 1.0)
        tasks.append(task)
    if settings.get("regularization", 1e-6):
        solver.add_regularization_task(float(settings.get("regularization", 1e-6)))
    if settings.get("collisions", "hard"):
        apart = solver.add_avoid_self_collisions_constraint()
        apart.self_collisions_margin = robot.margin
        apart.self_collisions_trigger = float(settings.get("trigger", 0.05))
        apart.configure("apart", settings.get("collisions", "hard"), 1.0)

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        for name, angle in zip(robot.names, q, strict=True):
            model.set_joint(name, float(angle))
        model.update_kinematics()
        for task, place in zip(tasks, goal.points, strict=True):
            task.target_world = place
        for _ in range(solves):
            solver.solve(True)
            model.update_kinematics()
        return np.array([model.get_joint(name) for name in robot.names])

    return solve
