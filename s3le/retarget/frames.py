"""What is seen of the human in a frame: unit vectors, and the filter that they may go through."""

import numpy as np

from s3le.errors import ParameterError
from s3le.retarget.calm import calm, directions, middle
from s3le.retarget.settings import Settings
from s3le.robot.robot import Robot
from s3le.skeleton import BONES, DIM


class Calm:
    """The filter of what is seen; nothing, by the default settings."""

    def __init__(self, settings: Settings) -> None:
        """Nothing has been seen yet."""
        self._cutoff = float(settings.cutoff) or np.inf
        self._quickness = float(settings.quickness)  # another type would be compiled anew
        self._delay = settings.delay
        self._kept, self._rate = np.zeros(DIM), np.zeros(DIM)
        self._seen: list[np.ndarray] = []  # the last frames, where the answer comes one late
        self._any = False

    @staticmethod
    def warm_up(x: np.ndarray) -> None:
        """Compile what a filter runs; x (21,) are any unit vectors."""
        middle(x, x, x, np.empty(DIM))
        calm(x, 1.0 / 30.0, 1.0, 1.0, x.copy(), np.zeros(DIM))

    def __call__(self, x: np.ndarray, dt: float) -> np.ndarray:
        """What is wanted after a frame (21,), dt [s] after the one before."""
        if self._delay:
            self._seen = [*(self._seen or [x, x])[-2:], x]
            late = np.empty(DIM)
            middle(*self._seen, late)
            x = late
        if self._any and self._cutoff < np.inf:
            calm(x, dt, self._cutoff, self._quickness, self._kept, self._rate)
        else:  # nothing has been seen yet, or there is no filter
            self._kept[:], self._any = x, True
        return self._kept.copy()


def seen(robot: Robot, x: np.ndarray) -> np.ndarray | None:
    """Seven unit vectors (21,), as the robot sees them; None where there are none.

    Raises:
        ParameterError: x has another shape or holds no numbers.
    """
    try:
        if np.iscomplexobj(x):
            raise TypeError
        x = np.asarray(x, float)
    except (TypeError, ValueError, OverflowError):  # the last: an int beyond every float
        raise ParameterError("a frame must hold numbers") from None
    if x.shape not in ((DIM,), (len(BONES), 3)):
        raise ParameterError(f"a frame must have shape ({DIM},) or (7, 3), got {x.shape}")
    x = np.ascontiguousarray(robot.seen(x.reshape(DIM)))
    out = np.empty(DIM)
    return out if directions(x, out) else None
