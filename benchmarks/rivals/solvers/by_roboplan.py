"""roboplan's optimal inverse kinematics (OInK): frame tasks, limits and barriers, in C++.

Settings: `solves`, programs a frame; `closest`, pairs that its self-collision barrier holds apart
(0: no barrier); `gain`, of the barrier; `speed`, its limit of joint speeds; `accelerations`, its
limit of theirs; `task_gain`.
"""

from collections.abc import Callable

import numpy as np
from plain import POINTS, Goal, Plain, Writer
from roboplan.core import CartesianConfiguration, Scene, loadUrdfSceneDescriptionFromXml
from roboplan.optimal_ik import (
    AccelerationLimit,
    FrameTask,
    FrameTaskOptions,
    Oink,
    PositionLimit,
    SelfCollisionBarrier,
    SelfCollisionBarrierOptions,
    VelocityLimit,
)

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("roboplan", "pin", "osqp")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    written, solves = Writer(robot).capsules, int(settings.get("solves", 1))
    scene = Scene("robot", loadUrdfSceneDescriptionFromXml(written.text))
    scene.importSrdf(_srdf(robot, written.bodies))
    at = scene.getJointPositionIndices(robot.names)
    oink = Oink(scene)
    options = FrameTaskOptions(
        position_cost=1.0, orientation_cost=0.0, task_gain=float(settings.get("task_gain", 1.0)),
        lm_damping=float(settings.get("damping", 1e-3)),
    )  # fmt: skip
    tasks = [
        FrameTask(oink, scene, CartesianConfiguration("base", written.points[role], np.eye(4)),
                  options)
        for role in POINTS
    ]  # fmt: skip
    constraints = [PositionLimit(oink, gain=1.0)]
    if settings.get("speed", True):
        constraints.append(VelocityLimit(oink, dt / solves, robot.speed))
    hardest = None
    if settings.get("accelerations"):
        hardest = AccelerationLimit(oink, dt / solves, robot.acceleration)
        constraints.append(hardest)
    barriers = []
    if settings.get("closest", 20):
        barriers.append(
            SelfCollisionBarrier(
                oink, scene, dt / solves,
                SelfCollisionBarrierOptions(
                    n_collision_pairs=int(settings.get("closest", 20)),
                    gain=float(settings.get("gain", 20.0)), safe_displacement_gain=0.0,
                    d_min=robot.margin,
                ),
            )
        )  # fmt: skip
    step = np.zeros(oink.num_variables)

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        full = scene.getCurrentJointPositions()
        full[at] = q
        scene.setJointPositions(full)
        for task, place in zip(tasks, goal.points, strict=True):
            pose = np.eye(4)
            pose[:3, 3] = place
            task.setTargetFrameTransform(np.asfortranarray(pose))
        for _ in range(solves):
            try:
                oink.solveIk(scene, tasks, constraints, barriers, step, 1e-6)
            except Exception:
                if hardest:  # the robot stays where it is
                    hardest.reset()
                raise
            full = scene.integrate(full, step)
            scene.setJointPositions(full)
            if hardest:
                hardest.setLastVelocity(step * solves / dt)
        return full[at].copy()

    return solve


def _srdf(robot: Plain, bodies: tuple[str, ...]) -> str:
    """All joints as a group; pairs that are not watched may touch."""
    watched = {frozenset(pair) for pair in robot.watched}
    lines = [
        f'<disable_collisions link1="{bodies[a]}" link2="{bodies[b]}" reason="not watched"/>'
        for a in range(len(bodies))
        for b in range(a + 1, len(bodies))
        if frozenset((a, b)) not in watched
    ]
    joints = "".join(f'<joint name="{name}"/>' for name in robot.names)
    group = f'<group name="all">{joints}</group>'
    return "\n".join([f'<robot name="{robot.name}">', group, *lines, "</robot>"])
