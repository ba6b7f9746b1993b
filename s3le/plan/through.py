"""Speeds for rows that tell none: the curve through a motion's own rows, if there is one.

A step from (q, v) to (q', w) in dt is the cubic that meets both. Of that cubic speed and
acceleration are linear in v and w, so the pairs (v, w) that keep the limits are a polygon, and the
speeds at a row that any speeds before it allow are an interval. These are followed from the first
row to the last; then a speed is taken from each, from the last row to the first, as near as may be
to a smooth guess. So where there are speeds within the limits, they are found. Of clearance, of
positions between rows, and of ways to rest nothing is known here.
"""

from typing import NamedTuple

import numpy as np

from s3le.plan.limits import Limits
from s3le.safety.paths import grid_of

# Weight of even accelerations against that of accelerations without a bend within a step: a third
# gives the cubic spline, next to nothing the parabolas that go through all rows.
SHARES = (1.0 / 3.0, 0.05, 0.01, 1e-3, 1e-5)
_ROUNDING = 5e-7  # share by which a limit may be exceeded: the audit allows the double


class Through:
    """The curves through the rows of one motion."""

    def __init__(self, time: np.ndarray, q: np.ndarray, most: Limits) -> None:
        """Follow what speeds each row allows.

        Args:
            time: of the rows [s], (m,), rising.
            q: [rad], (m, n).
            most: what joints may do.
        """
        self._shape, dt = q.shape, np.diff(time)
        self._chord = np.diff(q, axis=0) / dt[:, None]
        fastest = most.speed * (1.0 + _ROUNDING)
        hardest = most.acceleration * (1.0 + _ROUNDING)
        self._lines = _lines(dt, self._chord, fastest, hardest)
        self._box = _box(dt, q, most, fastest) if len(dt) else (np.zeros(q.shape),) * 2
        self._low, self._high = _reached(self._lines, *self._box)
        # There are speeds within the limits of speed and acceleration.
        self.within = bool((self._low[-1] <= self._high[-1]).all())

    def guess(self, share: float) -> np.ndarray:
        """Speeds that are smooth, and allow each row by itself, (m, n); see smooth."""
        if not len(self._chord):
            return np.zeros(self._shape)
        return np.clip(smooth(self._chord, share), *self._box)

    def near(self, guess: np.ndarray) -> np.ndarray:
        """Speeds within the limits near others [rad/s], (m, n); if there are none, these."""
        return _chosen(self._lines, self._low, self._high, guess) if self.within else guess


def smooth(chord: np.ndarray, share: float) -> np.ndarray:
    """Speeds at rows, (m, n): least squares of what bends within steps, and of what it costs.

    Minimises the squares of v + w - 2 s, which is 0 on a parabola, and of w - v times the share,
    over all steps, s being a step's mean speed.

    Args:
        chord: mean speed of each step [rad/s], (m - 1, n).
        share: above 0; 1 gives the mean of the two steps that meet at a row.
    """
    m = len(chord) + 1
    wanted = np.zeros((m, chord.shape[1]))
    wanted[:-1] += 2.0 * chord
    wanted[1:] += 2.0 * chord
    # Its normal equations have three diagonals: by elimination, first row to last and back.
    beside, own = 1.0 - share, np.full(m, 2.0 * (1.0 + share))
    own[[0, -1]] = 1.0 + share
    for t in range(1, m):
        ratio = beside / own[t - 1]
        own[t] -= ratio * beside
        wanted[t] -= ratio * wanted[t - 1]
    wanted[-1] /= own[-1]
    for t in range(m - 2, -1, -1):
        wanted[t] = (wanted[t] - beside * wanted[t + 1]) / own[t]
    return wanted


class _Lines(NamedTuple):
    """What limits speeds v and w at both ends of a step: at every k, low <= a v + b w <= high."""

    a: np.ndarray  # (k, 1)
    b: np.ndarray
    low: np.ndarray  # (m - 1, k, n)
    high: np.ndarray


def _lines(dt: np.ndarray, chord: np.ndarray, fastest: np.ndarray, hardest: np.ndarray) -> _Lines:
    """Acceleration at the begin of a step, at its end, and speed in its middle."""
    a, b = np.array([[4.0], [2.0], [1.0]]), np.array([[2.0], [4.0], [1.0]])
    bend = hardest * dt[:, None]
    room = np.stack([bend, bend, np.broadcast_to(4.0 * fastest, bend.shape)], axis=1)
    six = 6.0 * chord[:, None, :]
    return _Lines(a, b, six - room, six + room)


def _box(
    dt: np.ndarray, q: np.ndarray, most: Limits, fastest: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest speed at each row by itself, (m, n).

    The cubic of a step stays between the least and the greatest of its ends, q + v dt / 3 and
    q' - w dt / 3: so joints stay within their limits. And they can brake before they are there.
    """
    down, up = np.maximum(q - most.lower, 0.0), np.maximum(most.upper - q, 0.0)
    grid = grid_of(dt)
    low = -np.minimum(fastest, _braked(down, most.acceleration, grid))
    high = np.minimum(fastest, _braked(up, most.acceleration, grid))
    step = dt[:, None] / 3.0
    low[:-1] = np.maximum(low[:-1], -down[:-1] / step)
    high[:-1] = np.minimum(high[:-1], up[:-1] / step)
    low[1:] = np.maximum(low[1:], -up[1:] / step)
    high[1:] = np.minimum(high[1:], down[1:] / step)
    return low, high


def _braked(room: np.ndarray, hardest: np.ndarray, dt: float) -> np.ndarray:
    """A speed from which a joint can brake within some room [rad], (m, n), in steps of dt [s].

    Of one step of braking it is exact (curve.stop); of more it leaves a little.
    """
    finite = np.where(np.isfinite(hardest), hardest, 0.0)
    many = np.sqrt(2.0 * finite * np.maximum(room - finite * dt * dt / 8.0, 0.0))
    return np.maximum(np.minimum(2.0 * room / dt, hardest * dt), many)


def _reached(
    lines: _Lines, least_of: np.ndarray, most_of: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest speed at each row that speeds before it allow, (m, n); none: crossed.

    Args:
        lines: of all steps.
        least_of, most_of: what each row allows by itself [rad/s], (m, n).
    """
    low, high = least_of.copy(), most_of.copy()
    with np.errstate(invalid="ignore"):
        for t in range(len(low) - 1):
            # Of w: below the lines through the upper ends, above those through the lower ones.
            top = np.concatenate([lines.high[t] / lines.b, most_of[None, t + 1]])
            bottom = np.concatenate([lines.low[t] / lines.b, least_of[None, t + 1]])
            fall = np.concatenate([lines.a / lines.b, [[0.0]]])
            # Of v: where every upper line is above every lower one.
            gap = top[:, None] - bottom[None]  # (4, 4, n), at v = 0
            lean = (fall[:, None] - fall[None])[..., 0]
            least, most = low[t].copy(), high[t].copy()
            for i, j in zip(*np.nonzero(lean), strict=True):
                bound = gap[i, j] / lean[i, j]
                if lean[i, j] > 0.0:
                    most = np.minimum(most, bound)
                else:
                    least = np.maximum(least, bound)
            empty = ~(least <= most) | ~(gap[lean == 0.0] >= 0.0).all(axis=0)
            low[t + 1] = (bottom - fall * most).max(axis=0)
            high[t + 1] = (top - fall * least).min(axis=0)
            low[t + 1, empty], high[t + 1, empty] = np.inf, -np.inf
    return low, high


def _chosen(lines: _Lines, low: np.ndarray, high: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Speeds near a guess, one from each interval, such that every step keeps its lines, (m, n)."""
    v = np.empty(guess.shape)
    v[-1] = np.clip(guess[-1], low[-1], high[-1])
    for t in range(len(v) - 2, -1, -1):
        used = lines.b * v[t + 1]
        least = np.maximum(((lines.low[t] - used) / lines.a).max(axis=0), low[t])
        most = np.minimum(((lines.high[t] - used) / lines.a).min(axis=0), high[t])
        v[t] = np.clip(guess[t], least, np.maximum(least, most))
    return v
