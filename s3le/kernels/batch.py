"""Whole batches through the compiled kernels, on every core, in chunks that fit the cache.

Rows are independent, so the result does not depend on how many workers share them.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels.compiled import compiled
from s3le.kernels.distance import nearest_on_segments, place_capsules, reach
from s3le.kernels.kinematics import bones, place
from s3le.kernels.solver import blend, clearance_of, minimise, restore
from s3le.kernels.threads import workers
from s3le.robot.chain import Chain
from s3le.skeleton import POINTS
from s3le.types import Progress

CHUNK = 256  # rows a worker takes at a time

SAME, SOLVED, FALLBACK = 0, 1, 2  # how a projection came about
PROJECTIONS = ("nearest", "blend")  # the nearest feasible pose found, or the authors' rule


class Projection(NamedTuple):
    """Result of Proj_Q, one entry a row."""

    q: np.ndarray  # [rad], (n, n_dof), feasible
    how: np.ndarray  # uint8 (n,): SAME (was feasible), SOLVED, FALLBACK (towards the anchor)


class Solution(NamedTuple):
    """Result of following a skeleton, one entry a row."""

    q: np.ndarray  # [rad], (n, n_dof)
    cost: np.ndarray  # (n,), 1/2 |x(q) - x|^2 + ridge/2 |q - q_ref|^2
    feasible: np.ndarray  # bool (n,)


def skeletons(chain: Chain, q: np.ndarray, progress: Progress | None = None) -> np.ndarray:
    """Skeleton features x = FK(q): q (n, n_dof) [rad] -> (n, 21)."""
    q = _poses(chain, q)
    x = np.empty((len(q), 21))
    _spread(lambda rows: _skeletons(chain, q[rows], x[rows]), len(q), progress)
    return x


def points(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The ten skeleton points of each pose, (n, 10, 3) [m], x forward, y left, z up."""
    q = _poses(chain, q)
    at = np.empty((len(q), len(chain.point), 3))
    _points(chain, q, at)
    return at[:, : len(POINTS)]


def capsule_ends(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Both segment ends of every capsule, (n, bodies, 2, 3) [m], x forward, y left, z up."""
    q = _poses(chain, q)
    ends = np.empty((len(q), len(chain.body_radius), 2, 3))
    _capsule_ends(chain, q, ends)
    return ends


def clearances(chain: Chain, q: np.ndarray, progress: Progress | None = None) -> np.ndarray:
    """Least signed distance over the watched pairs [m], (n,); NaN where q is not finite."""
    q = _poses(chain, q)
    out = np.empty(len(q))
    balls = reach(chain)
    _spread(lambda rows: _clearances(chain, balls, q[rows], out[rows]), len(q), progress)
    return out


def pair_distances(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Signed distance of every watched pair at each pose [m], (n, pairs)."""
    q = _poses(chain, q)
    out = np.empty((len(q), len(chain.pair)))
    _spread(lambda rows: _pair_distances(chain, q[rows], out[rows]), len(q), None)
    return out


def project(
    chain: Chain,
    anchor: np.ndarray,
    q: np.ndarray,
    margin: float,
    progress: Progress | None = None,
    kind: str = "nearest",
) -> Projection:
    """Proj_Q: for each relaxed pose the nearest feasible one found, least change in q (Sec. IV-B).

    A feasible pose is returned as it is, to the bit. Where `kind` is "blend", a pose that collides
    is blended towards the anchor until it does not, as the authors have it, and counts as FALLBACK.

    Args:
        chain: the robot.
        anchor: a feasible pose [rad], (n_dof,), from which the fallback always succeeds.
        q: relaxed poses [rad], (n, n_dof), finite.
        margin: clearance wanted [m].
        progress: called with numbers of rows done.
        kind: one of PROJECTIONS.

    Raises:
        ParameterError: q has another shape, a row of it is not finite, or there is no such kind.
    """
    if kind not in PROJECTIONS:
        raise ParameterError(f"projection must be one of {', '.join(PROJECTIONS)}, got {kind!r}")
    q = _poses(chain, q).copy()
    if not np.isfinite(q).all():
        row = int(np.argmin(np.isfinite(q).all(axis=1)))
        raise ParameterError(f"poses to project must be finite, row {row} is not")
    how = np.empty(len(q), np.uint8)
    balls, solve = reach(chain), kind == "nearest"
    _spread(
        lambda rows: _project(chain, balls, anchor, margin, solve, q[rows], how[rows]),
        len(q),
        progress,
    )
    return Projection(q, how)


def follow(
    chain: Chain,
    x: np.ndarray,
    starts: np.ndarray,
    q_ref: np.ndarray,
    ridge: float,
    margin: float,
    constrained: bool,
    progress: Progress | None = None,
) -> Solution:
    """Pose whose skeleton is nearest to x, the best of several starts.

    Args:
        chain: the robot.
        x: wanted skeletons, (n, 21), finite.
        starts: poses to start from [rad], (n, k, n_dof).
        q_ref: pose that the ridge pulls to [rad], (n_dof,).
        ridge: weight of |q - q_ref|^2, > 0; settles what the skeleton leaves open.
        margin: clearance wanted [m].
        constrained: respect limits and margin; otherwise neither.
        progress: called with numbers of rows done.

    Raises:
        ParameterError: x or starts have another shape.
    """
    starts = np.require(starts, float, ["C", "W"])
    x = np.require(x, float, ["C", "W"])
    if x.ndim != 2 or x.shape[1] != 21:
        raise ParameterError(f"skeletons must have shape (n, 21), got {x.shape}")
    n_dof = len(chain.parent)
    if starts.ndim != 3 or starts.shape[::2] != (len(x), n_dof):
        raise ParameterError(f"starts must have shape ({len(x)}, k, {n_dof}), got {starts.shape}")
    q = np.empty((len(x), starts.shape[2]))
    cost = np.empty(len(x))
    feasible = np.empty(len(x), np.bool_)
    balls = reach(chain)

    def work(rows: slice) -> None:
        _follow(
            chain, balls, x[rows], starts[rows], q_ref, ridge, margin, constrained,
            q[rows], cost[rows], feasible[rows],
        )  # fmt: skip

    _spread(work, len(x), progress)
    return Solution(q, cost, feasible)


def _poses(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The poses as the kernels want them; they would read beyond rows of another length.

    Read-only ones, as a file gives them, are copied: for them kernels would be compiled anew.
    """
    q = np.require(q, float, ["C", "W"])
    if q.ndim != 2 or q.shape[1] != len(chain.parent):
        raise ParameterError(f"poses must have shape (n, {len(chain.parent)}), got {q.shape}")
    return q


def _spread(work: Callable[[slice], None], n: int, progress: Progress | None) -> None:
    """Run work over slices of n rows on every core; the kernels release the interpreter lock."""
    slices = [slice(i, min(i + CHUNK, n)) for i in range(0, n, CHUNK)]
    if not slices:
        return
    work(slices[0])  # compiles once, in this thread
    if progress:
        progress(slices[0].stop)
    with ThreadPoolExecutor(workers()) as pool:
        for rows, _ in zip(slices[1:], pool.map(work, slices[1:]), strict=True):
            if progress:
                progress(rows.stop - rows.start)


@compiled
def _skeletons(chain, q, x):
    n = q.shape[1]
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    none = np.empty((0, n))
    for row in range(len(q)):
        place(chain, q[row], R, p, z)
        bones(chain, R, p, z, x[row], none)


@compiled
def _turn(rotation, v, out):
    """Out = rotation v; numba's own matrix product would need scipy at run time."""
    for i in range(3):
        out[i] = rotation[i, 0] * v[0] + rotation[i, 1] * v[1] + rotation[i, 2] * v[2]


@compiled
def _points(chain, q, at):
    n = q.shape[1]
    v = np.empty(3)
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    for row in range(len(q)):
        place(chain, q[row], R, p, z)
        for k in range(len(chain.point)):
            f = chain.point_frame[k]
            _turn(R[f], chain.point[k], v)
            for i in range(3):
                v[i] += p[f, i]
            _turn(chain.base, v, at[row, k])


@compiled
def _capsule_ends(chain, q, out):
    n = q.shape[1]
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    for row in range(len(q)):
        place(chain, q[row], R, p, z)
        place_capsules(chain, R, p, ends)
        for k in range(len(ends)):
            for side in range(2):
                _turn(chain.base, ends[k, side], out[row, k, side])


@compiled
def _clearances(chain, balls, q, out):
    for row in range(len(q)):
        out[row] = clearance_of(chain, balls, q[row])


@compiled
def _pair_distances(chain, q, out):
    n = q.shape[1]
    R = np.empty((n + 1, 3, 3))
    p = np.empty((n + 1, 3))
    z = np.empty((n, 3))
    ends = np.empty((len(chain.body_frame), 3, 3))
    witness = np.empty((2, 3))
    for row in range(len(q)):
        place(chain, q[row], R, p, z)
        place_capsules(chain, R, p, ends)
        for k in range(len(chain.pair)):
            a, b = chain.pair[k, 0], chain.pair[k, 1]
            gap = nearest_on_segments(ends, a, b, witness)
            out[row, k] = gap - chain.body_radius[a] - chain.body_radius[b] + chain.slack[k]


@compiled
def _project(chain, balls, anchor, margin, solve, q, how):
    n = q.shape[1]
    out = np.empty(3)
    empty = np.empty(0)
    for row in range(len(q)):
        want = q[row].copy()
        inside = True
        for i in range(n):
            inside = inside and chain.lower[i] <= want[i] <= chain.upper[i]
            q[row, i] = min(max(want[i], chain.lower[i]), chain.upper[i])
        if clearance_of(chain, balls, q[row]) >= margin:
            how[row] = SAME if inside else SOLVED
            continue
        # Two starts: the clipped pose itself, and the feasible pose that blending leads to.
        back = q[row].copy()
        safe = blend(chain, balls, anchor, margin, back)
        # Blending is the answer to beat; where it failed, back is the anchor.
        kept = back
        how[row] = FALLBACK
        best = _far(back, want) if safe else np.inf
        for start in range(2 if solve else 0):
            if start == 1 and not safe:
                break
            trial = back.copy() if start == 1 else q[row].copy()
            minimise(chain, balls, False, empty, want, 0.0, margin, True, 60, trial, out)
            if clearance_of(chain, balls, trial) < margin and not restore(
                chain, balls, margin, trial
            ):
                continue
            far = _far(trial, want)
            if far < best:
                best = far
                kept = trial
                how[row] = SOLVED
        q[row] = kept


@compiled
def _far(a, b):
    total = 0.0
    for i in range(len(a)):
        total += (a[i] - b[i]) ** 2
    return total


@compiled
def _follow(chain, balls, x, starts, q_ref, ridge, margin, constrained, q, cost, feasible):
    out = np.empty(3)
    for row in range(len(x)):
        best = np.inf
        q[row] = starts[row, 0]
        feasible[row] = False
        for k in range(starts.shape[1]):
            trial = starts[row, k].copy()
            minimise(chain, balls, True, x[row], q_ref, ridge, margin, constrained, 100, trial, out)
            if constrained and not clearance_of(chain, balls, trial) >= margin:
                if not restore(chain, balls, margin, trial):
                    continue
            if out[0] < best:
                best = out[0]
                q[row] = trial
                feasible[row] = True
        cost[row] = best
