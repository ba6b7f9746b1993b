"""A retargeter for tests: what the command line asks of one, done plainly.

Every frame is a constrained following from the pose before; the robot goes as far towards it as
its speed allows and a proof exists, in halves, and else holds.
"""

from types import SimpleNamespace

import numpy as np
from worlds import coman

from s3le.following import Follower
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.safety.paths import CERTIFIED, Prover

ROOM = 1e-6  # [m], kept beyond the margin: kernels and coal agree to 1e-7


MODES = {0: "start", 1: "reached", 2: "slowed", 3: "held"}


def follow_by(cls) -> Follower:
    """COMAN, led by one of the retargeters below."""
    return Follower(cls(coman()), MODES)


class Plain:
    """Implements s3le.following.Retargets, and is its own only stream."""

    def __init__(self, robot: Robot, margin_between: float = 0.0005) -> None:
        self.robot, self.settings = robot, SimpleNamespace(between=margin_between)
        self.speed = np.array([joint.velocity for joint in robot.joints])
        self._prover = Prover(robot, margin_between)
        self._q = None

    def start(self, q=None):
        self._q = None if q is None else np.array(q, float)
        return self

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
            return SimpleNamespace(q=want.copy(), mode=0)
        share, mode = self._share(want - here, dt), 3
        for _ in range(6):
            target = np.clip(here + share * (want - here), robot.lower, robot.upper)
            clear = batch.clearances(chain, target[None])[0] >= robot.margin + ROOM
            if clear and self._prover.step(here, target).status == CERTIFIED:
                mode = 1 if share == 1.0 else 2
                self._q = target
                break
            share /= 2
        return SimpleNamespace(q=self._q.copy(), mode=mode)

    def batch(self, x, times):
        self.start()
        steps = np.diff(times, prepend=times[0] - 1 / 30)
        made = [self.step(frame, dt) for frame, dt in zip(x, steps, strict=True)]
        return SimpleNamespace(q=np.array([m.q for m in made]), mode=[m.mode for m in made])

    def _share(self, change, dt):
        moving = np.abs(change) > 0
        if not moving.any():
            return 1.0
        return min(1.0, float((self.speed[moving] * dt / np.abs(change[moving])).min()))


class Reckless(Plain):
    """The same without any guard: it jumps to where the human is."""

    def step(self, x, dt):
        robot = self.robot
        middle = (robot.lower + robot.upper) / 2
        starts = robot.anchor[None, None]
        found = batch.follow(
            self.robot.chain, x[None], starts, middle, 1e-3, self.robot.margin, False
        )
        return SimpleNamespace(q=np.clip(found.q[0], robot.lower, robot.upper), mode=1)
