"""mink: differential inverse kinematics on MuJoCo, one quadratic program a step.

Settings: `solves`, programs a frame; `collisions`, its collision limit on all watched pairs;
`speed`, its limit of joint speeds; `gain`, of the collision limit; `posture`, cost of staying near
the anchor; `detected` [m], from where on a pair is looked at.
"""

from collections.abc import Callable

import mink
import mujoco
import numpy as np
from plain import POINTS, Goal, Plain, capsule_places

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("mink", "mujoco", "daqp", "qpsolvers")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    solves = int(settings.get("solves", 1))
    model = model_of(robot)
    tasks = [mink.FrameTask(name, "site", 1.0, 0.0, lm_damping=1e-3) for name in POINTS]
    if settings.get("posture"):
        stay = mink.PostureTask(model, settings["posture"])
        stay.set_target(robot.anchor)
        tasks.append(stay)
    limits = [mink.ConfigurationLimit(model)]
    if settings.get("speed", True):
        limits.append(
            mink.VelocityLimit(model, dict(zip(robot.names, robot.speed.tolist(), strict=True)))
        )
    if settings.get("collisions", True):
        pairs = [([f"body_{a}"], [f"body_{b}"]) for a, b in robot.watched]
        limits.append(
            mink.CollisionAvoidanceLimit(
                model, pairs, gain=float(settings.get("gain", 0.85)),
                minimum_distance_from_collisions=robot.margin,
                collision_detection_distance=float(settings.get("detected", 0.05)),
            )
        )  # fmt: skip
    configuration = mink.Configuration(model)

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        configuration.update(q)
        for task, place in zip(tasks, goal.points, strict=False):
            task.set_target(mink.SE3.from_translation(place))
        for _ in range(solves):
            v = mink.solve_ik(configuration, tasks, dt / solves, "daqp", 1e-6, limits=limits)
            configuration.integrate_inplace(v, dt / solves)
        return configuration.q.copy()

    return solve


def model_of(robot: Plain) -> mujoco.MjModel:
    """MuJoCo's model of the robot, its capsules as they are."""
    spec = mujoco.MjSpec()
    carriers = []
    for i, joint in enumerate(robot.joints):
        up = spec.worldbody if joint.parent < 0 else carriers[joint.parent]
        body = up.add_body(name=f"link_{i}", pos=joint.translation, quat=_quat(joint.rotation))
        body.mass, body.inertia, body.explicitinertial = 0.1, [1e-3] * 3, True
        body.add_joint(
            name=joint.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=joint.axis,
            limited=True, range=[joint.lower, joint.upper],
        )  # fmt: skip
        carriers.append(body)
    for i, (body, (middle, turn, half)) in enumerate(
        zip(robot.bodies, capsule_places(robot), strict=True)
    ):
        carrier = spec.worldbody if body.joint < 0 else carriers[body.joint]
        long = half > 1e-9
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE if long else mujoco.mjtGeom.mjGEOM_SPHERE
        carrier.add_geom(
            name=f"body_{i}", type=kind, pos=middle, quat=_quat(turn), mass=0.0,
            size=[body.radius, half if long else 0.0, 0.0],
        )  # fmt: skip
    for role in POINTS:
        place = robot.points[role]
        carrier = spec.worldbody if place.joint < 0 else carriers[place.joint]
        carrier.add_site(name=role, pos=place.offset)
    spec.compiler.degree = False
    return spec.compile()


def _quat(turn: np.ndarray) -> np.ndarray:
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, turn.ravel())
    return found
