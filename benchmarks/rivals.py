"""The same clip by the retargeter and by per-frame constrained inverse kinematics: mink and pink.

    pip install mink==1.3.0 pin-pink==4.4.0 daqp
    python benchmarks/rivals.py [--clip FILE] [--folder data/retargeter] [--frames 1000]

mink and pink follow six points (shoulders, elbows, hands) that lie along the human's seven
vectors at the robot's own bone lengths, with joint limits, speed limits and their collision limits
on (mink: all watched pairs; pink: the closest 20), one quadratic program a frame or ten. Each
starts where the retargeter does. Nothing is asserted; one core, times are those of this machine.
Poses count as colliding, and the paths between them as not proven, by the same measures for all.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from tuple_cost import one_core

sys.path.append(str(Path(__file__).parent / "judge"))
from engines import spec_of  # noqa: E402

from s3le.human.skeletons import read_frames
from s3le.kernels import batch  # noqa: E402
from s3le.retarget import Retargeter  # noqa: E402
from s3le.retarget.follow import follow  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.safety import paths  # noqa: E402
from s3le.skeleton import cosine_distance  # noqa: E402

POINTS = ("r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand")
FOLLOWS = {  # point -> the point that its bone starts at, and the bone's row in a skeleton
    "r_shoulder": ("neck", 1), "r_elbow": ("r_shoulder", 2), "r_hand": ("r_elbow", 3),
    "l_shoulder": ("neck", 4), "l_elbow": ("l_shoulder", 5), "l_hand": ("l_elbow", 6),
}  # fmt: skip
CLOSEST = 20  # pairs that pink's barrier holds apart
DETECTED = 0.05  # [m], from where on mink's limit looks at a pair


class Run(NamedTuple):
    """What one way of retargeting made of the clip."""

    name: str
    q: np.ndarray  # [rad], (n, n_dof)
    seconds: np.ndarray  # [s], (n,)
    failed: int  # frames without a solution, in which the robot stayed


Solve = Callable[[np.ndarray, np.ndarray], np.ndarray]  # targets (6, 3) [m], pose -> pose


def main(
    clip: Annotated[Path | None, typer.Option(help="motion file; none: frames of demo")] = None,
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    frames: Annotated[int, typer.Option(help="most frames")] = 1000,
    rate: Annotated[float, typer.Option(help="frames per second [Hz]")] = 30.0,
) -> None:
    """Print the table."""
    it = Retargeter.load(folder)
    robot = it.robot
    if clip is None:
        clip = sorted(Path("data/clips").glob("*/test/*"))[0]
    given = read_frames(clip, robot.neck, rate=rate)
    x, times = given.x[:frames], given.time[:frames]
    print(
        f"{robot.name}, {given.name}, {len(x)} frames at {rate:g} Hz, "
        f"{len(robot.watched)} pairs, joints at most {it.speed.max():g} rad/s"
    )
    print(
        f"{'':34}{'us a frame':>11}{'p99':>8}{'to human':>10}{'p95':>8}{'collide':>9}"
        f"{'< margin':>9}{'paths not proven':>17}{'too fast':>9}{'failed':>7}"
    )
    with one_core():
        ours = _ours(it, x, times)
        _say(it, ours, x, times)
        for name, solve in _rivals(robot, 1.0 / rate, it.speed):
            _say(it, followed(name, solve, robot, x, ours.q[0]), x, times)


def _ours(it: Retargeter, x: np.ndarray, times: np.ndarray) -> Run:
    made = follow(it, x, times)
    return Run("s3le: look up, refine, certify", made.q, made.seconds, 0)


def followed(name: str, solve: Solve, robot: Robot, x: np.ndarray, start: np.ndarray) -> Run:
    """What a solver makes of skeletons x (n, 21), from a pose [rad] on."""
    q, rows, seconds, failed = start.copy(), [], [], 0
    goals = targets(robot, x)
    for goal in goals:
        began = time.perf_counter()
        try:
            q = solve(goal, q)
        except Exception as error:  # each library has its own; the count is what is shown
            if not failed:
                print(f"{name}: {type(error).__name__}: {' '.join(str(error).split())[:120]}")
            failed += 1
        seconds.append(time.perf_counter() - began)
        rows.append(q.copy())
    return Run(name, np.array(rows), np.array(seconds), failed)


def targets(robot: Robot, x: np.ndarray) -> np.ndarray:
    """Where the six points are to be [m], in the robot's base frame, (n, 6, 3)."""
    at = _points(robot)
    at["neck"] = 0.5 * (at["r_shoulder"] + at["l_shoulder"])
    u = x.reshape(-1, 7, 3) @ robot.base_rotation  # into the base frame
    found = {"neck": at["hip"] + np.linalg.norm(at["neck"] - at["hip"]) * u[:, 0]}
    for name, (before, bone) in FOLLOWS.items():
        length = np.linalg.norm(at[name] - at[before])
        found[name] = found[before] + length * u[:, bone]
    return np.stack([found[name] for name in POINTS], axis=1)


def _points(robot: Robot) -> dict[str, np.ndarray]:
    """The points at the anchor [m], in the base frame, by pinocchio."""
    import pinocchio as pin

    model, _ = robot.reduced()
    data = model.createData()
    pin.forwardKinematics(model, data, robot.anchor)
    return {
        role: data.oMi[point.joint + 1].act(point.offset) for role, point in robot.points.items()
    }


def _rivals(robot: Robot, dt: float, speed: np.ndarray) -> Iterator[tuple[str, Solve]]:
    """Those that are installed."""
    for name, make in (("mink", mink_solver), ("pink", pink_solver)):
        for solves in (1, 10):
            try:
                solve = make(robot, dt, speed, solves)
            except ModuleNotFoundError as error:
                print(f"{name}: not installed ({error.name}); see the top of this file")
                break
            yield f"{name}, collision limit, {solves} a frame", solve


def mink_solver(robot: Robot, dt: float, speed: np.ndarray, solves: int) -> Solve:
    """By mink; speed: limits [rad/s], (n,); solves: quadratic programs in dt [s]."""
    import mink

    spec = spec_of(robot)
    for joint in list(spec.joints):
        if joint.name not in robot.joint_names:
            spec.delete(joint)
    for name in POINTS:
        point = robot.points[name]
        spec.joint(robot.joint_names[point.joint]).parent.add_site(name=name, pos=point.offset)
    model = spec.compile()
    at = np.array([model.joint(name).qposadr[0] for name in robot.joint_names])
    bodies = [[body.name] for body in robot.bodies]
    tasks = [mink.FrameTask(name, "site", 1.0, 0.0, lm_damping=1e-3) for name in POINTS]
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict(zip(robot.joint_names, speed.tolist(), strict=True))),
        mink.CollisionAvoidanceLimit(
            model,
            [(bodies[a], bodies[b]) for a, b in robot.watched],
            minimum_distance_from_collisions=robot.margin,
            collision_detection_distance=DETECTED,
        ),
    ]
    configuration = mink.Configuration(model)

    def solve(goal: np.ndarray, q: np.ndarray) -> np.ndarray:
        full = np.zeros(model.nq)
        full[at] = q
        configuration.update(full)
        for task, place in zip(tasks, goal, strict=True):
            task.set_target(mink.SE3.from_translation(place))
        for _ in range(solves):
            v = mink.solve_ik(configuration, tasks, dt / solves, "daqp", 1e-6, limits=limits)
            configuration.integrate_inplace(v, dt / solves)
        return configuration.q[at].copy()

    return solve


def pink_solver(robot: Robot, dt: float, speed: np.ndarray, solves: int) -> Solve:
    """By pink; see mink_solver."""
    import pink
    import pinocchio as pin
    from pink.barriers import SelfCollisionBarrier

    model, geometry = robot.reduced()
    model.velocityLimit = speed.copy()
    number = {item.name: i for i, item in enumerate(geometry.geometryObjects)}
    for a, b in robot.watched:
        names = robot.bodies[a].name, robot.bodies[b].name
        geometry.addCollisionPair(pin.CollisionPair(*(number[name] for name in names)))
    for name in POINTS:
        point = robot.points[name]
        place = pin.SE3(np.eye(3), np.array(point.offset))
        model.addFrame(pin.Frame(name, point.joint + 1, place, pin.FrameType.OP_FRAME))
    data, collisions = model.createData(), pin.GeometryData(geometry)
    tasks = [pink.tasks.FrameTask(name, 1.0, 0.0, lm_damping=1e-3) for name in POINTS]
    barrier = SelfCollisionBarrier(
        min(CLOSEST, len(robot.watched)),
        gain=20.0,
        safe_displacement_gain=0.0,  # its default pulls the robot away from the human
        d_min=robot.margin,
    )

    def solve(goal: np.ndarray, q: np.ndarray) -> np.ndarray:
        at = pink.Configuration(model, data, q, True, True, geometry, collisions)
        for task, place in zip(tasks, goal, strict=True):
            task.set_target(pin.SE3(np.eye(3), place))
        for _ in range(solves):
            v = pink.solve_ik(
                at, tasks, dt / solves, "daqp", 1e-6, barriers=[barrier], safety_break=False
            )
            at.integrate_inplace(v, dt / solves)
        return at.q.copy()

    return solve


def _say(it: Retargeter, run: Run, x: np.ndarray, times: np.ndarray) -> None:
    robot = it.robot
    far = cosine_distance(batch.skeletons(robot.chain, run.q), x)
    clearance = batch.clearances(robot.chain, run.q)
    proven = paths.certify(robot, run.q, it.settings.between)
    fast = (np.abs(np.diff(run.q, axis=0)) > it.speed * np.diff(times)[:, None] + 1e-9).any(axis=1)
    p50, p99 = np.quantile(run.seconds, [0.5, 0.99]) * 1e6
    print(
        f"{run.name:34}{p50:11.0f}{p99:8.0f}{far.mean():10.4f}{np.quantile(far, 0.95):8.3f}"
        f"{np.mean(clearance < 0.0):9.1%}{np.mean(clearance < robot.margin):9.1%}"
        f"{np.mean(proven.status != paths.CERTIFIED):17.1%}{fast.mean():9.1%}{run.failed:7d}",
        flush=True,
    )


if __name__ == "__main__":
    typer.run(main)
