"""Signed capsule distances over the watched pairs, with gradients, compiled.

Of a pair that overlaps by design the distance is counted from its baseline: slack is added.
"""

import numpy as np

from s3le.kernels.compiled import compiled

_TINY = 1e-12  # [m], under this two segments count as meeting


@compiled
def place_capsules(chain, R, p, ends):
    """World ends and centre of every capsule's segment: ends (b, 3, 3) [m], rows a, b, centre."""
    for k in range(len(chain.body_frame)):
        f = chain.body_frame[k]
        for i in range(3):
            a = p[f, i]
            b = p[f, i]
            for m in range(3):
                a += R[f, i, m] * chain.body_a[k, m]
                b += R[f, i, m] * chain.body_b[k, m]
            ends[k, 0, i] = a
            ends[k, 1, i] = b
            ends[k, 2, i] = 0.5 * (a + b)


@compiled
def reach(chain):
    """Radius [m] of the ball around each capsule's centre that contains it, (b,)."""
    out = np.empty(len(chain.body_radius))
    for k in range(len(out)):
        d = chain.body_b[k] - chain.body_a[k]
        out[k] = 0.5 * np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) + chain.body_radius[k]
    return out


@compiled
def nearest_on_segments(ends, one, other, witness):
    """Distance [m] between two segments, nearest points into witness (2, 3).

    The minimum of a convex quadratic over the unit square: its free optimum if inside, otherwise
    on an edge. Parallel and zero-length segments need no special case beyond the clamps.

    Written out component by component: differences of arrays would be arrays, made and thrown away
    for every pair, which takes half the time of all that looks at pairs.

    Args:
        ends: of all segments [m], (b, 2 or more, 3).
        one, other: which two of them.
        witness: receives the points.
    """
    ux = ends[one, 1, 0] - ends[one, 0, 0]
    uy = ends[one, 1, 1] - ends[one, 0, 1]
    uz = ends[one, 1, 2] - ends[one, 0, 2]
    vx = ends[other, 1, 0] - ends[other, 0, 0]
    vy = ends[other, 1, 1] - ends[other, 0, 1]
    vz = ends[other, 1, 2] - ends[other, 0, 2]
    rx = ends[one, 0, 0] - ends[other, 0, 0]
    ry = ends[one, 0, 1] - ends[other, 0, 1]
    rz = ends[one, 0, 2] - ends[other, 0, 2]
    a = ux * ux + uy * uy + uz * uz
    e = vx * vx + vy * vy + vz * vz
    f = vx * rx + vy * ry + vz * rz
    c = ux * rx + uy * ry + uz * rz
    b = ux * vx + uy * vy + uz * vz
    if a <= 1e-24 and e <= 1e-24:
        s = t = 0.0
    elif a <= 1e-24:
        s = 0.0
        t = min(max(f / e, 0.0), 1.0)
    elif e <= 1e-24:
        t = 0.0
        s = min(max(-c / a, 0.0), 1.0)
    else:
        det = a * e - b * b
        s = min(max((b * f - c * e) / det, 0.0), 1.0) if det > 1e-14 * a * e else 0.5
        t = (b * s + f) / e
        if t < 0.0:
            t = 0.0
            s = min(max(-c / a, 0.0), 1.0)
        elif t > 1.0:
            t = 1.0
            s = min(max((b - c) / a, 0.0), 1.0)
        elif det <= 1e-14 * a * e:
            # Parallel: move s to where it projects back, so that the answer is still a minimum.
            s = min(max((b * t - c) / a, 0.0), 1.0)
        if det <= 1e-14 * a * e:
            # Not quite parallel segments are nearest at an end of one of them.
            least = _apart(ends, one, other, s, t) - 1e-14 * (a + e)
            for end in range(2):
                s_end = min(max((b * end - c) / a, 0.0), 1.0)
                t_end = min(max((b * end + f) / e, 0.0), 1.0)
                apart = _apart(ends, one, other, float(end), t_end)
                if apart < least:
                    least, s, t = apart, float(end), t_end
                apart = _apart(ends, one, other, s_end, float(end))
                if apart < least:
                    least, s, t = apart, s_end, float(end)
    witness[0, 0] = ends[one, 0, 0] + s * ux
    witness[0, 1] = ends[one, 0, 1] + s * uy
    witness[0, 2] = ends[one, 0, 2] + s * uz
    witness[1, 0] = ends[other, 0, 0] + t * vx
    witness[1, 1] = ends[other, 0, 1] + t * vy
    witness[1, 2] = ends[other, 0, 2] + t * vz
    total = 0.0
    for i in range(3):
        total += (witness[1, i] - witness[0, i]) ** 2
    return np.sqrt(total)


@compiled
def _apart(ends, one, other, s, t):
    """Squared distance [m^2] of the points at s and t."""
    total = 0.0
    for i in range(3):
        r = ends[one, 0, i] - ends[other, 0, i]
        u = ends[one, 1, i] - ends[one, 0, i]
        v = ends[other, 1, i] - ends[other, 0, i]
        total += (r + s * u - t * v) ** 2
    return total


@compiled
def separation(ends, one, other, witness, normal):
    """Distance [m] between two segments; normal (3,) from the first, defined even where they meet.

    Arguments as of nearest_on_segments.
    """
    gap = nearest_on_segments(ends, one, other, witness)
    if gap > _TINY:
        for i in range(3):
            normal[i] = (witness[1, i] - witness[0, i]) / gap
        return gap
    # Segments that cross have no direction between nearest points: leave along the common normal.
    A, B = ends[one], ends[other]
    d1 = A[1] - A[0]
    d2 = B[1] - B[0]
    normal[0] = d1[1] * d2[2] - d1[2] * d2[1]
    normal[1] = d1[2] * d2[0] - d1[0] * d2[2]
    normal[2] = d1[0] * d2[1] - d1[1] * d2[0]
    size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if size <= 1e-12:
        longer = d1 if np.abs(d1).sum() >= np.abs(d2).sum() else d2
        least = np.argmin(np.abs(longer))
        normal[:] = 0.0
        normal[least] = 1.0
        along = longer[least] / max(longer[0] ** 2 + longer[1] ** 2 + longer[2] ** 2, 1e-300)
        for i in range(3):
            normal[i] -= along * longer[i]
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    side = 0.0
    for i in range(3):
        side += normal[i] * (B[0, i] + B[1, i] - A[0, i] - A[1, i])
    if side < 0.0:
        size = -size
    for i in range(3):
        normal[i] /= size
    return gap


@compiled
def clearance(chain, ends, balls):
    """Least signed distance [m] over the watched pairs and the row of the pair that has it."""
    best = np.inf
    which = -1
    witness = np.empty((2, 3))
    for k in range(len(chain.pair)):
        a, b = chain.pair[k, 0], chain.pair[k, 1]
        bound = best + balls[a] + balls[b]
        apart = 0.0
        for i in range(3):
            apart += (ends[a, 2, i] - ends[b, 2, i]) ** 2
        if bound <= 0.0 or apart >= bound * bound:
            continue  # the balls around the two are already farther apart than the best
        d = nearest_on_segments(ends, a, b, witness)
        d -= chain.body_radius[a] + chain.body_radius[b] - chain.slack[k]
        if d < best:
            best = d
            which = k
    return best, which


@compiled
def near_pairs(chain, ends, balls, p, z, band, d, G):
    """Distances and gradients of the watched pairs closer than band.

    Writes d (k,) [m] and G (k, n) [m/rad] for the k pairs found, in order; returns k. A buffer that
    is too small keeps the first ones, which the caller prevents by giving one row per pair.
    """
    n = len(z)
    found = 0
    witness = np.empty((2, 3))
    normal = np.empty(3)
    for k in range(len(chain.pair)):
        a, b = chain.pair[k, 0], chain.pair[k, 1]
        bound = band + balls[a] + balls[b]
        apart = 0.0
        for i in range(3):
            apart += (ends[a, 2, i] - ends[b, 2, i]) ** 2
        if apart >= bound * bound:
            continue
        gap = separation(ends, a, b, witness, normal)
        gap -= chain.body_radius[a] + chain.body_radius[b] - chain.slack[k]
        if gap >= band or found >= len(d):
            continue
        d[found] = gap
        fa, fb = chain.body_frame[a], chain.body_frame[b]
        for j in range(n):
            g = 0.0
            for side in range(2):
                f = fa if side == 0 else fb
                if chain.moves[fa, j] == chain.moves[fb, j] or not chain.moves[f, j]:
                    continue  # a joint that carries both does not change their distance
                r0 = witness[side, 0] - p[j + 1, 0]
                r1 = witness[side, 1] - p[j + 1, 1]
                r2 = witness[side, 2] - p[j + 1, 2]
                v = (
                    normal[0] * (z[j, 1] * r2 - z[j, 2] * r1)
                    + normal[1] * (z[j, 2] * r0 - z[j, 0] * r2)
                    + normal[2] * (z[j, 0] * r1 - z[j, 1] * r0)
                )
                g += v if side == 1 else -v
            G[found, j] = g
        found += 1
    return found
