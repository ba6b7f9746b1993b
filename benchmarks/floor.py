"""How little a pose has to move to be clear, with all the time in the world: a floor under a guard.

The pose nearest to a wanted one that keeps the margin, whatever went before and comes after. Near
is the angle of the joint that moves most (`weight` None), or a weighted sum of squares. Sequential
quadratic programs with daqp from several starts: the best local optimum that was found. What no
motion can undercut is `least`: a pair that lacks clearance needs its joints to turn so far at
least, whatever way they turn, by the lengths of the links between. `in_time` leaves bodies out
instead: a motion within the limits in time that goes as little as possible beyond a distance.
"""

from collections.abc import Sequence

import daqp
import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from s3le.kernels import distance, kinematics, solver
from s3le.plan import limits
from s3le.plan.limits import Limits
from s3le.robot.robot import Robot
from s3le.safety.judge import reaches

STEPS, RADIUS = 16, 0.15  # of a search; [rad] of its first steps
BAND = 0.1  # [m], pairs farther apart than the margin and this are left out
BEYOND = 1e-6  # [m], asked for beyond the margin, for rounding
_TIE = 1e-4  # weight of the sum of squares beside the square of the joint that moves most


class Floor:
    """Nearest clear poses of one robot."""

    def __init__(self, robot: Robot) -> None:
        """Take note of the robot's sizes."""
        self.robot, self._balls = robot, distance.reach(robot.chain)
        reach = reaches(robot)
        a, b = reach[robot.watched.T]
        # By how much a pair can come nearer if every joint turns by one radian [m], (pairs,).
        self._lever = np.where((a > 0) != (b > 0), np.maximum(a, b), 0.0).sum(axis=1)

    def least(self, lacks: np.ndarray) -> np.ndarray:
        """What some joint must turn at least [rad], (m,), of clearances that pairs lack.

        Args:
            lacks: margin less clearance, of every watched pair [m], (m, pairs).
        """
        return np.maximum(lacks / self._lever, 0.0).max(axis=1)

    def nearest(
        self, wanted: np.ndarray, starts: Sequence[np.ndarray], weight: np.ndarray | None = None
    ) -> np.ndarray:
        """The clear pose nearest to a wanted one that was found [rad], (n,).

        Args:
            wanted: [rad], (n,).
            starts: where searches begin; one that is clear is no worse than the result.
            weight: (n, n) of the joints' squares; None: the joint that moves most counts.

        Raises:
            ValueError: none was found; a clear start always is.
        """
        best, least = None, np.inf
        for start in starts:
            q, radius = np.clip(start, self.robot.lower, self.robot.upper), RADIUS
            for turn in range(STEPS + 1):
                cost = _cost(q - wanted, weight)
                if cost < least and self._clear(q):
                    best, least = q, cost
                step = None if turn == STEPS else self._step(q, wanted, weight, radius)
                if step is None or np.abs(step).max() < 1e-6:
                    break
                q = np.clip(q + step, self.robot.lower, self.robot.upper)
                radius *= 1.0 if turn < STEPS // 2 else 0.6
        if best is None:
            raise ValueError("no clear pose was found")
        return best

    def _clear(self, q: np.ndarray) -> bool:
        found = solver.clearance_of(self.robot.chain, self._balls, q)
        return bool(found >= self.robot.margin)

    def _step(self, q, wanted, weight, radius) -> np.ndarray | None:
        """The step that the linearised distances allow, or as much of it as there is."""
        n, robot = len(q), self.robot
        d, G = self._pairs(q)
        gap = robot.margin + BEYOND - d
        lower = np.maximum(robot.lower - q, -radius)
        upper = np.minimum(robot.upper - q, radius)
        off = q - wanted
        if weight is None:  # one more unknown: the angle of the joint that moves most
            H, f = np.diag(np.r_[np.full(n, _TIE), 1.0]), np.r_[_TIE * off, 0.0]
            rows = np.zeros((len(d) + 2 * n, n + 1))
            rows[: len(d), :n] = G
            rows[len(d) : len(d) + n, :n] = rows[len(d) + n :, :n] = np.eye(n)
            rows[len(d) : len(d) + n, n], rows[len(d) + n :, n] = 1.0, -1.0
            most = np.full(2 * n, 1e30)
            most[n:] = -off
            least = np.r_[-off, np.full(n, -1e30)]
            lower, upper = np.r_[lower, 0.0], np.r_[upper, 1e30]
        else:
            H, f, rows = np.array(weight, float), weight @ off, G
            least, most = np.empty(0), np.empty(0)
        for share in (1.0, 0.5, 0.2, 0.05):
            asked = np.where(gap > 0.0, gap * share, gap)
            x, _, flag, _ = daqp.solve(
                H, f, np.ascontiguousarray(rows),
                np.r_[upper, np.full(len(d), 1e30), most], np.r_[lower, asked, least],
                np.zeros(len(lower) + len(rows), np.int32),
            )  # fmt: skip
            if flag > 0:
                return np.array(x)[:n]
        return None

    def _pairs(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chain, n = self.robot.chain, len(q)
        R, p, z = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
        ends = np.empty((len(chain.body_frame), 3, 3))
        d, G = np.empty(len(chain.pair)), np.empty((len(chain.pair), n))
        kinematics.place(chain, q, R, p, z)
        distance.place_capsules(chain, R, p, ends)
        k = distance.near_pairs(chain, ends, self._balls, p, z, self.robot.margin + BAND, d, G)
        return d[:k].copy(), G[:k].copy()


def in_time(time: np.ndarray, wanted: np.ndarray, most: Limits, free: float = 0.0) -> np.ndarray:
    """The motion within range, speeds and accelerations nearest to a wanted one [rad], (m, n).

    Each joint by a linear program: least sum of distances beyond `free` [rad], which cost nothing.
    Bodies are not looked at.
    """
    m = len(time)
    rate = sparse.diags([-1.0, 1.0], [0, 1], (m - 1, m), "csr") / np.diff(time)[:, None]
    rate = sparse.csr_matrix(rate)
    mean = 0.5 * (np.diff(time)[1:] + np.diff(time)[:-1])
    change = sparse.csr_matrix((rate[1:] - rate[:-1]).multiply(1.0 / mean[:, None]))
    one, none = sparse.identity(m), sparse.csr_matrix((m - 1, m))
    out = wanted.clip(most.lower, most.upper)
    for j in range(wanted.shape[1]):
        if not limits.broken(time, wanted, _only(most, j)).any():
            continue
        both = [[one, -one], [-one, -one]]
        ends = [wanted[:, j] + free, free - wanted[:, j]]
        for rows, limit in ((rate, most.speed[j]), (change, most.acceleration[j])):
            if np.isfinite(limit):
                k = rows.shape[0]
                both += [[rows, none[:k]], [-rows, none[:k]]]
                ends += [np.full(k, limit)] * 2
        found = linprog(
            np.r_[np.zeros(m), np.ones(m)], sparse.bmat(both, "csr"), np.concatenate(ends),
            bounds=[(most.lower[j], most.upper[j])] * m + [(0.0, None)] * m, method="highs",
        )  # fmt: skip
        if found.status:
            raise ValueError(f"joint {j}: {found.message}")
        out[:, j] = found.x[:m]
    return out


def _only(most: Limits, j: int) -> Limits:
    """The limits of one joint alone."""
    free = np.arange(len(most.speed)) != j
    return Limits(
        np.where(free, -np.inf, most.lower), np.where(free, np.inf, most.upper),
        np.where(free, np.inf, most.speed), np.where(free, np.inf, most.acceleration),
    )  # fmt: skip


def _cost(off: np.ndarray, weight: np.ndarray | None) -> float:
    return float(np.abs(off).max()) if weight is None else float(off @ weight @ off)
