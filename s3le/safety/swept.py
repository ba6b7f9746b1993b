"""How far, and along how bent a way, each capsule can move on a joint path.

The path is q(t), 0 <= t <= 1. A capsule is all points within a radius of its core, a segment. Seen
from a frame that carries it, a core moves only by the joints j between, at rates of at most w_j =
max |q'_j| that change by at most b_j = max |q''_j|; on a straight path w_j = |q1_j - q0_j| and b_j
= 0. Let r_j bound the distance of any point of the core from axis j at any angles. Then for each
point x of the core

    |x'|  <= V = sum_j w_j r_j
    |x''| <= A = sum_j b_j r_j + w_j (w_j r_j + 2 sum_k w_k r_k over the joints k beyond j)

since x' = sum_j q'_j z_j x (x - p_j), and since the second derivative by joints j and k, k = j or
beyond j, is z_j x (z_k x (x - p_k)), which is no longer than r_k.
Source: the first line is that of Schwarzer, Saha, Latombe, "Adaptive dynamic collision checking"
(IEEE T-RO 21(3), 2005); the second is ours.
"""

from typing import NamedTuple

import numpy as np

from s3le.kernels.compiled import compiled
from s3le.kernels.distance import reach
from s3le.robot.chain import Chain


class Swept(NamedTuple):
    """What can move how far on one robot; independent of the pose."""

    carrier: np.ndarray  # int64 (p,), C: the last frame that carries both bodies of a pair
    radius: np.ndarray  # [m], (b, n), r_j of every core; 0 where the joint does not move it
    balls: np.ndarray  # [m], (b,), distance.reach


def swept(chain: Chain) -> Swept:
    """Bounds that hold at all angles, computed once a robot.

    From the body towards the base, a core is held in a cylinder around each joint's axis, which
    turning about that axis leaves as it is, and in a ball around the joint; the next cylinder
    contains what both have in common. Source: ours; the balls alone are sums of link lengths.
    """
    moves, frame = chain.moves, chain.body_frame
    both = moves[frame[chain.pair[:, 0]]] & moves[frame[chain.pair[:, 1]]]  # (p, n)
    depth = moves[1:].sum(axis=1)  # joints from the base; of those on a line no two are equal
    carrier = np.where(both.any(axis=1), 1 + np.where(both, depth, 0).argmax(axis=1), 0)
    line = np.stack([chain.body_a, chain.body_b], axis=1)  # (b, 2, 3), a core, then part of an axis
    across = np.zeros(len(frame))  # [m], points are within this of the line
    ball = np.linalg.norm(line, axis=2).max(axis=1)  # [m], and within this of the joint
    lean = np.zeros(len(frame))  # sine of the angle between the line and the axis it meets
    radius = np.zeros((len(frame), len(chain.parent)))
    for j in reversed(range(len(chain.parent))):  # joints beyond come after those before
        on, axis, before = moves[frame, j], chain.axis[j], chain.parent[j]
        along = line[on] @ axis  # (k, 2)
        off = np.linalg.norm(line[on] - along[..., None] * axis, axis=2).max(axis=1)
        slack = across[on] * lean[on]
        low = np.maximum(along.min(axis=1) - slack, -ball[on])
        high = np.minimum(along.max(axis=1) + slack, ball[on])
        across[on] = radius[on, j] = np.minimum(off + across[on], ball[on])
        ball[on] = np.minimum(ball[on], np.hypot(np.maximum(-low, high), across[on]))
        # The joint before sees this axis where it is, however far this joint has turned.
        turned = chain.rotation[j] @ axis
        line[on] = np.stack([low, high], axis=1)[..., None] * turned + chain.translation[j]
        ball[on] += np.linalg.norm(chain.translation[j])
        cosine = turned @ chain.axis[before - 1] if before else 1.0
        lean[on] = np.sqrt(max(0.0, 1.0 - cosine * cosine))
    return Swept(carrier, radius, reach(chain))


@compiled
def travels(chain, swept, rates, bends, travel, bend):
    """V and A of every core on the whole path [m], (b, n + 1), seen from the frames beneath it.

    Args:
        rates, bends: w and b of the joints [rad], (n,).
        chain, swept, travel, bend: the robot, its Swept, and what receives V and A.
    """
    for body in range(len(chain.body_frame)):
        f = chain.body_frame[body]
        v = a = 0.0
        travel[body, f] = v
        bend[body, f] = a
        while f > 0:
            j = f - 1
            rate = rates[j]
            a += bends[j] * swept.radius[body, j]
            a += rate * (rate * swept.radius[body, j] + 2.0 * v)
            v += rate * swept.radius[body, j]
            f = chain.parent[j]
            travel[body, f] = v
            bend[body, f] = a
