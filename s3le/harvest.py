"""Columns of the tables of poses: solves put together with their independent check.

Every function certifies with coal what it returns; a pose that fails stops the stage.
"""

import numpy as np

from s3le import retargeting, sampling
from s3le.errors import ClipError
from s3le.kernels import batch
from s3le.kernels.batch import Progress
from s3le.machine import Machine
from s3le.tables.pairs import HOW

Columns = dict[str, np.ndarray]


def pair(
    machine: Machine,
    frames: Columns,
    count: int,
    ridge: float,
    progress: Progress | None = None,
) -> tuple[Columns, dict]:
    """Tuples (x~, x-bar, q~, q-bar) from the frames of training clips (Sec. IV-B).

    Args:
        machine: the robot.
        frames: columns of table skeletons; `count` of its training frames are taken, evenly.
        count: tuples wanted; all training frames where there are fewer.
        ridge: see retargeting.relaxed_poses.
        progress: called with numbers of rows done, twice a row (solved, certified).

    Returns:
        Pair (columns of table mocap_pairs, counts for the metrics).

    Raises:
        ClipError: there is no training frame.
        CertificateError: a projected pose is not feasible.
    """
    train = train_rows(frames, count)
    x = frames["x"][train]
    q_relaxed, residual = retargeting.relaxed_poses(machine, x, ridge, progress)
    projected = batch.project(machine.chain, machine.robot.anchor, q_relaxed, machine.margin)
    columns = {
        "clip": frames["clip"][train],
        "frame": frames["frame"][train],
        "residual": residual,
        "x_relaxed": x,
        "x_feasible": batch.skeletons(machine.chain, projected.q),
        "q_relaxed": q_relaxed,
        "q_feasible": projected.q,
        "projection": _names(projected.how),
    } | certificate(machine, projected.q, progress)
    counts = {"rows": len(x), "residual_mean": float(residual.mean())}
    return columns, counts | projection_counts(machine, q_relaxed, projected)


def sample(
    machine: Machine,
    count: int,
    alpha: float,
    renormalise: bool,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[Columns, dict]:
    """Columns of table kinematic_pairs and counts for the metrics; see sampling.draw_tuples.

    Raises:
        CertificateError: a projected pose is not feasible.
    """
    drawn = sampling.draw_tuples(machine, count, alpha, renormalise, rng, progress)
    columns = {
        "row": np.arange(count, dtype=np.int32),
        "mix": drawn.mix,
        "x_mixed": drawn.x_mixed,
        "x_relaxed": drawn.x_relaxed,
        "x_feasible": drawn.x_feasible,
        "q_relaxed": drawn.q_relaxed,
        "q_feasible": drawn.q_feasible,
        "projection": _names(drawn.how),
    } | certificate(machine, drawn.q_feasible, progress)
    projected = batch.Projection(drawn.q_feasible, drawn.how)
    counts = {"rows": count, "alpha": alpha}
    return columns, counts | projection_counts(machine, drawn.q_relaxed, projected)


def feasible(
    machine: Machine, count: int, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[Columns, dict]:
    """Columns of table robot_poses and counts; see sampling.draw_feasible.

    Raises:
        CertificateError: a pose is not feasible by the independent check.
    """
    q, share = sampling.draw_feasible(machine, count, rng, progress)
    columns = {
        "row": np.arange(count, dtype=np.int32),
        "q": q,
        "x": batch.skeletons(machine.chain, q),
    } | certificate(machine, q, progress)
    return columns, {"rows": count, "accepted_share": share}


def truth(
    machine: Machine,
    frames: Columns,
    starts: int,
    ridge: float,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Columns:
    """Columns of table ground_truth for every frame that is not of a training clip.

    Raises:
        ClipError: there is no such frame.
        CertificateError: a pose is not feasible.
    """
    rows = test_rows(frames)
    q, distance = retargeting.ground_truth(
        machine, frames["x"][rows], starts, ridge, rng, progress
    )
    return (
        {name: frames[name][rows] for name in ("split", "clip", "frame")}
        | {"to_human": distance, "q": q, "x": batch.skeletons(machine.chain, q)}
        | certificate(machine, q, progress)
    )


def train_rows(frames: Columns, count: int) -> np.ndarray:
    """Rows of table skeletons that pairs are made from: training frames, evenly, at most count.

    Raises:
        ClipError: there are none.
    """
    rows = np.flatnonzero(frames["split"] == "train")
    if not len(rows):
        raise ClipError("no training frame is left; look at the dropped frames of stage skeletons")
    if len(rows) > count:
        rows = rows[np.linspace(0, len(rows) - 1, count).round().astype(int)]
    return rows


def test_rows(frames: Columns) -> np.ndarray:
    """Rows of table skeletons that belong to clips not trained on, in order.

    Raises:
        ClipError: there are none.
    """
    rows = np.flatnonzero(frames["split"] != "train")
    if not len(rows):
        raise ClipError("no test frame is left; put a clip into the split 'test'")
    return rows


def certificate(machine: Machine, q: np.ndarray, progress: Progress | None = None) -> Columns:
    """The certificate columns of feasible poses.

    Raises:
        CertificateError: some pose is not feasible.
    """
    report = machine.certifier().require(q, machine.margin, progress)
    return {"clearance": report.clearance, "limit_margin": report.limit_margin}


def projection_counts(
    machine: Machine, q_relaxed: np.ndarray, projected: batch.Projection
) -> dict[str, float | int]:
    """What Proj_Q did: how many rows came about how, and how far the joints moved [rad]."""
    clipped = np.clip(q_relaxed, machine.robot.lower, machine.robot.upper)
    collided = batch.clearances(machine.chain, clipped) < machine.margin
    moved = np.linalg.norm(projected.q - clipped, axis=1)
    many = bool(collided.any())
    return {
        "feasible": int((projected.how == batch.SAME).sum()),
        "solved": int((projected.how == batch.SOLVED).sum()),
        "fallback": int((projected.how == batch.FALLBACK).sum()),
        "collided": int(collided.sum()),
        "moved_mean_rad": float(moved[collided].mean()) if many else 0.0,
        "moved_median_rad": float(np.median(moved[collided])) if many else 0.0,
    }


def _names(how: np.ndarray) -> np.ndarray:
    return np.array(HOW)[how]
