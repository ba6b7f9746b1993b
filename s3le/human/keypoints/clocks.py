"""Rates and clocks of files: which key holds one, in which unit, and what rate it gives.

People's motion is recorded at 5 to 1000 Hz. A clock that gives such a rate in milliseconds or
microseconds only is read so, and that is said; any other rate outside of it is asked for.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.human.clip import at_constant_rate
from s3le.human.keypoints.values import number, numbers
from s3le.human.text import refusal, shown

USUAL = (5.0, 1000.0)  # [Hz]
RATE = 30.0  # [Hz] where nothing says another
EVEN = 0.02  # steps in time that differ by less than this share are alike
ROUNDED = 0.05  # of a step, by which times that were rounded may be off an even clock's
UNEVEN = 20.0  # refuse times that would give more frames per row than this
APART = 0.05  # a rate and times that differ by a larger share do not agree
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_NAMED = UNITS | {
    "sec": 1.0, "secs": 1.0, "seconds": 1.0, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3,
    "usec": 1e-6, "micros": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nsec": 1e-9,
    "nanoseconds": 1e-9,
}  # fmt: skip
_RATES = (  # keys, without _, - and spaces
    "fps", "framerate", "mocapframerate", "framespersecond", "videofps", "mocapfps", "motionfps",
    "targetfps", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency",
    "capturerate", "capturefps", "camerarate", "datarate", "rate", "frequency", "freq", "hz",
)  # fmt: skip
_STEPS = ("dt", "frametime", "timestep", "deltat", "deltatime", "frameduration")
_TIMES = ("time", "timestamp", "t", "times", "timestamps")
_WRITTEN = re.compile(r"(\d{1,9}(?:\.\d{0,9})?)(?:/(\d{1,9}(?:\.\d{0,9})?))?\s*(?:fps|hz)?")


class Clock(NamedTuple):
    """What a file says about time."""

    fps: float | None = None  # [Hz]
    time: np.ndarray | None = None  # (n,), of each frame
    unit: float | None = None  # [s] of its times, where a key names it
    odd: str = ""  # what is there instead of a rate, for people
    told: str = ""  # what was assumed of the rate

    def or_else(self, other: "Clock") -> "Clock":
        """Itself where it says anything, else the other."""
        return self if self.fps or self.time is not None or self.odd else other


def key(name: Any) -> str:
    """A key as it is compared: small letters, without _, - and spaces."""
    return re.sub(r"[_\-\s]", "", str(name).lower())


def is_clock(name: str) -> str:
    """The name of a column as a key where it is a clock's or a rate's, else nothing."""
    plain = re.sub(r"[^a-z]", "", name.lower())
    known = plain in (*_RATES, *_STEPS) or _unit(plain, (*_TIMES, *_STEPS)) is not None
    return plain if known else ""


def find(path: Path | str, tree: Mapping, count: int | None = None) -> Clock:
    """What a dict of a file says about time.

    Args:
        path: for messages.
        tree: anything by its key.
        count: how many frames the times must be for; None: any.

    Raises:
        ClipError: times with words among them.
    """
    keys = {key(name): name for name in tree}
    clock = Clock()
    for plain in _RATES:
        given = _alike(tree[keys[plain]]) if plain in keys else None
        if given is not None and not clock.fps:
            odd = f"its '{keys[plain]}' is {shown(str(given))}"
            clock = Clock(_rate(given), odd="" if _rate(given) else clock.odd or odd)
    for plain, name in keys.items():
        unit = _unit(plain, _STEPS)
        given = _alike(tree[name]) if unit is not None else None
        if given is not None and not clock.fps:
            clock = _of_step(name, given, unit or None, clock)
    for plain, name in keys.items():
        unit = _unit(plain, _TIMES)
        if unit is not None:
            time = numbers(path, tree[name], f"'{name}'")
            if time is not None and time.ndim == 2 and 1 in time.shape:
                time = time.ravel()
            if time is not None and time.ndim == 1 and count in (None, len(time)):
                return clock._replace(time=time, unit=unit or None)
    return clock


def _of_step(name: Any, given: Any, unit: float | None, clock: Clock) -> Clock:
    """The rate that the time between two frames gives."""
    step = _rate(given)
    rates = _rates(step, unit) if step and (step != 1.0 or unit) else {}
    if len(rates) != 1:
        return clock._replace(odd=clock.odd or f"its '{name}' is {shown(str(given))}")
    ((word, found),) = rates.items()
    found = _round(found, 2e-4)
    told = "" if word == "s" else f"{found:g} Hz, its '{name}' is in {word}"
    return Clock(found, told=told)


def usual(path: Path | str, fps: float) -> None:
    """Refuse a rate [Hz] at which people are not recorded.

    Raises:
        ClipError: it is outside of USUAL.
    """
    low, high = USUAL
    if not low <= fps <= high:
        raise refusal(path, None, f"its rate is {fps:g} Hz, people are recorded at {low:g} to "
                      f"{high:g} Hz; give --fps")  # fmt: skip


def rate(
    path: Path | str, points: np.ndarray, clock: Clock, fps: float | None
) -> tuple[float, np.ndarray, list[str]]:
    """Frames per second, positions at that rate, and where it comes from.

    Args:
        path: for messages.
        points: positions, (n, any, 3), a frame each.
        clock: what the file says.
        fps: what a person says [Hz].

    Raises:
        ClipError: a rate outside of USUAL, times that do not rise or are too uneven.
    """
    if fps is not None:
        return fps, points, []
    low, high = USUAL
    if clock.fps is not None:
        usual(path, clock.fps)
        _agree(path, clock)
        return clock.fps, points, [clock.told] if clock.told else []
    if len(points) == 1:
        return RATE, points, []
    if clock.time is None:
        if clock.odd:
            raise refusal(path, None, f"{clock.odd}, which is no rate; give --fps")
        return RATE, points, [f"{RATE:g} Hz, for the file has no rate (else --fps)"]
    with np.errstate(invalid="ignore"):
        steps = np.diff(clock.time)
        rises = (steps > 0.0).all()
    if not rises:
        raise refusal(path, None, "its time does not rise; leave it out and give --fps")
    step = float(np.median(steps))
    if step == 1.0 and clock.unit is None:
        raise refusal(path, None, "its time counts frames (0, 1, 2, ...), not seconds; give --fps")
    rates = _rates(step, clock.unit)
    if len(rates) != 1:
        raise refusal(path, None, f"its time gives {1.0 / step:g} Hz in seconds, people are "
                      f"recorded at {low:g} to {high:g} Hz; give --fps")  # fmt: skip
    ((word, found),) = rates.items()
    time = (clock.time - clock.time[0]) * (clock.unit or UNITS[word])
    mean = time[-1] / len(steps)
    off = float(np.abs(time - mean * np.arange(len(time))).max())
    unit = "" if word == "s" else f", which are in {word}"
    if np.abs(steps / step - 1.0).max() <= EVEN or off <= ROUNDED * mean:
        found = _round(1.0 / mean, 1e-4 + 2.0 * off / time[-1])
        return found, points, [f"{found:g} Hz by its times{unit}"]
    found = _round(found)
    if time[-1] * found > UNEVEN * len(points):
        raise refusal(path, None, "its times are too uneven to be one motion; give --fps")
    points = at_constant_rate(points, time, found)
    return found, points, [f"uneven times{unit}, resampled at {found:g} Hz"]


def _agree(path: Path | str, clock: Clock) -> None:
    """Refuse times that give another rate than the one that is named."""
    fps = clock.fps
    if clock.time is None or fps is None or len(clock.time) < 2:
        return
    steps = np.diff(clock.time)
    # Rounded times have another median than mean, and times with gaps another mean than median.
    both = [_rates(float(step), clock.unit) for step in (np.median(steps), steps.mean())]
    if (steps == 1.0).all() or not all(len(rates) == 1 for rates in both):
        return
    seen = [found for rates in both for found in rates.values()]
    if all(abs(found / fps - 1.0) > APART for found in seen):
        raise refusal(path, None, f"its rate is {fps:g} Hz, its times give "
                      f"{_round(seen[0]):g} Hz; say which with --fps")  # fmt: skip


def _rates(step: float, unit: float | None) -> dict[str, float]:
    """Rates [Hz] of people's motion that a step may mean, by unit."""
    units = UNITS if unit is None else {_word(unit): unit}
    found = {word: 1.0 / (step * own) for word, own in units.items() if step * own > 0.0}
    low, high = USUAL
    return {word: r for word, r in found.items() if low * 0.999 <= r <= high * 1.001}


def _word(unit: float) -> str:
    return next((word for word, own in UNITS.items() if own == unit), "ns")


def _round(found: float, share: float = 1e-2) -> float:
    """A whole rate where it is one but for so small a share."""
    whole = round(found)
    return float(whole) if whole and abs(whole - found) <= share * found else found


def _unit(plain: str, names: tuple[str, ...]) -> float | None:
    """Unit [s] of a clock's key, 0 where it names none; None: it is no such key."""
    if plain in names:
        return 0.0
    for name in names:
        if len(name) > 1 and plain.startswith(name) and plain[len(name) :] in _NAMED:
            return _NAMED[plain[len(name) :]]
    return None


def _alike(value: Any) -> Any:
    """One value, or the one that all frames have; None: there is none."""
    if isinstance(value, np.ndarray):
        value = value.ravel().tolist() if value.size < 1_000_000 else None
    if isinstance(value, (list, tuple)):
        first = next((v for v in value if v is not None), None)
        if not isinstance(first, (int, float, str)):
            return None
        return first if all(v is None or v == first for v in value) else None
    return value if isinstance(value, (int, float, str)) and value != "" else None


def _rate(value: Any) -> float | None:
    """A rate as number or as text: `60`, `29.97 fps`, `30000/1001`."""
    if isinstance(value, str):
        found = _WRITTEN.fullmatch(value.strip().lower())
        if not found or (found[2] and not float(found[2])):
            return None
        return (float(found[1]) / float(found[2] or 1.0)) or None
    given = number(value)
    return given if given and given > 0.0 else None
