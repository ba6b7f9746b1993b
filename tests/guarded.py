"""A guard that tests share, who wants impossible things of it, and rows checked by other means."""

from dataclasses import replace
from functools import cache

import numpy as np
from worlds import inside_limits

from s3le.guard import Guard
from s3le.guard.answers import Step
from s3le.guard.guard import SETTINGS
from s3le.kernels import batch
from s3le.plan import limits
from s3le.robot.robot import Robot
from s3le.safety.paths import CERTIFIED, certify

BETWEEN = 0.0005  # [m]
AGREEMENT = 1e-7  # [m], of kernels and coal (test_distance.py)
ROUNDED = 1.0 + 1e-9
RATES = (30.0, 100.0, 250.0)


@cache
def shared(name: str, straight: bool = False) -> Guard:
    return Guard.load(name, settings=replace(SETTINGS, curved=not straight))


def begun(name: str = "coman", q=None, straight: bool = False) -> Guard:
    guard = shared(name, straight)
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


def assert_rows_hold(robot: Robot, start: np.ndarray, rows: list[Step], dt: np.ndarray) -> None:
    """By coal and the proof; nothing that the guard computed is used but its rows.

    From rest before row 0; between rows, and those on the way, each joint is accelerated evenly.
    """
    t, q, v, row_of = [0.0], [start], [np.zeros(len(start))], [-1]
    for number, (row, step) in enumerate(zip(rows, dt, strict=True)):
        now = np.sum(dt[:number])
        for after, at, speed in (*row.via, (step, row.q, row.v)):
            t, q, v = [*t, now + after], [*q, at], [*v, speed]
            row_of.append(number if after == step else -1)
    t, q, v, row_of = np.array(t), np.array(q), np.array(v), np.array(row_of)
    took = np.diff(t)[:, None]
    assert np.abs(np.diff(q, axis=0) - 0.5 * took * (v[1:] + v[:-1])).max() < 1e-9
    most = np.array([j.velocity for j in robot.joints]) * ROUNDED
    a = np.abs(np.diff(v, axis=0)) / took
    assert (np.abs(v) <= most).all()
    assert (a <= limits.limits(robot).acceleration * (1.0 + 1e-6)).all()
    report = robot.certifier().check(q[row_of >= 0])
    assert (report.clearance >= robot.margin)[[row.certified for row in rows]].all()
    assert (report.limit_margin >= 0.0).all()
    assert (certify(robot, q, BETWEEN - AGREEMENT, time=t, v=v).status == CERTIFIED).all()


# --- reasons


def colliding(name: str, seed: int, least: float, most: float) -> np.ndarray:
    """Poses within limits whose clearance lies between two numbers [m]."""
    robot = shared(name).robot
    q = inside_limits(robot, 3000, seed)
    d = batch.clearances(robot.chain, q)
    return q[(d > least) & (d < most)]
