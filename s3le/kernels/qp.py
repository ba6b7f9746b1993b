"""A small strictly convex quadratic program, solved by the dual active-set method, compiled.

    minimise  1/2 s'H s + g's    subject to  lower <= s <= upper,  G s >= h

Source: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex
quadratic programs", Mathematical Programming 27 (1983). It starts at the free optimum and adds
violated constraints one by one, so a program with few active constraints costs little, and it
proves infeasibility when there is no solution.
"""

import numpy as np

from s3le.kernels.compiled import compiled

SOLVED, INFEASIBLE, STALLED = 0, 1, 2


@compiled
def inverse_factor(H, J):
    """J (n, n) = L^-T of the Cholesky factor L of H; False where H is not positive definite."""
    n = len(H)
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            v = H[i, j]
            for k in range(j):
                v -= L[i, k] * L[j, k]
            if i == j:
                if not v > 0.0:
                    return False
                L[i, i] = np.sqrt(v)
            else:
                L[i, j] = v / L[j, j]
    # J = inverse of L', column by column by back substitution; J is upper triangular.
    J[:] = 0.0
    for c in range(n):
        J[c, c] = 1.0 / L[c, c]
        for i in range(c - 1, -1, -1):
            v = 0.0
            for k in range(i + 1, c + 1):
                v += L[k, i] * J[k, c]
            J[i, c] = -v / L[i, i]
    return True


@compiled
def solve(J0, g, lower, upper, G, h, m, s, most):
    """Solve the program.

    Args:
        J0: inverse_factor of H, (n, n).
        g: linear term, (n,).
        lower, upper: bounds of s, (n,), lower <= upper.
        G, h: general rows, of which the first m count, (>=m, n) and (>=m,).
        s: receives the solution, (n,).
        most: receives the largest multiplier of a general row, (1,).

    Returns:
        SOLVED, INFEASIBLE, or STALLED (more changes of the active set than can be needed).
    """
    n = len(g)
    J = J0.copy()
    R = np.zeros((n, n))
    active = np.full(n, -1, np.int64)  # constraint number: bound i -> i or n + i, row k -> 2n + k
    u = np.zeros(n + 1)
    d = np.empty(n)
    z = np.empty(n)
    r = np.empty(n)
    normal = np.empty(n)
    size = np.ones(m)
    for k in range(m):
        v = 0.0
        for i in range(n):
            v += G[k, i] * G[k, i]
        size[k] = max(np.sqrt(v), 1e-12)
    for i in range(n):  # s = -H^-1 g = -J (J' g)
        v = 0.0
        for k in range(n):
            v += J[k, i] * g[k]
        d[i] = v
    for i in range(n):
        v = 0.0
        for k in range(n):
            v -= J[i, k] * d[k]
        s[i] = v
    used = 0
    most[0] = 0.0
    for _ in range(20 * (n + 10)):
        # The most violated constraint, measured as a distance.
        worst = -1e-10
        entering = -1
        for i in range(n):
            v = s[i] - lower[i]
            if v < worst:
                worst, entering = v, i
            v = upper[i] - s[i]
            if v < worst:
                worst, entering = v, n + i
        for k in range(m):
            v = -h[k]
            for i in range(n):
                v += G[k, i] * s[i]
            v /= size[k]
            if v < worst:
                worst, entering = v, 2 * n + k
        if entering < 0:
            for k in range(used):
                if active[k] >= 2 * n:
                    most[0] = max(most[0], u[k] / size[active[k] - 2 * n])
            return SOLVED
        slack = worst
        for i in range(n):
            normal[i] = 0.0
        if entering < n:
            normal[entering] = 1.0
        elif entering < 2 * n:
            normal[entering - n] = -1.0
        else:
            for i in range(n):
                normal[i] = G[entering - 2 * n, i] / size[entering - 2 * n]
        u[used] = 0.0
        while True:
            for i in range(n):
                v = 0.0
                for k in range(n):
                    v += J[k, i] * normal[k]
                d[i] = v
            span = 0.0
            for i in range(used, n):
                span += d[i] * d[i]
            for i in range(n):
                v = 0.0
                for k in range(used, n):
                    v += J[i, k] * d[k]
                z[i] = v
            for i in range(used - 1, -1, -1):
                v = d[i]
                for k in range(i + 1, used):
                    v -= R[i, k] * r[k]
                r[i] = v / R[i, i]
            partial = np.inf
            leaving = -1
            for k in range(used):
                if r[k] > 1e-14 and u[k] / r[k] < partial:
                    partial = u[k] / r[k]
                    leaving = k
            full = -slack / span if span > 1e-18 and used < n else np.inf
            step = min(partial, full)
            if step == np.inf:
                return INFEASIBLE
            for k in range(used):
                u[k] -= step * r[k]
            u[used] += step
            if full < np.inf:
                for i in range(n):
                    s[i] += step * z[i]
                slack += step * span
            if full <= partial:
                _add(J, R, d, used)
                active[used] = entering
                used += 1
                break
            _drop(J, R, active, u, leaving, used)
            used -= 1
    return STALLED


@compiled
def _rotate_columns(J, a, b, c, s):
    for i in range(len(J)):
        x, y = J[i, a], J[i, b]
        J[i, a] = c * x + s * y
        J[i, b] = -s * x + c * y


@compiled
def _add(J, R, d, used):
    """Take the constraint with J'n = d into the active set: rotate d's tail into one entry."""
    n = len(d)
    for k in range(n - 1, used, -1):
        size = np.hypot(d[k - 1], d[k])
        if size == 0.0:
            continue
        c, s = d[k - 1] / size, d[k] / size
        d[k - 1], d[k] = size, 0.0
        _rotate_columns(J, k - 1, k, c, s)
    for i in range(used + 1):
        R[i, used] = d[i]


@compiled
def _drop(J, R, active, u, leaving, used):
    """Remove one active constraint and make R triangular again."""
    for k in range(leaving, used - 1):
        active[k] = active[k + 1]
        u[k] = u[k + 1]
        for i in range(used):
            R[i, k] = R[i, k + 1]
    u[used - 1] = u[used]  # the multiplier of the constraint that is entering moves up
    u[used] = 0.0
    for k in range(leaving, used - 1):
        size = np.hypot(R[k, k], R[k + 1, k])
        if size == 0.0:
            continue
        c, s = R[k, k] / size, R[k + 1, k] / size
        for j in range(k, used - 1):
            x, y = R[k, j], R[k + 1, j]
            R[k, j] = c * x + s * y
            R[k + 1, j] = -s * x + c * y
        _rotate_columns(J, k, k + 1, c, s)
