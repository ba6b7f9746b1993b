"""The paths between poses, certified: what `certificate` is to poses, this is to motions.

Between two consecutive poses the joints move straight. `certify` proves that every watched pair
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
from s3le.safety import segment
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
) -> Segments:
    """Prove the straight joint paths between consecutive poses of a trajectory.

    A path with an end that is not finite is UNDECIDED. The result does not depend on how many
    threads share the work.

    Args:
        robot: whose trajectory it is.
        q: poses [rad], (n, n_dof), n at least 1.
        margin_between: clearance to keep on the paths [m], above 0, at most robot.margin.
        budget: most poses looked at between two ends, at least 0.
        progress: called with numbers of further paths done.

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

    def work(at: slice) -> int:
        segment.prove_rows(
            chain, bounds, segment.scratch(chain), q[at.start : at.stop + 1],
            float(margin_between), int(budget), status[at], number[at], pair[at], used[at],
        )  # fmt: skip
        return at.stop - at.start

    slices = [slice(i, min(i + CHUNK, n)) for i in range(0, n, CHUNK)]
    with ThreadPoolExecutor(workers()) as pool:
        # The first one in this thread, so that it is compiled once.
        for done in (*map(work, slices[:1]), *pool.map(work, slices[1:])):
            if progress:
                progress(done)
    bound, until, t, clearance = number.T
    return Segments(status, bound, until, t, pair, clearance, used)


def _check(robot: Robot, margin_between: float, budget: int) -> None:
    if not 0.0 < margin_between <= robot.margin:
        raise ParameterError(
            f"margin_between must be above 0 and at most the margin of the poses, "
            f"{robot.margin!r} m, got {margin_between!r}"
        )
    if not budget >= 0:
        raise ParameterError(f"the budget of a proof must be at least 0 poses, got {budget!r}")
