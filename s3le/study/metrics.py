"""What every stage counted, as one tree, and the few numbers of it that runs are compared by."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from s3le.learn.methods import ENTRIES, label
from s3le.robot.robot import Robot

_ANSWER = "certified_refined"
_OF_ANSWER = {  # its figures -> their names among the compared ones
    "to_truth": "to_truth",
    "to_human": "to_human",
    "limited_rate": "limited_by_speed",
    "segment_uncertified_rate": "paths_not_proven",
}
_UNSAFE = (  # entry, its figure, its name among the compared ones
    ("ale", "collision_rate", "poses_collide"),
    ("ale", "limit_rate", "limits_broken"),
    ("s3le", "segment_collision_rate", "paths_collide"),
    ("s3le", "segment_too_fast_rate", "steps_too_fast"),
)
_COVERED = ("human", "pairs_alone", "uniform")  # samplers


def merge(
    robot: Robot,
    clips: str,
    counts: Mapping[str, Mapping[str, Any]],
    truth: Mapping[str, np.ndarray],
    figures: Mapping[str, Mapping[str, Any]],
    coverage: list[Mapping[str, Any]],
    synthetic: Mapping[str, Any],
) -> tuple[dict[str, Any], list[dict[str, Any]], list[dict[str, Any]]]:
    """Put the stages' figures together.

    Args:
        robot: the robot.
        clips: value of the parameter.
        counts: by stage: skeletons, pair, sample, poses.
        truth: columns of table ground_truth.
        figures: by entry, what comparison.judge found for each split.
        coverage: rows of coverage.table.
        synthetic: errors of the synthetic example.

    Returns:
        Triple (run, methods, motions): the tree for reports/run.json, one row for each
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
            "robot": robot.name,
            "clips": clips,
            "n_dof": robot.n_dof,
            "pairs_watched": len(robot.watched),
            "margin_mm": robot.margin * 1e3,
            # What every cosine distance of this tree is a mean over.
            "vectors": len(robot.vectors),
            "vectors_are": "the seven" if robot.followed is None else ", ".join(robot.vectors),
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


def compared(run: Mapping[str, Any]) -> dict[str, Any]:
    """The few numbers by which a person compares two runs, for reports/metrics.json.

    `dvc metrics diff` sorts their names, so the headline is called "answer" and comes first: what
    people retarget with, refined and certified.

    Args:
        run: the tree of `merge`; entries that it lacks are left out.
    """
    tree: dict[str, Any] = {name: {} for name in ("answer", "coverage", "distance", "unsafe")}
    for split, part in run["splits"].items():
        methods = part["methods"]
        if answer := methods.get(_ANSWER):
            tree["answer"][split] = {name: answer[key] for key, name in _OF_ANSWER.items()}
        tree["distance"][split] = {"ground_truth_to_human": part["truth"]["to_human"]} | {
            name: methods[name]["to_truth"]
            for name in ENTRIES
            if name in methods and name != _ANSWER
        }
        tree["unsafe"][split] = {
            f"{name}_{words}": methods[name][key] for name, key, words in _UNSAFE if name in methods
        }
        covered = run["coverage"].get(split, {})
        tree["coverage"][split] = {
            name: covered[name]["mean"] for name in _COVERED if name in covered
        }
    tree["synthetic"] = {
        name: run["synthetic"][name]["error_invariant"]["mean"]
        for name in ("with_nt_xent", "without_nt_xent")
    }
    counts = run["sampling"]
    tree["tuples"] = {
        "collided_share": counts["collided"] / counts["rows"],
        "moved_mean_rad": counts["moved_mean_rad"],
        "pairs": run["pairs"]["rows"],
        "rows": counts["rows"],
    }
    return tree


def _coverage(rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean distances by split and sampler, alone and with IK pairs stored beside."""
    tree: dict[str, Any] = {}
    for row in rows:
        split = tree.setdefault(row["split"], {})
        name = "pairs_alone" if row["sampler"] == "none" else row["sampler"]
        kind = "with_pairs" if row["pairs"] and row["rows"] else "mean"
        split.setdefault(name, {})[kind] = row["mean"]
    return tree
