"""Body poses of the SMPL family -> joints, for files that hold rotations instead of places.

A pose is one rotation per joint as axis times angle [rad], the root's first. The first 22
joints are the same in SMPL, SMPL-H and SMPL-X. The body's own frame: x left, y up, z forward.
What a person's shape changes are lengths and a few degrees; the offsets below are one grown
person's, rounded and made alike on both sides, of those joints that the ten points need.
"""

import numpy as np

from s3le.human.rotation import turn

COUNT = 22
# joint: (parent, offset of the left one in the parent's frame [m])
_TRUNK = {
    3: (0, (0.0, 0.117, -0.030)),
    6: (3, (0.0, 0.136, 0.010)),
    9: (6, (0.0, 0.055, 0.014)),
    12: (9, (0.0, 0.213, -0.036)),
    15: (12, (0.0, 0.089, 0.050)),
}
_LEFT = {  # (left, right): (left's parent, right's, offset)
    (1, 2): (0, 0, (0.062, -0.087, -0.010)),
    (4, 5): (1, 2, (0.041, -0.386, 0.002)),
    (7, 8): (4, 5, (-0.016, -0.424, -0.036)),
    (10, 11): (7, 8, (0.040, -0.060, 0.124)),
    (13, 14): (9, 9, (0.079, 0.115, -0.023)),
    (16, 17): (13, 14, (0.113, 0.045, -0.014)),
    (18, 19): (16, 17, (0.259, -0.015, -0.027)),
    (20, 21): (18, 19, (0.264, 0.010, -0.005)),
}
_MIRROR = np.array([-1.0, 1.0, 1.0])


def joints(pose: np.ndarray, place: np.ndarray | None = None) -> np.ndarray:
    """Where the joints are.

    Args:
        pose: axis times angle [rad], (n, at least 66); more joints are ignored.
        place: of the root [m], (n, 3); None: at the origin.

    Returns:
        Joints [m] in the frame of the root's rotation, (n, 22, 3), NaN where the pose is.
    """
    vectors = np.asarray(pose[:, : 3 * COUNT], float).reshape(len(pose), COUNT, 3)
    return placed(rotations(vectors), place)


def placed(local: np.ndarray, place: np.ndarray | None = None) -> np.ndarray:
    """Where the joints are whose rotations are matrices.

    Args:
        local: rotation of each joint against its parent, (n, at least 22, 3, 3); more are ignored.
        place: of the root [m], (n, 3); None: at the origin.

    Returns:
        As `joints`.
    """
    tree = {j: (parent, np.array(offset)) for j, (parent, offset) in _TRUNK.items()}
    for (left, right), (above_left, above_right, offset) in _LEFT.items():
        tree[left] = (above_left, np.array(offset))
        tree[right] = (above_right, np.array(offset) * _MIRROR)
    at = np.zeros((len(local), COUNT, 3))
    at[:, 0] = 0.0 if place is None else place
    turned = {0: local[:, 0]}
    for joint in sorted(tree):  # parents have smaller numbers
        parent, bone = tree[joint]
        at[:, joint] = at[:, parent] + turn(turned[parent], bone)
        turned[joint] = turned[parent] @ local[:, joint]
    return at


def rotations(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of axis times angle [rad], (..., 3) (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    cross = cross.reshape(*vector.shape, 3)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + first * cross + second * (cross @ cross)
