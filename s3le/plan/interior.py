"""A quadratic program over a window of time by a primal-dual interior-point method, compiled.

    minimise    sum_t  1/2 d_t' H_t d_t + g_t' d_t  +  steady/2 sum_t |second difference of q + d|^2
    subject to  low_t <= q_t + d_t <= high_t
                |first difference|  <= most it may be at that step
                |second difference| <= most it may be at that frame
                row_k . (d_t, d_t+1) >= need_k  -  e_k,   at stiff/2 e_k^2 each

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
    count: np.ndarray  # type: ignore[assignment]  # int64 (1,), rows in use; hides tuple.count
    frame: np.ndarray  # int64 (k,), t of each row
    row: np.ndarray  # (k, 2, n), at t and t + 1
    need: np.ndarray  # [m], (k,), what the row still lacks at q; kept up to date
    s: np.ndarray  # (m, 3, 2, n), slacks
    z: np.ndarray  # (m, 3, 2, n), multipliers
    ds: np.ndarray
    dz: np.ndarray
    c: np.ndarray  # (m, 3, n), values of the constraints at q
    rs: np.ndarray  # (k, 2): slack and multiplier
    dr: np.ndarray  # (k, 2)
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
        c=np.zeros(few),
        rs=np.ones((rows, 2)), dr=np.zeros((rows, 2)),
        A=np.zeros((frames * n_dof, 2 * n_dof + 1)), d=np.zeros(frames * n_dof),
    )  # fmt: skip


@compiled
def _values(p, m):
    """What the constraints speak of, at q: into p.c."""
    n = p.q.shape[1]
    q = p.q
    for t in range(m):
        c = p.c[t]
        a, b, e = max(t - 1, 0), t, min(t + 1, m - 1)
        for kind in range(_KINDS):
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            for i in range(n):
                c[kind, i] = before * q[a, i] + here * q[b, i] + after * q[e, i]


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
    _values(p, m)
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            for i in range(n):
                v = p.c[t, kind, i]
                least = wall * (p.high[t, kind, i] - p.low[t, kind, i])
                p.s[t, kind, 0, i] = max(v - p.low[t, kind, i], least)
                p.s[t, kind, 1, i] = max(p.high[t, kind, i] - v, least)
                for side in range(2):
                    start = mu / p.s[t, kind, side, i]
                    if anew or p.z[t, kind, side, i] < start:
                        p.z[t, kind, side, i] = start


@compiled
def warm_rows(p, mu, stiff):
    """The same for the linearised clearances, always anew, with all products mu."""
    for k in range(p.count[0]):
        spare = -p.need[k]
        root = np.sqrt(spare * spare + 4.0 * mu / stiff)
        # A slack s and a multiplier z with s - z / stiff = spare and s z = mu, without cancelling.
        if spare > 0.0:
            p.rs[k, 0] = 0.5 * (root + spare)
            p.rs[k, 1] = mu / p.rs[k, 0]
        else:
            p.rs[k, 1] = 0.5 * stiff * (root - spare)
            p.rs[k, 0] = mu / p.rs[k, 1]


@compiled
def _assemble(p, m, stiff, steady):
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
        weight = p.rs[k, 1] / (p.rs[k, 0] + p.rs[k, 1] / stiff)
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
def _direction(p, m, mu, corrected, stiff, steady):
    """Step of everything towards products mu; corrected: by the products of the last steps."""
    n = p.q.shape[1]
    d = p.d[: m * n]
    used = 1.0 if corrected else 0.0
    total = np.empty(n)
    worst = np.ones(n)
    for t in range(m):
        for i in range(n):
            d[t * n + i] = -p.g[t, i]
    for k in range(p.count[0]):
        t = p.frame[k]
        s, z = p.rs[k, 0], p.rs[k, 1]
        r = mu - s * z - used * p.dr[k, 0] * p.dr[k, 1]
        lack = -p.need[k] + z / stiff - s
        move = z + (r - z * lack) / (s + z / stiff)
        for i in range(n):
            d[t * n + i] += move * p.row[k, 0, i]
            if t + 1 < m:
                d[(t + 1) * n + i] += move * p.row[k, 1, i]
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            more = steady if kind == 2 else 0.0
            c, low, high = p.c[t, kind], p.low[t, kind], p.high[t, kind]
            s0, z0, ds0, dz0 = p.s[t, kind, 0], p.z[t, kind, 0], p.ds[t, kind, 0], p.dz[t, kind, 0]
            s1, z1, ds1, dz1 = p.s[t, kind, 1], p.z[t, kind, 1], p.ds[t, kind, 1], p.dz[t, kind, 1]
            for i in range(n):
                r0 = mu - used * ds0[i] * dz0[i] - z0[i] * (c[i] - low[i] - s0[i])
                r1 = mu - used * ds1[i] * dz1[i] - z1[i] * (high[i] - c[i] - s1[i])
                total[i] = r0 / s0[i] - r1 / s1[i] - more * c[i]
            own = d[t * n : (t + 1) * n]
            for i in range(n):
                own[i] += here * total[i]
            if kind > 0:
                other = d[(t - 1) * n : t * n]
                for i in range(n):
                    other[i] += before * total[i]
            if kind > 1:
                other = d[(t + 1) * n : (t + 2) * n]
                for i in range(n):
                    other[i] += after * total[i]
    for t in range(m):
        if p.fixed[t]:
            d[t * n : (t + 1) * n] = 0.0
    solve_with(p.A[: m * n], d)
    step = 1.0
    for k in range(p.count[0]):
        t = p.frame[k]
        s, z = p.rs[k, 0], p.rs[k, 1]
        r = mu - s * z - used * p.dr[k, 0] * p.dr[k, 1]
        along = 0.0
        for i in range(n):
            along += p.row[k, 0, i] * d[t * n + i]
            if t + 1 < m:
                along += p.row[k, 1, i] * d[(t + 1) * n + i]
        lack = -p.need[k] + z / stiff - s + along
        p.dr[k, 1] = (r - z * lack) / (s + z / stiff)
        p.dr[k, 0] = lack + p.dr[k, 1] / stiff
        for j in range(2):
            if p.dr[k, j] < 0.0:
                step = min(step, -p.rs[k, j] / p.dr[k, j])
    for t in range(m):
        for kind in range(_KINDS):
            if not p.on[t, kind]:
                continue
            before, here, after = p.coef[t, kind, 0], p.coef[t, kind, 1], p.coef[t, kind, 2]
            c, low, high = p.c[t, kind], p.low[t, kind], p.high[t, kind]
            s0, z0, ds0, dz0 = p.s[t, kind, 0], p.z[t, kind, 0], p.ds[t, kind, 0], p.dz[t, kind, 0]
            s1, z1, ds1, dz1 = p.s[t, kind, 1], p.z[t, kind, 1], p.ds[t, kind, 1], p.dz[t, kind, 1]
            last, own = d[max(t - 1, 0) * n :], d[t * n :]
            then = d[min(t + 1, m - 1) * n :]
            for i in range(n):
                c_new = c[i] + before * last[i] + here * own[i] + after * then[i]
                e0 = c_new - low[i] - s0[i]
                e1 = high[i] - c_new - s1[i]
                f0 = (mu - s0[i] * z0[i] - used * ds0[i] * dz0[i] - z0[i] * e0) / s0[i]
                f1 = (mu - s1[i] * z1[i] - used * ds1[i] * dz1[i] - z1[i] * e1) / s1[i]
                ds0[i] = e0
                ds1[i] = e1
                dz0[i] = f0
                dz1[i] = f1
                # The share of the way after which a slack or multiplier is gone is 1 / this.
                worst[i] = max(worst[i], max(max(-e0 / s0[i], -e1 / s1[i]),
                                             max(-f0 / z0[i], -f1 / z1[i])))  # fmt: skip
    most = 1.0
    for i in range(n):
        most = max(most, worst[i])
    return min(step, 1.0 / most)


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
        count += 1
        total += (p.rs[k, 0] + step * p.dr[k, 0]) * (p.rs[k, 1] + step * p.dr[k, 1])
    return total / max(count, 1), count


@compiled
def improve(p, m, stiff, steady, small, most):
    """Solve the program from where it is.

    Args:
        p: the program, after `warm`; q, g and need are moved along.
        m: frames in use.
        stiff: what a linearised clearance costs that lacks e, stiff/2 e^2.
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
        _values(p, m)
        _assemble(p, m, stiff, steady)
        if not factor(p.A[: m * n], 1e-12):
            return np.nan, done
        step = _direction(p, m, 0.0, False, stiff, steady)
        ahead = _products(p, m, step)[0]
        share = min(1.0, max(ahead / mu, 0.0)) ** 3
        step = min(1.0, _BACK * _direction(p, m, max(share * mu, 0.1 * small), True, stiff, steady))
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
            for j in range(2):
                p.rs[k, j] += step * p.dr[k, j]
        for t in range(m):
            for kind in range(_KINDS):
                if p.on[t, kind]:
                    for side in range(2):
                        s, z = p.s[t, kind, side], p.z[t, kind, side]
                        ds, dz = p.ds[t, kind, side], p.dz[t, kind, side]
                        for i in range(n):
                            s[i] += step * ds[i]
                            z[i] += step * dz[i]
        mu = _products(p, m, 0.0)[0]
        if mu <= small and step > 0.9:
            break
    return mu, done
