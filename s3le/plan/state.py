"""What a robot that is driven step by step knows, as plain numbers and arrays."""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.plan import pursue
from s3le.plan.limits import SHORTEST

LONGEST = 1.0  # [s], a robot that was left alone for longer moves as if it had been this


class State(NamedTuple):
    """All that a walker knows beside its settings; plain numbers and arrays."""

    q: np.ndarray  # [rad], (n,), where the robot is
    v: np.ndarray  # [rad/s], (n,), the speed of its last step
    before: float  # [s], its duration; NaN: there was none
    clearance: float  # [m], of the pose
    even: bool  # all steps so far were of one length
    asked: np.ndarray  # [rad], (n,), what was wanted last; NaN: nothing was
    pace: np.ndarray  # [rad/s], (n,), how fast that had come; NaN: not known
    flag: np.ndarray  # int64 (4,) and
    way: np.ndarray  # [rad], (2, n), see pursue.Memory
    stop: tuple[np.ndarray, float, float] | None = None  # see smooth.Smooth; None: it rests


def checked(state: State, n: int) -> State:
    """A copy of a state of a robot of n joints, if it can be one; its clearance is not looked at.

    Raises:
        ParameterError: it has other shapes, or holds what is no number.
    """
    q, v = pose(state.q, n, "a state's pose"), pose(state.v, n, "a state's speed")
    flag, way = np.array(state.flag), np.array(state.way, float)
    asked, pace = np.array(state.asked, float), np.array(state.pace, float)
    before = float(state.before)
    if asked.shape != (n,) or pace.shape != (n,):
        raise ParameterError(f"a state's wanted pose and its pace must have shape ({n},)")
    good = flag.shape == (4,) and flag.dtype.kind == "i" and 0 <= flag[pursue.LEFT] <= 2
    if not good or way.shape != (2, n) or not np.isfinite(way).all():
        raise ParameterError("a state must come from Walker.state of the same robot")
    if not (np.isnan(before) and not v.any()) and not SHORTEST <= before <= LONGEST:
        raise ParameterError(f"a state's step must last {SHORTEST:g} to {LONGEST:g} s")
    return State(q, v, before, state.clearance, bool(state.even), asked, pace, flag, way)


def pose(q: np.ndarray, n: int, what: str) -> np.ndarray:
    """A pose as an array of its own, (n,).

    Raises:
        ParameterError: it has another shape, or is not finite; names `what` and the joint.
    """
    try:
        q = np.array(q, float)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{what} must hold numbers") from None
    if q.shape != (n,):
        raise ParameterError(f"{what} must have shape ({n},), got {q.shape}")
    if not np.isfinite(q).all():
        joint = int(np.argmin(np.isfinite(q)))
        raise ParameterError(f"{what} is not finite at joint {joint} ({q[joint]!r})")
    return q
