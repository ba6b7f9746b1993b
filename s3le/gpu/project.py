"""Proj_Q for many poses at once: sequential quadratic programming over a batch, in torch.

    minimise 1/2 |q - q_ref|^2   subject to   l <= q <= u,  distance_k(q) >= margin for every k

The steps, trust region and merit function of s3le.kernels.solver.minimise, row by row, with two
differences that a batch of equal shapes asks for:

- A quadratic program takes the NEAREST pairs within the band, not all of them. Of coman's 378 the
  band holds 30 at a median clipped pose and 100 at one in a hundred, but 32 were enough for every
  violated pair of 600 (31 at most, 9 in nine of ten), and a farther pair that a step runs into
  enters the next program. Violation and acceptance are of all watched pairs.
- Rows that cannot all be met are missed at a price (s3le.gpu.qp) instead of asking for a share of
  the distance, and the merit's weight is then raised until the step is one of descent.

Source: Nocedal and Wright, Numerical Optimization, 2nd ed., Sec. 18.5 (l1 merit, trust region).
"""

from typing import NamedTuple

import torch
from torch import Tensor

from s3le.gpu.chain import Solid
from s3le.gpu.distance import clearances
from s3le.gpu.qp import Program, solve
from s3le.gpu.start import NEAREST, SLACK, blend, clip, nearest_rows, restore
from s3le.kernels.batch import FALLBACK, SAME, SOLVED

_BAND = 0.10  # [m], pairs farther than this over the margin do not enter a quadratic program
_STEPS = 60  # most iterations
_SMALL = 1e-7  # [rad], steps and trust regions under this end a row


class _State(NamedTuple):
    """What the iterations carry, one row a pose."""

    row: Tensor  # int64, where the pose stands in the batch
    q: Tensor  # [rad], (rows, n)
    want: Tensor  # [rad], (rows, n)
    gap: Tensor  # [m], (rows, k)
    G: Tensor  # [m/rad], (rows, k, n)
    cost: Tensor  # (rows,), 1/2 |q - want|^2
    short: Tensor  # [m], (rows,), violation over all pairs
    weight: Tensor  # (rows,), of violation in the merit
    radius: Tensor  # [rad], (rows,), of the trust region


def project(
    solid: Solid, anchor: Tensor, margin: float, q: Tensor, solve: bool = True
) -> tuple[Tensor, Tensor]:
    """The nearest feasible pose found for each pose, and how it came about.

    Two starts: the pose clipped to its limits, and the feasible pose that blending leads to. The
    nearer result wins; where neither is feasible the blended pose is the answer.

    Args:
        solid: the robot.
        anchor: a feasible pose [rad], (n, 1).
        margin: clearance wanted [m].
        q: relaxed poses [rad], (n, rows), finite.
        solve: False: the blended pose is the answer wherever one is needed.

    Returns:
        Poses [rad], (n, rows), and kernels.batch's code of each, uint8 (rows,).
    """
    out = clip(solid, q)
    inside = (out == q).all(dim=0)
    how = torch.where(inside, SAME, SOLVED).to(torch.uint8)
    hit = (~(clearances(solid, out) >= margin)).nonzero()[:, 0]
    if not len(hit):
        return torch.where(inside, q, out), how
    want, clipped = q.index_select(1, hit), out.index_select(1, hit)
    back, safe = blend(solid, anchor, margin, clipped)
    if not solve:
        out.index_copy_(1, hit, back)
        how.index_fill_(0, hit, FALLBACK)
        return torch.where(how == SAME, q, out), how
    # Both starts of all rows are one batch; a start that is not feasible is not worth a second.
    second = safe.nonzero()[:, 0]
    starts = torch.cat([clipped, back.index_select(1, second)], dim=1)
    wants = torch.cat([want, want.index_select(1, second)], dim=1)
    trial = minimise(solid, margin, wants, starts)
    good = clearances(solid, trial) >= margin
    poor = (~good).nonzero()[:, 0]
    if len(poor):
        mended, there = restore(solid, margin, trial.index_select(1, poor))
        trial.index_copy_(1, poor, mended)
        good.index_copy_(0, poor, there)
    # Blending is the answer to beat; where it failed, back is the anchor.
    best = torch.where(safe, _far(back, want), torch.inf)
    kept, code = back, torch.full_like(how[: len(hit)], FALLBACK)
    for start in range(2):
        at = second if start else torch.arange(len(hit), device=q.device)
        part = slice(len(hit), None) if start else slice(len(hit))
        far = torch.where(good[part], _far(trial[:, part], want.index_select(1, at)), torch.inf)
        nearer = (far < best.index_select(0, at)).nonzero()[:, 0]
        into = at.index_select(0, nearer)
        best = best.index_copy(0, into, far.index_select(0, nearer))
        kept = kept.index_copy(1, into, trial[:, part].index_select(1, nearer))
        code = code.index_fill(0, into, SOLVED)
    out.index_copy_(1, hit, kept)
    how.index_copy_(0, hit, code)
    return torch.where(how == SAME, q, out), how


def minimise(solid: Solid, margin: float, want: Tensor, start: Tensor) -> Tensor:
    """Candidates near `want` from given starts; the caller decides by clearance.

    Args:
        solid: the robot.
        margin: clearance wanted [m].
        want: poses to be near to [rad], (n, rows).
        start: poses within the limits to start from [rad], (n, rows).

    Returns:
        Poses within the limits [rad], (n, rows).
    """
    goal, band = margin + SLACK, margin + _BAND
    out = start.clone()
    gap, G, short = nearest_rows(solid, start, goal, band, NEAREST)
    q, want = start.T.contiguous(), want.T.contiguous()
    ones = torch.ones_like(short)
    row = torch.arange(len(q), device=q.device)
    state = _State(row, q, want, gap, G, _cost(q, want), short, ones, 0.5 * ones)
    for _ in range(_STEPS):
        state, stop = _step(solid, goal, band, state)
        going = (~stop).nonzero()[:, 0]
        if len(going) < len(stop):
            out.index_copy_(1, state.row, state.q.T)
            if not len(going):
                return out
            state = _State(*(part.index_select(0, going) for part in state))
    out.index_copy_(1, state.row, state.q.T)
    return out


def _step(solid: Solid, goal: float, band: float, state: _State) -> tuple[_State, Tensor]:
    """One iteration of every row, and which rows have ended."""
    row, q, want, gap, G, cost, short, weight, radius = state
    low, high = solid.lower.T, solid.upper.T
    g = q - want
    lower = torch.maximum(-radius[:, None], low - q)
    upper = torch.minimum(radius[:, None], high - q)
    found = solve(Program(g, lower, upper, G, gap))
    s = found.s
    size = s.abs().amax(dim=1)
    model = (s * (g + 0.5 * s)).sum(dim=1)
    # Pairs that the program is not told of are expected to stay as short as they are.
    gain = gap.clamp(min=0.0).sum(dim=1) - found.missed
    weight = torch.maximum(weight, 2.0 * found.most)
    needed = torch.where((model > 0.0) & (gain > 0.0), 2.0 * model / gain.clamp(min=1e-12), 0.0)
    weight = torch.maximum(weight, needed)
    hoped = -model + weight * gain
    trial = torch.minimum(torch.maximum(q + s, low), high)
    gap_new, G_new, short_new = nearest_rows(solid, trial.T.contiguous(), goal, band, NEAREST)
    cost_new = _cost(trial, want)
    got = cost - cost_new + weight * (short - short_new)
    last = size < _SMALL  # such a step is not taken
    taken = (got > 0.1 * hoped) & (got > 0.0) & ~last
    grown = torch.where(got > 0.7 * hoped, (2.0 * radius).clamp(max=1.0), radius)
    radius = torch.where(taken, grown, 0.3 * torch.minimum(radius, size))
    q = torch.where(taken[:, None], trial, q)
    gap = torch.where(taken[:, None], gap_new, gap)
    G = torch.where(taken[:, None, None], G_new, G)
    cost, short = torch.where(taken, cost_new, cost), torch.where(taken, short_new, short)
    settled = taken & (got < 1e-12 * (1.0 + cost)) & (short <= 0.0)
    stop = last | settled | (~taken & (radius < _SMALL))
    return _State(row, q, want, gap, G, cost, short, weight, radius), stop


def _cost(q: Tensor, want: Tensor) -> Tensor:
    """1/2 |q - want|^2, (rows,)."""
    return 0.5 * ((q - want) ** 2).sum(dim=1)


def _far(a: Tensor, b: Tensor) -> Tensor:
    """|a - b|^2 of poses with rows last, (rows,)."""
    return ((a - b) ** 2).sum(dim=0)
