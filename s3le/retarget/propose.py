"""What proposes poses for a frame: a look-up among stored poses, or a decoder.

A retargeter asks its proposer for poses to start from. How good they are decides how near the
answer comes to the human, never whether it is safe.
"""

import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np

from s3le.retarget.encoder import Encoder
from s3le.search.neighbours import Neighbours


class Proposer(Protocol):
    """Proposes poses; only read while in use, so that threads may share it."""

    def propose(self, x: np.ndarray) -> np.ndarray:
        """Poses to start from [rad], (at most k, n_dof), for the skeleton x (21,)."""


class LookUp:
    """Poses whose latents, or whose skeletons, are nearest."""

    def __init__(
        self, poses: np.ndarray, index: Neighbours, k: int, encoder: Encoder | None
    ) -> None:
        """Join the parts.

        Args:
            poses: stored poses [rad], (n, n_dof).
            index: finds rows of poses.
            k: how many are proposed, where there are as many.
            encoder: skeleton to what is searched; None: the skeleton itself is.
        """
        self._poses, self._index, self._encoder = poses, index, encoder
        self._k, self._own = min(k, len(index)), threading.local()

    def propose(self, x: np.ndarray) -> np.ndarray:
        """See Proposer."""
        z = self._encoder(x) if self._encoder else x
        if not hasattr(self._own, "seek"):
            self._own.seek = self._index.seeker(self._k)  # scratch, one for each thread
        rows, _ = self._own.seek(z)
        return self._poses[rows]


class Decoder:
    """A pose that a network makes up; it may break limits and collide."""

    def __init__(self, encoder: Encoder, decoder: Callable[[np.ndarray], np.ndarray]) -> None:
        """Take both networks."""
        self._encoder, self._decoder = encoder, decoder

    def propose(self, x: np.ndarray) -> np.ndarray:
        """See Proposer."""
        return self._decoder(self._encoder(x))[None].astype(float)
