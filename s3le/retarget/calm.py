"""A low-pass for unit vectors that lets fast motion through, and what makes them unit; compiled.

Source: Casiez, Roussel, Vogel, "1 Euro filter: a simple speed-based low-pass filter for noisy
input in interactive systems" (CHI 2012), here for directions: filtered component by component,
then brought back to unit length.
"""

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels.compiled import compiled
from s3le.retarget.settings import Settings
from s3le.robot.robot import Robot
from s3le.skeleton import BONES, DIM

_SPEED_CUTOFF = 1.0  # [Hz], of the speed that sets the cutoff


@compiled
def directions(x, out):
    """Bring seven vectors x (21,) to unit length, into out (21,); False where one has none.

    A component that is not finite, or beyond 1e9, and a length of 1e-9 or less, are none. What out
    holds then does not matter.
    """
    for b in range(0, 21, 3):
        square = 0.0
        for i in range(b, b + 3):
            if not abs(x[i]) <= 1e9:  # catches NaN
                return False
            square += x[i] * x[i]
        size = np.sqrt(square)
        if not size > 1e-9:
            return False
        for i in range(b, b + 3):
            out[i] = x[i] / size
    return True


@compiled
def calm(x, dt, cutoff, quickness, kept, rate):
    """Filter a frame in place of what is kept.

    Args:
        x: seven unit vectors, (21,).
        dt: time since the last frame [s].
        cutoff: of a human who stands still [Hz]; inf: no filter.
        quickness: what the cutoff gains with speed [Hz per 1/s].
        kept: the last filtered frame, (21,); receives this one.
        rate: its filtered rate of change [1/s], (21,); receives this one's.
    """
    if cutoff == np.inf:
        kept[:] = x
        return
    share = 1.0 - np.exp(-2.0 * np.pi * _SPEED_CUTOFF * dt)
    for b in range(0, 21, 3):
        speed = 0.0
        for i in range(b, b + 3):
            rate[i] += share * ((x[i] - kept[i]) / dt - rate[i])
            speed += rate[i] * rate[i]
        gain = 1.0 - np.exp(-2.0 * np.pi * (cutoff + quickness * np.sqrt(speed)) * dt)
        size = 0.0
        for i in range(b, b + 3):
            kept[i] += gain * (x[i] - kept[i])
            size += kept[i] * kept[i]
        size = np.sqrt(size)
        for i in range(b, b + 3):
            # Opposite directions may cancel out: then the new one counts.
            kept[i] = kept[i] / size if size > 1e-6 else x[i]


@compiled
def middle(before, now, after, out):
    """The one of three frames that is nearest to both others, bone by bone, into out (21,)."""
    for b in range(0, 21, 3):
        ab = bc = ac = 0.0
        for i in range(b, b + 3):
            ab += (before[i] - now[i]) ** 2
            bc += (now[i] - after[i]) ** 2
            ac += (before[i] - after[i]) ** 2
        ab, bc, ac = np.sqrt(ab), np.sqrt(bc), np.sqrt(ac)
        if ab + bc <= ab + ac and ab + bc <= bc + ac:
            out[b : b + 3] = now[b : b + 3]
        elif ab + ac <= bc + ac:
            out[b : b + 3] = before[b : b + 3]
        else:
            out[b : b + 3] = after[b : b + 3]


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
