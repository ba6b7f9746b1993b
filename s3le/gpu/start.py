"""Feasible poses by two simple rules: blending towards the anchor, and least-change restoring.

Counterparts of blend and restore in s3le.kernels.solver; rows are last (s3le.gpu.chain).
"""

import torch
from torch import Tensor

from s3le.gpu.chain import Solid
from s3le.gpu.distance import clearances, gradients, measure
from s3le.gpu.qp import Program, solve

SLACK = 1e-6  # [m], aimed for beyond the margin, so that rounding cannot fall below it
NEAREST = 32  # pairs a quadratic program takes; see s3le.gpu.project
_ROUNDS = 400  # of blending
_STEPS = 8  # of restoring
_BAND = 0.02  # [m], pairs farther than this over the margin do not enter a restoring step


def clip(solid: Solid, q: Tensor) -> Tensor:
    """Poses within the limits, (n, rows) [rad]; a pose inside is left to the bit."""
    return torch.minimum(torch.maximum(q, solid.lower), solid.upper)


def blend(solid: Solid, anchor: Tensor, margin: float, q: Tensor) -> tuple[Tensor, Tensor]:
    """Move poses towards the anchor until they are feasible.

    Only the joints that carry a body of a pair too close are moved, a twentieth of what is left
    at a time (the authors' projection); after 400 rounds all of them go to the anchor.

    Args:
        solid: the robot.
        anchor: pose to move to [rad], (n, 1).
        margin: clearance wanted [m].
        q: poses within the limits [rad], (n, rows).

    Returns:
        Poses [rad], (n, rows), and whether each is feasible, bool (rows,).
    """
    out = anchor.expand_as(q).clone()
    safe = (clearances(solid, anchor) >= margin).expand(q.shape[1]).clone()
    row = torch.arange(q.shape[1], device=q.device)
    for _ in range(_ROUNDS):
        if not len(row):
            break
        close = (measure(solid, q).distance < margin).to(q.dtype)  # (p, rows)
        moved = torch.mm(solid.touched.T, close) > 0.0  # (n, rows), whole numbers: exact
        busy = moved.any(dim=0)
        done = (~busy).nonzero()[:, 0]
        if len(done):
            at = row.index_select(0, done)
            out.index_copy_(1, at, q.index_select(1, done))
            safe.index_fill_(0, at, True)
            left = busy.nonzero()[:, 0]
            q, row, moved = q.index_select(1, left), row[left], moved.index_select(1, left)
        q = torch.where(moved, clip(solid, 0.95 * q + 0.05 * anchor), q)
    return out, safe


def nearest_rows(
    solid: Solid, q: Tensor, goal: float, band: float, count: int
) -> tuple[Tensor, Tensor, Tensor]:
    """The pairs that a quadratic program is told of: the nearest few, as far as within the band.

    Args:
        solid: the robot.
        q: poses [rad], (n, rows).
        goal: clearance aimed for [m].
        band: distance [m] from which a pair is left out.
        count: most pairs of a pose.

    Returns:
        gap (rows, k) [m], goal less distance, -1 for a pair left out; gradients (rows, k, n)
        [m/rad], 0 for a pair left out; and violation (rows,) [m], over all watched pairs.
    """
    apart = measure(solid, q)
    short = (goal - apart.distance).clamp(min=0.0).sum(dim=0)
    k = min(count, len(solid.pair_a))
    distance, chosen = torch.topk(apart.distance, k, dim=0, largest=False)
    out = (distance >= band).T
    gap = (goal - distance.T).masked_fill(out, -1.0)
    G = gradients(solid, apart, chosen).masked_fill(out[:, :, None], 0.0)
    return gap, G, short


def restore(solid: Solid, margin: float, q: Tensor) -> tuple[Tensor, Tensor]:
    """Push poses that are nearly feasible to the margin by least-change steps.

    Args:
        solid: the robot.
        margin: clearance wanted [m].
        q: poses within the limits [rad], (n, rows).

    Returns:
        Poses [rad], (n, rows), and whether each is there, bool (rows,).
    """
    out = q.clone()
    row = torch.arange(q.shape[1], device=q.device)
    extra = SLACK
    for _ in range(_STEPS):
        goal = margin + extra
        gap, G, _ = nearest_rows(solid, q, goal, margin + _BAND, NEAREST)
        left = (gap.amax(dim=1) > extra).nonzero()[:, 0]
        out.index_copy_(1, row, q)
        if not len(left):
            break
        q, row = q.index_select(1, left), row[left]
        lower, upper = (solid.lower - q).T.contiguous(), (solid.upper - q).T.contiguous()
        found = solve(Program(torch.zeros_like(lower), lower, upper, G[left], gap[left]))
        q = clip(solid, q + found.s.T)
        extra *= 2.0
    out.index_copy_(1, row, q)
    return out, clearances(solid, out) >= margin
