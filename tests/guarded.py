"""A guard that tests share, who wants impossible things of it, and rows checked by other means."""

from functools import cache

import numpy as np
from worlds import inside_limits

from s3le.guard import Guard
from s3le.kernels import batch
from s3le.plan import limits
from s3le.robot.robot import Robot
from s3le.safety.paths import CERTIFIED, certify

BETWEEN = 0.0005  # [m]
AGREEMENT = 1e-7  # [m], of kernels and coal (test_distance.py)
ROUNDED = 1.0 + 1e-9
RATES = (30.0, 100.0, 250.0)


@cache
def shared(name: str) -> Guard:
    return Guard.load(name)


def begun(name: str = "coman", q=None) -> Guard:
    guard = shared(name)
    guard.start(q)
    return guard


def adversary(guard: Guard, m: int, rate: float, seed: int) -> np.ndarray:
    """Jumps to any pose and beyond limits, swings through the body, and poses that stand still."""
    robot, rng = guard.robot, np.random.default_rng(seed)
    n, t = robot.n_dof, np.arange(m)[:, None] / rate
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    swings = middle + 1.1 * half * np.sin(
        2.0 * np.pi * rng.uniform(0.1, 1.5, n) * t + rng.uniform(0.0, 6.28, n)
    )
    jumps = rng.uniform(robot.lower - 0.5, robot.upper + 0.5, (m, n))
    hold = max(int(rate / 4), 1)
    jumps = np.repeat(jumps[::hold], hold, axis=0)[:m]
    return np.where((np.arange(m) // (2 * hold) % 2 == 0)[:, None], jumps, swings)


def driven(guard: Guard, wanted: np.ndarray, dt: np.ndarray) -> tuple[np.ndarray, list]:
    rows = [guard.step(q, one) for q, one in zip(wanted, dt, strict=True)]
    return np.array([row.q for row in rows]), rows


def assert_rows_hold(
    robot: Robot, start: np.ndarray, q: np.ndarray, dt: np.ndarray, certified: np.ndarray
) -> None:
    """By differences, coal and the proof; nothing that the guard computed is used.

    Speed and acceleration of a row are those of the step that ends there, from rest before row 0.
    """
    q = np.vstack([start, q])
    speed = np.array([j.velocity for j in robot.joints])
    v = np.diff(q, axis=0) / dt[:, None]
    before = np.concatenate([dt[:1], dt[:-1]])
    a = np.diff(np.vstack([np.zeros(len(start)), v]), axis=0) / (0.5 * (before + dt))[:, None]
    assert (np.abs(v) <= speed * ROUNDED)[certified].all()
    assert (np.abs(a) <= limits.limits(robot).acceleration * ROUNDED)[certified].all()
    report = robot.certifier().check(q[1:])
    assert (report.clearance >= robot.margin).all() and (report.limit_margin >= 0.0).all()
    assert (certify(robot, q, BETWEEN).status == CERTIFIED).all()


# --- reasons


def colliding(name: str, seed: int, least: float, most: float) -> np.ndarray:
    """Poses within limits whose clearance lies between two numbers [m]."""
    robot = shared(name).robot
    q = inside_limits(robot, 3000, seed)
    d = batch.clearances(robot.chain, q)
    return q[(d > least) & (d < most)]
