"""What proposes poses for a frame: a look-up among stored poses, or a decoder.

A retargeter asks its proposer for poses to start from. How good they are decides how near the
answer comes to the human, never whether it is safe.
"""

from typing import Protocol

import numpy as np

from s3le.kernels.nearest import nearest_few
from s3le.retarget.encoder import Encoder


class Search(Protocol):
    """Nearest stored rows of a vector; only read while in use, so that threads may share it."""

    def query(self, z: np.ndarray, k: int) -> np.ndarray:
        """Rows of the k stored vectors nearest to z (d,), nearest first, int64 (at most k,)."""


class Proposer(Protocol):
    """Proposes poses; only read while in use, so that threads may share it."""

    def propose(self, x: np.ndarray) -> np.ndarray:
        """Poses to start from [rad], (at most k, n_dof), for the skeleton x (21,)."""


class Exact:
    """Looks at every stored vector."""

    def __init__(self, stored: np.ndarray) -> None:
        """Take the stored vectors, (n, d)."""
        self._stored = np.ascontiguousarray(stored, np.float32)

    def query(self, z: np.ndarray, k: int) -> np.ndarray:
        """See Search."""
        return nearest_few(self._stored, z, k)


class LookUp:
    """Poses whose latents, or whose skeletons, are nearest."""

    def __init__(self, poses: np.ndarray, search: Search, k: int, encoder: Encoder | None) -> None:
        """Join the parts.

        Args:
            poses: stored poses [rad], (n, n_dof).
            search: finds rows of poses.
            k: how many are proposed.
            encoder: skeleton to latent; None: the skeleton itself is searched.
        """
        self._poses, self._search, self._k, self._encoder = poses, search, k, encoder

    def propose(self, x: np.ndarray) -> np.ndarray:
        """See Proposer."""
        z = self._encoder(x) if self._encoder else x
        return self._poses[self._search.query(z, self._k)]


class Decoder:
    """A pose that a network makes up; it may break limits and collide."""

    def __init__(self, encoder: Encoder, decoder: Encoder) -> None:
        """Take both networks."""
        self._encoder, self._decoder = encoder, decoder

    def propose(self, x: np.ndarray) -> np.ndarray:
        """See Proposer."""
        return self._decoder(self._encoder(x))[None].astype(float)
