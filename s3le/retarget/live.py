"""A stream of frames as lines of JSON: one line in, one line out, whatever the line is.

In: {"x": [21 numbers]} or {"points": [[x, y, z], ...]} (ten points in metres, z up, ordered or
keyed as skeleton.POINTS), with "dt" [s] since the last line or "t" [s]; without either the stream's
rate holds; of joints that others move as s3le/guard/live.py has it. Out: {"t", "q", "heading",
"mode", "clearance"}, or {"line", "error"}; a refused line
moves nothing and its time is added to the next one's. A stream whose first good line has "q",
wanted joint angles, is one of joints: see s3le/guard/live.py.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from s3le.errors import ClipError, ParameterError, S3leError
from s3le.guard.guard import Guard
from s3le.guard.live import (
    GIVEN,
    LONGEST_LINE,
    Clock,
    array,
    heed,
    lines,
    refused,
    said_of,
    serve,
)
from s3le.human import dataset
from s3le.human.clip import FARTHEST
from s3le.retarget.stream import Retargeter
from s3le.skeleton import DIM, POINTS

__all__ = ["LONGEST_LINE", "Live", "lines", "serve"]
UNIT = 1e-3  # how far from 1 the length of a bone in x may be; it is then made 1


class Live:
    """Turns lines into lines; the robot's state is the stream's."""

    def __init__(
        self,
        retargeter: Retargeter,
        rate: float,
        tilt_max: float,
        about: Mapping[str, Any] | None = None,
        guard: Callable[[], Guard] | None = None,
        given: Sequence[str] | str | None = None,
        given_speed: object = None,
    ) -> None:
        """Begin a stream at the robot's anchor.

        Args:
            retargeter: the one to follow the stream; every pose is checked.
            rate: frames per second of lines that do not say [Hz].
            tilt_max: frames whose torso leans farther are refused [rad]; only of "points".
            about: further words for the greeting.
            guard: makes what follows a stream of joints, at the anchor too; None: with the robot's
                own limits.
            given, given_speed: joints that others move; see Retargeter.start.

        Raises:
            ParameterError: rate is none, or what is given makes no sense.
        """
        self._its, self._clock, self._tilt = retargeter, Clock(rate), tilt_max
        self._about, self._number = about or {}, 0
        self._begin = guard or (lambda: Guard(retargeter.robot, given=given))
        self._guard: Guard | None = None
        self._human = False  # a frame of a human has been followed
        self._heading = 0.0  # [rad], of the last good line
        self._stream = retargeter.start(
            retargeter.robot.anchor, check=True, given=given, given_speed=given_speed
        )

    def greeting(self) -> str:
        """The first line out: what the others will mean."""
        robot = self._its.robot
        return json.dumps(
            {
                "robot": robot.name,
                "robot_hash": robot.digest,
                "joints": robot.joint_names,
                **({"given": list(self._stream.given)} if self._stream.given else {}),
                "q": robot.anchor.tolist(),
                "units": {"t": "s", "q": "rad", "v": "rad/s", "heading": "rad", "clearance": "m"},
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
            given = self._clock.parse(line)
            if self._guard:
                heed(self._guard, given)
            dt = self._clock.since(given)
            of_joints = self._guard or "q" in given
            said = self._said_of_joints(given, dt) if of_joints else self._said(given, dt)
        except (S3leError, ValueError) as refusal:
            return refused(self._number, refusal)
        return json.dumps({"t": self._clock.good(dt), **said})

    def _said(self, given: dict[str, Any], dt: float) -> dict[str, Any]:
        x, heading = self._skeleton(given)
        made = self._stream.step(x, dt, **{key: given[key] for key in GIVEN if key in given})
        self._heading, self._human = heading, True
        return {
            "q": made.q.tolist(),
            **({} if made.v is None else {"v": made.v.tolist()}),
            "heading": heading,
            "mode": made.mode,
            "clearance": made.clearance,
            **({"given": made.given} if made.given else {}),
        }

    def _said_of_joints(self, given: dict[str, Any], dt: float) -> dict[str, Any]:
        if self._human or "x" in given or "points" in given:
            raise ParameterError(
                "a stream is either of joints (q) or of a human (x or points); begin another one"
            )
        guard = self._guard or self._begin()
        heed(guard, given)
        said = said_of(guard, given, dt)
        self._guard = guard  # the first good line has decided
        return said

    def _skeleton(self, given: dict[str, Any]) -> tuple[np.ndarray, float]:
        """Seven vectors that face forward, and the yaw that was taken out; of "x" none: 0 [rad]."""
        if ("x" in given) == ("points" in given):
            raise ParameterError('wanted either "x" (21 numbers) or "points" (ten points)')
        if "x" in given:
            x = array(given["x"], (DIM,), "x")
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
        points = array(points, (len(POINTS), 3), "points")
        if not (np.abs(points) <= FARTHEST).all():
            raise ParameterError(f"points must lie within {FARTHEST:g} m")
        kept = dataset.skeletons(points[None], self._its.robot.neck, self._tilt)
        if not len(kept.rows):
            cause = next(cause for cause, count in kept.dropped.items() if count)
            raise ClipError(f"this frame cannot be used ({cause})")
        return kept.x[0], float(np.unwrap([self._heading, kept.heading[0]])[1])
