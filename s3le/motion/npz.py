"""Trajectories as NPZ, for those who train policies; nothing in one is ever unpickled.

Arrays `time` [s], `q` [rad] and `v` [rad/s] (n, n_dof), `joint_names`, `heading` [rad],
`clearance` [m], `mode`, `about` (JSON text), and `fps` [Hz] where the steps in time are alike.
`np.load(path)` reads it.
"""

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.motion.columns import ANGLES, SPEEDS, interpret
from s3le.motion.trajectory import Trajectory
from s3le.store import npz

MOST_BYTES = 4 << 30  # of one file, unpacked; ten hours of forty joints at 1 kHz


def write(trajectory: Trajectory, part: Path) -> None:
    """Write one file; the same trajectory gives the same bytes."""
    arrays = {
        "time": trajectory.time,
        "q": trajectory.q,
        "v": trajectory.v,
        "joint_names": np.array(trajectory.joints),
        "heading": trajectory.heading,
        "clearance": trajectory.clearance,
        "mode": trajectory.mode,
        "fps": None if trajectory.rate is None else np.float64(trajectory.rate),
        "about": np.array(json.dumps(trajectory.about, sort_keys=True)),
    }
    held: dict[str, Any] = {k: v for k, v in arrays.items() if v is not None}
    with part.open("wb") as stream:  # savez would add a suffix to a name
        np.savez_compressed(stream, **held)


def read(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read ours or another tool's.

    Raises:
        TrajectoryError: what s3le.store.npz or interpret refuses.
    """
    arrays = npz.read_npz(path, TrajectoryError, MOST_BYTES)
    about = told(arrays.pop("about", None))
    return interpret(str(path), arrays, fps, joints, about)


def read_npy(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read a single array (n, n_dof) of angles, named by joints.

    Raises:
        TrajectoryError: as read.
    """
    array = npz.read_npy(path, TrajectoryError, MOST_BYTES)
    return interpret(str(path), {ANGLES[0]: array}, fps, joints)


def told(text: np.ndarray | None) -> dict[str, Any]:
    """What the file says about itself, as far as it can be read."""
    try:
        about = json.loads(str(text))
    except (ValueError, RecursionError):
        return {}
    return about if isinstance(about, dict) else {}


def tells_speeds(path: Path) -> bool:
    """Is a sound file ours, and does it tell speeds?"""
    with zipfile.ZipFile(path) as archive:
        return {f"{SPEEDS}.npy", "about.npy"} <= set(archive.namelist())
