"""Nearest feasible pose to a pose, or to a skeleton: sequential quadratic programming, compiled.

    project:  minimise 1/2 |q - q_ref|^2                          (Proj_Q, Sec. IV-B)
    follow:   minimise 1/2 |x(q) - x_ref|^2 + ridge/2 |q - q_ref|^2

both subject to  l <= q <= u  and  distance_k(q) >= margin  for every watched pair k. Because the
seven vectors have unit length, 1/2 |x - x_ref|^2 is the sum of the bones' cosine distances.

Steps come from a quadratic model with the distances linearised at the witness points, inside a
trust region; a step is kept only if it lowers objective + weight * violation, so the iteration
cannot cycle. What it returns is a candidate: the caller decides by clearance.
"""

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import (
    clearance,
    near_pairs,
    nearest_on_segments,
    place_capsules,
)
from s3le.kernels.kinematics import bones, place
from s3le.kernels.qp import INFEASIBLE, SOLVED, inverse_factor, solve

_SLACK = 1e-6  # [m], aimed for beyond the margin, so that rounding cannot fall below it
_BAND = 0.10  # [m], pairs farther than this over the margin do not enter a quadratic program


@compiled
def minimise(chain, balls, follow, x_ref, q_ref, ridge, margin, collide, steps, q, out):
    """Improve q in place, anywhere within the joint limits; see minimise_within."""
    minimise_within(
        chain, balls, chain.lower, chain.upper, follow, x_ref, q_ref, ridge, margin, collide, _BAND,
        0.0, steps, q, out,
    )  # fmt: skip


@compiled
def minimise_within(
    chain, balls, lowest, highest, follow, x_ref, q_ref, ridge, margin, collide, band, fine, steps,
    q, out,
):  # fmt: skip
    """Improve q in place.

    Args:
        chain, balls: the robot and distance.reach(chain).
        lowest, highest: the box that q is kept in [rad], (n,), no wider than the limits.
        follow: track x_ref (21,) instead of q_ref alone.
        ridge: weight of |q - q_ref|^2 when following, > 0.
        margin: clearance wanted [m].
        collide: keep clear of collisions and within the box; False frees the pose of both.
        band: pairs farther than this over the margin do not enter a quadratic program [m].
        fine: a step smaller than this in every joint is the last one [rad].
        steps: most iterations.
        q: start; receives the result, (n,).
        out: receives [objective, violation [m], iterations].
    """
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    x = np.empty(21)
    J = np.empty((21 if follow else 0, n))
    none = np.empty((0, n))
    rows = len(chain.pair) if collide else 0
    d = np.empty(rows)
    G = np.empty((rows, n))
    h = np.empty(rows)
    d_new = np.empty(rows)
    G_new = np.empty((rows, n))
    H = np.eye(n)
    factor = np.eye(n)
    g = np.empty(n)
    lower = np.empty(n)
    upper = np.empty(n)
    s = np.empty(n)
    trial = np.empty(n)
    most = np.zeros(1)
    goal = margin + _SLACK

    if collide:
        for i in range(n):
            q[i] = min(max(q[i], lowest[i]), highest[i])
    place(chain, q, R, p, z)
    m = 0
    if collide:
        place_capsules(chain, R, p, ends)
        m = near_pairs(chain, ends, balls, p, z, margin + band, d, G)
    if follow:
        bones(chain, R, p, z, x, J)
    cost = _objective(follow, x, x_ref, q, q_ref, ridge)
    short = _violation(d, m, goal)
    weight = 1.0
    radius = 0.5
    done = 0
    while done < steps:
        done += 1
        if follow:
            for i in range(n):
                v = ridge * (q[i] - q_ref[i])
                for k in range(21):
                    v += J[k, i] * (x[k] - x_ref[k])
                g[i] = v
                for j in range(i + 1):
                    v = ridge if i == j else 0.0
                    for k in range(21):
                        v += J[k, i] * J[k, j]
                    H[i, j] = v
                    H[j, i] = v
            if not inverse_factor(H, factor):
                break
        else:
            for i in range(n):
                g[i] = q[i] - q_ref[i]
        for i in range(n):
            lower[i] = -radius
            upper[i] = radius
            if collide:
                lower[i] = max(lower[i], lowest[i] - q[i])
                upper[i] = min(upper[i], highest[i] - q[i])
        share = 1.0  # of the missing distance that this step is asked for
        status = INFEASIBLE
        while True:
            for k in range(m):
                gap = goal - d[k]
                h[k] = gap * share if gap > 0.0 else gap
            status = solve(factor, g, lower, upper, G, h, m, s, most)
            if status == SOLVED or share == 0.0:
                break
            share = share * 0.5 if share > 0.2 else 0.0
        if status != SOLVED:
            break
        size = 0.0
        for i in range(n):
            size = max(size, abs(s[i]))
        if size < 1e-7:
            break
        weight = max(weight, 2.0 * most[0])
        model = 0.0
        for i in range(n):
            v = 0.0
            for j in range(n):
                v += H[i, j] * s[j]
            model += s[i] * (g[i] + 0.5 * v)
        left = 0.0
        for k in range(m):
            v = goal - d[k]
            for i in range(n):
                v -= G[k, i] * s[i]
            left += max(v, 0.0)
        hoped = -model + weight * (short - left)
        for i in range(n):
            trial[i] = q[i] + s[i]
            if collide:
                trial[i] = min(max(trial[i], lowest[i]), highest[i])
        place(chain, trial, R, p, z)
        m_new = 0
        if collide:
            place_capsules(chain, R, p, ends)
            m_new = near_pairs(chain, ends, balls, p, z, margin + band, d_new, G_new)
        if follow:
            bones(chain, R, p, z, x, none)
        cost_new = _objective(follow, x, x_ref, trial, q_ref, ridge)
        short_new = _violation(d_new, m_new, goal)
        got = cost - cost_new + weight * (short - short_new)
        if got > 0.1 * hoped and got > 0.0:
            q[:] = trial
            cost, short, m = cost_new, short_new, m_new
            d, d_new = d_new, d
            G, G_new = G_new, G
            if follow:
                bones(chain, R, p, z, x, J)
            if got > 0.7 * hoped:
                radius = min(2.0 * radius, 1.0)
            if short <= 0.0 and (size < fine or got < 1e-12 * (1.0 + cost)):
                break
        else:
            if follow:
                place(chain, q, R, p, z)
                bones(chain, R, p, z, x, none)
            radius = 0.3 * min(radius, size)
            if radius < 1e-7:
                break
    out[0] = cost
    out[1] = short
    out[2] = done


@compiled
def restore(chain, balls, margin, q):
    """Push q, which is nearly feasible, to margin by least-change steps; True when it is there."""
    return restore_within(chain, balls, chain.lower, chain.upper, margin, q)


@compiled
def restore_within(chain, balls, lowest, highest, margin, q):
    """Restore without leaving the box from lowest to highest [rad], (n,), that q is in."""
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    d = np.empty(len(chain.pair))
    G = np.empty((len(chain.pair), n))
    h = np.empty(len(chain.pair))
    eye = np.eye(n)
    zero = np.zeros(n)
    s = np.empty(n)
    most = np.zeros(1)
    extra = _SLACK
    for _ in range(8):
        place(chain, q, R, p, z)
        place_capsules(chain, R, p, ends)
        m = near_pairs(chain, ends, balls, p, z, margin + 0.02, d, G)
        short = 0.0
        for k in range(m):
            short = max(short, margin - d[k])
            h[k] = margin + extra - d[k]
        if short <= 0.0:
            return True
        if solve(eye, zero, lowest - q, highest - q, G, h, m, s, most) != SOLVED:
            return False
        for i in range(n):
            q[i] = min(max(q[i] + s[i], lowest[i]), highest[i])
        extra *= 2.0
    return False


@compiled
def clearance_of(chain, balls, q):
    """Least signed distance [m] over the watched pairs at q; NaN where q is not finite."""
    n = len(q)
    for i in range(n):
        if not np.isfinite(q[i]):
            return np.nan
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    place(chain, q, R, p, z)
    place_capsules(chain, R, p, ends)
    return clearance(chain, ends, balls)[0]


@compiled
def blend(chain, balls, anchor, margin, q):
    """Move q towards the anchor until it is feasible; False where the anchor itself is not.

    Only the joints that carry a body of a pair too close are moved, a twentieth of what is left
    at a time (the authors' projection); after 400 rounds all of them go to the anchor.
    """
    n = len(q)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    witness = np.empty((2, 3))
    moved = np.empty(n, np.bool_)
    for _ in range(400):
        place(chain, q, R, p, z)
        place_capsules(chain, R, p, ends)
        moved[:] = False
        for k in range(len(chain.pair)):
            a, b = chain.pair[k, 0], chain.pair[k, 1]
            bound = margin + balls[a] + balls[b]
            apart = 0.0
            for i in range(3):
                apart += (ends[a, 2, i] - ends[b, 2, i]) ** 2
            if apart >= bound * bound:
                continue
            gap = (
                nearest_on_segments(ends, a, b, witness)
                - chain.body_radius[a]
                - chain.body_radius[b]
                + chain.slack[k]
            )
            if gap < margin:
                for j in range(n):
                    if chain.moves[chain.body_frame[a], j] or chain.moves[chain.body_frame[b], j]:
                        moved[j] = True
        if not moved.any():
            return True
        for j in range(n):
            if moved[j]:
                q[j] = min(max(0.95 * q[j] + 0.05 * anchor[j], chain.lower[j]), chain.upper[j])
    q[:] = anchor
    return clearance_of(chain, balls, q) >= margin


@compiled
def _objective(follow, x, x_ref, q, q_ref, ridge):
    cost = 0.0
    for i in range(len(q)):
        cost += (q[i] - q_ref[i]) ** 2
    if not follow:
        return 0.5 * cost
    cost *= ridge
    for k in range(21):
        cost += (x[k] - x_ref[k]) ** 2
    return 0.5 * cost


@compiled
def _violation(d, m, goal):
    total = 0.0
    for k in range(m):
        total += max(goal - d[k], 0.0)
    return total
