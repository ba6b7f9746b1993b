"""A low-pass for unit vectors that lets fast motion through, and what makes them unit; compiled.

Source: Casiez, Roussel, Vogel, "1 Euro filter: a simple speed-based low-pass filter for noisy
input in interactive systems" (CHI 2012), here for directions: filtered component by component,
then brought back to unit length.
"""

import numpy as np

from s3le.kernels.compiled import compiled

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
