"""Signed capsule distances over all watched pairs, and gradients of chosen ones, in torch.

The same closed form as s3le.kernels.distance, written without branches; the long way for segments
almost parallel is gone only where they are, entry by entry, so an answer never depends on the
other entries. Rows are last (s3le.gpu.chain).
"""

from typing import NamedTuple

import torch
from torch import Tensor

from s3le.gpu.chain import Solid
from s3le.gpu.fuse import fused
from s3le.gpu.kinematics import capsule_ends, cross, dot, place

_TINY = 1e-12  # [m], under this two segments count as meeting
_POINT = 1e-24  # [m^2], a segment under this squared length is a point
_PARALLEL = 1e-14  # [-], of the squared sine of two segments' angle


class Apart(NamedTuple):
    """All watched pairs of some poses."""

    distance: Tensor  # [m], (p, rows), signed
    s: Tensor  # (p, rows), place of the nearest point on the first segment, 0..1
    t: Tensor  # (p, rows), on the second
    a: Tensor  # [m], (3, bodies, rows), first ends of the capsules' segments
    along: Tensor  # [m], (3, bodies, rows), from first to second end
    p: Tensor  # [m], (3, n + 1, rows), frames
    z: Tensor  # (3, n, rows), joint axes


def nearest_on_segments(A: Tensor, d1: Tensor, B: Tensor, d2: Tensor) -> tuple[Tensor, ...]:
    """Distance of segments A + s d1 and B + t d2, s and t in [0, 1], and where it is taken.

    Args:
        A, B: first ends [m], (3, k, rows).
        d1, d2: from first to second end [m], (3, k, rows).

    Returns:
        Distance [m], s and t, each (k, rows).
    """
    gap, s, t, rare = _closed_form(A, d1, B, d2)
    at = rare.nonzero(as_tuple=True)
    if len(at[0]):
        every = (slice(None), *at)
        found = _at_an_end(A[every], d1[every], B[every], d2[every], s[at], t[at])
        gap, s, t = (old.index_put(at, new) for old, new in zip((gap, s, t), found, strict=True))
    return gap, s, t


def _closed_form(A: Tensor, d1: Tensor, B: Tensor, d2: Tensor) -> tuple[Tensor, ...]:
    """Distance, s, t, and where the segments are so nearly parallel that there may be a better."""
    r = A - B
    a, e = dot(d1, d1), dot(d2, d2)
    f, c, b = dot(d2, r), dot(d1, r), dot(d1, d2)
    point_a, point_b = a <= _POINT, e <= _POINT
    a_, e_ = a.masked_fill(point_a, 1.0), e.masked_fill(point_b, 1.0)
    det = a * e - b * b
    parallel = ~(det > _PARALLEL * (a * e))
    s = ((b * f - c * e) / det.masked_fill(parallel, 1.0)).clamp(0.0, 1.0)
    s = s.masked_fill(parallel, 0.5)
    free = (b * s + f) / e_
    t = free.clamp(0.0, 1.0)
    # Where t had to be clamped, s follows it; parallel: s moves to where it projects back.
    follows = parallel | (free < 0.0) | (free > 1.0)
    s = torch.where(follows, ((b * t - c) / a_).clamp(0.0, 1.0), s)
    # A segment that is a point has no place on it but 0; the other is then clamped by itself.
    s = torch.where(point_b, (-c / a_).clamp(0.0, 1.0), s).masked_fill(point_a, 0.0)
    t = torch.where(point_a, (f / e_).clamp(0.0, 1.0), t).masked_fill(point_b, 0.0)
    return _length(A, d1, B, d2, s, t), s, t, parallel & ~point_a & ~point_b


def _length(A: Tensor, d1: Tensor, B: Tensor, d2: Tensor, s: Tensor, t: Tensor) -> Tensor:
    """Distance of the points at s and t, in the kernel's order of operations."""
    gap = (B + t * d2) - (A + s * d1)
    return torch.sqrt(dot(gap, gap))


def _at_an_end(A, d1, B, d2, s, t):
    """Segments not quite parallel are nearest at an end of one of them; all (3, m) and (m,)."""
    r = A - B
    a, e = dot(d1, d1), dot(d2, d2)
    f, c, b = dot(d2, r), dot(d1, r), dot(d1, d2)

    def apart(s, t):
        gap = r + s * d1 - t * d2
        return dot(gap, gap)

    least = apart(s, t) - 1e-14 * (a + e)
    for end in (0.0, 1.0):
        fixed = torch.full_like(s, end)
        s_end = ((b * end - c) / a).clamp(0.0, 1.0)
        t_end = ((b * end + f) / e).clamp(0.0, 1.0)
        for s_new, t_new in ((fixed, t_end), (s_end, fixed)):
            new = apart(s_new, t_new)
            less = new < least
            least = torch.where(less, new, least)
            s, t = torch.where(less, s_new, s), torch.where(less, t_new, t)
    return _length(A, d1, B, d2, s, t), s, t


def measure(solid: Solid, q: Tensor) -> Apart:
    """Signed distances of all watched pairs [m]; q (n, rows) [rad]."""
    found, rare = _measure(solid, q)
    at = rare.nonzero(as_tuple=True)
    if len(at[0]):
        first, second = (bodies[at[0]] for bodies in (solid.pair_a, solid.pair_b))
        ends = [v[:, body, at[1]] for body in (first, second) for v in (found.a, found.along)]
        gap, s, t = _at_an_end(*ends, found.s[at], found.t[at])
        found = found._replace(
            distance=found.distance.index_put(at, gap - solid.radii[at[0], 0]),
            s=found.s.index_put(at, s),
            t=found.t.index_put(at, t),
        )
    return found


@fused
def _measure(solid: Solid, q: Tensor) -> tuple[Apart, Tensor]:
    """The same but for the rare entries, bool (p, rows), that may be nearer at an end."""
    R, p, z = place(solid, q)
    a, b = capsule_ends(solid, R, p)
    along = b - a
    first, second = solid.pair_a, solid.pair_b
    distance, s, t, rare = _closed_form(
        a.index_select(1, first),
        along.index_select(1, first),
        a.index_select(1, second),
        along.index_select(1, second),
    )
    return Apart(distance - solid.radii, s, t, a, along, p, z), rare


def clearances(solid: Solid, q: Tensor) -> Tensor:
    """Least signed distance over the watched pairs [m], (rows,); NaN where q is not finite."""
    if not len(solid.pair_a):
        least = q.new_full((q.shape[1],), torch.inf)
    else:
        least = measure(solid, q).distance.amin(dim=0)
    return torch.where(torch.isfinite(q).all(dim=0), least, torch.nan)


def separation(A: Tensor, d1: Tensor, B: Tensor, d2: Tensor, s: Tensor, t: Tensor) -> tuple:
    """Nearest points and the unit normal from the first to the second, defined where they meet.

    Args:
        A, d1, B, d2: segments as in nearest_on_segments [m], (3, ...).
        s, t: places of the nearest points, (...).

    Returns:
        Points on the first and second segment [m] and the normal, each (3, ...).
    """
    at_a, at_b = A + s * d1, B + t * d2
    gap = at_b - at_a
    length = torch.sqrt(dot(gap, gap))
    meet = length <= _TINY
    normal = torch.where(meet, _way_out(A, d1, B, d2), gap / length.masked_fill(meet, 1.0))
    return at_a, at_b, normal


def _way_out(A: Tensor, d1: Tensor, B: Tensor, d2: Tensor) -> Tensor:
    """Normal of segments that meet: common to both, or else square to the longer one."""
    normal = cross(d1, d2)
    size = torch.sqrt(dot(normal, normal))
    longer = torch.where(_sum_of_sizes(d1) >= _sum_of_sizes(d2), d1, d2)
    least = longer.abs().argmin(dim=0, keepdim=True)
    along = longer.gather(0, least)[0] / dot(longer, longer).clamp(min=1e-300)
    square = torch.zeros_like(longer).scatter(0, least, 1.0) - along * longer
    normal = torch.where(size <= 1e-12, square, normal)
    side = dot(normal, B + (B + d2) - A - (A + d1))
    size = torch.sqrt(dot(normal, normal))
    return normal / torch.where(side < 0.0, -size, size)


def _sum_of_sizes(v: Tensor) -> Tensor:
    return v[0].abs() + v[1].abs() + v[2].abs()


@fused
def gradients(solid: Solid, apart: Apart, chosen: Tensor) -> Tensor:
    """Slopes of chosen pairs' distances.

    Args:
        solid: the robot.
        apart: what `measure` returned.
        chosen: pairs of each row, int64 (k, rows).

    Returns:
        Gradients [m/rad], (rows, k, n).
    """

    def of(bodies: Tensor) -> tuple[Tensor, Tensor]:
        body = bodies[chosen].expand(3, *chosen.shape)
        return apart.a.gather(1, body), apart.along.gather(1, body)

    A, d1 = of(solid.pair_a)
    B, d2 = of(solid.pair_b)
    s, t = apart.s.gather(0, chosen), apart.t.gather(0, chosen)
    at_a, at_b, normal = separation(A, d1, B, d2, s, t)
    # normal . (z x (w - p)) = z . ((w - p) x normal) = z . (w x normal) - normal . (z x p)
    arms = torch.cat([cross(at_a, normal), cross(at_b, normal)], dim=1)  # (3, 2k, rows)
    left = torch.cat([arms, torch.cat([-normal, -normal], dim=1)])  # (6, 2k, rows)
    right = torch.cat([apart.z, cross(apart.z, apart.p[:, 1:])])  # (6, n, rows)
    slope = torch.bmm(left.permute(2, 1, 0), right.permute(2, 0, 1))  # (rows, 2k, n)
    k = len(chosen)
    side = solid.side[chosen.T]  # (rows, k, n); a joint that carries both changes nothing
    return torch.where(side > 0.0, slope[:, k:], slope[:, :k]) * side
