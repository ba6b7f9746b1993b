"""Streams as lines of JSON: one line in, one line out, whatever the line is; and one of joints.

In: {"q": [rad, ...]} in the robot's order, or {"q": {"joint": rad, ...}}, or {"q": null} to brake;
with "dt" [s] since the last line or "t" [s]; without either the stream's rate holds. Beside it, or
alone: "measured", where the robot is, as q; "stop": true latches a stop, false releases it. Where
others move joints: "given", where these are, and "given_next" [rad] or "given_speed" [rad/s]. Out:
{"t", "q", "v", "reason", "certified", "clearance"}, with "given" if others did not keep their word;
or {"line", "error"}; a refused line moves nothing and its time is added to the next one's. Human
vectors are for s3le/retarget/live.py.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, BinaryIO, Protocol

import numpy as np

from s3le.errors import CertificateError, ParameterError, S3leError
from s3le.guard.guard import Guard

LONGEST_LINE = 65_536  # [bytes]
LONGEST_STEP = 3600.0  # [s]
GIVEN = ("given", "given_next", "given_speed")
_KEYS = ("q", "measured", "stop", "dt", "t", *GIVEN)


def lines(source: BinaryIO) -> Iterator[bytes]:
    """Lines of a stream; of one that is too long only its beginning, so memory stays bounded."""
    while line := source.readline(LONGEST_LINE + 1):
        whole = line
        while not whole.endswith(b"\n") and (rest := source.readline(LONGEST_LINE)):
            whole = rest  # the tail of a line that is too long
        yield line


class Clock:
    """The time of a stream's lines; that of refused ones is owed to the next good one."""

    def __init__(self, rate: float) -> None:
        """Begin at zero.

        Args:
            rate: lines per second of those that do not say [Hz].

        Raises:
            ParameterError: rate is none.
        """
        if not 0.1 <= rate <= 10_000.0:
            raise ParameterError(f"rate must be in [0.1, 10000] Hz, got {rate!r}")
        self.time = 0.0  # [s], of the last good line
        self._period, self._owed = 1.0 / rate, 0.0
        self._last: float | None = None  # [s], what the line before said

    def parse(self, line: bytes) -> dict[str, Any]:
        """What a line holds.

        Raises:
            ParameterError: it is no object of JSON.
        """
        try:
            return _parse(line)
        except ParameterError:
            self._owed += self._period  # time passes whether or not a line is any good
            raise

    def since(self, given: Mapping[str, Any]) -> float:
        """The time from the last good line to this one [s].

        Raises:
            ParameterError: the line says another.
        """
        self._owed += self._step(given)
        if not 0.0 < self._owed <= LONGEST_STEP:
            owed, self._owed = self._owed, 0.0
            raise ParameterError(f"{owed!r} s since the last frame; wanted above 0, below an hour")
        return self._owed

    def good(self, dt: float) -> float:
        """Note that a line was answered; the time [s]."""
        self._owed = 0.0
        self.time += dt
        return round(self.time, 9)

    def _step(self, given: Mapping[str, Any]) -> float:
        for key in ("dt", "t"):
            value = given.get(key)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ParameterError(f"{key} must be a number [s], got {value!r:.40}")
            if not abs(value) < 1e12:
                raise ParameterError(f"{key} must be finite, got {value!r:.40}")
            if key == "dt":
                if not value > 0:
                    raise ParameterError(f"dt must be above 0 s, got {value!r:.40}")
                return float(value)
            last = self._last
            if last is not None and not value > last:
                raise ParameterError(f"t must rise: {value!r:.40} s after {last!r} s")
            self._last = float(value)
            return self._period if last is None else float(value) - last
        return self._period


class Lines(Protocol):
    """What serve takes: it greets, and answers each line with one."""

    def greeting(self) -> str:
        """The first line out."""
        ...

    def answer(self, line: bytes) -> str:
        """What a line is answered with."""
        ...


class LiveJoints:
    """Turns lines of wanted joint angles into lines; the robot's state is the guard's."""

    def __init__(self, guard: Guard, rate: float, about: Mapping[str, Any] | None = None) -> None:
        """Begin a stream where the guard's robot is.

        Args:
            guard: of the robot to move; nobody else steps it.
            rate: lines per second of those that do not say [Hz].
            about: further words for the greeting.

        Raises:
            ParameterError: rate is none.
        """
        self._clock, self._guard, self._about = Clock(rate), guard, about or {}
        self._number = 0

    def greeting(self) -> str:
        """The first line out: what the others will mean."""
        guard = self._guard
        return json.dumps(
            {
                "robot": guard.robot.name,
                "robot_hash": guard.robot.digest,
                "joints": guard.robot.joint_names,
                **({"given": list(guard.given)} if guard.given else {}),
                "q": guard.q.tolist(),
                "units": {"t": "s", "q": "rad", "clearance": "m"},
                "margin": guard.robot.margin,
                "margin_between": guard.settings.between,
                **self._about,
            }
        )

    def answer(self, line: bytes) -> str:
        """What a line is answered with."""
        self._number += 1
        try:
            given = self._clock.parse(line)
            heed(self._guard, given)
            dt = self._clock.since(given)
            said = said_of(self._guard, given, dt)
        except (S3leError, ValueError) as refusal:
            return refused(self._number, refusal)
        return json.dumps({"t": self._clock.good(dt), **said})


def heed(guard: Guard, given: Mapping[str, Any]) -> None:
    """Stop, or let go, whatever else a line says.

    Raises:
        ParameterError: "stop" is neither true nor false; a stop is latched.
    """
    if "stop" not in given:
        return
    if given["stop"] is False:
        guard.release()
        return
    guard.stop()
    if given["stop"] is not True:
        raise ParameterError(f'"stop" must be true or false, got {given["stop"]!r:.40}')


def said_of(guard: Guard, given: Mapping[str, Any], dt: float) -> dict[str, Any]:
    """The guard's answer to one line of joints.

    Raises:
        ParameterError, StateError: see Guard.step; or a key is unknown, or there is no "q".
    """
    if wrong := [key for key in given if key not in _KEYS]:
        raise ParameterError(f"unknown key {wrong[0]!r:.40}; a line of joints has {_KEYS}")
    if "stop" not in given and "q" not in given:
        raise ParameterError('wanted "q": angles [rad], by name or in the order of the joints')
    said = {key: given[key] for key in GIVEN if key in given}
    made = guard.step(given.get("q"), dt, given.get("measured"), **said)
    return {
        "q": made.q.tolist(),
        "v": made.v.tolist(),
        "reason": made.reason,
        "certified": made.certified,
        "clearance": made.clearance,
        **({"given": made.given} if made.given else {}),
    }


def refused(number: int, refusal: Exception) -> str:
    """The line that says why another one moved nothing."""
    return json.dumps({"line": number, "error": " ".join(str(refusal).split())[:500]})


def serve(live: Lines, source: Iterable[bytes], say) -> None:
    """Answer every line until there are no more.

    Raises:
        CertificateError: a pose was refused by coal; said before the stream ends.
    """
    say(live.greeting())
    for line in source:
        try:
            say(live.answer(line))
        except CertificateError as refusal:
            say(json.dumps({"fatal": str(refusal)}))
            raise


def _parse(line: bytes) -> dict[str, Any]:
    if len(line) > LONGEST_LINE:
        raise ParameterError(f"a line has at most {LONGEST_LINE} bytes")
    try:
        given = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ParameterError(f"not JSON ({error})") from None
    if not isinstance(given, dict):
        raise ParameterError('wanted an object, as {"x": [21 numbers], "dt": 0.033}')
    return given


def array(values: Any, shape: tuple[int, ...], what: str) -> np.ndarray:
    """Numbers of JSON as an array of one shape.

    Raises:
        ParameterError: they are not, or not finite.
    """
    try:
        given = np.array(values, dtype=object)
        good = given.shape == shape and all(
            isinstance(v, int | float) and not isinstance(v, bool) for v in given.ravel()
        )
        found = given.astype(float) if good else None
    except (ValueError, TypeError, OverflowError):
        found = None
    if found is None or not np.isfinite(found).all():
        raise ParameterError(f"{what} must be {'x'.join(map(str, shape))} finite numbers")
    return found
