"""What a guard answers, and what changes from answer to answer."""

from typing import NamedTuple

import numpy as np

from s3le.guard.given import Told
from s3le.plan.state import State
from s3le.plan.steps import Via


class Step(NamedTuple):
    """One row."""

    q: np.ndarray  # [rad], (n,), where to be when the step is over
    v: np.ndarray  # [rad/s], (n,), the speed there; among given joints that of the whole step
    reason: str  # why it is not what was wanted, see reasons
    certified: bool  # within all limits, and proven
    clearance: float  # [m], of the pose, measured by coal
    bound: float  # [m], proven clearance of the path that leads there; NaN: none is proven
    given: str = ""  # what others did otherwise than was said of the step before; empty: nothing
    via: tuple[Via, ...] = ()  # rows within the step, see plan.steps.Step


class Chunk(NamedTuple):
    """Rows of a chunk, h of them."""

    q: np.ndarray  # [rad], (h, n)
    v: np.ndarray  # [rad/s], (h, n)
    reason: tuple[str, ...]
    certified: np.ndarray  # bool (h,)
    clearance: np.ndarray  # [m], (h,)
    bound: np.ndarray  # [m], (h,)
    via: tuple[tuple[Via, ...], ...]  # (h,), see Step


class Kept(NamedTuple):
    """All that changes from row to row."""

    walker: State
    leaving: tuple[np.ndarray, int, float, float] | None  # way, leg, share, rate
    q: np.ndarray
    v: np.ndarray
    came: np.ndarray
    before: float
    led_out: int
    stopped: bool
    others: tuple[np.ndarray, Told | None] | None  # Given.keep
