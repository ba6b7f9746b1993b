"""The one tree of numbers that a run is compared by, from what every stage counted."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from s3le.machine import Machine
from s3le.methods import ENTRIES, label


def merge(
    machine: Machine,
    clips: str,
    counts: Mapping[str, Mapping[str, Any]],
    truth: Mapping[str, np.ndarray],
    figures: Mapping[str, Mapping[str, Any]],
    coverage: list[Mapping[str, Any]],
    synthetic: Mapping[str, Any],
) -> tuple[dict[str, Any], list[dict[str, Any]], list[dict[str, Any]]]:
    """Put the stages' figures together.

    Args:
        machine: the robot.
        clips: value of the parameter.
        counts: by stage: skeletons, pair, sample, poses.
        truth: columns of table ground_truth.
        figures: by entry, what comparison.judge found for each split.
        coverage: rows of coverage.table.
        synthetic: errors of the synthetic example.

    Returns:
        Triple (metrics, methods, motions): the tree for reports/metrics.json, one row for each
        split and entry, and one for each split, motion and entry; "bar" names a row in a chart.
    """
    splits: dict[str, Any] = {}
    motions = []
    for split in dict.fromkeys(truth["split"].tolist()):
        at = truth["split"] == split
        methods = {}
        for name in ENTRIES:
            found = figures[name][split]
            methods[name] = {key: found["all"][key] for key in found["all"] if key != "frames"}
            for clip, values in found["motions"].items():
                where = {"split": split, "clip": clip, "method": name}
                motions.append(where | {"bar": f"{split} {clip}: {name}"} | values)
        splits[split] = {
            "clips": len(set(truth["clip"][at].tolist())),
            "frames": int(at.sum()),
            "truth": {
                "to_human": float(truth["to_human"][at].mean()),
                # NaN is no clearance.
                "collision_rate": float((~(truth["clearance"][at] >= 0.0)).mean()),
                "limit_rate": float((~(truth["limit_margin"][at] >= 0.0)).mean()),
            },
            "methods": methods,
        }
    tree = {
        "run": {
            "robot": machine.robot.name,
            "clips": clips,
            "n_dof": machine.robot.n_dof,
            "pairs_watched": len(machine.watched),
            "margin_mm": machine.margin * 1e3,
            # What every cosine distance of this tree is a mean over.
            "vectors": len(machine.vectors),
            "vectors_are": "the seven" if machine.followed is None else ", ".join(machine.vectors),
        },
        "clips": counts["skeletons"]["clips"],
        "domain": counts["skeletons"]["domain"],
        "pairs": counts["pair"],
        "sampling": counts["sample"],
        "poses": counts["poses"],
        "coverage": _coverage(coverage),
        "synthetic": synthetic,
        "splits": splits,
    }
    table = [
        {"split": split, "method": name, "bar": f"{split}: {label(name, found['proposed_by'])}"}
        | found
        for split, part in splits.items()
        for name, found in part["methods"].items()
    ]
    return tree, table, motions


def _coverage(rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean distances by split and sampler, alone and with IK pairs stored beside."""
    tree: dict[str, Any] = {}
    for row in rows:
        split = tree.setdefault(row["split"], {})
        name = "pairs_alone" if row["sampler"] == "none" else row["sampler"]
        kind = "with_pairs" if row["pairs"] and row["rows"] else "mean"
        split.setdefault(name, {})[kind] = row["mean"]
    return tree
