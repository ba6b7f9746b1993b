"""Why a row is not what was wanted, in words that begin alike."""

import numpy as np

from s3le.plan import causal, why
from s3le.plan.limits import Limits
from s3le.plan.settings import Settings, bounds
from s3le.plan.steps import HOW
from s3le.robot.chain import Chain
from s3le.robot.ranges import origin
from s3le.robot.robot import Robot
from s3le.safety.swept import Swept, swept

AS_WANTED = "as wanted"
SLOWED = "slowed by"  # a joint: its speed or its acceleration
MOVED = "moved away from"  # a body, "against" another
HELD = "held by"  # the same where the robot stands; or "limits of" a joint
BRAKED = "braked"
STOPPED = "stopped"
LEADING_OUT = "leading out"
_STILL = 0.01  # [rad/s], a robot whose joints are all slower stands
_CODE = {word: code for code, word in HOW.items()}


class Reasons:
    """Finds the reasons of one robot's rows."""

    def __init__(
        self,
        robot: Robot,
        most: Limits,
        settings: Settings,
        bodies: tuple[Chain, Swept] | None = None,
    ) -> None:
        """Take note of the robot's names, and compile what a reason needs.

        Args:
            robot, most, settings: of the guard.
            bodies: what its walker keeps apart, Walker.bodies; None: as the robot has them.
        """
        self._chain, moved = bodies or (robot.chain, swept(robot.chain))
        self._balls = moved.balls
        self._bounds, self._target = bounds(most), float(settings.target)
        self._joints = robot.joint_names
        names = [origin(body.name) for body in robot.bodies]
        self._pairs = [f"{names[a]} against {names[b]}" for a, b in robot.watched]
        q, still = robot.anchor, np.zeros(robot.n_dof)
        self.of("limited", q, still, 0.02, 0.02, q + 9.0, q)

    def of(
        self,
        how: str,
        q: np.ndarray,
        v: np.ndarray,
        before: float,
        dt: float,
        wanted: np.ndarray,
        to: np.ndarray,
    ) -> str:
        """The reason of one row.

        Args:
            how: how the walker came to it, see steps.HOW.
            q, v: where the robot was [rad] and its speed [rad/s], (n,).
            before, dt: duration of the row before and of this one [s].
            wanted, to: what was wanted and what came out [rad], (n,).
        """
        code = _CODE[how]
        if code == causal.WANTED:
            return AS_WANTED
        stands = bool(np.abs(to - q).max(initial=0.0) <= _STILL * dt)
        if code == causal.BRAKED and not stands:
            return BRAKED
        kind, which = why.why(
            self._chain, self._balls, q, v, before, dt, self._bounds, self._target, code, wanted, to
        )
        if kind == why.JOINT:
            return f"{SLOWED} {self._joints[which]}"
        if kind == why.LIMIT:
            return f"{HELD} limits of {self._joints[which]}"
        return f"{HELD if stands else MOVED} {self._pairs[which]}"
