"""How well and how safely a method retargets: distances and rates over whole clips."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from s3le.robot.certificate import Report
from s3le.skeleton import cosine_distance


class Scored(NamedTuple):
    """Distances of what a method returned, one entry a frame."""

    to_truth: np.ndarray  # mean cosine distance to the ground truth's skeleton
    to_human: np.ndarray  # mean cosine distance to the human's skeleton


def score(
    x: np.ndarray, truth: np.ndarray, human: np.ndarray, bones: np.ndarray | None = None
) -> Scored:
    """Distances of the returned skeletons x to truth and human, all (n, 21).

    Bones, bool (7,), are those that count; None: all.
    """
    return Scored(cosine_distance(x, truth, bones), cosine_distance(x, human, bones))


def summary(clips: Sequence[str], scored: Scored, report: Report, margin: float) -> dict[str, dict]:
    """Figures over one split: over all frames, and per motion.

    Args:
        clips: name of each frame's clip, (n,).
        scored: distances, one a frame.
        report: the independent check of the returned poses.
        margin: clearance wanted [m].

    Returns:
        {"all": figures, "motions": {clip: figures}}; a rate is a share of frames, and a pose that
        could not be measured counts as colliding and as outside the limits.
    """
    clips = np.asarray(clips)
    collides = ~(report.clearance >= 0.0)  # NaN collides
    outside = ~(report.limit_margin >= 0.0)
    close = ~(report.clearance >= margin)

    def figures(rows: np.ndarray) -> dict[str, float | int]:
        return {
            "frames": int(rows.sum()),
            "to_truth": float(scored.to_truth[rows].mean()),
            "to_human": float(scored.to_human[rows].mean()),
            "collision_rate": float(collides[rows].mean()),
            "below_margin_rate": float(close[rows].mean()),
            "limit_rate": float(outside[rows].mean()),
        }

    motions = {str(clip): figures(clips == clip) for clip in dict.fromkeys(clips.tolist())}
    total = figures(np.ones(len(clips), bool))
    means = [motion["to_truth"] for motion in motions.values()]
    total["to_truth_motions"] = float(np.mean(means))  # every motion counts the same
    return {"all": total, "motions": motions}
