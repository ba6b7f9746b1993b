"""A stream of frames as lines of JSON: one line in, one line out, whatever the line is.

In: {"x": [21 numbers]} or {"points": [[x, y, z], ...]} (ten points in metres, z up, ordered or
keyed as skeleton.POINTS), with "dt" [s] since the last line or "t" [s]; without either the stream's
rate holds. Out: {"t", "q", "heading", "mode", "clearance"}, or {"line", "error"}; a refused line
moves nothing and its time is added to the next one's.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np

from s3le.errors import CertificateError, ClipError, ParameterError, S3leError
from s3le.human import dataset
from s3le.human.clip import FARTHEST
from s3le.retarget.stream import Retargeter
from s3le.skeleton import DIM, POINTS

LONGEST_LINE = 65_536  # [bytes]
LONGEST_STEP = 3600.0  # [s]
UNIT = 1e-3  # how far from 1 the length of a bone in x may be; it is then made 1


def lines(source: BinaryIO) -> Iterator[bytes]:
    """Lines of a stream; of one that is too long only its beginning, so memory stays bounded."""
    while line := source.readline(LONGEST_LINE + 1):
        whole = line
        while not whole.endswith(b"\n") and (rest := source.readline(LONGEST_LINE)):
            whole = rest  # the tail of a line that is too long
        yield line


class Live:
    """Turns lines into lines; the robot's state is the stream's."""

    def __init__(
        self,
        retargeter: Retargeter,
        rate: float,
        tilt_max: float,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin a stream at the robot's anchor.

        Args:
            retargeter: the one to follow the stream; every pose is checked.
            rate: frames per second of lines that do not say [Hz].
            tilt_max: frames whose torso leans farther are refused [rad]; only of "points".
            about: further words for the greeting.

        Raises:
            ParameterError: rate is none.
        """
        if not 0.1 <= rate <= 10_000.0:
            raise ParameterError(f"rate must be in [0.1, 10000] Hz, got {rate!r}")
        self._its, self._period, self._tilt = retargeter, 1.0 / rate, tilt_max
        self._about = about or {}
        self._time, self._owed, self._number = 0.0, 0.0, 0
        self._last_t: float | None = None
        self._heading = 0.0  # [rad], of the last good line
        self._stream = retargeter.start(retargeter.robot.anchor, check=True)

    def greeting(self) -> str:
        """The first line out: what the others will mean."""
        robot = self._its.robot
        return json.dumps(
            {
                "robot": robot.name,
                "robot_hash": robot.digest,
                "joints": robot.joint_names,
                "q": robot.anchor.tolist(),
                "units": {"t": "s", "q": "rad", "heading": "rad", "clearance": "m"},
                "margin": robot.margin,
                "margin_between": self._its.settings.between,
                **self._about,
            }
        )

    def answer(self, line: bytes) -> str:
        """What a line is answered with.

        Raises:
            CertificateError: the retargeter gave a pose that coal refuses; the stream must end.
        """
        self._number += 1
        try:
            x, heading, dt = self._frame(line)
            made = self._stream.step(x, dt)
        except (S3leError, ValueError) as refusal:
            words = " ".join(str(refusal).split())[:500]
            return json.dumps({"line": self._number, "error": words})
        self._owed = 0.0
        self._time += dt
        self._heading = heading
        return json.dumps(
            {
                "t": round(self._time, 9),
                "q": made.q.tolist(),
                "heading": heading,
                "mode": made.mode,
                "clearance": made.clearance,
            }
        )

    def _frame(self, line: bytes) -> tuple[np.ndarray, float, float]:
        """A line's skeleton, its heading [rad], and the time since the last good one [s]."""
        try:
            given = _parse(line)
        except ParameterError:
            self._owed += self._period  # time passes whether or not a line is any good
            raise
        self._owed += self._step(given)
        if not 0.0 < self._owed <= LONGEST_STEP:
            owed, self._owed = self._owed, 0.0
            raise ParameterError(f"{owed!r} s since the last frame; wanted above 0, below an hour")
        return *self._skeleton(given), self._owed

    def _step(self, given: dict[str, Any]) -> float:
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
            last, self._last_t = self._last_t, float(value)
            if last is None:
                return self._period
            if not value > last:
                self._last_t = last
                raise ParameterError(f"t must rise: {value!r:.40} s after {last!r} s")
            return float(value) - last
        return self._period

    def _skeleton(self, given: dict[str, Any]) -> tuple[np.ndarray, float]:
        """Seven vectors that face forward, and the yaw that was taken out; of "x" none: 0 [rad]."""
        if ("x" in given) == ("points" in given):
            raise ParameterError('wanted either "x" (21 numbers) or "points" (ten points)')
        if "x" in given:
            x = _array(given["x"], (DIM,), "x")
            bones = x.reshape(7, 3)
            length = np.linalg.norm(bones, axis=1, keepdims=True)
            if not (np.abs(length - 1.0) <= UNIT).all():
                raise ParameterError("x must be seven unit vectors")
            return (bones / length).reshape(DIM), 0.0
        points = given["points"]
        if isinstance(points, dict):
            missing = [name for name in POINTS if name not in points]
            if missing:
                raise ParameterError(f"points lacks {', '.join(missing)}")
            points = [points[name] for name in POINTS]
        points = _array(points, (len(POINTS), 3), "points")
        if not (np.abs(points) <= FARTHEST).all():
            raise ParameterError(f"points must lie within {FARTHEST:g} m")
        kept = dataset.skeletons(points[None], self._its.robot.neck, self._tilt)
        if not len(kept.rows):
            cause = next(cause for cause, count in kept.dropped.items() if count)
            raise ClipError(f"this frame cannot be used ({cause})")
        return kept.x[0], float(np.unwrap([self._heading, kept.heading[0]])[1])


def serve(live: Live, source: Iterable[bytes], say) -> None:
    """Answer every line until there are no more.

    Raises:
        CertificateError: see Live.answer; said before the stream ends.
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


def _array(values: Any, shape: tuple[int, ...], what: str) -> np.ndarray:
    try:
        given = np.array(values, dtype=object)
        good = given.shape == shape and all(
            isinstance(v, int | float) and not isinstance(v, bool) for v in given.ravel()
        )
        array = given.astype(float) if good else None
    except (ValueError, TypeError, OverflowError):
        array = None
    if array is None or not np.isfinite(array).all():
        raise ParameterError(f"{what} must be {'x'.join(map(str, shape))} finite numbers")
    return array
