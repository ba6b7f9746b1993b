"""A robot that is led out, step by step, along a way that s3le/guard/out.py found."""

import numpy as np


class Leaving:
    """A robot on its way out: straight from pose to pose, from rest to rest at each."""

    def __init__(self, way: np.ndarray, speed: np.ndarray, acceleration: np.ndarray) -> None:
        """Stand at the beginning of a way.

        Args:
            way: poses [rad], (k, n), k at least 2.
            speed, acceleration: limits [rad/s], [rad/s^2], (n,); inf: any.
        """
        self.way, self._speed, self._hardest = way, speed, acceleration
        self.leg, self.share, self.rate = 0, 0.0, 0.0  # which leg, of it [-], and [1/s]

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self.leg == len(self.way) - 1

    def here(self) -> np.ndarray:
        """Where the robot is [rad], (n,)."""
        if self.done:
            return self.way[-1].copy()
        start, end = self.way[self.leg], self.way[self.leg + 1]
        return end.copy() if self.share == 1.0 else start + self.share * (end - start)

    def step(self, mean: float, dt: float, stop: bool) -> np.ndarray:
        """Where to be dt later [rad], (n,).

        A joint on a leg moves by a share of it, so one number drives them all. It goes as fast as
        it can while it could brake before the leg's end whatever steps come (s3le/plan/ends.py).

        Args:
            mean: of the last step's and this one's duration [s].
            dt: this one's [s].
            stop: brake.
        """
        if self.done:
            return self.way[-1].copy()
        moved = np.abs(self.way[self.leg + 1] - self.way[self.leg])
        some = moved > 0.0
        fastest = float((self._speed[some] / moved[some]).min(initial=np.inf)) * (1.0 - 1e-9)
        hardest = float((self._hardest[some] / moved[some]).min(initial=np.inf)) * (1.0 - 1e-6)
        room, last = 1.0 - self.share, self.rate
        if last > 0.0 and room == 0.0:  # at a corner: stand, then turn
            self.leg, self.share, self.rate = self.leg + 1, 0.0, 0.0
            return self.here()
        lands = np.isinf(hardest) or room <= 0.5 * hardest * dt * dt
        most = room / dt if lands else np.sqrt(2.0 * hardest * room) - 0.5 * hardest * dt
        rate = min(fastest, last + hardest * mean, most)
        if stop:
            rate = min(rate, max(last - hardest * mean, 0.0)) if np.isfinite(hardest) else 0.0
        self.rate = rate
        self.share = 1.0 if lands and rate >= room / dt else min(self.share + rate * dt, 1.0)
        if self.share == 1.0 and self.leg == len(self.way) - 2:
            self.leg += 1
        return self.here()
