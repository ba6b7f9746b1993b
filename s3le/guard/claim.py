"""What the guard claims of a motion: one set of numbers for planning and for the proof."""

from dataclasses import dataclass, replace

import numpy as np

from s3le.errors import ParameterError
from s3le.plan.limits import Limits, limits
from s3le.plan.settings import Settings
from s3le.robot.robot import Robot
from s3le.safety import audit

ROOM = 0.0005  # [m] beyond the margin that planning aims at; less moves less (docs/guard.md)
_LEAST = 0.1  # share of a speed or an acceleration that a reserve must leave


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What is asked of a motion: plain numbers, by value, so that it can be sent and hashed."""

    margin: float  # [m], clearance of every pose
    speed_factor: float = 1.0  # share of the robot's joint speeds
    acceleration: tuple[float, ...]  # [rad/s^2], one a joint of the robot; inf: any
    between: float | None = None  # [m], clearance of every path; None: a quarter of the margin
    straight: bool = False  # rows with straight joints between; else curves with a way to rest
    jerk: float = 0.0  # [rad/s^3], aimed at and told, but not claimed; 0: any

    def demands(self, robot: Robot) -> audit.Demands:
        """What the audit is asked, for the robot of `robot`."""
        names = robot.joint_names
        own = audit.demands(robot, self.margin, self.between)
        speed = dict(zip(names, (own.velocity * self.speed_factor).tolist(), strict=True))
        hardest = dict(zip(names, self.acceleration, strict=True))
        return audit.demands(
            robot, self.margin, self.between, velocity=speed, acceleration=hardest
        )  # fmt: skip


def claim(
    robot: Robot,
    margin: float | None = None,
    speed_factor: float = 1.0,
    acceleration: dict[str, float] | float | None = None,
    straight: bool = False,
    jerk: float = 0.0,
) -> tuple[Robot, Claim]:
    """What is claimed, and the robot that keeps its margin.

    Args:
        robot: whose motions.
        margin: clearance of every pose [m]; None: the robot's own.
        speed_factor: share of the joint speeds that may be used, in (0, 1].
        acceleration: of all joints, or of some by name [rad/s^2]; else the robot
            file's, or limits.ACCELERATION.
        straight, jerk: see Claim.

    Raises:
        ParameterError: a number is out of its range, a joint unknown, or the robot's anchor pose
            does not keep the margin.
    """
    named = audit.demands(robot, margin, acceleration=acceleration)
    hardest = limits(robot).acceleration.copy()
    if isinstance(acceleration, dict):
        for joint, value in acceleration.items():
            hardest[robot.joint_names.index(joint)] = value
    elif acceleration is not None:
        hardest[:] = acceleration
    limits(robot, hardest, speed_factor)  # refuses what is out of range
    Settings(jerk=jerk)  # likewise
    made = Claim(
        margin=named.margin, speed_factor=float(speed_factor),
        acceleration=tuple(hardest.tolist()), straight=straight, jerk=float(jerk),
    )  # fmt: skip
    if robot.margin != made.margin:
        robot = replace(robot, margin=made.margin)
        clearance = float(robot.certifier().check(robot.anchor[None]).clearance[0])
        if not clearance >= made.margin:
            raise ParameterError(
                f"the anchor pose of {robot.name} keeps {clearance * 1e3:.2f} mm, the margin asked "
                f"for is {made.margin * 1e3:g} mm; ask for less"
            )
    return robot, made


def with_reserve(
    robot: Robot, of: Claim, reserve: float, step: float
) -> tuple[Robot, Limits, Settings]:
    """What planning is held to, so that poses off by a reserve still keep the claim.

    The reserve is taken off both ends of the joint ranges; what two or three rows that are off by
    it change of a speed or an acceleration is taken off those; and it is added to the clearances
    as a metre's lever moves. Whether that was enough is seen by the audit.

    Args:
        robot: of the claim.
        of: the claim.
        reserve: [rad]; 0: none.
        step: shortest time between rows [s].

    Raises:
        ParameterError: a reserve leaves next to nothing of a limit; says of which joint.
    """
    most = limits(robot, np.array(of.acceleration), of.speed_factor)
    lower, upper = most.lower + reserve, most.upper - reserve
    speed = most.speed - 2.0 * reserve / step
    hardest = most.acceleration - 4.0 * reserve / step**2
    for had, left, unit in (
        (most.speed, speed, "rad/s"), (most.acceleration, hardest, "rad/s^2"),
        (most.upper - most.lower, upper - lower, "rad"),
    ):  # fmt: skip
        small = ~(left >= _LEAST * had)
        if small.any():
            joint = int(np.argmax(small))
            raise ParameterError(
                f"angles are written to {reserve:.1g} rad, which at {step:g} s a row leaves "
                f"{left[joint]:.3g} of {had[joint]:.3g} {unit} for {robot.joint_names[joint]}"
            )
    margin = of.margin + reserve
    settings = Settings(
        target=margin + ROOM,
        between=audit.demands(robot, of.margin, of.between).margin_between + reserve,
        check=False,  # the audit does, once it is rounded
        curved=not of.straight,
        jerk=of.jerk,
    )
    if reserve:
        robot = replace(robot, margin=margin)
    return robot, Limits(lower, upper, speed, hardest), settings
