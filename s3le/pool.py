"""The poses that a row of the comparison stores, with their latents."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from s3le import artifact
from s3le.machine import Machine
from s3le.methods import Entry

Columns = dict[str, np.ndarray]
_FEASIBLE = ("q_feasible", "x_feasible")
_POSE = {"mocap_pairs": _FEASIBLE, "kinematic_pairs": _FEASIBLE}


def columns(table: str) -> tuple[str, ...]:
    """The columns that `stored` wants of a table."""
    return (*_POSE.get(table, ("q", "x")), "clearance", "limit_margin")


def stored(
    machine: Machine, entry: Entry, tables: Mapping[str, Columns], model: Path | None
) -> tuple[Columns, int]:
    """Columns of table index: every pose of the entry's pool with its latent.

    The latent of an entry without a model is the pose's skeleton itself.

    Args:
        machine: the robot.
        entry: the row of the comparison.
        tables: columns of the tables in entry.pool, by name.
        model: the trained model's file; None for an entry without one.

    Returns:
        Pair (columns, length of a latent).

    Raises:
        ModelError: the model is missing, damaged, or of another robot.
    """
    parts = []
    for name in entry.pool:
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
        net, _ = artifact.load_model(model, method=entry.model, robot_hash=machine.tag)
        z = artifact.encode_q(net, pool["q"])
    found = {
        "row": np.arange(len(z), dtype=np.int32),
        "source": pool["source"],
        "source_row": pool["source_row"],
        "z": np.asarray(z, np.float32),
    } | {key: pool[key] for key in ("q", "x", "clearance", "limit_margin")}
    return found, z.shape[1]
