"""How far a motion was moved, in numbers that can be put together over many files."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

LEAST = 0.05  # [deg], a frame that moves no farther counts as touched but not as moved
STEP = 1.01  # ratio of neighbouring bins: quantiles over many files are true to 1 %
NAMED = 5  # joints that are named


def tally(
    wanted: Sequence[np.ndarray], q: Sequence[np.ndarray], joints: Sequence[str]
) -> dict[str, Any]:
    """What was moved between two motions, as JSON can hold it.

    Args:
        wanted: [rad], of each episode (m, n), as read.
        q: [rad], the same, as written.
        joints: names of the n.

    Returns:
        frames; touched: those in which any joint differs to the bit; moved: those that go farther
        than LEAST degrees in any joint; over those the median, p95 and most of the joint that moved
        most [deg]; joints: those that moved, the farthest first; bins: see pooled.
    """
    off = [np.abs(np.rad2deg(b - a)) for a, b in zip(wanted, q, strict=True)]
    far = np.concatenate([one.max(axis=1) for one in off])  # (frames,)
    by_joint = np.concatenate(off)
    touched = sum(int((a != b).any(axis=1).sum()) for a, b in zip(wanted, q, strict=True))
    moved = far[far > LEAST]
    order = np.argsort(-by_joint.max(axis=0), kind="stable")[:NAMED]
    bins, counts = np.unique(np.rint(np.log(moved) / np.log(STEP)).astype(int), return_counts=True)
    return {
        "frames": len(far),
        "touched": touched,
        "moved": len(moved),
        **_quantiles(moved),
        "joints": [
            {
                "joint": joints[j],
                "frames": int((by_joint[:, j] > LEAST).sum()),
                "most_deg": float(by_joint[:, j].max()),
            }
            for j in order
            if by_joint[:, j].max() > LEAST
        ],
        "bins": [[int(bin), int(count)] for bin, count in zip(bins, counts, strict=True)],
    }


def pooled(tallies: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The same over many files, without joints and bins; median and p95 to 1 %."""
    counts: dict[int, int] = {}
    for one in tallies:
        for bin, count in one["bins"]:
            counts[bin] = counts.get(bin, 0) + count
    bins = np.array(sorted(counts), int)
    values = np.repeat(STEP**bins, [counts[bin] for bin in bins.tolist()])
    whole = {key: sum(one[key] for one in tallies) for key in ("frames", "touched", "moved")}
    if len(tallies) == 1:
        return whole | {key: tallies[0][key] for key in ("median_deg", "p95_deg", "most_deg")}
    most = max((one["most_deg"] for one in tallies), default=0.0)
    return whole | _quantiles(values) | {"most_deg": most}


def _quantiles(moved: np.ndarray) -> dict[str, float]:
    if not len(moved):
        return {"median_deg": 0.0, "p95_deg": 0.0, "most_deg": 0.0}
    median, p95 = np.quantile(moved, (0.5, 0.95))
    return {"median_deg": float(median), "p95_deg": float(p95), "most_deg": float(moved.max())}
