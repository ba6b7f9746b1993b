"""Joints that are not decided here, folded into a chain where they stand; compiled.

A folded chain has our joints alone. What others move is geometry of it: bodies and points ride on
the last joint of ours before them, and a joint of ours begins where the others between it and the
one before put it.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.kinematics import place


@compiled
def fold(whole, near, own, source, q, out):
    """Write into a folded chain where the others stand.

    Args:
        whole: a Chain of all joints.
        near: the last frame of ours on the way from the base to each frame of it, 0 if there is
            none, int64 (N + 1,).
        own: our joints among its, int64 (n,).
        source: which of its bodies each body of `out` is, int64 (v,).
        q: angles of all joints, ours at 0 [rad], (N,).
        out: a Chain of ours; receives rotation, translation, body_a, body_b and point.
    """
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    place(whole, q, R, p, z)
    for i in range(len(own)):
        j = own[i]
        f = whole.parent[j]
        c = near[f]
        _seen(R, p, f, c, whole.translation[j], out.translation[i])
        for a in range(3):
            for b in range(3):
                total = 0.0
                for k in range(3):
                    turned = 0.0
                    for m in range(3):
                        turned += R[f, k, m] * whole.rotation[j, m, b]
                    total += R[c, k, a] * turned
                out.rotation[i, a, b] = total
    for k in range(len(source)):
        f = whole.body_frame[source[k]]
        _seen(R, p, f, near[f], whole.body_a[source[k]], out.body_a[k])
        _seen(R, p, f, near[f], whole.body_b[source[k]], out.body_b[k])
    for k in range(len(whole.point)):
        f = whole.point_frame[k]
        _seen(R, p, f, near[f], whole.point[k], out.point[k])


@compiled
def _seen(R, p, f, c, x, out):
    """A point x (3,) of frame f, in frame c."""
    for i in range(3):
        total = 0.0
        for k in range(3):
            at = p[f, k] - p[c, k]
            for m in range(3):
                at += R[f, k, m] * x[m]
            total += R[c, k, i] * at
        out[i] = total
