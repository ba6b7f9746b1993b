"""Forward kinematics, the seven bones and their Jacobian, for one pose at a time, compiled."""

import numpy as np

from s3le.kernels.compiled import compiled


@compiled
def place(chain, q, R, p, z):
    """Place every frame: R (n+1, 3, 3), p (n+1, 3) [m]; z (n, 3), joint axes in the base frame."""
    n = len(q)
    for i in range(3):
        p[0, i] = 0.0
        for k in range(3):
            R[0, i, k] = 1.0 if i == k else 0.0
    for j in range(n):
        f = chain.parent[j]
        x, y, w = chain.axis[j, 0], chain.axis[j, 1], chain.axis[j, 2]
        c, s = np.cos(q[j]), np.sin(q[j])
        v = 1.0 - c
        # Rodrigues: turn about the unit axis (x, y, w).
        t00, t01, t02 = c + x * x * v, x * y * v - w * s, x * w * v + y * s
        t10, t11, t12 = y * x * v + w * s, c + y * y * v, y * w * v - x * s
        t20, t21, t22 = w * x * v - y * s, w * y * v + x * s, c + w * w * v
        for i in range(3):
            a0 = a1 = a2 = 0.0
            pi = p[f, i]
            for k in range(3):
                r = R[f, i, k]
                a0 += r * chain.rotation[j, k, 0]
                a1 += r * chain.rotation[j, k, 1]
                a2 += r * chain.rotation[j, k, 2]
                pi += r * chain.translation[j, k]
            p[j + 1, i] = pi
            z[j, i] = a0 * x + a1 * y + a2 * w
            R[j + 1, i, 0] = a0 * t00 + a1 * t10 + a2 * t20
            R[j + 1, i, 1] = a0 * t01 + a1 * t11 + a2 * t21
            R[j + 1, i, 2] = a0 * t02 + a1 * t12 + a2 * t22


@compiled
def bones(chain, R, p, z, x, J):
    """The seven unit vectors and their Jacobian in the frame x forward, y left, z up.

    Writes x (21,) and, where J is (21, n) and not empty, J = dx/dq. A bone of no length is NaN.
    """
    n = len(z)
    with_jacobian = J.shape[0] > 0
    at = np.empty((len(chain.point), 3))
    for k in range(len(chain.point)):
        f = chain.point_frame[k]
        for i in range(3):
            v = p[f, i]
            for m in range(3):
                v += R[f, i, m] * chain.point[k, m]
            at[k, i] = v
    d = np.empty(3)
    u = np.empty(3)
    g = np.empty(3)
    w = np.empty(3)
    for b in range(7):
        for i in range(3):
            d[i] = 0.5 * (
                at[chain.head[b, 0], i]
                + at[chain.head[b, 1], i]
                - at[chain.tail[b, 0], i]
                - at[chain.tail[b, 1], i]
            )
        length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        if length > 1e-9:
            for i in range(3):
                u[i] = d[i] / length
        else:
            u[:] = np.nan
        for i in range(3):
            x[3 * b + i] = (
                chain.base[i, 0] * u[0] + chain.base[i, 1] * u[1] + chain.base[i, 2] * u[2]
            )
        if not with_jacobian:
            continue
        for j in range(n):
            g[:] = 0.0
            for side in range(2):
                for h in range(2):
                    k = chain.head[b, h] if side == 0 else chain.tail[b, h]
                    if chain.moves[chain.point_frame[k], j]:
                        s = 0.5 if side == 0 else -0.5
                        r0 = at[k, 0] - p[j + 1, 0]
                        r1 = at[k, 1] - p[j + 1, 1]
                        r2 = at[k, 2] - p[j + 1, 2]
                        g[0] += s * (z[j, 1] * r2 - z[j, 2] * r1)
                        g[1] += s * (z[j, 2] * r0 - z[j, 0] * r2)
                        g[2] += s * (z[j, 0] * r1 - z[j, 1] * r0)
            along = u[0] * g[0] + u[1] * g[1] + u[2] * g[2]
            for i in range(3):
                w[i] = (g[i] - along * u[i]) / length
            for i in range(3):
                J[3 * b + i, j] = (
                    chain.base[i, 0] * w[0] + chain.base[i, 1] * w[1] + chain.base[i, 2] * w[2]
                )
