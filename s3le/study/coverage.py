"""How near the stored poses come to human skeletons: what a look-up could reach at best.

A human skeleton's distance is that of the nearest stored pose, found in skeleton space itself, so
no model can do better with the same rows. The paper asks for this in its Discussion: a pool that
covers human skeletons without pairs from inverse kinematics.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.human.splits import test_rows
from s3le.kernels import batch
from s3le.rng import stream
from s3le.robot.robot import Robot
from s3le.search.metrics import look_up
from s3le.skeleton import DIM, cosine_distance
from s3le.tuples import samplers
from s3le.tuples.sampling import relaxed_limits
from s3le.types import Progress


class Pool(NamedTuple):
    """Feasible poses that a sampler led to, certified, one a row."""

    q: np.ndarray  # q-bar [rad], (n, n_dof)
    x: np.ndarray  # x-bar, (n, 21)
    how: np.ndarray  # uint8 (n,), kernels.batch codes


def distances(
    x: np.ndarray,
    humans: np.ndarray,
    progress: Progress | None = None,
    bones: np.ndarray | None = None,
) -> np.ndarray:
    """Mean cosine distance of the nearest stored pose to each human skeleton.

    Bones are unit vectors, so |a - b|^2 = 14 times the mean cosine distance (seven bones, twice
    1 - cos each): the row nearest in L2 is the one sought. It is found in float32 and its
    distance then taken in float64, so a tie within 1e-6 may go either way.

    Args:
        x: stored skeletons, (n, 21), bones of unit length.
        humans: skeletons to come near to, (m, 21), bones of unit length.
        progress: called with numbers of skeletons done.
        bones: which of the seven count (Robot.followed), the others equal everywhere.

    Returns:
        Distance [-], (m,), in [0, 2].

    Raises:
        ParameterError: nothing stored, no human, another shape, not finite, or a bone that is
            not of unit length (its nearest row in L2 would be another).
    """
    for what, rows in (("stored", x), ("human", humans)):
        if rows.ndim != 2 or rows.shape[1] != DIM or not len(rows):
            raise ParameterError(
                f"{what} skeletons must have shape (n, {DIM}), n > 0, got {rows.shape}"
            )
        length = np.linalg.norm(rows.reshape(len(rows), -1, 3), axis=2)
        bad = ~(np.abs(length - 1.0) <= 1e-6).all(axis=1)  # NaN compares False
        if bad.any():
            raise ParameterError(
                f"bones must have unit length, {what} skeleton {int(np.argmax(bad))} has not"
            )
    row, _ = look_up(x, humans, "l2", progress)
    return cosine_distance(x[row], humans, bones)


def summary(found: np.ndarray) -> dict[str, float]:
    """Mean and 90th percentile of distances (m,)."""
    return {"mean": float(found.mean()), "p90": float(np.percentile(found, 90.0))}


def draw_pool(
    robot: Robot,
    sampler: str,
    rows: int,
    alpha: float,
    seed: int,
    progress: Progress | None = None,
    projection: str = "nearest",
) -> Pool:
    """Draw relaxed poses, project them, certify them.

    Args:
        robot: the robot.
        sampler: one of samplers.SAMPLERS.
        rows: relaxed poses to draw; fewer rows are the first of more rows.
        alpha: relaxation of the joint ranges [-].
        seed: root of the random streams.
        progress: called with numbers of rows done, twice a row.
        projection: one of kernels.batch.PROJECTIONS.

    Raises:
        ParameterError: an unknown sampler, or a number out of its range.
        CertificateError: a projected pose is not feasible.
    """
    low, high = relaxed_limits(robot.lower, robot.upper, alpha)
    # A stream of its own for each sampler: their differences are then not those of one draw.
    rng = stream(seed, f"coverage {sampler}")
    q = samplers.draw(sampler, robot, low, high, 0, rows, rng, seed)
    projected = batch.project(robot.chain, robot.anchor, q, robot.margin, progress, kind=projection)
    robot.certifier().require(projected.q, robot.margin, progress)
    return Pool(projected.q, batch.skeletons(robot.chain, projected.q), projected.how)


def measure(
    x: np.ndarray, humans: Mapping[str, np.ndarray], bones: np.ndarray | None = None
) -> list[dict]:
    """Split, mean and p90 of the distances of each split's people to the stored skeletons x."""
    return [
        {"split": split} | summary(distances(x, seen, bones=bones))
        for split, seen in humans.items()
    ]


def how_drawn(how: np.ndarray) -> dict[str, float]:
    """Shares of rows that were feasible as drawn, and that Proj_Q could only blend."""
    return {
        "feasible": float((how == batch.SAME).mean()),
        "fallback": float((how == batch.FALLBACK).mean()),
    }


def compare(
    robot: Robot,
    humans: Mapping[str, np.ndarray],
    names: Iterable[str],
    sizes: Iterable[int],
    alpha: float,
    seed: int,
    extra: np.ndarray,
    progress: Progress | None = None,
    projection: str = "nearest",
) -> list[dict]:
    """Coverage of every sampler at equal row counts.

    The smaller pools of a sampler are the first rows of its largest, so the same rows serve all
    sizes. Deterministic by seed, whatever the number of threads.

    Args:
        robot: the robot.
        humans: split -> skeletons that no sampler has seen, (m, 21).
        names: samplers to compare.
        sizes: row counts, at least 1 each.
        alpha: relaxation of the joint ranges [-].
        seed: root of the random streams.
        extra: skeletons stored beside every sampler's rows, (k, 21), e.g. those of IK pairs, or
            none (k = 0); they come on top of the row count.
        progress: called with numbers of rows done, twice a row of each sampler's largest pool.
        projection: one of kernels.batch.PROJECTIONS.

    Returns:
        One mapping for each sampler, split and size: sampler, split, rows, seed, mean, p90,
        feasible (share of rows feasible without projection), fallback (share that Proj_Q could
        only blend towards the anchor).

    Raises:
        ParameterError: no size, no split, an unknown sampler; see draw_pool and distances.
        CertificateError: a projected pose is not feasible.
    """
    sizes = sorted(set(sizes))
    if not sizes or not sizes[0] >= 1:
        raise ParameterError(f"row counts must be at least 1, got {sizes}")
    if not humans:
        raise ParameterError("there is no split to measure; give human skeletons")
    found = []
    for name in names:
        pool = draw_pool(robot, name, sizes[-1], alpha, seed, progress, projection)
        for size in sizes:
            about = {"sampler": name, "rows": size, "seed": seed} | how_drawn(pool.how[:size])
            x = np.concatenate([pool.x[:size], extra])
            found += [about | row for row in measure(x, humans, robot.followed)]
    return found


def table(
    robot: Robot,
    frames: Mapping[str, np.ndarray],
    pairs: np.ndarray,
    rows: int,
    alpha: float,
    seed: int,
    progress: Progress | None = None,
    projection: str = "nearest",
) -> list[dict]:
    """All samplers, alone and with IK pairs beside them, and the pairs alone.

    Args:
        robot: the robot.
        frames: columns of table skeletons; the clips not trained on are the people.
        pairs: skeletons of the poses that inverse kinematics found, (k, 21).
        rows: poses of each sampler.
        alpha: relaxation of the joint ranges [-].
        seed: root of the random streams.
        progress, projection: as in compare.

    Returns:
        Rows of compare, with "pairs" (how many IK pairs are stored beside) and "bar", which names
        the row in a chart; sampler "none" is the pairs alone.

    Raises:
        ClipError: there is no such frame.
    """
    at = test_rows(frames)
    split = frames["split"][at]
    humans = {str(name): frames["x"][at[split == name]] for name in np.unique(split)}
    none = {"rows": 0, "seed": seed, "feasible": 0.0, "fallback": 0.0, "pairs": len(pairs)}
    found = []
    for name in samplers.SAMPLERS:
        pool = draw_pool(robot, name, rows, alpha, seed, progress, projection)
        for k, x in ((0, pool.x), (len(pairs), np.concatenate([pool.x, pairs]))):
            for row in measure(x, humans, robot.followed):
                about = {"sampler": name, "rows": rows, "seed": seed} | how_drawn(pool.how)
                found.append(row | about | {"pairs": k})
    found += [row | none | {"sampler": "none"} for row in measure(pairs, humans, robot.followed)]
    order = ("split", "sampler", "rows", "pairs", "seed", "mean", "p90", "feasible", "fallback")
    return [{name: row[name] for name in order} | {"bar": _bar(row)} for row in found]


def _bar(row: Mapping[str, Any]) -> str:
    """What names a row in a chart."""
    if row["sampler"] == "none":
        return f"{row['split']}: pairs alone"
    return f"{row['split']}: {row['sampler']}" + (" and pairs" if row["pairs"] else "")
