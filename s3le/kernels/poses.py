"""What is asked of a pose: is it in a box, how far is it from another, or a skeleton; compiled."""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.kinematics import bones, place

AGREEMENT = 1e-6  # [m], kept beyond every margin: another engine's distances may differ by this


@compiled
def cost_of(chain, q, x):
    """Half the squared distance of the pose's skeleton to x: its seven cosine distances' sum."""
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    found = np.empty(21)
    place(chain, q, R, p, z)
    bones(chain, R, p, z, found, np.empty((0, n)))
    total = 0.0
    for k in range(21):
        total += (found[k] - x[k]) ** 2
    return 0.5 * total


@compiled
def inside(q, lowest, highest):
    """Is the pose in the box? False where it is not finite."""
    for i in range(len(q)):
        if not lowest[i] <= q[i] <= highest[i]:
            return False
    return True


@compiled
def apart(a, b):
    """Largest difference of two poses in any joint [rad]."""
    most = 0.0
    for i in range(len(a)):
        most = max(most, abs(a[i] - b[i]))
    return most
