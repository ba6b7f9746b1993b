"""How deep two bodies can overlap at all: over the range of a joint, and as a proof over several.

Seen from the last frame C before both, the ends x of one core and y of the other depend on the
joints between alone. About the middle c of a box of angles |u_j - c_j| <= h_j, for a unit vector n
fixed in C (taken from the nearest points of the cores at c) and each two ends,

    f(u) = n . (y - x) >= f(c) - sum_j |df/du_j| h_j - (sum_jk rho_jk h_j h_k) / 2,

for turning joint j and then k moves an end with second derivative of no more than rho_jk, its
distance from the axis of the outer one of the two. Two cores are at least as far apart as the least
of the four shadows f, so that a box is decided, or halved along the joint that costs most. The same
parabola bounds a path in safety/segment.py.
"""

from typing import NamedTuple

import numpy as np

from s3le.robot.model import Body, Geometry

_BOXES = 4096  # looked at, at most, before nothing is said
_SAMPLES = 181  # angles over the range of one joint
_SPREAD = 512  # poses over the ranges of several
_ROUNDING = 1e-9  # [m], taken off what is proven


class _Side(NamedTuple):
    """A core on its way from C through its joints."""

    joints: list[int]  # from C outwards
    ends: np.ndarray  # [m], (2, 3), in the last joint's frame, or in C's
    far: np.ndarray  # [m], (k,), no end is ever farther from each joint's axis


class _Placed(NamedTuple):
    """Both cores at poses: ends in C and how they turn."""

    ends: np.ndarray  # [m], (n, 2, 3)
    turns: np.ndarray  # [m/rad], (n, k, 2, 3), of each end with each joint of its own side


def over_range(robot: Geometry, one: Body, other: Body) -> tuple[float, float]:
    """Least and greatest signed distance [m] seen over the ranges of the joints between.

    Of one joint by 181 angles, of more by 512 poses, the same for the same robot.
    """
    a, b = _sides(robot, one, other)
    low, high = _box(robot, [*a.joints, *b.joints])
    if len(low) == 1:
        angles = np.linspace(low, high, _SAMPLES)
    else:
        angles = low + np.random.default_rng(0).random((_SPREAD, len(low))) * (high - low)
    gap = _nearest(_place(robot, a, angles[:, : len(a.joints)]).ends,
                   _place(robot, b, angles[:, len(a.joints) :]).ends)[0]  # fmt: skip
    gap = gap - one.radius - other.radius
    return float(gap.min()), float(gap.max())


def never_deeper(robot: Geometry, one: Body, other: Body, floor: float) -> bool:
    """Is the signed distance of two bodies proven to be at least floor [m] at any angles?

    False says that some angles bring them nearer, or that 4,096 boxes of angles did not tell.
    """
    a, b = _sides(robot, one, other)
    low, high = _box(robot, [*a.joints, *b.joints])
    own, wanted = len(a.joints), floor + one.radius + other.radius
    bend = np.zeros((len(low), len(low)))
    for side, first in ((a, 0), (b, own)):
        for j in range(len(side.joints)):
            for k in range(len(side.joints)):
                bend[first + j, first + k] = side.far[max(j, k)]
    middle, half = (0.5 * (low + high))[None], (0.5 * (high - low))[None]
    looked = 0
    while len(middle):
        looked += len(middle)
        if looked > _BOXES:
            return False
        x, y = _place(robot, a, middle[:, :own]), _place(robot, b, middle[:, own:])
        gap, normal = _nearest(x.ends, y.ends)
        if not (gap >= wanted).all():
            return False
        # f of each two ends, (n, 2, 2), and how it turns, (n, k, 2, 2)
        fx, fy = x.ends @ normal[:, :, None], y.ends @ normal[:, :, None]
        f = fy[:, None, :, 0] - fx[:, :, None, 0]
        gx = -(x.turns @ normal[:, None, :, None])[..., 0]
        gy = (y.turns @ normal[:, None, :, None])[..., 0]
        slope = np.concatenate(
            [np.repeat(gx[..., None], 2, axis=3), np.repeat(gy[:, :, None, :], 2, axis=2)], axis=1
        )
        fall = np.abs(slope) * half[:, :, None, None]
        curve = 0.5 * np.einsum("ni,ij,nj->n", half, bend, half)
        bound = (f - fall.sum(axis=1)).min(axis=(1, 2)) - curve - _ROUNDING
        wide = ~(bound >= wanted)  # catches NaN
        middle, half, fall = middle[wide], half[wide], fall[wide]
        cost = fall.max(axis=(2, 3)) + half * (half @ bend)
        rows, at = np.arange(len(middle)), cost.argmax(axis=1) if len(middle) else []
        half = half.copy()
        half[rows, at] *= 0.5
        step = np.zeros_like(half)
        step[rows, at] = half[rows, at]
        middle, half = np.concatenate([middle - step, middle + step]), np.tile(half, (2, 1))
    return True


def _sides(robot: Geometry, one: Body, other: Body) -> tuple[_Side, _Side]:
    paths = [robot.path_to(body.joint) for body in (one, other)]
    shared = sum(x == y for x, y in zip(*paths, strict=False))
    made = []
    for body, path in zip((one, other), paths, strict=True):
        joints, ends = path[shared:], np.stack([body.a, body.b])
        far = np.zeros(len(joints))
        ball = float(np.linalg.norm(ends, axis=1).max())
        for k in reversed(range(len(joints))):
            joint = robot.joints[joints[k]]
            far[k] = ball
            if k == len(joints) - 1:  # nothing turns in between: the distance itself
                across = ends - (ends @ joint.axis)[:, None] * joint.axis
                far[k] = float(np.linalg.norm(across, axis=1).max())
            ball += float(np.linalg.norm(joint.translation))
        made.append(_Side(joints, ends, far))
    return made[0], made[1]


def _box(robot: Geometry, joints: list[int]) -> tuple[np.ndarray, np.ndarray]:
    return robot.lower[joints], robot.upper[joints]


def _place(robot: Geometry, side: _Side, angles: np.ndarray) -> _Placed:
    """A core at angles (n, k) [rad] of its joints."""
    n = len(angles)
    ends = np.broadcast_to(side.ends, (n, 2, 3))
    turns = np.zeros((n, len(side.joints), 2, 3))
    for k in reversed(range(len(side.joints))):
        joint = robot.joints[side.joints[k]]
        turn = joint.rotation @ _about(joint.axis, angles[:, k])  # (n, 3, 3)
        turns[:, k] = np.cross(joint.axis, ends)  # in the joint's frame, before it is turned
        ends = ends @ turn.transpose(0, 2, 1) + joint.translation
        turns[:, k:] = turns[:, k:] @ turn[:, None].transpose(0, 1, 3, 2)
    return _Placed(ends, turns)


def _about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) about an axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def _nearest(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] (n,) of segments (n, 2, 3) and the unit vector from x to y, NaN where they meet.

    The least of what the inside of both gives, where their common normal falls there, and of each
    end against the other segment.
    """
    d1, d2, r = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0], x[:, 0] - y[:, 0]
    a, e, b = _dot(d1, d1), _dot(d2, d2), _dot(d1, d2)
    c, f = _dot(d1, r), _dot(d2, r)
    with np.errstate(divide="ignore", invalid="ignore"):
        det = a * e - b * b
        inner = np.stack([(b * f - c * e) / det, (a * f - b * c) / det])
        ways = [inner]
        for t in (0.0, 1.0):
            ways.append(np.stack([np.clip(np.nan_to_num((b * t - c) / a), 0.0, 1.0),
                                  np.full(len(a), t)]))  # fmt: skip
            ways.append(np.stack([np.full(len(a), t),
                                  np.clip(np.nan_to_num((b * t + f) / e), 0.0, 1.0)]))  # fmt: skip
        s, t = np.stack(ways).transpose(1, 0, 2)  # (ways, n) each
        # Of parallel ones the inside gives inf or NaN.
        apart = (y[:, 0] + t[..., None] * d2) - (x[:, 0] + s[..., None] * d1)
    square = _dot(apart, apart)
    square[~((s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0))] = np.inf  # catches NaN
    best = square.argmin(axis=0)
    rows = np.arange(len(a))
    gap = np.sqrt(square[best, rows])
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = apart[best, rows] / gap[:, None]
    return gap, normal


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", x, y)
