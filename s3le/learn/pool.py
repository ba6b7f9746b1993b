"""The poses that a row of the comparison stores, with their latents."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from s3le.errors import ParameterError
from s3le.learn import methods
from s3le.learn.methods import Entry
from s3le.robot.robot import Robot
from s3le.types import Columns

_FEASIBLE = ("q_feasible", "x_feasible")
_POSE = {"mocap_pairs": _FEASIBLE, "kinematic_pairs": _FEASIBLE}


def columns(table: str) -> tuple[str, ...]:
    """The columns that `stored` wants of a table."""
    return (*_POSE.get(table, ("q", "x")), "clearance", "limit_margin")


def tables(name: str, with_pairs: bool) -> tuple[str, ...]:
    """Tables whose poses an entry stores; without mocap pairs where that is asked for.

    Raises:
        ParameterError: no such entry, or nothing is left for it to store.
    """
    pool = methods.entry(name).pool
    left = tuple(table for table in pool if with_pairs or table != "mocap_pairs")
    if not left:
        raise ParameterError(f"index.with_pairs is false and '{name}' stores nothing but pairs")
    return left


def stored(
    robot: Robot, entry: Entry, tables: Mapping[str, Columns], model: Path | None
) -> tuple[Columns, int]:
    """Columns of table index: every pose of the entry's pool with its latent.

    The latent of an entry without a model is the pose's skeleton itself.

    Args:
        robot: the robot.
        entry: the row of the comparison.
        tables: columns of the tables that are stored, by name, in the order of the rows.
        model: the trained model's file; None for an entry without one.

    Returns:
        Pair (columns, length of a latent).

    Raises:
        ModelError: the model is missing, damaged, or of another robot.
    """
    parts = []
    for name in tables:
        q, x = _POSE.get(name, ("q", "x"))
        rows = tables[name]
        n = len(rows[q])
        parts.append(
            {
                "source": np.full(n, name),
                "source_row": np.arange(n, dtype=np.int32),
                "q": rows[q],
                "x": rows[x],
                "clearance": rows["clearance"],
                "limit_margin": rows["limit_margin"],
            }
        )
    pool = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    z = pool["x"]
    if entry.model:
        if model is None:
            raise ParameterError(f"poses of '{entry.model}' want the file of its model")
        from s3le.learn import artifact  # torch: two seconds that skeletons need not wait

        net, _ = artifact.load_model(model, method=entry.model, robot_hash=robot.tag)
        z = artifact.encode_q(net, pool["q"])
    found = {
        "row": np.arange(len(z), dtype=np.int32),
        "source": pool["source"],
        "source_row": pool["source_row"],
        "z": np.asarray(z, np.float32),
    } | {key: pool[key] for key in ("q", "x", "clearance", "limit_margin")}
    return found, z.shape[1]
