"""What can be chosen about planning; the defaults are measured ones (docs/guard.md)."""

from dataclasses import dataclass, fields

import numpy as np

from s3le.errors import ParameterError
from s3le.plan.causal import Bounds, Care
from s3le.plan.limits import Limits
from s3le.plan.rounds import Custom
from s3le.robot.robot import Robot
from s3le.safety.paths import BUDGET

RANGES = {  # field -> (least, most), both allowed
    "target": (0.0, 0.1),
    "between": (1e-9, 0.1),
    "reserve": (0.0, 0.1),
    "band": (0.0, 1.0),
    "horizon": (0.01, 60.0),
    "window": (16, 100_000),
    "steady": (0.0, 1e6),
    "jerk": (0.0, 1e12),
    "soft": (1e-3, 1e9),
    "stiff": (1e-3, 1e9),
    "small": (1e-12, 1e-2),
    "fine": (1e-9, 1.0),
    "rounds": (1, 1000),
    "inner": (1, 1000),
    "repairs": (0, 100),
    "search": (1, 1000),
    "lead": (0.0, 1.0),
    "budget": (0, 100_000),
}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of planning.

    The clearances stand in this order: target, the robot's own margin, between.
    """

    target: float = 0.004  # clearance that is aimed at [m], at least the poses' margin
    between: float = 0.0005  # clearance kept on the paths between poses [m], at most the margin
    reserve: float = 0.0  # more than margin and between that a stream keeps where it can [m]
    band: float = 0.03  # pairs farther than this over the target are left out [m]
    horizon: float = 0.5  # time before and after what is broken in which rows may move [s]
    window: int = 300  # most rows that are planned at once
    steady: float = 0.0  # weight of the squared second differences [1/rad^2]
    jerk: float = 0.0  # change of acceleration that is aimed at, not claimed [rad/s^3]; 0: any
    soft: float = 50.0  # stiffness of clearances in the first round [1/m^2]
    stiff: float = 5000.0  # and in the last; the cost of a unit vector is its square
    small: float = 1e-7  # product of slack and multiplier at which a solve ends
    fine: float = 2e-3  # a round that moves no joint farther is the last one [rad]
    rounds: int = 8  # most linearisations
    inner: int = 4  # most iterations between two
    repairs: int = 3  # times that unproven paths are planned anew
    search: int = 3  # most iterations of the search for one step
    lead: float = 1.0  # share of the way on which a step's brake goes that counts as gone already
    budget: int = BUDGET  # poses that a proof may look at
    check: bool = True  # measure every pose of the result with coal too
    curved: bool = False  # speeds are continuous, and each row has a proven stop (plan/curved.py)

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type is bool:
                if type(value) is not bool:
                    raise ParameterError(f"plan: {field.name} must be true or false")
                continue
            least, most = RANGES[field.name]
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ParameterError(f"plan: {field.name} must be a number, got {value!r}")
            if not least <= value <= most:
                raise ParameterError(
                    f"plan: {field.name} must be in [{least:g}, {most:g}], got {value!r}"
                )
            if field.type is int and type(value) is not int:
                raise ParameterError(f"plan: {field.name} must be a whole number, got {value!r}")

    def custom(self) -> Custom:
        """How a window is planned, as the kernels want it."""
        return Custom(
            band=float(self.band), soft=float(self.soft), stiff=float(self.stiff),
            steady=float(self.steady), small=float(self.small), rounds=int(self.rounds),
            inner=int(self.inner), fine=float(self.fine),
        )  # fmt: skip

    def care(self, robot: Robot) -> Care:
        """How a step is looked for, as the kernels want it.

        Raises:
            ParameterError: the three clearances are not in their order.
        """
        if not self.between <= robot.margin <= self.target:
            raise ParameterError(
                f"plan: clearances must be ordered between <= margin <= target, got "
                f"{self.between:g}, {robot.margin:g}, {self.target:g} m"
            )
        return Care(
            target=float(self.target), margin=float(robot.margin), between=float(self.between),
            band=float(self.band), steps=int(self.search), budget=int(self.budget),
            lead=float(self.lead), curved=bool(self.curved),
        )  # fmt: skip


def bounds(most: Limits) -> Bounds:
    """Limits as the kernels want them."""
    return Bounds(*(np.ascontiguousarray(part, float) for part in most))
