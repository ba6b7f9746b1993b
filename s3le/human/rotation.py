"""Rotation matrices of whole clips, (n, 3, 3), active, for column vectors."""

import numpy as np


def about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotation about a coordinate axis, right-handed.

    Args:
        axis: 0, 1 or 2 for x, y or z.
        angle: [rad], shape (n,).

    Returns:
        Matrices, shape (n, 3, 3).
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.zeros((len(angle), 3, 3))
    matrix[:, axis, axis] = 1.0
    matrix[:, i, i] = matrix[:, j, j] = np.cos(angle)
    matrix[:, j, i] = np.sin(angle)
    matrix[:, i, j] = -matrix[:, j, i]
    return matrix


def from_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """Rotation of unit quaternions, scalar part first.

        R = I + 2 w [v]x + 2 [v]x [v]x

    Args:
        wxyz: unit quaternions [-], shape (n, 4).

    Returns:
        Matrices, shape (n, 3, 3).
    """
    w, x, y, z = np.asarray(wxyz, float).T
    cross = np.zeros((len(w), 3, 3))
    cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0] = x, y, z
    cross -= cross.transpose(0, 2, 1)
    return np.eye(3) + 2.0 * (w[:, None, None] * cross + cross @ cross)


def turn(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Each matrix (n, 3, 3) times its vector (n, 3) or the one vector (3,); shape (n, 3)."""
    return np.einsum("nij,...j->ni" if vectors.ndim == 1 else "nij,nj->ni", matrices, vectors)
