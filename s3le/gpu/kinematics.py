"""Forward kinematics, the seven bones and their Jacobian, for many poses at once, in torch.

The same maps as s3le.kernels.kinematics; rows are last (s3le.gpu.chain). Sums over the three
coordinates are written out: a reduction may choose its order by the number of rows, and a pose's
answer should not depend on the poses around it.
"""

import torch
from torch import Tensor

from s3le.gpu.chain import Solid

SHORTEST = 1e-9  # [m], a bone under this has no direction


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Inner product over the first dimension, of size three."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product over the first dimension, of size three."""
    return torch.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def rotate(R: Tensor, v: Tensor) -> Tensor:
    """R v over the leading dimensions (3, 3) and (3)."""
    return R[:, 0] * v[0] + R[:, 1] * v[1] + R[:, 2] * v[2]


def place(solid: Solid, q: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Place every frame of every pose.

    Args:
        solid: the robot.
        q: poses [rad], (n, rows).

    Returns:
        R (3, 3, n + 1, rows); p [m], (3, n + 1, rows); z (3, n, rows), the joints' axes in the
        base frame. Frame 0 is the base, frame j + 1 moves with joint j.
    """
    n, rows = q.shape
    constant, cosine, sine = solid.turn
    own = constant + cosine * torch.cos(q) + sine * torch.sin(q)  # (3, 3, n, rows)
    R = q.new_zeros(3, 3, n + 1, rows)
    p = q.new_zeros(3, n + 1, rows)
    z = q.new_empty(3, n, rows)
    for i in range(3):
        R[i, i, 0] = 1.0
    for joint, parent in solid.levels:
        before = R.index_select(2, parent)
        turn = own.index_select(2, joint)
        after = (
            before[:, 0:1] * turn[0] + before[:, 1:2] * turn[1] + before[:, 2:3] * turn[2]
        )  # (3, 3, k, rows)
        R.index_copy_(2, joint + 1, after)
        step = rotate(before, solid.translation.index_select(1, joint))
        p.index_copy_(1, joint + 1, p.index_select(1, parent) + step)
        z.index_copy_(1, joint, rotate(before, solid.axis.index_select(1, joint)))
    return R, p, z


def _fixed(R: Tensor, p: Tensor, frame: Tensor, at: Tensor) -> Tensor:
    """Points fixed in frames, in the base frame: at (3, k, 1) [m] -> (3, k, rows) [m]."""
    return p.index_select(1, frame) + rotate(R.index_select(2, frame), at)


def capsule_ends(solid: Solid, R: Tensor, p: Tensor) -> tuple[Tensor, Tensor]:
    """Both ends of every capsule's segment in the base frame [m], each (3, bodies, rows)."""
    a = _fixed(R, p, solid.body_frame, solid.body_a)
    return a, _fixed(R, p, solid.body_frame, solid.body_b)


def _mix(weights: Tensor, v: Tensor) -> Tensor:
    """Fixed combinations of the second-last-but-rows dimension: (b, k), (3, k, ...) -> (3, b, ...).

    One point at a time, for the same reason as `dot`.
    """
    shape = (1, -1) + (1,) * (v.dim() - 2)
    total = 0.0
    for k in range(weights.shape[1]):
        total = total + weights[:, k].view(shape) * v[:, k : k + 1]
    return total


def bones(solid: Solid, R: Tensor, p: Tensor) -> Tensor:
    """Skeleton features x (21, rows), x forward, y left, z up; a bone of no length is NaN."""
    unit, _, _ = _directions(solid, R, p)
    return _upright(solid, unit).transpose(0, 1).reshape(21, -1)


def bones_and_jacobian(solid: Solid, R: Tensor, p: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
    """Skeleton features and their slopes: x (21, rows) and dx/dq [1/rad], (21, n, rows)."""
    unit, length, at = _directions(solid, R, p)
    arm = at[:, :, None] - p[:, None, 1:]  # (3, 10, n, rows)
    swing = cross(z[:, None].expand_as(arm), arm)
    moved = solid.moves.index_select(0, solid.point_frame)  # (10, n)
    g = _mix(solid.bone, swing * moved[None, :, :, None])  # (3, 7, n, rows)
    across = g - dot(unit[:, :, None], g) * unit[:, :, None]
    J = _upright(solid, across / length[None, :, None])
    x = _upright(solid, unit).transpose(0, 1).reshape(21, -1)
    return x, J.transpose(0, 1).reshape(21, *J.shape[2:])


def _directions(solid: Solid, R: Tensor, p: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Unit bones (3, 7, rows), their lengths [m] (7, rows), the points [m] (3, 10, rows)."""
    at = _fixed(R, p, solid.point_frame, solid.point)
    d = _mix(solid.bone, at)
    length = torch.sqrt(dot(d, d))
    unit = torch.where(length > SHORTEST, d / length, torch.nan)
    return unit, length, at


def _upright(solid: Solid, v: Tensor) -> Tensor:
    """From the base frame to x forward, y left, z up; v (3, ...)."""
    B = solid.base.view(3, 3, *([1] * (v.dim() - 1)))
    return B[:, 0] * v[0] + B[:, 1] * v[1] + B[:, 2] * v[2]
