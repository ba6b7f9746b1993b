"""Many small strictly convex quadratic programs at once, by a primal-dual interior-point method.

    minimise  1/2 s's + g's + cost * sum_k max(0, h_k - G_k s) / |G_k|    s.t.  lower <= s <= upper

Rows are elastic: one that cannot be met is missed at a price per unit of distance instead of
leaving its program without a solution, so every program of a batch has one. Where the rows can be
met at multipliers below the price, the solution is the one of  G s >= h  (exact penalty).

Source: Mehrotra, "On the implementation of a primal-dual interior point method", SIAM Journal on
Optimization 2 (1992): predictor, then corrector, with one n x n factor for both. The price bounds
a row's multiplier y, so y and price - y are a complementary pair with the row's slack and miss.

Rows of the batch are independent: each stops when it is solved itself, and is then taken out.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from s3le.gpu.fuse import fused

PRICE = 100.0  # of a unit row's miss, in sizes of the objective's slope
STEPS = 40  # most iterations; ten to fifteen are usual
# Complementarity and dual residual wanted, in sizes of the objective's slope; rounding can hold
# the residual up where constraints are degenerate, and is then let through at a smaller gap.
_GAP, _SLOPE = 1e-13, 1e-9
_GAP_AT_LAST, _SLOPE_AT_LAST = 1e-14, 1e-6
_THIN = 1e-11  # least half width of the box that the method is shown [unit of s]
_START = 0.1  # complementarity to start from, in sizes of the box
_NEARLY = 0.995  # share of the way to the nearest bound that a step may take


class Program(NamedTuple):
    """A batch of programs with H = I; float64."""

    g: Tensor  # (rows, n)
    lower: Tensor  # (rows, n), finite; the start is meant for boxes up to some tens wide
    upper: Tensor  # (rows, n), finite, not below lower
    G: Tensor  # (rows, k, n); a row of zeros with h < 0 is no constraint
    h: Tensor  # (rows, k)


class Solution(NamedTuple):
    """One entry a program."""

    s: Tensor  # (rows, n), within the bounds
    most: Tensor  # (rows,), largest multiplier of a row of G that is met, in the units of G
    missed: Tensor  # (rows,), sum over rows of max(0, h - G s)
    solved: Tensor  # bool (rows,); else s is the last iterate, or 0 clipped where that is NaN


class _State(NamedTuple):
    """What the iterations carry, one row a program; M = 2k + 2n complementary pairs v, y."""

    row: Tensor  # int64, where the program stands in the batch
    g: Tensor  # (rows, n), scaled
    weight: Tensor  # (rows, 1), of s's, scaled
    G: Tensor  # (rows, k, n), unit rows
    s: Tensor  # (rows, n)
    v: Tensor  # (rows, M): slack of rows, miss of rows, s - lower, upper - s
    y: Tensor  # (rows, M): their multipliers


def solve(program: Program) -> Solution:
    """Solve every program of the batch.

    A program that is not finite, or does not converge, is marked and leaves the others alone.
    """
    g, lower, upper, G, h = program
    rows, k, n = G.shape
    scale = g.abs().amax(dim=1, keepdim=True).clamp(min=1.0)
    size = torch.linalg.vector_norm(G, dim=2)
    empty = size <= 1e-12
    size = size.masked_fill(empty, 1.0)
    state = _start(g / scale, 1.0 / scale, lower, upper, G / size[:, :, None], h / size)
    s, y = torch.zeros_like(g), torch.zeros_like(h)
    solved = torch.zeros(rows, dtype=torch.bool, device=g.device)
    for _ in range(STEPS):
        fine, stop = _judge(state)
        going = (~stop).nonzero()[:, 0]  # the one word from the device in an iteration
        if len(going) < len(stop):
            s.index_copy_(0, state.row, state.s)
            y.index_copy_(0, state.row, state.y[:, :k])
            solved.index_copy_(0, state.row, fine)
            if not len(going):
                break
            state = _State(*(part.index_select(0, going) for part in state))
        state = _step(state)
    else:
        s.index_copy_(0, state.row, state.s)
        y.index_copy_(0, state.row, state.y[:, :k])
    solved &= torch.isfinite(s).all(dim=1)
    s = torch.minimum(torch.maximum(torch.nan_to_num(s, 0.0), lower), upper)
    short = (h - torch.bmm(G, s[:, :, None])[:, :, 0]).clamp(min=0.0)
    met = (short <= 1e-7 * size) & ~empty
    most = (torch.nan_to_num(y, 0.0) * scale / size * met).amax(dim=1)
    return Solution(s, most, short.sum(dim=1), solved)


def _start(g, weight, lower, upper, G, h) -> _State:
    """A point inside every bound, with multipliers that balance it roughly."""
    rows, k, n = G.shape
    middle = 0.5 * (lower + upper)
    half = (0.5 * (upper - lower)).clamp(min=_THIN)
    s = middle + torch.clamp(-g / weight - middle, -0.5 * half, 0.5 * half)
    below, above = s - (middle - half), (middle + half) - s
    over = torch.bmm(G, s[:, :, None])[:, :, 0] - h
    room = _START * half.amax(dim=1, keepdim=True)
    slack = over.clamp(min=0.0) + room
    pull = (room / slack).clamp(max=0.5 * PRICE)
    v = torch.cat([slack, slack - over, below, above], dim=1)
    y = torch.cat([pull, PRICE - pull, room / below, room / above], dim=1)
    row = torch.arange(rows, device=g.device)
    return _State(row, g, weight, G, s, v, y)


def _residual(state: _State) -> Tensor:
    """Slope of the Lagrangian in s, (rows, n)."""
    k, n = state.G.shape[1:]
    pull = torch.bmm(state.y[:, None, :k], state.G)[:, 0]
    bound = state.y[:, 2 * k + n :] - state.y[:, 2 * k : 2 * k + n]
    return state.weight * state.s + state.g - pull + bound


@fused
def _judge(state: _State) -> tuple[Tensor, Tensor]:
    """Which programs are solved, and which are to be taken out, both bool (rows,)."""
    gap = (state.v * state.y).mean(dim=1)
    rest = _residual(state).abs().amax(dim=1)
    fine = (gap <= _GAP) & (rest <= _SLOPE) | (gap <= _GAP_AT_LAST) & (rest <= _SLOPE_AT_LAST)
    return fine, fine | ~torch.isfinite(gap + rest)


@fused
def _step(state: _State) -> _State:
    """One predictor and corrector step of every program."""
    row, g, weight, G, s, v, y = state
    k, n = G.shape[1:]
    slope, gap = _residual(state), (v * y).mean(dim=1)
    ratio = v / y
    loose, below, above = ratio[:, : 2 * k], ratio[:, 2 * k : 2 * k + n], ratio[:, 2 * k + n :]
    theta = 1.0 / (loose[:, :k] + loose[:, k:])
    A = torch.bmm(G.transpose(1, 2), theta[:, :, None] * G)
    A.diagonal(dim1=1, dim2=2).add_(weight + 1.0 / below + 1.0 / above)
    factor, _ = torch.linalg.cholesky_ex(A)  # no check: what is not finite ends its own row only

    def direction(wanted: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Newton step for v dy + y dv = wanted; y and price - y move by opposite amounts."""
        c = wanted / y
        e = c[:, :k] - c[:, k : 2 * k]
        c_below, c_above = c[:, 2 * k : 2 * k + n], c[:, 2 * k + n :]
        right = torch.bmm((theta * e)[:, None], G)[:, 0] - slope
        right = right + c_below / below - c_above / above
        ds = torch.cholesky_solve(right[:, :, None], factor)
        dy = theta * (e - torch.bmm(G, ds)[:, :, 0])
        ds = ds[:, :, 0]
        dy = torch.cat([dy, -dy, (c_below - ds) / below, (c_above + ds) / above], dim=1)
        return ds, c - ratio * dy, dy

    def longest(dv: Tensor, dy: Tensor) -> Tensor:
        """Step to the first bound that is met."""
        fastest = torch.maximum((-dv / v).amax(dim=1), (-dy / y).amax(dim=1))
        return 1.0 / fastest.clamp(min=1e-300)

    _, dv, dy = direction(-v * y)
    length = longest(dv, dy).clamp(max=1.0)[:, None]
    hoped = ((v + length * dv) * (y + length * dy)).mean(dim=1)
    centre = (hoped / gap) ** 3 * gap
    # The corrector counts as far as the predictor got: in full it can corner a program for good.
    ds, dv, dy = direction(centre[:, None] - v * y - length * dv * dy)
    length = (_NEARLY * longest(dv, dy)).clamp(max=1.0)[:, None]
    return _State(row, g, weight, G, s + length * ds, v + length * dv, y + length * dy)
