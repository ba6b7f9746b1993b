"""Driving a robot after a plan step by step, each step proven, where the plan does not hold."""

from typing import TYPE_CHECKING

import numpy as np

from s3le.kernels import batch
from s3le.plan import pursue
from s3le.plan.rounds import Aim
from s3le.skeleton import DIM

if TYPE_CHECKING:
    from s3le.plan.whole import Planner


class Drive:
    """One way after a plan; goes on from where it is whenever it is asked to."""

    def __init__(
        self,
        planner: "Planner",
        times: np.ndarray,
        lasts: np.ndarray,
        planned: np.ndarray,
        bones: bool,
        aim: Aim,
        first: int,
        row: int,
    ) -> None:
        """Stand at row first of a plan.

        Args:
            planner: the robot's.
            times: of the rows [s], (m,).
            lasts: time in which the speed changes at each row [s], (m,).
            planned: the plan [rad], (m, n).
            bones: go downhill in what a person sees; False: joint by joint.
            aim: what the plan is near to.
            first: the row; it holds, and so does the step that led to it.
            row: to be driven past before it is on the plan again.
        """
        self._its, self._times, self._lasts, self._planned = planner, times, lasts, planned
        self._bones, self._aim = bones, aim
        self._memory = pursue.memory(planner._joints)
        before, n = times[max(first, 1)] - times[max(first, 1) - 1], planned.shape[1]
        self._v = (planned[first] - planned[first - 1]) / before if first else np.zeros(n)
        self.q = planned.copy()  # [rad], (m, n); beyond the last row as planned
        self.last, self.met = first, False  # row that was driven; is it on the plan again?
        self._row, self._same = row, 0

    def to(self, stop: int) -> None:
        """Drive up to a row, or until two rows from there on are as planned."""
        its, aim = self._its, self._aim
        nothing, out, first = np.zeros((0, self.q.shape[1])), np.zeros(2), self.last + 1
        x = np.zeros((max(stop + 1 - first, 0), DIM if self._bones else 0))
        if self._bones:
            batch._skeletons(its.robot.chain, self._planned[first : stop + 1], x)
        while self.last < stop and not self.met:
            t = self.last + 1
            dt = self._times[t] - self._times[t - 1]
            before = 2.0 * self._lasts[t - 1] - dt if t > 1 else dt  # half of both is what lasts
            pursue.pursue(
                its.robot.chain, its._swept, its._scratch, self._memory, self.q[t - 1], self._v,
                before, dt, its._bounds, its._care, self._planned[t],
                x[t - first], aim.bone, aim.W[min(t, len(aim.W) - 1)],
                nothing, its.robot.anchor, self.q[t], out,
            )  # fmt: skip
            self._v, self.last = (self.q[t] - self.q[t - 1]) / dt, t
            self._same = self._same + 1 if (self.q[t] == self._planned[t]).all() else 0
            self.met = self._same >= 2 and t >= self._row


def ways(
    planner: "Planner",
    times: np.ndarray,
    lasts: np.ndarray,
    planned: np.ndarray,
    aim: Aim,
    first: int,
    row: int,
) -> list[Drive]:
    """The ways after a plan: downhill in what a person sees, if that counts, and joint by joint.

    Going downhill may end on the wrong side of a limb for long; the joints know where they belong.
    """
    return [
        Drive(planner, times, lasts, planned, bones, aim, first, row)
        for bones in ([True, False] if len(aim.x) else [False])
    ]
