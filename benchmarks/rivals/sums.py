"""Sums over motions: one row for each entrant, robot and protocol, with intervals over clips.

A share or a mean is over frames, of all clips; its interval is what 95 % of DRAWS draws of as many
clips, with replacement, give. Adversarial streams have rows of their own: nobody can follow them.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from s3le.rng import stream

DRAWS, SEED = 1000, 19
GROUPS = {
    "trunk": ("hip_to_neck",), "shoulders": ("neck_to_r_shoulder", "neck_to_l_shoulder"),
    "upper arms": ("r_shoulder_to_elbow", "l_shoulder_to_elbow"),
    "forearms": ("r_elbow_to_hand", "l_elbow_to_hand"),
}  # fmt: skip


class Case(NamedTuple):
    """One motion."""

    key: str
    label: str
    robot: str
    protocol: int
    clip: str
    kind: str
    frames: int  # of the task
    said: dict[str, Any] | None  # verdict.Court.judge; None: there is no motion
    about: dict[str, Any]
    same: bool | None  # to the bit, made again; None: it was not


Figure = dict[str, float | None]  # value, and low and high of its interval


def record(cases: Sequence[Case], about: dict, sizes: dict[str, float | None]) -> dict[str, Any]:
    """All rows, as JSON can hold them."""
    places = dict.fromkeys((c.robot, c.protocol, c.kind == "adversarial", c.key) for c in cases)
    rows = []
    for robot, protocol, hard, key in places:
        mine = [c for c in cases
                if (c.robot, c.protocol, c.kind == "adversarial", c.key)
                == (robot, protocol, hard, key)]  # fmt: skip
        rows.append(
            {"robot": robot, "protocol": protocol, "adversarial": hard, "key": key,
             "label": mine[0].label, "size_mb": sizes.get(key)} | row(mine)
        )  # fmt: skip
    versions = {c.label: c.about.get("about", {}) for c in cases if c.about}
    return {"about": about | {"versions": versions}, "rows": rows}


def row(cases: Sequence[Case]) -> dict[str, Any]:
    """One row."""
    seen = [c.said for c in cases if c.said is not None]
    found: dict[str, Any] = {
        "clips": len(cases), "motions": len(seen),
        "frames": sum(s["frames"] for s in seen),
        "lost": sum(c.frames for c in cases if c.said is None),  # frames of motions never made
        "said": next((c.about["said"] for c in cases if c.about.get("said")), ""),
        "first_s": next((c.about["first"] for c in cases if c.about), None),
        "same": next((c.same for c in cases if c.same is not None), None),
    }  # fmt: skip
    if not seen:
        return found
    found["angle"] = spread(seen, lambda s: s["angle"] * s["frames"], _frames)
    for name in ("angle_beside", "lean"):  # of those whose base floats
        if all(name in s for s in seen):
            found[name] = spread(seen, lambda s, n=name: s[n] * s["frames"], _frames)
    found["far"] = spread(seen, lambda s: s["far"] * s["frames"], _frames)
    found["angle_p95"] = float(np.mean([s["angle_p95"] for s in seen]))
    frames = found["frames"]
    for group, bones in GROUPS.items():
        kept = [b for b in bones if b in seen[0]["bones"]]
        if kept:
            total = sum(s["frames"] * np.mean([s["bones"][b] for b in kept]) for s in seen)
            found[group] = total / frames
    for name in ("poses_broken", "poses_near", "outside", "hard", "held", "failed",
                 "trunk_off", "repair_moved"):  # fmt: skip
        if all(name in s for s in seen):
            found[name] = spread(seen, lambda s, n=name: s[n], _frames)
    for name in ("fast", "paths_broken", "paths_unproven", "hull_paths"):
        if all(name in s for s in seen):
            found[name] = spread(seen, lambda s, n=name: s[n], lambda s: s["steps"])
    if all("hull_poses" in s for s in seen):
        found["hull_poses"] = spread(seen, lambda s: s["hull_poses"], _frames)
        found["hull_depth_mm"] = max(s["hull_depth_mm"] for s in seen)
    found["depth_mm"] = max(max(s["depth_mm"], s["paths_depth_mm"]) for s in seen)
    found["fastest"] = max(s["fastest"] for s in seen)
    for name, share in (("acceleration", 0.99), ("jerk", 0.99)):
        pooled = np.concatenate([s[name] for s in seen])
        found[f"{name}_p99"] = float(np.quantile(pooled, share)) if len(pooled) else None
    found["lag_ms"] = float(np.average([s["lag_ms"] for s in seen],
                                       weights=[s["frames"] for s in seen]))  # fmt: skip
    us = np.concatenate([s["us"] for s in seen])
    us = us[np.isfinite(us)]
    for name, share in (("us_p50", 0.5), ("us_p99", 0.99), ("us_p999", 0.999)):
        found[name] = float(np.quantile(us, share))
    for name in ("poses_denied", "proven_probed", "proven_broken", "hpp_heard", "hpp_refused"):
        found[name] = sum(s[name] for s in seen)
    found["repair_refused"] = sum(s.get("repair_refused", 0) for s in seen)
    kinds = Counter(s["repair_why"] for s in seen if s.get("repair_refused"))
    found["repair_why"] = "; ".join(f"{count} x {kind}" for kind, count in kinds.most_common())
    found["repair_left"] = sum(s.get("repair_left", 0) for s in seen)
    off = np.concatenate([s["repair_off"] for s in seen if "repair_off" in s] or [np.empty(0)])
    moved = off[off > 0.05]
    found["repair_deg"] = [*np.quantile(moved, (0.5, 0.95)), moved.max()] if len(moved) else None
    return found


def _frames(s: dict[str, Any]) -> float:
    return s["frames"]


def spread(
    seen: Sequence[dict], part: Callable[[dict], float], of: Callable[[dict], float]
) -> Figure:
    """A ratio of sums over motions, and the interval of it over draws of motions."""
    above, below = np.array([part(s) for s in seen], float), np.array([of(s) for s in seen], float)
    if not below.sum() > 0.0:
        return {"value": None, "low": None, "high": None}
    value = float(above.sum() / below.sum())
    if len(seen) < 2:
        return {"value": value, "low": None, "high": None}
    drawn = stream(SEED, "bootstrap").integers(len(seen), size=(DRAWS, len(seen)))
    ratio = above[drawn].sum(axis=1) / below[drawn].sum(axis=1)
    low, high = np.quantile(ratio, (0.025, 0.975))
    return {"value": value, "low": float(low), "high": float(high)}
