"""EmbodiK: prioritised differential inverse kinematics in C++.

Settings: `steps`, of a frame; `share` of the way to the goal that a step goes; `rows`, pairs that
its collision constraint holds apart at once (0: no constraint); `margin` [m], that it is told to
keep; `tuning`, its preset; `damping`; `mode`, of its tasks: MIN_ERROR or SCALE; `accelerations`,
its limit of these.

It reads no capsules, so it is given each as a cylinder and two spheres, which together are the
same body.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import embodik
import numpy as np
from plain import POINTS, Goal, Plain, Writer

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("embodik")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    written = Writer(robot).pieces
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(written.text, encoding="utf-8")
        model = embodik.RobotModel(str(file))
    at = np.array([model.get_joint_config_index(name) for name in robot.names])
    solver = embodik.KinematicsSolver(model)
    solver.dt = dt / int(settings.get("steps", 1))
    solver.enable_position_limits(True)
    solver.enable_velocity_limits(bool(settings.get("speed", True)))
    solver.set_damping(float(settings.get("damping", 1e-3)))
    if settings.get("accelerations"):
        solver.set_acceleration_limits(robot.acceleration[np.argsort(at)])
        solver.enable_acceleration_limits(True)
    if settings.get("rows", 5):
        pairs = _pairs(robot, model.get_collision_geometry_names())
        solver.configure_collision_constraint(
            float(settings.get("margin", robot.margin)), include_pairs=pairs,
            max_constraints=int(settings.get("rows", 5)),
        )  # fmt: skip
        tuning = getattr(embodik.CollisionTuningMode, settings.get("tuning", "PRECISE"))
        solver.set_collision_tuning_mode(tuning)
    mode = settings.get("mode", "MIN_ERROR")
    for role in POINTS:
        task = solver.add_frame_task(role, written.points[role], embodik.TaskType.FRAME_POSITION)
        task.solve_mode = getattr(embodik.TaskSolveMode, mode)
    options = embodik.PositionStepOptions()
    options.max_steps = int(settings.get("steps", 1))
    options.dt = solver.dt
    options.position_gain = float(settings.get("share", 1.0)) / solver.dt
    options.primary_solve_mode = getattr(embodik.TaskSolveMode, mode)

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        full = model.neutral_configuration()
        full[at] = q
        targets = []
        for role, place in zip(POINTS, goal.points, strict=True):
            pose = np.eye(4)
            pose[:3, 3] = place
            targets.append(embodik.TaskTarget(role, pose, options.position_gain, 0.0))
        found = solver.solve_position_step(full, targets, options)
        if found.status in (
            embodik.SolverStatus.INVALID_INPUT, embodik.SolverStatus.NON_FINITE_INPUT,
            embodik.SolverStatus.NUMERICAL_ERROR, embodik.SolverStatus.SHAPE_MISMATCH,
        ):  # fmt: skip
            raise RuntimeError(f"{found.status}: {found.status_message}")
        return np.asarray(found.q_solution)[at].copy()

    return solve


def _pairs(robot: Plain, names: list[str]) -> list[tuple[str, str]]:
    """Pairs of pieces of watched bodies."""
    pieces: dict[int, list[str]] = {}
    for name in names:
        pieces.setdefault(int(name.split("_")[1]), []).append(name)
    return [pair for a, b in robot.watched for pair in product(pieces[a], pieces[b])]
