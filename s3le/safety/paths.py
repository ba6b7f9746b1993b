"""The paths between poses, certified: what `certificate` is to poses, this is to motions.

Between two consecutive poses the joints move straight, or, where speeds are told with the poses, on
the cubic that meets both (safety/curve.py). `certify` proves that every watched pair
keeps `margin_between` on the whole of that path, or names a pose on it that does not, or, when its
budget is spent, says that it does not know, which is never taken for a yes. The proof itself is
that of kernels/segment.py. It speaks of clearance alone: that the poses keep `margin` and their
limits is for s3le.robot.certificate, and as limits are a box, a path between two poses within them
stays within them.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels.threads import workers
from s3le.robot.robot import Robot
from s3le.safety import curve, rest, segment
from s3le.safety.segment import CERTIFIED, COLLIDES, UNDECIDED  # noqa: F401  of Segments.status
from s3le.safety.swept import swept

BUDGET = 200  # poses looked at between two given ones; benchmarks/segments.py needed 23 at most
CHUNK = 64  # segments a worker takes at a time


class Segments(NamedTuple):
    """What is known of the paths between consecutive poses, one entry a path."""

    status: np.ndarray  # uint8 (n,), CERTIFIED, COLLIDES or UNDECIDED; only the first is a yes
    bound: np.ndarray  # [m], (n,), proven lower bound of the clearance on the path; NaN: none
    until: np.ndarray  # (n,), share of the path, from its start, that is proven to keep the margin
    t: np.ndarray  # (n,), where on it a pose collides, 0 to 1; the first does by then. NaN: none
    pair: np.ndarray  # int64 (n,), row of the watched pair that is closest there; -1: none
    clearance: np.ndarray  # [m], (n,), signed distance of that pair there; NaN: none
    used: np.ndarray  # int64 (n,), poses looked at between the ends


def certify(
    robot: Robot,
    q: np.ndarray,
    margin_between: float,
    budget: int = BUDGET,
    progress: Callable[[int], object] | None = None,
    time: np.ndarray | None = None,
    v: np.ndarray | None = None,
) -> Segments:
    """Prove the joint paths between consecutive poses of a trajectory.

    A path with an end that is not finite is UNDECIDED. The result does not depend on how many
    threads share the work.

    Args:
        robot: whose trajectory it is.
        q: poses [rad], (n, n_dof), n at least 1.
        margin_between: clearance to keep on the paths [m], above 0, at most robot.margin.
        budget: most poses looked at between two ends, at least 0.
        progress: called with numbers of further paths done.
        time, v: when the poses are reached [s], (n,), and how fast [rad/s], (n, n_dof); without
            them the paths are straight.

    Returns:
        Segments of n - 1 paths.

    Raises:
        ParameterError: q has another shape, margin_between or budget is out of its range.
    """
    _check(robot, margin_between, budget)
    chain = robot.chain
    q = np.require(q, float, ["C", "W"])  # one that is read-only would be compiled for anew
    if q.ndim != 2 or q.shape[1] != len(chain.parent) or not len(q):
        raise ParameterError(
            f"a trajectory must have shape (n, {len(chain.parent)}) with n at least 1, "
            f"got {q.shape}"
        )
    n = len(q) - 1
    status, number = np.full(n, UNDECIDED, np.uint8), np.full((n, 4), np.nan)
    pair, used = np.full(n, -1, np.int64), np.zeros(n, np.int64)
    bounds = swept(chain)

    dt, speeds = np.empty(0), np.empty((0, q.shape[1]))
    if v is not None:
        if time is None:
            raise ParameterError("paths of which speeds are told need the times of their rows")
        speeds, dt = np.require(v, float, ["C", "W"]), np.diff(np.asarray(time, float))
        if speeds.shape != q.shape or dt.shape != (n,):
            raise ParameterError(f"speeds {speeds.shape} and times do not fit poses {q.shape}")

    def work(at: slice) -> int:
        rows = slice(at.start, at.stop + 1)
        room = float(margin_between), int(budget), status[at], number[at], pair[at], used[at]
        its = chain, bounds, segment.scratch(chain)
        if len(speeds):
            segment.prove_steps(*its, q[rows], speeds[rows], dt[at], *room)
        else:
            segment.prove_rows(*its, q[rows], *room)
        return at.stop - at.start

    slices = [slice(i, min(i + CHUNK, n)) for i in range(0, n, CHUNK)]
    with ThreadPoolExecutor(workers()) as pool:
        # The first one in this thread, so that it is compiled once.
        for done in (*map(work, slices[:1]), *pool.map(work, slices[1:])):
            if progress:
                progress(done)
    bound, until, t, clearance = number.T
    return Segments(status, bound, until, t, pair, clearance, used)


def sampled(
    time: np.ndarray, q: np.ndarray, v: np.ndarray, left: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angles and speeds at moments of a motion that is told by rows of both, (k, n_dof) each.

    Args:
        time, q, v: the rows [s], (n,), [rad], [rad/s], (n, n_dof).
        left: row that each moment comes after, or is, int (k,), at most n - 2.
        at: the moments [s], (k,).
    """
    q, v = np.require(q, float, ["C", "W"]), np.require(v, float, ["C", "W"])
    found = np.empty((2, len(at), q.shape[1]))
    left, at = np.ascontiguousarray(left, np.int64), np.ascontiguousarray(at, float)
    curve.sample(q, v, np.array(time, float), left, at, found[0], found[1])
    return found[0], found[1]


def grid_of(steps: np.ndarray) -> float:
    """Duration of the steps of a motion to rest [s]: the median of a motion's own, (m,)."""
    return float(np.median(steps)) if len(steps) else 1.0


def rests(
    robot: Robot,
    time: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    acceleration: np.ndarray,
    margin_between: float,
    budget: int = BUDGET,
) -> np.ndarray:
    """Has the robot a proven way to rest from each row? bool (n,).

    Args:
        robot: whose trajectory it is; its margin is kept by the rows of that way.
        time, q, v: when [s], (n,), where [rad] and how fast [rad/s] it is, (n, n_dof).
        acceleration: with which each joint may brake [rad/s^2], (n_dof,).
        margin_between, budget: see certify.
    """
    _check(robot, margin_between, budget)
    chain, n = robot.chain, len(q)
    q, v = np.require(q, float, ["C", "W"]), np.require(v, float, ["C", "W"])
    dt, good = np.full(n, grid_of(np.diff(time))), np.zeros(n, np.bool_)
    bounds, hardest = swept(chain), np.array(acceleration, float)

    def work(at: slice) -> None:
        rest.rests_rows(
            chain, bounds, segment.scratch(chain), q[at], v[at], hardest, dt[at],
            robot.margin, float(margin_between), int(budget), good[at],
        )  # fmt: skip

    slices = [slice(i, min(i + CHUNK, n)) for i in range(0, n, CHUNK)]
    with ThreadPoolExecutor(workers()) as pool:
        for at in slices[:1]:  # in this thread, so that it is compiled once
            work(at)
        list(pool.map(work, slices[1:]))
    return good


def _check(robot: Robot, margin_between: float, budget: int) -> None:
    if not 0.0 < margin_between <= robot.margin:
        raise ParameterError(
            f"margin_between must be above 0 and at most the margin of the poses, "
            f"{robot.margin!r} m, got {margin_between!r}"
        )
    if not budget >= 0:
        raise ParameterError(f"the budget of a proof must be at least 0 poses, got {budget!r}")
