"""Are these angles of this robot, in radians? What cannot be is refused before it is planned."""

from math import pi, radians

import numpy as np

from s3le.errors import TrajectoryError
from s3le.plan.limits import Limits
from s3le.robot.robot import Robot

WILD = 5.0  # so many times as far from zero as a range goes is no angle in radians
TURNED = 3.0  # the same of the median row: all of it is in another unit
STILL = 0.1  # [rad], a motion "in degrees" that never goes farther was in radians already
JUMP = 5.0  # times its limit that a speed must be to be called a jump
WRAP = 0.3  # [rad], by which a jump may miss a full turn and still be called one
NAMED = 3  # jumps that are named
_SLACK = 0.2  # [rad], beyond its range by which a joint may be, once it is read in degrees


def refuse_foreign(name: str, robot: Robot, q: np.ndarray, degrees: bool) -> list[str]:
    """Refuse angles that cannot be this robot's in radians.

    Args:
        name: of the motion, for messages.
        robot: whose motion it is said to be.
        q: [rad], (m, n), as read.
        degrees: they were said to be in degrees.

    Returns:
        Sentences for a person.

    Raises:
        TrajectoryError: they are degrees, of another robot, or a row is wildly off.
    """
    reach = np.maximum(np.maximum(np.abs(robot.lower), np.abs(robot.upper)), radians(5.0))
    times = np.abs(q) / reach  # (m, n)
    farthest = times.max(axis=1)
    row = int(np.argmax(farthest))
    joint = int(np.argmax(times[row]))
    its = robot.joints[joint]
    found = (
        f"{its.name} is {q[row, joint]:.6g} rad in row {row}, its range is "
        f"[{its.lower:.4g}, {its.upper:.4g}]"
    )
    if np.median(farthest) > TURNED:
        turned = np.deg2rad(q)
        fits = (turned >= robot.lower - _SLACK) & (turned <= robot.upper + _SLACK)
        if not degrees and fits.mean() > 0.9:
            raise TrajectoryError(
                f"{name}: its angles look like degrees: {found}; read them with --degrees"
            )
        raise TrajectoryError(f"{name}: its angles are not {robot.name}'s: {found}")
    if farthest[row] > WILD:
        raise TrajectoryError(
            f"{name}: {found}: {farthest[row]:.0f} times as far from zero as it goes; "
            "mend or cut that row"
        )
    most = float(np.abs(q).max())
    if degrees and 0.0 < most < STILL:
        return [f"read in degrees no joint goes beyond {most:.4f} rad; were these radians already?"]
    return []


def jumps(robot: Robot, time: np.ndarray, q: np.ndarray, most: Limits) -> list[str]:
    """Sentences on steps far beyond every speed limit; they are planned over, but are worth a look.

    Args:
        robot: whose motion it is.
        time: [s], (m,).
        q: [rad], (m, n).
        most: its limits.
    """
    if len(q) < 2:
        return []
    step = np.diff(q, axis=0)
    share = np.abs(step) / np.diff(time)[:, None] / most.speed
    rows = np.flatnonzero(share.max(axis=1) > JUMP)
    if not len(rows):
        return []
    said = []
    for row in rows[:NAMED]:
        joint = int(share[row].argmax())
        turn = abs(abs(step[row, joint]) - 2.0 * pi) < WRAP
        said.append(
            f"{robot.joint_names[joint]} by {np.rad2deg(step[row, joint]):.1f} deg after row {row}"
            + (" (a full turn: an angle that was wrapped?)" if turn else "")
        )
    more = f", and {len(rows) - NAMED} more" if len(rows) > NAMED else ""
    count = "one jump" if len(rows) == 1 else f"{len(rows)} jumps"
    return [f"{count}, planned over: {', '.join(said)}{more}"]
