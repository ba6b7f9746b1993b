"""One motion inside a file, and what a file that was read can do.

A file is more than its angles: it has a root, feet, names, an order, a rate, a type of numbers.
A layout keeps all of it and takes new angles for the robot's own joints. What a file cannot hold
to the last digit (float32, degrees) is rounded before anything is proven about it: `as_written`
gives the angles that will lie in the file, and these are what to prove.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from s3le.guard.layouts.numbers import Numbers
from s3le.motion.fit import Others
from s3le.motion.trajectory import Placed

GUARDED = "guarded"  # mode of a row that was changed, in files that have a column of modes


class Episode(NamedTuple):
    """One motion of a robot's own joints."""

    name: str  # of the file, or 'FOLDER, episode 3'
    time: np.ndarray  # [s], (m,), rising
    q: np.ndarray  # [rad], [m] of a prismatic joint, (m, n) in robot.joint_names order, finite
    notes: list[str]  # what was assumed, and what stays as it is
    numbers: Numbers  # how the file writes these angles
    mode: np.ndarray | None = None  # str (m,), how each row came about; see trajectory.BETWEEN
    others: Others | None = None  # joints that others move; they stay as they are, to the bit
    v: np.ndarray | None = None  # [rad/s], (m, n), where the file tells them: then it is a curve
    pace: Numbers | None = None  # how the file writes speeds; None: it has no place for them

    def as_written(self, q: np.ndarray) -> np.ndarray:
        """The angles that a file holds after `write` was given q [rad], (m, n).

        Where q is this episode's own q it comes back to the bit; elsewhere it is rounded to what
        the file can hold, within the joint's range where q is. as_written(as_written(q)) is
        as_written(q).

        Raises:
            TrajectoryError: q has another shape, or is not finite.
        """
        return self.numbers.as_written(self.name, q)

    def paced(self, v: np.ndarray) -> np.ndarray:
        """The speeds [rad/s], (m, n), that a file holds after `write` was given v.

        v itself where the file has no place for speeds.

        Raises:
            TrajectoryError: v has another shape, or is not finite.
        """
        return v if self.pace is None else self.pace.as_written(f"{self.name}, speeds", v)


class Layout(Protocol):
    """A file or folder that was read."""

    path: Path
    episodes: list[Episode]

    def root(self) -> Placed | None:
        """Where the base link is, in a file of one motion; None: it does not say (roots.KNOWN)."""

    def write(
        self,
        target: Path,
        q: Sequence[np.ndarray],
        about: Mapping[str, Any] | None = None,
        v: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        """Write the file again with other angles, whole or not at all.

        All else is as it was, to the bit: other columns, names, order, rate, types. Only where a
        file holds what this project says about it (robot, certificate, clearance, mode) does that
        follow: the old certificate goes, `about` comes in, the clearance of changed rows is NaN,
        which claims nothing, and their mode is GUARDED.

        Args:
            target: the new file, or folder where path is one; may be path itself.
            q: angles of each episode [rad], (m, n), as `episodes`.
            about: what is said of the new file (robot, robot_hash, certificate, as JSON can
                hold it), in layouts that have a place for words of ours; others leave it out.
            v: speeds of each episode [rad/s], (m, n), where it has a place for them; None: none
                are told, and those that a file of ours tells go where q has changed.

        Raises:
            TrajectoryError: q is not of these episodes, or is not finite; or target is a folder
                that is no data set of this layout.
            OSError: the disk refuses.
        """
