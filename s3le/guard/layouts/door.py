"""The door for joint motions of any tool: opened here, and written back as they came."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from s3le.errors import TrajectoryError
from s3le.guard.layouts.episode import Layout
from s3le.robot.model import Geometry


def open_layout(
    path: Path | str,
    robot: Geometry,
    *,
    fps: float | None = None,
    joints: Sequence[str] | None = None,
    degrees: bool = False,
    column: str | None = None,
) -> Layout:
    """Read the motions of a file or folder, and remember how they were written.

    Args:
        path: .parquet, .csv, .npz, .npy, .pkl, .h5, or a LeRobot folder (v3 or v2).
        robot: whose motions they are said to be.
        fps: rows per second [Hz], instead of the file's own times.
        joints: names of the columns, for files that have none.
        degrees: the angles are in degrees.
        column: of a LeRobot folder: which feature holds the joints; None: action.

    Raises:
        TrajectoryError: names the file, the place in it, what is wrong and what to do.
    """
    raise NotImplementedError


def find(path: Path | str) -> list[Path]:
    """The motions known here below a folder, in order of their names; a file is itself.

    Raises:
        TrajectoryError: there is nothing at path, or no motion below it.
    """
    raise NotImplementedError
