"""Is the joint path between two poses clear of collisions? A proof, not samples; compiled.

The path is q(t), 0 <= t <= 1: straight, or one of safety/curve.py. d(t) is a pair's signed
distance: that of the two cores less both radii. C is the last frame that carries both bodies; V
and A are the sums over both of their speed and acceleration bounds as seen from C
(safety/swept.py). On a part [a, b] of the path, of length h = b - a, two bounds hold:

    first order:   d(t) >= (d(a) + d(b) - h V) / 2
        for d changes by no more than the cores travel: d(t) >= d(a) - (t - a) V and
        d(t) >= d(b) - (b - t) V; the mean of the two.
        Source: Schwarzer, Saha, Latombe, "Adaptive dynamic collision checking" (IEEE T-RO 21(3),
        2005), whose test is d(a) + d(b) > h V.
    second order:  d(t) >= least over s in [0, 1] and over ends x of one core and y of the other of
        (1 - s) f(a) + s f(b) - s (1 - s) h^2 A / 2,  less both radii,  where f = n . (y - x),
        for any unit vector n fixed in C: two cores are at least as far apart as their shadows on
        n, a shadow ends at an end of its core, and f lies above its chord less that parabola as
        |f''| <= A; that f'' jumps where a joint begins to brake or stands changes nothing. Every n
        gives a bound; taken is the mean of the normals at a and b.
        Source: ours; the parabola is the error of linear interpolation.

Of a pair that overlaps by design, d counts from its floor (robot/pairs.py), with the same bounds.
A pair that neither bound keeps at the margin is looked at again on both halves. Travel shrinks
with h, the parabola with h^2, so that a step of 1/30 s hardly ever needs a half. Limits need no
proof: they are a box, and the path between two poses in a box stays in it.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import nearest_on_segments, place_capsules
from s3le.kernels.kinematics import place
from s3le.robot.chain import Chain
from s3le.safety import curve
from s3le.safety.curve import extremes, position
from s3le.safety.swept import travels

CERTIFIED, COLLIDES, UNDECIDED = 0, 1, 2

_SLOTS = 28  # poses held at a time; so a part of the path is no shorter than 2^-26 of it
_ROUNDING = 1e-9  # [m], taken off what is proven; the distances are good to 1e-12
_LARGEST = 1e3  # [rad], beyond it an angle between two others is not known well enough


class Scratch(NamedTuple):
    """Room for one proof at a time; the first axis is a slot, which holds a pose of the path."""

    path: np.ndarray  # (curve.ROWS, n), see there
    last: np.ndarray  # [rad], (n,), the end of a straight path
    extreme: np.ndarray  # (2, n), of the path's rate and of its change
    q: np.ndarray  # [rad], (slots, n)
    R: np.ndarray  # (slots, n + 1, 3, 3)
    p: np.ndarray  # [m], (slots, n + 1, 3)
    z: np.ndarray  # (slots, n, 3)
    ends: np.ndarray  # [m], (slots, b, 3, 3)
    t: np.ndarray  # (slots,)
    pairs: np.ndarray  # int32 (slots, p), still open on the part of the path that ends here
    # Hides tuple.count, which nobody calls.
    count: np.ndarray  # type: ignore[assignment]  # int64 (slots,), how many these are
    least: np.ndarray  # [m], (slots,), what is proven of them
    slot: np.ndarray  # int64 (slots,): first the slot where the part begins, then a stack of ends
    travel: np.ndarray  # [m], (b, n + 1), V of every core as seen from each frame that carries it
    bend: np.ndarray  # [m], (b, n + 1), A likewise
    normal: np.ndarray  # (2, 3)
    witness: np.ndarray  # [m], (2, 2, 3)


def scratch(chain: Chain) -> Scratch:
    """Room for the proofs of one thread, about 150 kB on a robot of 32 bodies."""
    n, bodies, pairs = len(chain.parent), len(chain.body_frame), len(chain.pair)
    return Scratch(
        path=np.zeros((curve.ROWS, n)),
        last=np.zeros(n),
        extreme=np.zeros((2, n)),
        q=np.zeros((_SLOTS, n)),
        R=np.zeros((_SLOTS, n + 1, 3, 3)),
        p=np.zeros((_SLOTS, n + 1, 3)),
        z=np.zeros((_SLOTS, n, 3)),
        ends=np.zeros((_SLOTS, bodies, 3, 3)),
        t=np.zeros(_SLOTS),
        pairs=np.zeros((_SLOTS, pairs), np.int32),
        count=np.zeros(_SLOTS, np.int64),
        least=np.zeros(_SLOTS),
        slot=np.zeros(_SLOTS, np.int64),
        travel=np.zeros((bodies, n + 1)),
        bend=np.zeros((bodies, n + 1)),
        normal=np.zeros((2, 3)),
        witness=np.zeros((2, 2, 3)),
    )


@compiled
def prove(chain, swept, s, q0, q1, margin, budget):
    """Prove that all watched pairs keep the margin on the straight path from q0 to q1.

    Args:
        q0, q1: the ends [rad], (n,).
        chain, swept, s, margin, budget: see prove_curve.

    Returns:
        See prove_curve.
    """
    curve.straight(q0, q1, s.path)
    s.last[:] = q1
    return _proof(chain, swept, s, True, margin, budget)


@compiled
def prove_curve(chain, swept, s, path, margin, budget):
    """Prove that all watched pairs keep the margin on a path, or find a pose where one does not.

    Args:
        chain, swept, s: the robot, swept(chain) and a scratch(chain) of this thread's own.
        path: (curve.ROWS, n).
        margin: clearance to keep [m].
        budget: most poses that may be looked at between the ends.

    Returns:
        (status, bound [m], until, t, pair, clearance [m], used):
        CERTIFIED with bound, a proven lower bound of the clearance on the path, at least margin;
        COLLIDES with a pose at t whose closest pair keeps only clearance, under margin; it need not
        be the deepest, and the first such pose of the path lies between until and t;
        UNDECIDED with bound, under margin, or NaN if the path is not finite: the budget is spent,
        or what is left to look at is too short.
        The path is proven clear from 0 to until. What does not apply is NaN or -1; used counts the
        poses looked at between the ends.
    """
    s.path[:] = path
    return _proof(chain, swept, s, False, margin, budget)


@compiled
def _proof(chain, swept, s, straight, margin, budget):
    extremes(s.path, s.extreme[0], s.extreme[1])
    for i in range(len(s.last)):  # written so that NaN is refused
        far = s.last[i] if straight else s.extreme[0, i]
        if not (abs(s.path[curve.START, i]) <= _LARGEST and abs(far) <= _LARGEST):
            return UNDECIDED, np.nan, 0.0, np.nan, -1, np.nan, 0
    for i in range(_SLOTS):
        s.slot[i] = i
    s.t[0] = 0.0
    s.t[1] = 1.0
    _look(chain, s, straight, 0)
    _look(chain, s, straight, 1)
    travels(chain, swept, s.extreme[0], s.extreme[1], s.travel, s.bend)
    low = np.inf  # of all that is decided
    top = 1
    used = 0
    s.count[1] = len(chain.pair)
    for row in range(len(chain.pair)):
        s.pairs[1, row] = row
    while top > 0:
        left, right = s.slot[0], s.slot[top]
        low, hit = _sift(chain, swept, s, left, right, margin, low)
        if hit >= 0:
            closest, pair = _closest(chain, s, hit, margin)
            return COLLIDES, np.nan, s.t[left], s.t[hit], pair, closest, used
        if s.count[right] == 0:  # go on where this part ends; its beginning is free for reuse
            s.slot[0], s.slot[top] = right, left
            top -= 1
            continue
        if used >= budget or top + 1 >= _SLOTS:
            for i in range(1, top + 1):
                low = min(low, s.least[s.slot[i]])
            return UNDECIDED, low, s.t[left], np.nan, -1, np.nan, used
        used += 1
        top += 1
        middle = s.slot[top]
        s.t[middle] = 0.5 * (s.t[left] + s.t[right])
        _look(chain, s, straight, middle)
        s.count[middle] = s.count[right]
        for i in range(s.count[right]):
            s.pairs[middle, i] = s.pairs[right, i]
    return CERTIFIED, low, 1.0, np.nan, -1, np.nan, used


@compiled
def prove_rows(chain, swept, s, q, margin, budget, status, number, pair, used):
    """Prove between each two consecutive rows of q (n, n_dof) [rad]; results by row, as prove's.

    Writes status uint8 (n - 1,), number (n - 1, 4) with bound, until, t and clearance, pair and
    used int64 (n - 1,).
    """
    for i in range(len(q) - 1):
        found = prove(chain, swept, s, q[i], q[i + 1], margin, budget)
        _note(found, i, status, number, pair, used)


@compiled
def prove_steps(chain, swept, s, q, v, dt, margin, budget, status, number, pair, used):
    """The same of steps that are cubics: rows q, v [rad/s], (n, n_dof), dt apart [s], (n - 1,)."""
    path = np.empty((curve.ROWS, q.shape[1]))
    for i in range(len(q) - 1):
        curve.cubic(q[i], v[i], q[i + 1], v[i + 1], dt[i], path)
        found = prove_curve(chain, swept, s, path, margin, budget)
        _note(found, i, status, number, pair, used)


@compiled
def _note(found, i, status, number, pair, used):
    """Write what prove gave of row i."""
    status[i] = found[0]
    number[i, 0] = found[1]
    number[i, 1] = found[2]
    number[i, 2] = found[3]
    number[i, 3] = found[5]
    pair[i] = found[4]
    used[i] = found[6]


@compiled
def _look(chain, s, straight, slot):
    """Place the robot at the slot's t."""
    t, q0, q1 = s.t[slot], s.path[curve.START], s.last
    if straight:
        for i in range(len(q0)):
            # At the ends to the bit, and the same whichever end is called the first.
            here = q0[i] if t == 0.0 else q1[i] if t == 1.0 else (1.0 - t) * q0[i] + t * q1[i]
            s.q[slot, i] = here
    else:
        position(s.path, t, s.q[slot])
    place(chain, s.q[slot], s.R[slot], s.p[slot], s.z[slot])
    place_capsules(chain, s.R[slot], s.p[slot], s.ends[slot])


@compiled
def _sift(chain, swept, s, left, right, margin, low):
    """Keep of right's pairs those that are open between left and right.

    Returns (low, hit): low now also bounds the pairs decided here; hit is the slot of a pose that
    breaks the margin, or -1.
    """
    L, R = s.ends[left], s.ends[right]
    h = s.t[right] - s.t[left]
    kept = 0
    s.least[right] = np.inf
    for i in range(s.count[right]):
        row = s.pairs[right, i]
        a, b = chain.pair[row, 0], chain.pair[row, 1]
        C = swept.carrier[row]
        travel = h * (s.travel[a, C] + s.travel[b, C])
        # First order, for the balls around the capsules: no root, and it decides nearly all.
        level = max(margin, low)
        far = level + _ROUNDING + swept.balls[a] + swept.balls[b] + 0.5 * travel
        if chain.slack[row] != 0.0:  # one whose floor is higher than the margin
            far += max(chain.floor[row] - margin, 0.0)
        square = far * far
        if _square(L, a, b, 2) >= square and _square(R, a, b, 2) >= square:
            continue
        radii = _radii(chain, row, margin)
        left_gap = nearest_on_segments(L, a, b, s.witness[0])
        if left_gap - radii < margin:
            return low, left
        right_gap = nearest_on_segments(R, a, b, s.witness[1])
        if right_gap - radii < margin:
            return low, right
        mean = 0.5 * (left_gap + right_gap) - radii
        bound = mean - 0.5 * travel
        bend = h * h * (s.bend[a, C] + s.bend[b, C])
        # The second order gives hardly more than mean - bend / 8: skip it where that is no use.
        most = mean - 0.125 * bend
        if bound < level and most > bound and most >= margin:
            bound = max(bound, _shadows(s, a, b, C, left, right, bend) - radii)
        bound -= _ROUNDING
        if bound >= margin:
            low = min(low, bound)
        else:  # also where travel is not finite
            s.least[right] = min(s.least[right], bound)
            s.pairs[right, kept] = row
            kept += 1
    s.count[right] = kept
    return low, -1


@compiled
def _radii(chain, row, margin):
    """What a pair's cores must be apart, less the margin [m].

    One that overlaps by design keeps its floor on the way instead of the margin.
    """
    a, b = chain.pair[row, 0], chain.pair[row, 1]
    radii = chain.body_radius[a] + chain.body_radius[b]
    return radii if chain.slack[row] == 0.0 else radii + chain.floor[row] - margin


@compiled
def _closest(chain, s, slot, margin):
    """Least clearance [m] at a slot's pose, as _sift counts it, and the row of its pair."""
    least, which = np.inf, -1
    for row in range(len(chain.pair)):
        ends = s.ends[slot]
        gap = nearest_on_segments(ends, chain.pair[row, 0], chain.pair[row, 1], s.witness[0])
        gap -= _radii(chain, row, margin)
        if gap < least:
            least, which = gap, row
    return least, which


@compiled
def _square(points, a, b, i):
    """Squared distance of points (a, i) and (b, i)."""
    x = points[a, i, 0] - points[b, i, 0]
    y = points[a, i, 1] - points[b, i, 1]
    z = points[a, i, 2] - points[b, i, 2]
    return x**2 + y**2 + z**2


@compiled
def _shadows(s, a, b, C, left, right, bend):
    """Second-order bound of the distance of two cores [m]; -inf where they have no normal."""
    normal, witness = s.normal, s.witness
    m0 = m1 = m2 = 0.0  # mean of the normals at both ends, in C
    for side in range(2):
        at = left if side == 0 else right
        gap = 0.0
        for i in range(3):
            gap += (witness[side, 0, i] - witness[side, 1, i]) ** 2
        gap = np.sqrt(gap)
        if not gap > 1e-9:
            return -np.inf
        for i in range(3):
            part = (witness[side, 1, i] - witness[side, 0, i]) / gap
            m0 += s.R[at, C, i, 0] * part
            m1 += s.R[at, C, i, 1] * part
            m2 += s.R[at, C, i, 2] * part
    size = np.sqrt(m0**2 + m1**2 + m2**2)
    if not size > 1e-3:
        return -np.inf
    for side in range(2):
        at = left if side == 0 else right
        for i in range(3):
            turned = s.R[at, C, i, 0] * m0 + s.R[at, C, i, 1] * m1 + s.R[at, C, i, 2] * m2
            normal[side, i] = turned / size
    least = np.inf
    for e in range(2):
        a0 = _along(normal, 0, s.ends, left, a, e)
        a1 = _along(normal, 1, s.ends, right, a, e)
        for g in range(2):
            f0 = _along(normal, 0, s.ends, left, b, g) - a0
            f1 = _along(normal, 1, s.ends, right, b, g) - a1
            rise = abs(f1 - f0)
            lowest = min(f0, f1)
            if rise < 0.5 * bend:  # else the chord less the parabola is lowest at an end
                lowest = 0.5 * (f0 + f1) - 0.125 * bend - 0.5 * rise * rise / bend
            least = min(least, lowest)
    return least


@compiled
def _along(normal, side, ends, slot, body, end):
    """How far an end of a core is along a normal [m]."""
    n, x = normal, ends
    return (
        n[side, 0] * x[slot, body, end, 0]
        + n[side, 1] * x[slot, body, end, 1]
        + n[side, 2] * x[slot, body, end, 2]
    )
