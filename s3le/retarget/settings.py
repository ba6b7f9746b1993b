"""What can be chosen about retargeting; stored with the artefact."""

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from s3le.errors import ParameterError
from s3le.plan import settings as planning
from s3le.plan.limits import Limits, limits
from s3le.retarget.refine import Rule
from s3le.robot.robot import Robot
from s3le.safety.paths import BUDGET


def _number(default: float, least: float, most: float, doc: str) -> Any:
    """A number that people choose, with its range, both ends allowed."""
    return field(default=default, metadata={"doc": doc, "range": (least, most)})


def _switch(default: bool, doc: str) -> Any:
    """Yes or no, chosen by people."""
    return field(default=default, metadata={"doc": doc})


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of one retargeter; by default those of the section `export` of params.yaml.

    The three clearances stand in this order: target, the poses' own margin, between.
    """

    k: int = _number(8, 1, 1000, "poses that the look-up proposes")
    iterations: int = _number(6, 1, 1000, "most iterations of each solve")
    target: float = _number(
        0.004, 0.0, 0.1, "clearance that refinement aims at [m], at least the poses' margin"
    )
    between: float = _number(
        0.0005, 1e-9, 0.1, "clearance kept on the paths between poses [m], at most the margin"
    )
    ridge: float = _number(0.001, 1e-9, 1.0, "pull towards the pose that a solve starts at [-]")
    toll: float = _number(
        0.003, 0.0, 2.0, "what a pose farther off must gain, in mean cosine distance [1/rad]"
    )
    speed_factor: float = _number(1.0, 1e-3, 1.0, "share of the robot's joint speeds that is used")
    acceleration_factor: float = _number(
        1.0, 1e-3, 1e3, "share of the joints' accelerations that is used"
    )
    jerk: float = _number(
        0.0, 0.0, 1e12, "jerk that whole motions aim at, not claimed [rad/s^3]; 0: any"
    )
    cutoff: float = _number(
        0.0, 0.0, 1e4, "of the filter of a human who stands still [Hz]; 0: no filter"
    )
    quickness: float = _number(
        1.0, 0.0, 1e3, "what the cutoff gains with the human's speed [Hz per 1/s]"
    )
    delay: bool = _switch(False, "answer one frame late, so that one odd frame goes unseen")
    check: bool = _switch(True, "a stream checks every pose independently; a batch always does")
    budget: int = BUDGET  # poses that a proof may look at

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        for each in fields(self):
            name, value = each.name, getattr(self, each.name)
            if each.type is bool:
                if type(value) is not bool:
                    raise ParameterError(f"retarget: {name} must be true or false, got {value!r}")
                continue
            least, most = each.metadata.get("range", (0, 100_000))
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ParameterError(f"retarget: {name} must be a number, got {value!r}")
            if not least <= value <= most:
                raise ParameterError(
                    f"retarget: {name} must be in [{least:g}, {most:g}], got {value!r}"
                )
            if each.type is int and type(value) is not int:
                raise ParameterError(f"retarget: {name} must be a whole number, got {value!r}")

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
            ridge=float(self.ridge),
            toll=float(self.toll),
            steps=int(self.iterations),
        )

    def limits(self, robot: Robot) -> Limits:
        """What each joint may do.

        Raises:
            ParameterError: the robot's file gives a joint no speed.
        """
        most = limits(robot, speed_factor=self.speed_factor)
        if not np.isfinite(most.speed).all():
            name = robot.joints[int(np.argmin(np.isfinite(most.speed)))].name
            raise ParameterError(f"robot {robot.name}: joint {name} has no speed limit")
        return most._replace(acceleration=most.acceleration * self.acceleration_factor)

    def planning(self, check: bool = True) -> planning.Settings:
        """How the nearest certified motion is looked for."""
        return planning.Settings(
            target=float(self.target), between=float(self.between), budget=int(self.budget),
            check=check, curved=True, jerk=float(self.jerk),
        )  # fmt: skip
