"""A retargeter for tests: what is asked of one, done plainly.

Every frame is a constrained following from the pose before; the robot goes as far towards it as
its speed allows and a proof exists, in halves, and else holds. It comes to rest at every row.
"""

from types import SimpleNamespace

import numpy as np
from worlds import coman

from s3le.kernels import batch, threads
from s3le.plan.limits import limits
from s3le.retarget import stored
from s3le.retarget.follow import frame_by_frame
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter, Step
from s3le.robot.robot import Robot
from s3le.safety.paths import CERTIFIED, certify

ROOM = 1e-6  # [m], kept beyond the margin: kernels and coal agree to 1e-7


def led_by(monkeypatch, cls):
    """COMAN, led by one of the retargeters below, in every folder and without one."""
    made = cls(coman())
    monkeypatch.setattr(stored, "retargeter_for", lambda robot, watch=None, streams=False: made)
    monkeypatch.setattr(Retargeter, "load", lambda folder, method=None: made)
    monkeypatch.setattr(threads, "processors", lambda: 1)  # other processes are led by the real one
    return made


class Plain:
    """Implements s3le.retarget.follow.Follows, and is its own only stream."""

    def __init__(self, robot: Robot | None = None, margin_between: float = 0.0005) -> None:
        self.robot = robot or coman()
        self.settings = SimpleNamespace(between=margin_between, jerk=0.0)
        self.most = limits(self.robot, acceleration=np.inf)
        self.speed = self.most.speed
        self._q = None

    given = ()

    def start(self, q=None, check=None, given=None, given_speed=None):
        self._q = None if q is None else np.array(q, float)
        return self

    def plan(self, x, dt, start=None, progress=None):
        return frame_by_frame(self, x, dt, start, progress)

    def step(self, x, dt):
        robot = self.robot
        chain = robot.chain
        here = robot.anchor if self._q is None else self._q
        middle = (robot.lower + robot.upper) / 2
        starts = np.stack([here, robot.anchor])[None]
        found = batch.follow(chain, x[None], starts, middle, 1e-3, robot.margin + ROOM, True)
        want = found.q[0] if found.feasible[0] else here
        if self._q is None:
            self._q = want
            return self._at(Mode.START)
        share, mode = self._share(want - here, dt), Mode.HELD
        for _ in range(6):
            target = np.clip(here + share * (want - here), robot.lower, robot.upper)
            clear = batch.clearances(chain, target[None])[0] >= robot.margin + ROOM
            path = np.stack([here, target])
            if clear and certify(robot, path, self.settings.between).status[0] == CERTIFIED:
                mode = Mode.REFINED if share == 1.0 else Mode.LIMITED
                self._q = target
                break
            share /= 2
        return self._at(mode)

    def _at(self, mode):
        clearance = float(self.robot.certifier().check(self._q[None]).clearance[0])
        still = np.zeros(self.robot.n_dof)
        return Step(self._q.copy(), mode, clearance, np.nan, np.nan, np.nan, v=still)

    def _share(self, change, dt):
        moving = np.abs(change) > 0
        if not moving.any():
            return 1.0
        # From rest to rest it goes half as fast again in between.
        most = self.speed[moving] * dt / 1.5 * (1.0 - 1e-9)
        return min(1.0, float((most / np.abs(change[moving])).min()))


class Reckless(Plain):
    """The same without any guard: it jumps to where the human is."""

    def step(self, x, dt):
        robot = self.robot
        middle = (robot.lower + robot.upper) / 2
        starts = robot.anchor[None, None]
        found = batch.follow(
            self.robot.chain, x[None], starts, middle, 1e-3, self.robot.margin, False
        )
        q = np.clip(found.q[0], robot.lower, robot.upper)
        still = np.zeros(robot.n_dof)
        return Step(q, Mode.REFINED, np.nan, np.nan, np.nan, np.nan, v=still)
