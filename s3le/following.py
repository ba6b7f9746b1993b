"""A retargeter as the command line uses one: loaded from a folder, then one frame after another.

All that is asked of it stands in `Retargets`; whatever else it can do is its own affair.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from s3le.errors import ModelError
from s3le.machine import Machine


class Retargets(Protocol):
    """What a retargeter must be able to do; s3le.retarget.Retargeter does."""

    machine: Machine
    margin_between: float  # [m], clearance that it keeps on the paths between its poses
    velocity: np.ndarray  # [rad/s], (n_dof,), speeds that it keeps

    def start(self, q: np.ndarray | None = None) -> Any:
        """Begin anew: from pose q [rad], or at the first frame's own pose."""

    def step(self, x: np.ndarray, dt: float) -> Any:
        """The next pose: x (21,), dt [s] since the last; has `q` [rad] and `mode`."""

    def batch(self, x: np.ndarray, times: np.ndarray) -> Any:
        """All poses at once, looking ahead: x (n, 21), times [s]; has `q` (n, n_dof), `mode`."""


class Answer(NamedTuple):
    """One pose, and how it came about."""

    q: np.ndarray  # [rad], (n_dof,)
    mode: str


class Follower:
    """The adapter between a retargeter and those who use it."""

    def __init__(self, retargeter: Retargets) -> None:
        """Wrap a retargeter."""
        self._retargeter = retargeter
        self.machine = retargeter.machine
        self.margin_between = float(retargeter.margin_between)
        self.velocity = np.asarray(retargeter.velocity, float)

    def start(self, q: np.ndarray | None = None) -> None:
        """Begin anew, see Retargets.start."""
        self._retargeter.start(q)

    def step(self, x: np.ndarray, dt: float) -> Answer:
        """One frame in, one pose out."""
        made = self._retargeter.step(x, dt)
        return Answer(np.array(made.q, float), self._word(made.mode))

    def batch(self, x: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All frames in, poses (n, n_dof) and modes (n,) out."""
        made = self._retargeter.batch(x, times)
        return np.array(made.q, float), np.array([self._word(mode) for mode in made.mode], str)

    def _word(self, mode: Any) -> str:
        """The mode's name; a retargeter may number its modes and list them as MODES."""
        modes = getattr(self._retargeter, "MODES", {})
        return str(modes[mode]) if isinstance(modes, Mapping) and mode in modes else str(mode)


def load(folder: Path, method: str | None = None) -> Follower:
    """The retargeter that a folder holds.

    Raises:
        ModelError: there is none, or this installation cannot run one.
    """
    try:
        from s3le.retarget import Retargeter
    except ModuleNotFoundError as error:
        raise ModelError(f"{folder}: no retargeter can be run here ({error})") from None
    if not Path(folder).is_dir():
        raise ModelError(f"{folder} holds no retargeter; export one with: dvc repro export")
    options = {} if method is None else {"method": method}
    return Follower(Retargeter.load(Path(folder), **options))
