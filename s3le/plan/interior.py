"""A quadratic program over a window of time by a primal-dual interior-point method, compiled.

    minimise    sum_t  1/2 d_t' H_t d_t + g_t' d_t  +  steady/2 sum_t |second difference of q + d|^2
    subject to  low_t <= q_t + d_t <= high_t
                |first difference|  <= most it may be at that step
                |second difference| <= most it may be at that frame
                row_k . (d_t, d_t+1) >= need_k  -  e_k,   e_k >= 0 at `price` each

The last kind are the linearised clearances, of a pose or of a point of the path to the next one.
They are elastic: two of them may be at odds where the linear model is poor, and a motion that is
within limits comes out in any case. Everything else is kept strictly.

Source: Mehrotra, "On the implementation of a primal-dual interior point method" (SIAM J. Optim. 2,
1992); Rao, Wright, Rawlings, "Application of interior-point methods to model predictive control"
(JOTA 99, 1998) for the band.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.plan.banded import factor, solve_with

_KINDS = 3  # position, first and second difference
_BACK = 0.99  # share of the way to the nearest wall that a step goes


class Program(NamedTuple):
    """One window of frames; the arrays of rows have room to spare."""

    q: np.ndarray  # [rad], (m, n), where the motion is; moved by the solver
    fixed: np.ndarray  # bool (m,), frames that stay as they are
    H: np.ndarray  # (m, n, n)
    g: np.ndarray  # (m, n), gradient at q; kept up to date
    coef: np.ndarray  # (m, 3, 3), by kind: what q of the frame before, this and the next count
    on: np.ndarray  # bool (m, 3), does the constraint exist
    low: np.ndarray  # [rad], (m, 3, n)
    high: np.ndarray  # [rad], (m, 3, n)
    count: np.ndarray  # int64 (1,), rows in use
    frame: np.ndarray  # int64 (k,), t of each row
    row: np.ndarray  # (k, 2, n), at t and t + 1
    need: np.ndarray  # [m], (k,), what the row still lacks at q; kept up to date
    s: np.ndarray  # (m, 3, 2, n), slacks
    z: np.ndarray  # (m, 3, 2, n), multipliers
    ds: np.ndarray
    dz: np.ndarray
    rs: np.ndarray  # (k, 4): slack, multiplier, elastic part, its own multiplier
    dr: np.ndarray  # (k, 4)
    A: np.ndarray  # (m n, 2 n + 1)
    d: np.ndarray  # (m n,)


def program(frames: int, n_dof: int, rows: int) -> Program:
    """Room for a window of so many frames and linearised clearances."""
    many, few = (frames, _KINDS, 2, n_dof), (frames, _KINDS, n_dof)
    return Program(
        q=np.zeros((frames, n_dof)), fixed=np.zeros(frames, np.bool_),
        H=np.zeros((frames, n_dof, n_dof)), g=np.zeros((frames, n_dof)),
        coef=np.zeros((frames, _KINDS, 3)), on=np.zeros((frames, _KINDS), np.bool_),
        low=np.zeros(few), high=np.zeros(few),
        count=np.zeros(1, np.int64), frame=np.zeros(rows, np.int64),
        row=np.zeros((rows, 2, n_dof)), need=np.zeros(rows),
        s=np.ones(many), z=np.ones(many), ds=np.zeros(many), dz=np.zeros(many),
        rs=np.ones((rows, 4)), dr=np.zeros((rows, 4)),
        A=np.zeros((frames * n_dof, 2 * n_dof + 1)), d=np.zeros(frames * n_dof),
    )  # fmt: skip


@compiled
def _value(p, t, kind, i):
    v = p.coef[t, kind, 1] * p.q[t, i]
    if t > 0:
        v += p.coef[t, kind, 0] * p.q[t - 1, i]
    if t + 1 < len(p.q):
        v += p.coef[t, kind, 2] * p.q[t + 1, i]
    return v


@compiled
def warm(p, m, mu, wall, anew):
    """Bring slacks and multipliers of m frames to where a solve may begin.

    Args:
        p: the program.
        m: frames in use.
        mu: least product of a slack and its multiplier, (a unit of the cost).
        wall: least slack as a share of the constraint's width.
        anew: forget the multipliers; else those of an earlier solve stay.
    """
    n = p.q.shape[1]
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            for i in range(n):
                v = _value(p, t, kind, i)
                least = wall * (p.high[t, kind, i] - p.low[t, kind, i])
                p.s[t, kind, 0, i] = max(v - p.low[t, kind, i], least)
                p.s[t, kind, 1, i] = max(p.high[t, kind, i] - v, least)
                for side in range(2):
                    start = mu / p.s[t, kind, side, i]
                    if anew or p.z[t, kind, side, i] < start:
                        p.z[t, kind, side, i] = start


@compiled
def warm_rows(p, mu, price):
    """The same for the linearised clearances, always anew."""
    for k in range(p.count[0]):
        gap = -p.need[k]  # what it has to spare
        p.rs[k, 0] = max(gap, 1e-3)
        p.rs[k, 2] = max(-gap, 0.0) + 1e-3
        p.rs[k, 1] = min(mu / p.rs[k, 0], 0.5 * price)
        p.rs[k, 3] = price - p.rs[k, 1]


@compiled
def _assemble(p, m, price, steady):
    """The matrix of the step, from the present slacks and multipliers."""
    n = p.q.shape[1]
    A = p.A[: m * n]
    A[:] = 0.0
    for t in range(m):
        for i in range(n):
            for j in range(i + 1):
                A[t * n + j, i - j] = p.H[t, i, j]
    for k in range(p.count[0]):
        t = p.frame[k]
        weight = p.rs[k, 1] / (p.rs[k, 0] + p.rs[k, 1] * p.rs[k, 2] / p.rs[k, 3])
        for i in range(n):
            a = weight * p.row[k, 0, i]
            b = weight * p.row[k, 1, i]
            if a != 0.0:
                for j in range(i + 1):
                    A[t * n + j, i - j] += a * p.row[k, 0, j]
            if b != 0.0:
                for j in range(i + 1):
                    A[(t + 1) * n + j, i - j] += b * p.row[k, 1, j]
                for j in range(n):
                    A[t * n + j, n + i - j] += b * p.row[k, 0, j]
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            more = steady if kind == 2 else 0.0
            for i in range(n):
                w = (
                    p.z[t, kind, 0, i] / p.s[t, kind, 0, i]
                    + p.z[t, kind, 1, i] / p.s[t, kind, 1, i]
                    + more
                )
                A[t * n + i, 0] += w * here * here
                if kind > 0:
                    A[(t - 1) * n + i, 0] += w * before * before
                    A[(t - 1) * n + i, n] += w * before * here
                if kind > 1:
                    A[(t + 1) * n + i, 0] += w * after * after
                    A[t * n + i, n] += w * here * after
                    A[(t - 1) * n + i, 2 * n] += w * before * after
    for t in range(m):
        if p.fixed[t]:
            for i in range(n):
                j = t * n + i
                A[j] = 0.0
                A[j, 0] = 1.0
                for k in range(1, min(j, 2 * n) + 1):
                    A[j - k, k] = 0.0


@compiled
def _direction(p, m, mu, corrected, steady):
    """Step of everything towards products mu; corrected: by the products of the last steps."""
    n = p.q.shape[1]
    d = p.d[: m * n]
    for t in range(m):
        for i in range(n):
            d[t * n + i] = -p.g[t, i]
    for k in range(p.count[0]):
        t = p.frame[k]
        s, z, e, y = p.rs[k, 0], p.rs[k, 1], p.rs[k, 2], p.rs[k, 3]
        r1 = mu - s * z
        r2 = mu - e * y
        if corrected:
            r1 -= p.dr[k, 0] * p.dr[k, 1]
            r2 -= p.dr[k, 2] * p.dr[k, 3]
        lack = -p.need[k] + e - s
        move = z + (r1 - z * (lack + r2 / y)) / (s + z * e / y)
        for i in range(n):
            d[t * n + i] += move * p.row[k, 0, i]
            if t + 1 < m:
                d[(t + 1) * n + i] += move * p.row[k, 1, i]
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            for i in range(n):
                v = _value(p, t, kind, i)
                total = -steady * v if kind == 2 else 0.0
                for side in range(2):
                    sign = 1.0 if side == 0 else -1.0
                    wall = p.low[t, kind, i] if side == 0 else p.high[t, kind, i]
                    s, z = p.s[t, kind, side, i], p.z[t, kind, side, i]
                    r = mu
                    if corrected:
                        r -= p.ds[t, kind, side, i] * p.dz[t, kind, side, i]
                    lack = sign * (v - wall) - s
                    total += sign * (r - z * lack) / s
                d[t * n + i] += here * total
                if kind > 0:
                    d[(t - 1) * n + i] += before * total
                if kind > 1:
                    d[(t + 1) * n + i] += after * total
    for t in range(m):
        if p.fixed[t]:
            d[t * n : (t + 1) * n] = 0.0
    solve_with(p.A[: m * n], d)
    step = 1.0
    for k in range(p.count[0]):
        t = p.frame[k]
        s, z, e, y = p.rs[k, 0], p.rs[k, 1], p.rs[k, 2], p.rs[k, 3]
        r1 = mu - s * z
        r2 = mu - e * y
        if corrected:
            r1 -= p.dr[k, 0] * p.dr[k, 1]
            r2 -= p.dr[k, 2] * p.dr[k, 3]
        along = 0.0
        for i in range(n):
            along += p.row[k, 0, i] * d[t * n + i]
            if t + 1 < m:
                along += p.row[k, 1, i] * d[(t + 1) * n + i]
        lack = -p.need[k] + e - s + along
        dz = (r1 - z * (lack + r2 / y)) / (s + z * e / y)
        de = (r2 + e * dz) / y
        p.dr[k, 0] = lack + de
        p.dr[k, 1] = dz
        p.dr[k, 2] = de
        p.dr[k, 3] = -dz
        for j in range(4):
            if p.dr[k, j] < 0.0:
                step = min(step, -p.rs[k, j] / p.dr[k, j])
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            for i in range(n):
                v = _value(p, t, kind, i)
                along = here * d[t * n + i]
                if kind > 0:
                    along += before * d[(t - 1) * n + i]
                if kind > 1:
                    along += after * d[(t + 1) * n + i]
                for side in range(2):
                    sign = 1.0 if side == 0 else -1.0
                    wall = p.low[t, kind, i] if side == 0 else p.high[t, kind, i]
                    s, z = p.s[t, kind, side, i], p.z[t, kind, side, i]
                    r = mu - s * z
                    if corrected:
                        r -= p.ds[t, kind, side, i] * p.dz[t, kind, side, i]
                    ds = sign * (v - wall) - s + sign * along
                    dz = (r - z * ds) / s
                    p.ds[t, kind, side, i] = ds
                    p.dz[t, kind, side, i] = dz
                    if ds < 0.0:
                        step = min(step, -s / ds)
                    if dz < 0.0:
                        step = min(step, -z / dz)
    return step


@compiled
def _products(p, m, step):
    """Mean product of slack and multiplier after a step, and how many there are."""
    n = p.q.shape[1]
    total = 0.0
    count = 0
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            count += 2 * n
            for side in range(2):
                for i in range(n):
                    total += (p.s[t, kind, side, i] + step * p.ds[t, kind, side, i]) * (
                        p.z[t, kind, side, i] + step * p.dz[t, kind, side, i]
                    )
    for k in range(p.count[0]):
        count += 2
        total += (p.rs[k, 0] + step * p.dr[k, 0]) * (p.rs[k, 1] + step * p.dr[k, 1])
        total += (p.rs[k, 2] + step * p.dr[k, 2]) * (p.rs[k, 3] + step * p.dr[k, 3])
    return total / max(count, 1), count


@compiled
def improve(p, m, price, steady, small, most):
    """Solve the program from where it is.

    Args:
        p: the program, after `warm`; q, g and need are moved along.
        m: frames in use.
        price: cost of a metre that a linearised clearance lacks.
        steady: weight of the squared second differences.
        small: mean product of slack and multiplier at which it is solved.
        most: iterations.

    Returns:
        (mu, iterations); mu is NaN where the matrix could not be factored.
    """
    n = p.q.shape[1]
    mu = _products(p, m, 0.0)[0]
    done = 0
    while done < most:
        done += 1
        _assemble(p, m, price, steady)
        if not factor(p.A[: m * n], 1e-12):
            return np.nan, done
        step = _direction(p, m, 0.0, False, steady)
        ahead = _products(p, m, step)[0]
        share = min(1.0, max(ahead / mu, 0.0)) ** 3
        step = min(1.0, _BACK * _direction(p, m, max(share * mu, 0.1 * small), True, steady))
        for t in range(m):
            for i in range(n):
                p.q[t, i] += step * p.d[t * n + i]
                for j in range(n):
                    p.g[t, i] += step * p.H[t, i, j] * p.d[t * n + j]
        for k in range(p.count[0]):
            t = p.frame[k]
            for i in range(n):
                p.need[k] -= step * p.row[k, 0, i] * p.d[t * n + i]
                if t + 1 < m:
                    p.need[k] -= step * p.row[k, 1, i] * p.d[(t + 1) * n + i]
            for j in range(4):
                p.rs[k, j] += step * p.dr[k, j]
        for t in range(m):
            for kind in range(_KINDS):
                if p.on[t, kind]:
                    for side in range(2):
                        for i in range(n):
                            p.s[t, kind, side, i] += step * p.ds[t, kind, side, i]
                            p.z[t, kind, side, i] += step * p.dz[t, kind, side, i]
        mu = _products(p, m, 0.0)[0]
        if mu <= small and step > 0.9:
            break
    return mu, done
