"""pink: differential inverse kinematics on pinocchio, one quadratic program a step.

Settings: `solves`, programs a frame; `closest`, pairs that its self-collision barrier holds apart
(0: no barrier); `gain`, of the barrier; `speed`, its limit of joint speeds; `accelerations`, its
limit of theirs; `posture`, cost of staying near the anchor.
"""

from collections.abc import Callable

import coal
import numpy as np
import pink
import pinocchio as pin
from pink.barriers import SelfCollisionBarrier
from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit
from plain import POINTS, Goal, Plain, Writer, capsule_places

from solvers import versions

FREE = 1e3  # [rad/s], a limit that is none


def about() -> dict[str, str]:
    """Versions."""
    return versions("pin-pink", "pin", "coal", "daqp", "qpsolvers")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    solves, closest = int(settings.get("solves", 1)), int(settings.get("closest", 20))
    model, geometry, names = model_of(robot, bool(settings.get("speed", True)))
    data, collisions = model.createData(), pin.GeometryData(geometry)
    tasks = [
        pink.tasks.FrameTask(names[name], 1.0, 0.0, lm_damping=settings.get("damping", 1e-3))
        for name in POINTS
    ]
    stay = []
    if settings.get("posture"):
        stay = [pink.tasks.PostureTask(cost=settings["posture"])]
        stay[0].set_target(robot.anchor)
    barriers = []
    if closest:
        barriers = [
            SelfCollisionBarrier(
                min(closest, len(robot.watched)), gain=float(settings.get("gain", 20.0)),
                safe_displacement_gain=0.0,  # its default pulls the robot away from the human
                d_min=robot.margin,
            )
        ]  # fmt: skip
    limits, hardest = None, None  # None: of places and speeds
    if settings.get("accelerations"):
        hardest = AccelerationLimit(model, robot.acceleration)
        limits = [ConfigurationLimit(model), VelocityLimit(model), hardest]
    step = dt / solves

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        at = pink.Configuration(model, data, q, True, True, geometry, collisions)
        for task, place in zip(tasks, goal.points, strict=True):
            task.set_target(pin.SE3(np.eye(3), place))
        for _ in range(solves):
            try:
                v = pink.solve_ik(
                    at, [*tasks, *stay], step, "daqp", 1e-6, limits=limits, barriers=barriers,
                    safety_break=False,
                )  # fmt: skip
            except Exception:
                if hardest:  # the robot stays where it is
                    hardest.set_last_integration(np.zeros(model.nv), step)
                raise
            at.integrate_inplace(v, step)
            if hardest:
                hardest.set_last_integration(v, step)
        return at.q.copy()

    return solve


def model_of(
    robot: Plain, speed: bool = True
) -> tuple[pin.Model, pin.GeometryModel, dict[str, str]]:
    """Pinocchio's model, its capsules with the watched pairs, and the frames of points."""
    written = Writer(robot).bare
    model = pin.buildModelFromXML(written.text)
    if model.names.tolist()[1:] != robot.names:
        raise ValueError("pinocchio puts the joints in another order")
    model.velocityLimit = robot.speed.copy() if speed else np.full(model.nv, FREE)
    geometry = pin.GeometryModel()
    for i, (body, (middle, turn, half)) in enumerate(
        zip(robot.bodies, capsule_places(robot), strict=True)
    ):
        shape = coal.Capsule(body.radius, 2.0 * half)
        geometry.addGeometryObject(
            pin.GeometryObject(f"body_{i}", body.joint + 1, pin.SE3(turn, middle), shape)
        )
    for a, b in robot.watched:
        geometry.addCollisionPair(pin.CollisionPair(a, b))
    return model, geometry, written.points
