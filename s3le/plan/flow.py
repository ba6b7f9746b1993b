"""Whole motions whose speed is continuous: wanted positions to rows of position and speed.

    planner = Flow(robot, limits(robot), Settings(curved=True))
    made = planner.plan(times, wanted, skeleton=True)   # made.q, made.v

It plans control points (s3le/plan/curved.py), of which there is one between each two rows and one
beyond either end, as whole.Planner plans rows. What holds is the curve: each row keeps the margin
and has a proven way to rest, and each parabola between two is proven.
"""

import numpy as np

from s3le.errors import ParameterError
from s3le.plan import curved, rounds
from s3le.plan.examine import Plan, origin
from s3le.plan.limits import Limits
from s3le.plan.settings import Settings
from s3le.plan.whole import Planner, _Job
from s3le.robot.robot import Robot
from s3le.safety.paths import grid_of
from s3le.types import Progress

_SHARPENED = 6  # so often what rows miss by is added to where control points are wanted


class Flow(Planner):
    """Plans motions of one robot that are told by positions and speeds; one per thread.

    As Planner, but the weights of the joints are one matrix for all rows. Near in the joints are
    the rows themselves: a motion that is smooth already goes through its own.
    """

    def _job(self, times, wanted, skeleton, weight, bone, stands, progress) -> _Job:
        if weight is not None and np.ndim(weight) != 2:
            raise ParameterError("weights of the joints must be one matrix for all rows")
        moments, lasts = control_times(times)
        points = control_points(wanted)
        for _ in range(0 if skeleton else _SHARPENED):
            points += control_points(wanted - rows(points, lasts)[0])
        if stands:
            points[:3] = wanted[0]
        aim = self._aim(moments, points, skeleton, weight, bone)
        return _FlowJob(self, moments, points, aim, stands, progress, lasts)


class _FlowJob(_Job):
    """One motion of control points; row t of it is where the step from t - 1 to t is half done."""

    _after = 2  # a parabola is complete with the control point after it

    def __init__(
        self,
        planner: Planner,
        times: np.ndarray,
        wanted: np.ndarray,
        aim: rounds.Aim,
        stands: bool,
        progress: Progress | None,
        lasts: np.ndarray,
    ) -> None:
        super().__init__(planner, times, wanted, aim, stands, progress)
        self.lasts, self.grid = lasts, grid_of(lasts[1:-1])
        self.given = 3 if stands else 0

    def _examine(self, first: int, last: int) -> None:
        its = self.its
        curved.examine(
            its._chain, its._swept, its._scratch, self.q, self.lasts, self.grid, its._bounds,
            its._care, first, last, self.clearance, self.proven, self.where, self.bound,
        )  # fmt: skip

    def plan(self) -> Plan:
        q, v = self.rows()
        same = (self.q == self.wanted).all(axis=1)
        how = origin(same[:-1] & same[1:], self.driven[1:])
        return Plan(q, how, self.clearance[1:], self.bound[1:], v)

    def _pose(self, row: int) -> np.ndarray:
        return self.rows(max(row - 1, 0), max(row, 1))[0][0]

    def rows(self, first: int = 0, last: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Rows first to last - 1 of the motion: (q [rad], v [rad/s]), (k, n)."""
        part = slice(first, None if last is None else last + 1)
        q, v = rows(self.q[part], self.lasts[part])
        return np.clip(q, self.its.most.lower, self.its.most.upper), v

    def broken(self) -> np.ndarray:
        """Control points that take part in what does not hold."""
        bad = super().broken()
        bad[:-2] |= ~self.proven[2:]
        return bad


def control_times(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """When control points are [s], and how long the parabola about each is [s], (m + 1,).

    Args:
        times: of the rows [s], (m,).
    """
    step = np.diff(times) if len(times) > 1 else np.ones(1)
    lasts = np.concatenate([step[:1], step, step[-1:]]) if len(times) > 1 else np.ones(2)
    return np.concatenate([times - 0.5 * lasts[:-1], times[-1:] + 0.5 * lasts[-1:]]), lasts


def rows(c: np.ndarray, lasts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a motion: (q [rad], v [rad/s]), (m, n).

    Args:
        c: its control points [rad], (m + 1, n).
        lasts: how long the parabola about each is [s], (m + 1,).
    """
    v = np.diff(c, axis=0) / (0.5 * (lasts[1:] + lasts[:-1]))[:, None]
    return c[1:] - 0.5 * lasts[1:, None] * v, v


def calmed(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows of the motion whose control points lie on another, smaller where it bends, (m, n).

    Args:
        times: of the rows [s], (m,).
        wanted: [rad], (m, n).
    """
    return rows(control_points(wanted), control_times(times)[1])[0]


def control_points(wanted: np.ndarray) -> np.ndarray:
    """Where control points are wanted for rows to be where they are wanted [rad], (m + 1, n).

    Midway between two rows, by the cubic through these and the two about them, so that a smooth
    motion is not made smaller; at either end as far beyond as the next one is before.
    """
    if len(wanted) == 1:
        return np.concatenate([wanted, wanted])
    ends = 2.0 * wanted[:1] - wanted[1:2], 2.0 * wanted[-1:] - wanted[-2:-1]
    w = np.concatenate([ends[0], wanted, ends[1]])
    inner = (9.0 * (w[1:-2] + w[2:-1]) - w[:-3] - w[3:]) / 16.0
    first, last = 2.0 * wanted[:1] - inner[:1], 2.0 * wanted[-1:] - inner[-1:]
    return np.concatenate([first, inner, last])


def planner(robot: Robot, most: Limits | None, settings: Settings) -> Planner:
    """A planner whose motions have continuous speeds, if the settings say so."""
    return (Flow if settings.curved else Planner)(robot, most, settings)
