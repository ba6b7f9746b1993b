"""What a guard is told of the joints that others move, and what it says of them.

Others say where their joints are, and one of two things of the step to come: where they will be
when it is over (they move there straight), or how fast they may move. Of what is proven the first
is the claim that they do so; what they turn out to have done is held against it with the next step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from s3le.errors import CertificateError, ParameterError
from s3le.guard.wanted import Reader
from s3le.plan import amid
from s3le.plan.amid import Amid
from s3le.plan.limits import Limits
from s3le.plan.settings import Settings
from s3le.plan.steps import Step
from s3le.robot.description import ALL
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody, movable, whole_body

GAVE_WAY = "gave way to"  # two bodies
FORCED = "forced"  # two bodies that no way of ours keeps apart
TOLERANCE = 0.1  # [rad], by which a given joint may be away from where it was said to be
_FLOATS = 1e-9  # [rad]


class Told(NamedTuple):
    """What others do in a step, (k,)."""

    now: np.ndarray  # [rad]
    then: np.ndarray | None  # [rad], when it is over; None: not known
    within: np.ndarray | None  # [rad], how far from now they may get until then


class Given:
    """The joints of one robot that others move."""

    def __init__(
        self,
        body: WholeBody,
        most: Limits,
        settings: Settings,
        speed: object = None,
        skeleton: bool = False,
    ) -> None:
        """Put the robot at its anchor, and them where the robot file holds them.

        Args:
            body: the robot, and which they are.
            most, settings, skeleton: see Amid.
            speed: how fast they may move where nothing else is said [rad/s], one or (k,).

        Raises:
            ParameterError: the speed is no such number.
        """
        whole, at = body.robot, body.others
        self.names = body.given
        self._reader = Reader(whole, self.names, whole.lower[at], whole.upper[at])
        self._speed = None if speed is None else self._fast(speed)
        self._last: Told | None = None
        self._held = whole.anchor[at]
        self.walker = Amid(
            body, most, settings, q=body.base.anchor, given=self._held, skeleton=skeleton
        )
        self._fresh = self.walker.state()

    def keep(self) -> tuple[np.ndarray, Told | None]:
        """Where they were to be after the last step [rad], (k,), and what was said of it."""
        return self.walker.given, self._last

    def put(self, given: np.ndarray, last: Told | None = None) -> None:
        """Go back to what `keep` gave."""
        self.walker.others(given, then=given)
        self._last = last

    def start(self, q: np.ndarray, given: object) -> float:
        """Begin with ours at q (n,) and them where they are said to be; the clearance there [m].

        Raises:
            ParameterError: given is no pose of theirs.
            CertificateError: q is beyond limits. Nothing has changed.
        """
        at = self._held if given is None else self._reader.pose(given, "the given joints")
        most = self.walker.most
        beyond = np.maximum(most.lower - q, q - most.upper)
        if not beyond.max(initial=-np.inf) <= 0.0:  # catches NaN
            joint = int(beyond.argmax())
            raise CertificateError(
                f"{self.walker.robot.joint_names[joint]} stands at {q[joint]:.4f} rad, "
                f"{beyond[joint]:.4f} rad beyond its limits; among given joints no way leads back"
            )
        self.put(at)
        clearance = self.walker.measure(q, at)
        self.walker.put(self._fresh._replace(q=q, clearance=clearance))
        return clearance

    def told(self, given: object, later: object, speed: object, dt: float) -> Told:
        """What is said of them for one step.

        Args:
            given: where they are [rad], (k,) or by name; None: where they were to be.
            later: where they will be when the step is over; None: not known.
            speed: how fast they may move [rad/s], one or (k,); None: not said.
            dt: the time until the step is over [s].

        Raises:
            ParameterError: what is said is not enough, or no pose of these joints.
        """
        if later is not None and speed is not None:
            raise ParameterError(
                "of the given joints say given_next (where they will be) or given_speed (how fast "
                "they may move), not both"
            )
        now = self.walker.given if given is None else self._reader.pose(given, "the given joints")
        if later is not None:
            return Told(now, self._reader.pose(later, "the given joints to come"), None)
        fast = self._speed if speed is None else self._fast(speed)
        if fast is None or given is None:
            need = "given (where they are)" if given is None and fast is not None else (
                "given_next (where they will be) or given_speed (how fast they may move) [rad/s]"
            )  # fmt: skip
            raise ParameterError(
                f"others move {', '.join(self.names[:3])}"
                f"{' and more' if len(self.names) > 3 else ''}: {need} is missing"
            )
        return Told(now, None, fast * dt)

    def chunk(
        self, given: object, later: object, speed: object, each: Sequence[float]
    ) -> list[Told]:
        """What is said of them for the rows of a chunk, each of so many seconds.

        Args:
            given: where they are before the first row, see told.
            later: where they will be at the end of each row, (h, k) or by name; None: not known.
            speed: see told; what they may do by a row grows with the time until it.
            each: durations of the rows [s].

        Raises:
            ParameterError: see told.
        """
        if later is None:
            return [
                self.told(given, None, speed, until) for until in np.cumsum(each).tolist()
            ]  # fmt: skip
        rows = self._reader.rows(later, "the given joints to come")
        if len(rows) != len(each):
            raise ParameterError(
                f"given_next must have {len(each)} rows as the chunk has, got {len(rows)}"
            )
        made = [self.told(given, rows[0], speed, each[0])]
        for before, row in zip(rows[:-1], rows[1:], strict=True):
            made.append(Told(before, row, None))
        return made

    def broken(self, told: Told) -> str:
        """What they did otherwise than was said of the last step, in words; empty: nothing."""
        last, self._last = self._last, told
        if last is None:
            return ""
        if last.then is None:
            assert last.within is not None
            off, most = np.abs(told.now - last.now), last.within + _FLOATS
        else:
            off, most = np.abs(told.now - last.then), np.full(len(self.names), TOLERANCE)
        worst = int((off - most).argmax())
        if off[worst] <= most[worst]:
            return ""
        return (
            f"{self.names[worst]} is {off[worst]:.4f} rad from where it was"
            f"{'' if last.then is None else ' said to be'}, {most[worst]:.4f} rad were allowed: "
            "the step before holds only as far as that"
        )

    def reason(self, made: Step) -> str:
        """Why a step is not what was wanted, where others are the cause; empty: they are not."""
        its = self.walker
        if made.how == amid.WAYS[amid.FORCED]:
            return f"{FORCED}: {its.nearest} {_apart(made.clearance)}"
        if its.apart:
            return f"{FORCED}, not ours to change: {its.apart}"
        return f"{GAVE_WAY} {its.nearest}" if made.how == amid.WAYS[amid.GAVE_WAY] else ""

    def _fast(self, speed: object) -> np.ndarray:
        k = len(self.names)
        try:
            fast = np.broadcast_to(np.asarray(speed, float), (k,)).copy()
        except (TypeError, ValueError):
            raise ParameterError(f"given_speed must be a number or {k} numbers [rad/s]") from None
        if not ((fast >= 0.0) & (fast < np.inf)).all():  # catches NaN
            raise ParameterError(f"given_speed must be finite and at least 0, got {speed!r:.60}")
        return fast


def of(robot: Robot, names: Sequence[str] | str | None) -> WholeBody | None:
    """The robot among the joints that others move; None: there are none.

    Args:
        robot: of ours.
        names: of the given joints; "all": all that it could move and does not; None: those that
            the robot file names.

    Raises:
        RobotError: see wholebody.whole_body.
        ParameterError: names is another word.
    """
    if names is None:
        names = robot.description.given
    if isinstance(names, str):
        if names != ALL:
            raise ParameterError(f"given must be names of joints, or {ALL!r}, got {names!r:.60}")
        names = (ALL,)
    names = tuple(names)
    return whole_body(robot, movable(robot) if names == (ALL,) else names) if names else None


def refuse(*said: object) -> None:
    """Refuse what is said of given joints where there are none.

    Raises:
        ParameterError: something is said.
    """
    if any(one is not None for one in said):
        raise ParameterError("no joint of the robot is given: name them with Guard(given=...)")


def _apart(clearance: float) -> str:
    if clearance < 0.0:
        return f"overlap by {-clearance * 1e3:.2f} mm"
    return f"are {clearance * 1e3:.2f} mm apart"
