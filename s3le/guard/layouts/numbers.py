"""Angles as a file writes them: in float32, in degrees, in text; and what they are as radians.

A file's number stands for an angle by `decode`. `encode` finds the number of the file's own type
whose angle is nearest; numbers of angles that nobody changed are kept, to the bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from s3le.errors import TrajectoryError

NEAR = (0, -1, 1, -2, 2)  # [ulp] around the rounded quotient; deg2rad loses no more


@dataclass(frozen=True, eq=False)
class Numbers:
    """How a file writes the angles of one motion."""

    raw: tuple[np.ndarray, ...]  # numbers of each joint in the file's type, (m,)
    degrees: tuple[bool, ...]  # of each joint
    q: np.ndarray  # [rad], (m, n): what raw stands for
    lower: np.ndarray  # [rad], (n,), of the robot
    upper: np.ndarray

    def encode(self, name: str, q: np.ndarray) -> list[np.ndarray]:
        """Numbers of the file for angles: one (m,) a joint, in the type of raw.

        Args:
            name: of the motion, for messages.
            q: [rad], (m, n).

        Raises:
            TrajectoryError: another shape than self.q, not finite, or too large for the file.
        """
        q = np.asarray(q, float)
        if q.shape != self.q.shape:
            raise TrajectoryError(f"{name}: angles of shape {q.shape}, it holds {self.q.shape}")
        for row, joint in np.argwhere(~np.isfinite(q))[:1]:
            raise TrajectoryError(f"{name}: row {row}: angle {joint} is {q[row, joint]}")
        with np.errstate(over="ignore"):
            return [self._encode(name, i, q[:, i]) for i in range(q.shape[1])]

    def as_written(self, name: str, q: np.ndarray) -> np.ndarray:
        """The angles that the numbers of `encode` stand for [rad], (m, n)."""
        made = np.empty(self.q.shape)
        for i, column in enumerate(self.encode(name, q)):
            made[:, i] = decode(column, self.degrees[i])
        return made

    def changed(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Rows in which a number is another than in the file, bool (m,)."""
        same = [new == old for new, old in zip(columns, self.raw, strict=True)]
        return ~np.all(same, axis=0)

    def _encode(self, name: str, joint: int, q: np.ndarray) -> np.ndarray:
        out = np.array(self.raw[joint])
        rows = np.flatnonzero(q != self.q[:, joint])
        if not len(rows):
            return out
        wanted, degrees = q[rows], self.degrees[joint]
        kind = out.dtype
        base = (np.rad2deg(wanted) if degrees else wanted).astype(kind)
        for row in rows[~np.isfinite(base)][:1]:
            raise TrajectoryError(
                f"{name}: row {row}: angle {joint}, {q[row]:.6g} rad, is larger than {kind} holds"
            )
        choices = np.stack([_step(base, k) for k in NEAR])  # (5, rows)
        angles = decode(choices, degrees)
        wrong = np.abs(angles - wanted)
        # What was within the joint's range must not be rounded out of it.
        low, high = self.lower[joint], self.upper[joint]
        out_of = ((angles < low) & (wanted >= low)) | ((angles > high) & (wanted <= high))
        wrong[out_of] = np.inf
        best = np.argmin(wrong, axis=0)  # the first of equals: the quotient itself
        out[rows] = choices[best, np.arange(len(rows))]
        return out


def decode(raw: np.ndarray, degrees: bool) -> np.ndarray:
    """The angles that numbers of a file stand for [rad], as s3le.motion.fit reads them."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is refused as any
        q = np.asarray(raw, float)
    return np.deg2rad(q) if degrees else q


def _step(values: np.ndarray, count: int) -> np.ndarray:
    """Numbers `count` places further on, in their own type."""
    toward = np.array(np.inf if count > 0 else -np.inf, values.dtype)
    for _ in range(abs(count)):
        values = np.nextafter(values, toward)
    return values
