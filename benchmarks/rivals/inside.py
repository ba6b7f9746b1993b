"""mink and pink in this process, for benchmarks that make a few motions with them themselves.

pip install mink==1.3.0 pin-pink==4.4.0 daqp
"""

import importlib
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from plain import Goal
from tasks import plain_of

from s3le.robot.robot import Robot

Solve = Callable[[Goal, np.ndarray], np.ndarray]


class Run(NamedTuple):
    """What one of them made of skeletons."""

    q: np.ndarray  # [rad], (m, n)
    seconds: np.ndarray  # [s], (m,)
    failed: int  # frames without a solution, in which the robot stayed


def followed(
    name: str, robot: Robot, speed: np.ndarray, dt: float, x: np.ndarray, start: np.ndarray,
    **settings: object,
) -> Run:  # fmt: skip
    """Let a solver follow skeletons.

    Args:
        name: mink or pink.
        robot: whose joints.
        speed: limits [rad/s], (n,).
        dt: time from row to row [s].
        x: skeletons, (m, 21).
        start: pose before the first [rad], (n,).
        **settings: as its module in solvers/ has them.
    """
    told = plain_of(robot)
    joints = tuple(
        joint._replace(speed=float(v)) for joint, v in zip(told.joints, speed, strict=True)
    )
    told = told._replace(joints=joints)
    solve: Solve = importlib.import_module(f"solvers.by_{name}").make(told, dt, settings)
    q, rows, seconds, failed = start.copy(), [], [], 0
    for goal in told.goals(x):
        began = time.perf_counter()
        try:
            q = solve(goal, q)
        except Exception as error:  # each library has its own; the count is what is shown
            if not failed:
                print(f"{name}: {type(error).__name__}: {' '.join(str(error).split())[:120]}")
            failed += 1
        seconds.append(time.perf_counter() - began)
        rows.append(q.copy())
    return Run(np.array(rows), np.array(seconds), failed)
