"""What can be chosen about retargeting; stored with the artefact."""

from dataclasses import dataclass, fields

import numpy as np

from s3le.errors import ParameterError
from s3le.retarget.refine import Rule
from s3le.robot.robot import Robot
from s3le.safety.paths import BUDGET

RANGES = {  # field -> (least, most), both allowed
    "k": (1, 1000),
    "iterations": (1, 1000),
    "target": (0.0, 0.1),
    "between": (1e-9, 0.1),
    "ridge": (1e-9, 1.0),
    "pull": (0.0, 1e6),
    "toll": (0.0, 2.0),
    "speed_factor": (1e-3, 1.0),
    "brake": (0.0, 1e6),
    "cutoff": (0.0, 1e4),
    "quickness": (0.0, 1e3),
    "budget": (0, 100_000),
}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of one retargeter.

    The three clearances stand in this order: target, the poses' own margin, between.
    """

    k: int  # poses that the look-up proposes
    iterations: int  # most iterations of each solve
    target: float  # clearance that refinement aims at [m], at least the poses' margin
    between: float  # clearance kept on the paths between poses [m], at most the poses' margin
    ridge: float  # weight of the pull towards the pose that a solve starts at [-]
    pull: float  # weight of the pull towards the pose wanted where it is out of reach [-]
    toll: float  # what a pose farther off must gain, in mean cosine distance [1/rad]
    speed_factor: float  # share of the robot's joint speeds that is used
    brake: float  # most change of speed, where safety leaves the choice [rad/s^2]; 0: any
    cutoff: float  # of the filter of a human who stands still [Hz]; 0: no filter
    quickness: float  # what the cutoff gains with the human's speed [Hz per 1/s]
    delay: bool  # answer one frame late, so that a frame unlike its neighbours goes unseen
    check: bool  # a stream checks every pose independently; a batch always does
    budget: int = BUDGET  # poses that a proof may look at

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        for name, (least, most) in RANGES.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ParameterError(f"retarget: {name} must be a number, got {value!r}")
            if not least <= value <= most:
                raise ParameterError(
                    f"retarget: {name} must be in [{least:g}, {most:g}], got {value!r}"
                )
        for field in fields(self):
            if field.type is int and type(getattr(self, field.name)) is not int:
                raise ParameterError(f"retarget: {field.name} must be a whole number")
            if field.type is bool and type(getattr(self, field.name)) is not bool:
                raise ParameterError(f"retarget: {field.name} must be true or false")

    def rule(self, robot: Robot) -> Rule:
        """The settings as the kernels want them.

        Raises:
            ParameterError: the three clearances are not in their order.
        """
        if not self.between <= robot.margin <= self.target:
            raise ParameterError(
                f"retarget: clearances must be ordered between <= margin <= target, got "
                f"{self.between:g}, {robot.margin:g}, {self.target:g} m"
            )
        return Rule(
            target=float(self.target),
            margin=float(robot.margin),
            between=float(self.between),
            ridge=float(self.ridge),
            pull=float(self.pull),
            toll=float(self.toll),
            steps=int(self.iterations),
            budget=int(self.budget),
        )

    def speed(self, robot: Robot) -> np.ndarray:
        """Most that each joint may do [rad/s], (n_dof,).

        Raises:
            ParameterError: the robot's file gives a joint no speed.
        """
        speed = np.array([joint.velocity for joint in robot.joints])
        if not (speed > 0.0).all() or not np.isfinite(speed).all():
            name = robot.joints[int(np.argmin((speed > 0.0) & np.isfinite(speed)))].name
            raise ParameterError(f"robot {robot.name}: joint {name} has no speed limit")
        return speed * self.speed_factor
