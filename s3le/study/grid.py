"""Which pool and which distance: the same models looked up in every pool by every metric.

Nothing is trained and nothing new is stored. The largest pool's index holds the smaller ones'
poses, by their source, so each cell of the grid is a look-up among some of its rows.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from s3le.errors import TableError
from s3le.kernels.batch import Progress
from s3le.learn import artifact
from s3le.learn.methods import POOLS
from s3le.robot.robot import Robot
from s3le.search import metrics
from s3le.study.comparison import comparable
from s3le.study.evaluation import score

Columns = dict[str, np.ndarray]
MODELS = ("skeleton", "lwl2", "s3le")  # skeleton: brute force, which no model has a part in
CELLS = tuple(
    (model, pool, metric)
    for model in MODELS
    for pool in POOLS
    for metric in (("l2",) if model == "skeleton" else metrics.LATENT_METRICS)
)


def table(
    robot: Robot,
    frames: Columns,
    truth: Columns,
    stored: Mapping[str, Columns],
    models: Mapping[str, Path],
    progress: Progress | None = None,
) -> list[dict]:
    """Distances of every model's look-up, by pool and metric.

    A pool whose tables are all left out of the index (`index.with_pairs: false`) has no row.

    Args:
        robot: the robot.
        frames: columns of table skeletons, test frames only.
        truth: columns of table ground_truth, one row for each of them, in the same order.
        stored: by model, columns of table index over the largest pool.
        models: by model, its file.
        progress: called with numbers of look-ups done.

    Returns:
        One row for each split and cell: "split", "model", "pool", "metric", "stored" poses,
        "frames", and the means "to_truth" and "to_human" [-] over all frames of the split.

    Raises:
        TableError: truth and frames do not match row by row.
        ModelError: a model is missing, damaged, or of another robot.
    """
    for column in ("clip", "frame"):
        if not np.array_equal(frames[column], truth[column]):
            raise TableError("ground_truth and skeletons hold different frames; dvc repro truth")
    human, rows = frames["x"], []
    nets = {
        name: artifact.load_model(path, method=name, robot_hash=robot.tag)[0]
        for name, path in models.items()
    }
    for model, pool, metric in CELLS:
        whole = stored[model if model in stored else MODELS[-1]]
        at = np.isin(whole["source"], POOLS[pool])
        if at.any():
            part = {column: whole[column][at] for column in ("x", "z")}
            net, z = nets.get(model), human
            if net is None:
                part["z"] = part["x"]
            else:
                z = artifact.encode_x(net, human)
            found, _ = metrics.look_up(*comparable(part, z, metric, net))
            scored = score(part["x"][found], truth["x"], human, robot.followed)
            for split in dict.fromkeys(frames["split"].tolist()):
                own = frames["split"] == split
                rows.append(
                    {"split": split, "model": model, "pool": pool, "metric": metric}
                    | {"stored": int(at.sum()), "frames": int(own.sum())}
                    | {
                        "to_truth": float(scored.to_truth[own].mean()),
                        "to_human": float(scored.to_human[own].mean()),
                    }
                )
        if progress:
            progress(1)
    return rows
