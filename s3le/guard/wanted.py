"""Wanted poses as people hand them over: numbers in the robot's order, or by the joints' names.

A wanted pose need not be feasible: it may lie beyond the limits, in collision, or far away. It must
be a pose, though: finite, of this robot's joints, in radians. What is not is refused with the row
and the joint.
"""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches

import numpy as np

from s3le.errors import ParameterError
from s3le.robot.robot import Robot

TURN = 2.0 * np.pi  # [rad] beyond its limits an angle is none that anybody wants
_HALF = np.pi  # [rad] beyond, and within them as degrees: it is taken for degrees


class Reader:
    """Reads poses of some joints of one robot."""

    def __init__(
        self, robot: Robot, names: Sequence[str], lower: np.ndarray, upper: np.ndarray
    ) -> None:
        """Take note of the joints' names, and of the robot's others.

        Args:
            robot: whose joints they are.
            names: the joints.
            lower, upper: their limits [rad], (n,).
        """
        self.names, self._lower, self._upper = tuple(names), lower, upper
        every = {j.get("name", "") for j in robot.tree.iter("joint") if j.get("type") != "fixed"}
        self.held = frozenset(every - set(self.names))

    def pose(self, given: object, what: str = "a wanted pose") -> np.ndarray:
        """One pose [rad], (n,), in the order of the robot's joints.

        Args:
            given: n numbers, or a mapping from names to numbers; joints that the robot holds still
                may be in it, and are left out.
            what: for a refusal.

        Raises:
            ParameterError: a name is unknown or missing, the shape is another, or an angle is not
                finite or looks like degrees.
        """
        if isinstance(given, Mapping):
            given = self._named(given, what)
        q = _numbers(given, what)
        if q.shape != (len(self.names),):
            raise ParameterError(f"{what} must have shape ({len(self.names)},), got {q.shape}")
        self._refuse(q[None], what, rows=False)
        return q

    def rows(self, given: object, what: str = "a chunk") -> np.ndarray:
        """Poses in rows [rad], (h, n).

        Args:
            given: (h, n) numbers, a mapping from names to (h,) numbers, or h mappings.
            what: for a refusal.

        Raises:
            ParameterError: as pose, or there is no row; names the row.
        """
        if isinstance(given, Mapping):
            columns = self._named(given, what)
            if len({np.shape(column) for column in columns}) != 1 or np.ndim(columns[0]) != 1:
                raise ParameterError(f"{what} by names must have as many angles for each joint")
            given = np.stack([_numbers(column, what) for column in columns], axis=1)
        elif isinstance(given, Sequence) and any(isinstance(row, Mapping) for row in given):
            given = [self.pose(row, f"{what}, row {i}") for i, row in enumerate(given)]
        q = _numbers(given, what)
        if q.ndim != 2 or q.shape[1] != len(self.names) or not len(q):
            raise ParameterError(
                f"{what} must have shape (h, {len(self.names)}) with h at least 1, got {q.shape}"
            )
        self._refuse(q, what, rows=True)
        return q

    def _named(self, given: Mapping, what: str) -> list:
        known = set(self.names)
        for name in given:
            if name not in known and name not in self.held:
                near = get_close_matches(str(name), self.names, n=1)
                raise ParameterError(
                    f"{what} names {str(name)!r:.60}, which is no joint of the robot"
                    + (f"; did you mean {near[0]}?" if near else "")
                )
        if missing := [name for name in self.names if name not in given]:
            raise ParameterError(f"{what} lacks {', '.join(missing)}")
        return [given[name] for name in self.names]

    def _refuse(self, q: np.ndarray, what: str, rows: bool) -> None:
        finite = np.isfinite(q)
        if not finite.all():
            row, joint = np.argwhere(~finite)[0]
            where = f", row {row}" if rows else ""
            raise ParameterError(
                f"{what}{where}: {self.names[joint]} is not finite ({q[row, joint]!s})"
            )
        beyond = np.maximum(self._lower - q, q - self._upper)
        if beyond.max() <= _HALF:
            return
        row, joint = np.unravel_index(int(beyond.argmax()), q.shape)
        angle, far = q[row, joint], beyond[row, joint]
        as_degrees = np.radians(q)
        fits = ((as_degrees >= self._lower) & (as_degrees <= self._upper)).all()
        if far <= TURN and not fits:
            return
        where = f", row {row}" if rows else ""
        if fits or abs(np.radians(angle)) <= max(-self._lower[joint], self._upper[joint]):
            next_ = f"as degrees it would be {np.radians(angle):.4g} rad: give radians"
        else:
            next_ = "give angles within a turn of them"
        raise ParameterError(
            f"{what}{where}: {self.names[joint]} at {angle:.6g} rad is {far:.4g} rad beyond its "
            f"limits [{self._lower[joint]:.4g}, {self._upper[joint]:.4g}]; {next_}"
        )


def _numbers(given: object, what: str) -> np.ndarray:
    """Numbers as floats; what is text, truth or an object is none."""
    try:
        found = np.asarray(given)
    except (TypeError, ValueError):
        raise ParameterError(f"{what} must hold numbers in rows of one length") from None
    if found.dtype.kind not in "iuf":
        raise ParameterError(f"{what} must hold numbers, got {found.dtype}")
    return np.array(found, float)


def duration(dt: object, least: float) -> float:
    """A step's duration [s].

    Raises:
        ParameterError: it is no number, not finite, or shorter than `least`.
    """
    if isinstance(dt, bool) or not isinstance(dt, (int, float, np.integer, np.floating)):
        raise ParameterError(f"dt must be a number [s], got {dt!r:.40}")
    if not least <= float(dt) < np.inf:  # catches NaN
        raise ParameterError(f"dt must be finite and at least {least:g} s, got {dt!r:.40}")
    return float(dt)


def is_lost(measured: object) -> bool:
    """Whether a measured pose holds what is not finite: nobody knows where the robot is."""
    values = list(measured.values()) if isinstance(measured, Mapping) else measured
    try:
        return not np.isfinite(np.asarray(values, float)).all()
    except (TypeError, ValueError):
        return False
