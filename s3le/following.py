"""A retargeter as the command line uses one: loaded from a folder, then one frame after another.

All that is asked of it stands in `Retargets` and `Streams`; whatever else it can do is its own
affair.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from s3le.errors import ModelError
from s3le.robot.robot import Robot
from s3le.store import documents


class Streams(Protocol):
    """One robot in motion."""

    def step(self, x: np.ndarray, dt: float) -> Any:
        """The next pose: x (21,), dt [s] since the last; has `q` [rad] and `mode`."""


class Retargets(Protocol):
    """What a retargeter must be able to do; s3le.retarget.stream.Retargeter does."""

    robot: Robot
    settings: Any  # its `between` is the clearance kept on the paths between poses [m]
    speed: np.ndarray  # [rad/s], (n_dof,), most that each joint does

    def start(self, q: np.ndarray | None = None) -> Streams:
        """Begin: from pose q [rad], or at the first frame's own pose."""

    def batch(self, x: np.ndarray, times: np.ndarray) -> Any:
        """All poses at once: x (n, 21), times [s]; has `q` (n, n_dof) and `mode`."""


class Answer(NamedTuple):
    """One pose, and how it came about."""

    q: np.ndarray  # [rad], (n_dof,)
    mode: str


class Follower:
    """The adapter between a retargeter and those who use it; follows one human at a time."""

    def __init__(self, retargeter: Retargets, modes: Mapping[int, str]) -> None:
        """Wrap a retargeter.

        Args:
            retargeter: what does the work.
            modes: its numbers of modes in words.
        """
        self._retargeter, self._modes = retargeter, modes
        self._stream = retargeter.start()
        self.robot = retargeter.robot
        self.margin_between = float(retargeter.settings.between)
        self.velocity = np.asarray(retargeter.speed, float)

    def start(self, q: np.ndarray | None = None) -> None:
        """Begin anew, see Retargets.start."""
        self._stream = self._retargeter.start(q)

    def step(self, x: np.ndarray, dt: float) -> Answer:
        """One frame in, one pose out."""
        made = self._stream.step(x, dt)
        return Answer(np.array(made.q, float), self._modes[int(made.mode)])

    def batch(self, x: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All frames in, poses (n, n_dof) and modes (n,) out."""
        made = self._retargeter.batch(x, times)
        return np.array(made.q, float), np.array([self._modes[int(m)] for m in made.mode], str)


def load(folder: Path, method: str | None = None) -> Follower:
    """The retargeter that a folder holds.

    Args:
        folder: written by the stage `export`.
        method: refuse any other method than this; None accepts all.

    Raises:
        ModelError: there is none, or of another method, or this installation cannot run one.
        S3leError: what the folder's own reader refuses.
    """
    try:
        from s3le.retarget import exported
        from s3le.retarget.mode import Mode
    except ModuleNotFoundError as error:
        raise ModelError(f"{folder}: no retargeter can be run here ({error})") from None
    if not Path(folder).is_dir():
        raise ModelError(f"{folder} holds no retargeter; write one with: dvc repro export")
    made = exported.load(Path(folder))
    own = documents.read_json(Path(folder) / exported.ABOUT, "export").get("method")
    if method not in (None, own):
        raise ModelError(
            f"{folder} retrieves by '{own}', not '{method}'; "
            f"export another: dvc exp run -S export.method={method} export"
        )
    return Follower(made, {int(mode): mode.name.lower() for mode in Mode})
