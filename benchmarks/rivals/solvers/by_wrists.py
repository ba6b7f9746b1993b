"""What xr_teleoperate does, from its published weights: two wrist poses by IPOPT, arms alone.

50 |position|^2 + |rotation|^2 + 0.02 |q|^2 + 0.1 |q - last|^2 within joint limits, at most 30
iterations from the last pose, then a weighted mean (0.4, 0.3, 0.2, 0.1) of four frames. No speeds,
no collisions; the controller after it clips the arms' speed, 20 rad/s at first. Setting `clip`
[rad/s]. The waist stays at its anchor. The rotation of a wrist is plain.Goal's, for clips have no
palms.
"""

from collections import deque
from collections.abc import Callable

import casadi
import numpy as np
from plain import HANDS, POINTS, Goal, Plain

from solvers import versions

WEIGHTS = (0.4, 0.3, 0.2, 0.1)


def about() -> dict[str, str]:
    """Versions."""
    return versions("casadi")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame that takes dt [s]."""
    arms = _arms(robot)
    opti = casadi.Opti()
    moved, last = opti.variable(len(arms)), opti.parameter(len(arms))
    places, turns = opti.parameter(3, 2), opti.parameter(6, 3)
    q = casadi.MX(robot.anchor)
    for row, joint in enumerate(arms):
        q[joint] = moved[row]
    frames = _frames(robot, q)
    far = wrong = 0.0
    for hand, row in enumerate(HANDS):
        place = robot.points[POINTS[row]]
        turn, at = frames[place.joint]
        far += casadi.sumsqr(at + turn @ place.offset - places[:, hand])
        wrong += casadi.sumsqr(_log(turn @ turns[3 * hand : 3 * hand + 3, :].T))
    opti.subject_to(opti.bounded(robot.lower[arms], moved, robot.upper[arms]))
    rest = 0.02 * casadi.sumsqr(moved) + 0.1 * casadi.sumsqr(moved - last)
    opti.minimize(50.0 * far + wrong + rest)
    opti.solver(
        "ipopt",
        {
            "expand": True, "detect_simple_bounds": True, "calc_lam_p": False, "print_time": False,
            "ipopt.sb": "yes", "ipopt.print_level": 0, "ipopt.max_iter": 30, "ipopt.tol": 1e-4,
            "ipopt.acceptable_tol": 5e-4, "ipopt.acceptable_iter": 5,
            "ipopt.warm_start_init_point": "yes",
        },
    )  # fmt: skip
    seen: deque = deque(maxlen=len(WEIGHTS))
    clip = float(settings.get("clip", 20.0)) * dt

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        opti.set_initial(moved, seen[0] if seen else q[arms])
        opti.set_value(last, seen[0] if seen else q[arms])
        opti.set_value(places, goal.points[list(HANDS)].T)
        opti.set_value(turns, goal.turns.reshape(6, 3))
        failed = None
        try:
            found = opti.solve().value(moved)
        except RuntimeError as error:  # it then goes on with what was reached, as the tool does
            found, failed = opti.debug.value(moved), error
            if not np.isfinite(found).all():
                raise failed from None
        seen.appendleft(np.atleast_1d(found))
        share = np.array(WEIGHTS[: len(seen)])
        mean = (share[:, None] * np.array(seen)).sum(axis=0) / share.sum()
        made = q.copy()
        made[arms] = q[arms] + np.clip(mean - q[arms], -clip, clip)
        return made

    return solve


def _arms(robot: Plain) -> np.ndarray:
    """Joints between each shoulder and its hand; those that carry both arms are the waist's."""
    paths = []
    for row in HANDS:
        path, joint = [], robot.points[POINTS[row]].joint
        while joint >= 0:
            path.append(joint)
            joint = robot.joints[joint].parent
        paths.append(set(path))
    return np.array(sorted((paths[0] | paths[1]) - (paths[0] & paths[1])))


def _frames(robot: Plain, q: casadi.MX) -> list[tuple[casadi.MX, casadi.MX]]:
    """Rotation and origin of each joint."""
    found: list[tuple[casadi.MX, casadi.MX]] = []
    for i, joint in enumerate(robot.joints):
        turn, at = (casadi.MX.eye(3), casadi.MX.zeros(3)) if joint.parent < 0 else found[
            joint.parent
        ]  # fmt: skip
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        own = np.eye(3) + casadi.sin(q[i]) * cross + (1.0 - casadi.cos(q[i])) * (cross @ cross)
        found.append((turn @ joint.rotation @ own, at + turn @ joint.translation))
    return found


def _log(turn: casadi.MX) -> casadi.MX:
    """Rotation vector of a rotation matrix; smooth at none."""
    cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1.0) / 2.0
    angle = casadi.acos(casadi.fmax(-1.0 + 1e-9, casadi.fmin(1.0 - 1e-9, cosine)))
    axis = casadi.vertcat(
        turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    )  # fmt: skip
    return axis * angle / (2.0 * casadi.sin(angle))
