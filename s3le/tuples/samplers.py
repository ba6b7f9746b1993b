"""Where relaxed poses are drawn from (paper, Sec. IV-C), by name; no mocap enters any of them.

The paper draws uniformly, and asks in its Discussion for draws that cover human skeletons better.
Every sampler fills the same box of relaxed limits and knows the robot by its kinematics alone:
which joints move one hand (that arm), which move both (the trunk). The constants of `rest` and
`human` come from ergonomics and judgement, each with its reason beside it.

Nothing here projects or certifies: the caller does, with the rows of every sampler alike.
Asking a shard for fewer rows gives the first of its rows.
"""

import math
from collections.abc import Callable
from difflib import get_close_matches
from itertools import product
from typing import NamedTuple

import numpy as np

from s3le import skeleton
from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.rng import stream
from s3le.robot.chain import watching
from s3le.robot.robot import Robot

# Draws that reject go on by whole blocks, so that what a row becomes does not hang on how many
# rows were asked for. Large enough to feed the kernels, small enough to waste little on few rows.
BLOCK = 4096
TRIES = 10  # draws of one arm beside one trunk; what still collides is left to the projection

# The constants of `rest` and `human` have the reasons below. Which biases `human` combines was
# picked among some thirty variants by the demo's training clips alone (docs/tried.md); no clip
# that the report measures on had a say.
#
# RULA (McAtamney and Corlett, Applied Ergonomics 24, 1993) has mild scores for a trunk within 20
# degrees of upright and its worst beyond 60: five in six draws of this spread are within 20.
TRUNK_SPREAD = math.radians(15.0)  # standard deviation of each trunk joint about the anchor [rad]
# Concentration of the upper arm about "hanging" [-]: on a sphere, half of all directions within
# 49 degrees of straight down (RULA's two mild classes of the upper arm end at 45).
HANGING = 2.0
# Least share of the peak that any direction keeps [-]: arms straight up are rare, not impossible.
RARE = 0.05
# People move their arms alike (carry, clap, jump, rest) or each for itself; half and half, for
# want of a reason for any other share.
ALIKE = 0.5  # share of poses whose left arm is the mirror image of the right one [-]
UNLIKE = math.radians(17.0)  # standard deviation of each joint from that mirror image [rad]
MIRROR_ERROR = 0.02  # [-], about a degree: unit vectors of a robot whose arms are mirror images


class Draw(NamedTuple):
    """What a sampler is asked for."""

    robot: Robot
    lower: np.ndarray  # of the box [rad], (n_dof,)
    upper: np.ndarray  # of the box [rad], (n_dof,)
    first: int  # number of the first row among the rows of all shards
    # Hides tuple.count, which nobody calls.
    count: int  # type: ignore[assignment]  # rows wanted
    rng: np.random.Generator  # of this shard
    seed: int  # of the run, the same for all shards

    def spread(self, share: np.ndarray) -> np.ndarray:
        """Shares of each joint's range in [0, 1] as angles [rad], (..., n_dof)."""
        # Rounding may carry a share below 1 just past the end.
        return np.minimum(self.lower + (self.upper - self.lower) * share, self.upper)


class Limbs(NamedTuple):
    """Which joints belong to what; every joint is in one group."""

    right: np.ndarray  # bool (n_dof,): moves the right hand only
    left: np.ndarray  # bool (n_dof,): moves the left hand only
    trunk: np.ndarray  # bool (n_dof,): moves both hands
    other: np.ndarray  # bool (n_dof,): moves neither, e.g. a head


def draw(
    name: str,
    robot: Robot,
    lower: np.ndarray,
    upper: np.ndarray,
    first: int,
    count: int,
    rng: np.random.Generator,
    seed: int,
) -> np.ndarray:
    """Relaxed poses of one shard.

    Args:
        name: one of SAMPLERS.
        robot: the robot.
        lower, upper: the box to draw from [rad], (n_dof,) each; see sampling.relaxed_limits.
        first: number of the shard's first row among the rows of all shards, at least 0; only
            `quasi` looks at it, to go on where the shard before ended.
        count: rows wanted, at least 1; fewer rows are the first of more rows.
        rng: this shard's own generator; `quasi` leaves it alone.
        seed: equal for all shards, at least 0; only `quasi` looks at it.

    Returns:
        q~ [rad], (count, n_dof), inside the box.

    Raises:
        ParameterError: an unknown name, a box of another shape, empty or not finite, or first,
            count or seed out of its range.
    """
    if name not in _SAMPLER:
        near = get_close_matches(str(name), SAMPLERS, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ParameterError(f"sampler must be one of {', '.join(SAMPLERS)}, got {name!r}{hint}")
    for what, value, least in (("first", first, 0), ("count", count, 1), ("seed", seed, 0)):
        if not value >= least:
            raise ParameterError(f"{what} must be at least {least}, got {value!r}")
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    wanted = (robot.n_dof,)
    if lower.shape != wanted or upper.shape != wanted:
        raise ParameterError(f"a box of {wanted} is wanted, got {lower.shape} and {upper.shape}")
    sound = np.isfinite(lower) & np.isfinite(upper) & (lower <= upper)  # NaN compares False
    if not sound.all():
        j = int(np.argmin(sound))
        raise ParameterError(
            f"joint {robot.joint_names[j]} cannot be drawn from [{lower[j]}, {upper[j]}]"
        )
    return _SAMPLER[name](Draw(robot, lower, upper, first, count, rng, seed))


def limbs(robot: Robot) -> Limbs:
    """Sort the joints by which hand they move."""
    chain = robot.chain
    moves = dict(zip(skeleton.POINTS, chain.moves[chain.point_frame], strict=False))
    right, left = moves["r_hand"], moves["l_hand"]
    return Limbs(right & ~left, left & ~right, right & left, ~right & ~left)


def _uniform(ask: Draw) -> np.ndarray:
    """Uniform in the box: the paper's draw."""
    return ask.rng.uniform(ask.lower, ask.upper, (ask.count, len(ask.lower)))


def _quasi(ask: Draw) -> np.ndarray:
    """Row k at frac(shift + k sqrt(p_j)), p_j the j-th prime: even in every joint at once.

    Chosen over Sobol's sequence because any row can be had without those before it, in exact
    integers and without a table; docs/tried.md compares the two.

    Source: Richtmyer's sequence, e.g. Niederreiter, Random Number Generation and Quasi-Monte
    Carlo Methods, 1992; random shift by Cranley and Patterson, 1976.
    """
    n = len(ask.lower)
    # Fractions of the roots in units of 2^-64; products wrap around, which is the "frac".
    step = np.array([math.isqrt(p << 128) % 2**64 for p in _primes(n)], np.uint64)
    shift = stream(ask.seed, "quasi").integers(0, 2**64, n, dtype=np.uint64)
    row = np.arange(ask.first, ask.first + ask.count, dtype=np.uint64)
    place = row[:, None] * step + shift  # (count, n)
    return ask.spread((place >> np.uint64(11)) * 2.0**-53)


def _centred(ask: Draw) -> np.ndarray:
    """Every joint denser towards the middle of its range: Beta(2, 2).

    Makers of humanoids put the ordinary poses of a joint inside its range, not at its stops.
    """
    return ask.spread(_beta(ask.rng.random((ask.count, len(ask.lower)))))


def _rest(ask: Draw) -> np.ndarray:
    """Trunk near upright (the anchor), everything else uniform."""
    share = ask.rng.random((ask.count, len(ask.lower)))
    return _upright(ask, share, ask.spread(share))


def _arms(ask: Draw) -> np.ndarray:
    """Each arm drawn until it is clear of trunk and legs by itself, both at the same trunk.

    What is left to the projection is then arm against arm. Uniform otherwise.
    """
    limb = limbs(ask.robot)
    blocks = [_arms_block(ask, limb) for _ in range(0, ask.count, BLOCK)]
    return np.concatenate(blocks)[: ask.count]


def _human(ask: Draw) -> np.ndarray:
    """Trunk near upright, arms hanging more than raised, often alike, joints off their stops.

    Arms are drawn as in `centred` and kept with probability max(RARE, exp(HANGING (-u_z - 1))),
    u the upper arm's direction beside an upright trunk: von Mises-Fisher about straight down.
    For a share ALIKE of rows the left arm is then the right one's mirror image but for UNLIKE,
    if the robot's arms are mirror images at all. The trunk is that of `rest`.
    """
    limb = limbs(ask.robot)
    signs = mirror_signs(ask.robot, limb)
    blocks: list[_Block] = []
    kept = np.zeros(2, int)
    while kept.min() < ask.count:
        blocks.append(_human_block(ask, limb))
        kept += len(blocks[-1].right), len(blocks[-1].left)
    # Row k takes the k-th kept arm of each side; fewer arms are kept than bodies are drawn.
    parts = (np.concatenate(part)[: ask.count] for part in zip(*blocks, strict=True))
    q, alike, unlike, right, left = parts
    if signs is not None:
        left = np.where(alike[:, None], right * signs + unlike[:, : len(signs)], left)
    q[:, limb.right], q[:, limb.left] = right, left
    return np.clip(q, ask.lower, ask.upper)


_SAMPLER: dict[str, Callable[[Draw], np.ndarray]] = {
    "uniform": _uniform,
    "quasi": _quasi,
    "arms": _arms,
    "centred": _centred,
    "rest": _rest,
    "human": _human,
}
SAMPLERS = tuple(_SAMPLER)


def mirror_signs(robot: Robot, limb: Limbs) -> np.ndarray | None:
    """Signs that turn the right arm's angles into those of its mirror image on the left.

    Joints correspond in the order of the chain. Found by trying all signs on random arms at the
    anchor's trunk and looking at the skeletons, so that no robot has to declare anything.

    Returns:
        1 or -1 for each joint of an arm, (k,); None where the arms are no mirror images of each
        other with zero in the same place, or have no joints or more than ten.
    """
    right, left = np.flatnonzero(limb.right), np.flatnonzero(limb.left)
    k = len(right)
    if len(left) != k or not 0 < k <= 10:
        return None
    probes = 8  # two poses can hide a wrong sign, eight random ones do not
    rng = np.random.default_rng(0)  # any poses will do; the same each time
    one = np.tile(robot.anchor, (probes, 1))
    one[:, right] = rng.uniform(-1.0, 1.0, (probes, k))
    one[:, left] = rng.uniform(-1.0, 1.0, (probes, k))
    want = skeleton.mirror(batch.skeletons(robot.chain, one))
    signs = np.array(list(product((1.0, -1.0), repeat=k)))  # (2^k, k)
    image = np.tile(one, (len(signs), 1, 1))  # (2^k, probes, n_dof)
    image[:, :, left] = signs[:, None] * one[:, right]
    image[:, :, right] = signs[:, None] * one[:, left]
    found = batch.skeletons(robot.chain, image.reshape(-1, robot.n_dof))
    error = np.abs(found.reshape(len(signs), probes, -1) - want).max(axis=(1, 2))
    best = int(np.argmin(error))
    return signs[best] if error[best] <= MIRROR_ERROR else None


class _Block(NamedTuple):
    """BLOCK draws of `human`: whole bodies, and the arms among them that were kept."""

    q: np.ndarray  # [rad], (BLOCK, n_dof); arms to be filled in
    alike: np.ndarray  # bool (BLOCK,), whether the left arm is to mirror the right one
    unlike: np.ndarray  # [rad], (BLOCK, joints of the larger arm), deviations from the image
    right: np.ndarray  # [rad], (kept, joints of the right arm)
    left: np.ndarray  # [rad], (kept, joints of the left arm)


def _human_block(ask: Draw, limb: Limbs) -> _Block:
    share = ask.rng.random((BLOCK, len(ask.lower)))
    keep = ask.rng.random((BLOCK, 2))
    alike = ask.rng.random(BLOCK) < ALIKE
    unlike = ask.rng.normal(0.0, UNLIKE, (BLOCK, max(limb.right.sum(), limb.left.sum())))
    q = ask.spread(_beta(share))
    q[:, limb.trunk] = ask.robot.anchor[limb.trunk]
    bones = batch.skeletons(ask.robot.chain, q).reshape(BLOCK, len(skeleton.BONES), 3)
    arms = []
    for side, (bone, joints) in enumerate((("r", limb.right), ("l", limb.left))):
        up = bones[:, skeleton.BONES.index(f"{bone}_shoulder_to_elbow"), 2]
        # A bone without length has no direction; fmax lets it pass for a rare one.
        weight = np.fmax(np.exp(HANGING * (-up - 1.0)), RARE)
        arms.append(q[np.ix_(keep[:, side] < weight, joints)])
    return _Block(_upright(ask, share, q), alike, unlike, *arms)


def _arms_block(ask: Draw, limb: Limbs) -> np.ndarray:
    robot = ask.robot
    q = ask.rng.uniform(ask.lower, ask.upper, (BLOCK, len(ask.lower)))
    for own, foreign in ((limb.right, limb.left), (limb.left, limb.right)):
        alone = _arm_alone(robot, own, foreign)
        if not len(alone.pair):
            continue
        again = np.arange(BLOCK)
        for _ in range(TRIES):
            at = np.clip(q[again], robot.lower, robot.upper)
            again = again[~(batch.clearances(alone, at) >= robot.margin)]
            if not len(again):
                break
            redrawn = ask.rng.uniform(ask.lower[own], ask.upper[own], (len(again), own.sum()))
            q[np.ix_(again, own)] = redrawn
    return q


def _arm_alone(robot: Robot, own: np.ndarray, foreign: np.ndarray):
    """The robot's chain with those watched pairs only that one arm has a part in, not the other."""
    chain = robot.chain
    moved = chain.moves[chain.body_frame]  # (bodies, n_dof)
    mine, others = (moved[:, joints].any(axis=1)[chain.pair] for joints in (own, foreign))
    return watching(chain, mine.any(axis=1) & ~others.any(axis=1))


def _upright(ask: Draw, share: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The poses q with trunk joints near the anchor: logistic, cut off at the box.

    Logistic and not normal: its inverse is elementary, and its heavier tails keep bent trunks in.
    """
    trunk = limbs(ask.robot).trunk
    centre, scale = ask.robot.anchor[trunk], TRUNK_SPREAD * math.sqrt(3.0) / math.pi
    low, high = (
        1.0 / (1.0 + np.exp((centre - end[trunk]) / scale)) for end in (ask.lower, ask.upper)
    )
    # Kept off 0 and 1, which lie at infinity; the box cuts off long before.
    p = np.clip(low + share[:, trunk] * (high - low), 1e-300, 1.0 - 1e-16)
    q[:, trunk] = np.clip(
        centre + scale * np.log(p / (1.0 - p)), ask.lower[trunk], ask.upper[trunk]
    )
    return q


def _beta(share: np.ndarray) -> np.ndarray:
    """Uniform shares turned into Beta(2, 2) ones by the inverse of 3 s^2 - 2 s^3."""
    return 0.5 - np.sin(np.arcsin(1.0 - 2.0 * share) / 3.0)


def _primes(n: int) -> list[int]:
    """The first n primes."""
    found: list[int] = []
    number = 2
    while len(found) < n:
        if all(number % p for p in found):
            found.append(number)
        number += 1
    return found
