"""Where a playback is: which moment, at which speed, playing or not; knows no window."""

import threading

import numpy as np

SPEEDS = {"⅛": 0.125, "¼": 0.25, "½": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}


class Player:
    """A playback over moments; safe to use from several threads."""

    def __init__(self, times: np.ndarray) -> None:
        """Begin at the first of some moments [s], (n,), rising; n is at least 1."""
        self.times = np.asarray(times, float)
        self._lock = threading.Lock()
        self._clock = float(self.times[0])
        self._speed, self._loop, self._playing = 1.0, True, False

    @property
    def playing(self) -> bool:
        """Does it play?"""
        return self._playing

    @property
    def index(self) -> int:
        """The moment to be shown: the last one that the clock has reached."""
        return int(np.searchsorted(self.times, self._clock + 1e-9, side="right")) - 1

    def toggle(self) -> bool:
        """Play or pause; from the end it begins anew. Returns whether it plays now."""
        with self._lock:
            if not self._playing and self._clock >= self.times[-1]:
                self._clock = float(self.times[0])
            self._playing = not self._playing and len(self.times) > 1
            return self._playing

    def pause(self) -> None:
        """Stand still."""
        with self._lock:
            self._playing = False

    def seek(self, time: float) -> None:
        """Go to the moment nearest to a time [s]."""
        with self._lock:
            self._clock = float(self.times[int(np.abs(self.times - time).argmin())])

    def step(self, count: int) -> None:
        """Pause, and go some moments on or back."""
        with self._lock:
            self._playing = False
            index = min(max(self.index + count, 0), len(self.times) - 1)
            self._clock = float(self.times[index])

    def set_speed(self, factor: float) -> None:
        """Seconds of the motion per second of the viewer."""
        with self._lock:
            self._speed = factor

    def set_loop(self, loop: bool) -> None:
        """Begin anew at the end, or stop there."""
        with self._lock:
            self._loop = loop

    def advance(self, seconds: float) -> None:
        """Let time pass [s]."""
        with self._lock:
            if not self._playing:
                return
            self._clock += seconds * self._speed
            first, last = float(self.times[0]), float(self.times[-1])
            if self._clock <= last:
                return
            if self._loop:
                self._clock = first + (self._clock - first) % (last - first)
            else:
                self._clock, self._playing = last, False
