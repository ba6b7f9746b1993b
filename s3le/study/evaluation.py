"""How well and how safely a method retargets: distances and rates over whole clips."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from s3le.robot.certificate import Report
from s3le.robot.robot import Robot
from s3le.safety import audit, checks, paths
from s3le.safety.paths import CERTIFIED, COLLIDES
from s3le.skeleton import cosine_distance

TOUCH = 1e-9  # [m], a path on which every pair keeps this much does not collide
_MODES = {  # figure -> modes of a motion that it counts
    "limited_rate": ("planned", "limited"),
    "avoiding_rate": ("detour", "shortened"),
    "held_rate": ("held", "braked", "halted"),
}


class Scored(NamedTuple):
    """Distances of what a method returned, one entry a frame."""

    to_truth: np.ndarray  # mean cosine distance to the ground truth's skeleton
    to_human: np.ndarray  # mean cosine distance to the human's skeleton


class Between(NamedTuple):
    """What lies between frames that follow each other in one motion, one entry a segment."""

    row: np.ndarray  # int (m,), row of the frame that it starts at
    feasible: np.ndarray  # bool (m,), are both its frames?
    collides: np.ndarray  # bool (m,), a pose on its straight path was shown to, by coal too
    undecided: np.ndarray  # bool (m,), neither that was shown nor that none does
    unproven: np.ndarray  # bool (m,), not certified to keep `margin`
    fast: np.ndarray  # bool (m,), a joint would exceed its speed at the clip's frame rate
    jump: np.ndarray  # [rad], (m,), largest change of a joint
    margin: float  # [m], that `unproven` asks for


def score(
    x: np.ndarray, truth: np.ndarray, human: np.ndarray, bones: np.ndarray | None = None
) -> Scored:
    """Distances of the returned skeletons x to truth and human, all (n, 21).

    Bones, bool (7,), are those that count; None: all.
    """
    return Scored(cosine_distance(x, truth, bones), cosine_distance(x, human, bones))


def between(
    robot: Robot,
    frames: Mapping[str, np.ndarray],
    q: np.ndarray,
    report: Report,
    v: np.ndarray | None = None,
) -> Between:
    """Look at the joint paths from each frame to the next.

    A frame that is missing leaves a gap, which is no segment. Margin between poses and speeds are
    those that `s3le audit` asks for where nothing else is said.

    Args:
        robot: the robot.
        frames: columns clip, frame and time [s], (n,), in order.
        q: poses [rad], (n, n_dof).
        report: the independent check of these poses.
        v: speeds [rad/s], (n, n_dof); None: the paths are straight.

    Raises:
        ParameterError: the robot's margin is 0, which leaves nothing for the paths.
    """
    wanted = audit.demands(robot)
    next_of = (frames["clip"][1:] == frames["clip"][:-1]) & (np.diff(frames["frame"]) == 1)
    row = np.flatnonzero(next_of)
    sound = (report.clearance >= robot.margin) & (report.limit_margin >= 0.0)  # NaN is not
    time = frames["time"]
    touch = min(TOUCH, wanted.margin_between)
    free = paths.certify(robot, q, touch, time=time, v=v)
    kept = paths.certify(robot, q, wanted.margin_between, time=time, v=v)
    # What the proof calls a collision, coal must see too.
    hit = row[free.status[row] == COLLIDES]
    t = free.t[hit][:, None]
    there = (1.0 - t) * q[hit] + t * q[hit + 1]
    if v is not None:
        there = paths.sampled(time, q, v, hit, time[hit] + t[:, 0] * (time[hit + 1] - time[hit]))[0]
    seen = robot.certifier(touch).check(there)
    collides = np.zeros(len(next_of), bool)
    collides[hit] = seen.clearance < 0.0
    step = np.abs(np.diff(q, axis=0))  # (n - 1, n_dof)
    speed = step[row] / np.diff(frames["time"])[row, None]
    return Between(
        row=row,
        feasible=sound[row] & sound[row + 1],
        collides=collides[row],
        undecided=(free.status[row] != CERTIFIED) & ~collides[row],
        unproven=kept.status[row] != CERTIFIED,
        fast=np.asarray(~(speed <= wanted.velocity * (1.0 + checks.ROUNDING)).all(axis=1)),
        jump=step[row].max(axis=1, initial=0.0),
        margin=wanted.margin_between,
    )


def summary(
    clips: Sequence[str],
    scored: Scored,
    report: Report,
    margin: float,
    paths: Between,
    modes: Sequence[str],
) -> dict[str, dict]:
    """Figures over one split: over all frames, and per motion.

    Args:
        clips: name of each frame's clip, (n,).
        scored: distances, one a frame.
        report: the independent check of the returned poses.
        margin: clearance wanted [m].
        paths: what lies between these frames; its rows count from the first of them.
        modes: how each frame's pose was obtained, words of tables.retargeted.MODES.

    Returns:
        {"all": figures, "motions": {clip: figures}}; a rate is a share of frames, and a pose that
        could not be measured counts as colliding and as outside the limits. Of segments, motions
        have counts; "all" has shares, of the segments between two feasible frames for collisions
        and what is undecided about them, of all segments else; None where there is none.
    """
    of_clip, of_mode = np.asarray(clips), np.asarray(modes)
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
            **{name: float(np.isin(of_mode[rows], words).mean()) for name, words in _MODES.items()},
            **_segments(paths, rows[paths.row]),
        }

    motions = {str(clip): figures(of_clip == clip) for clip in dict.fromkeys(of_clip.tolist())}
    total = figures(np.ones(len(of_clip), bool))
    means = [motion["to_truth"] for motion in motions.values()]
    total["to_truth_motions"] = float(np.mean(means))  # every motion counts the same
    return {"all": total | _shares(total, paths.margin), "motions": motions}


def _segments(paths: Between, at: np.ndarray) -> dict[str, float | int]:
    """Counts over the segments that `at` picks, bool (m,)."""
    feasible = at & paths.feasible
    return {
        "segments": int(at.sum()),
        "segments_feasible": int(feasible.sum()),
        "segments_colliding": int((feasible & paths.collides).sum()),
        "segments_undecided": int((feasible & paths.undecided).sum()),
        "segments_uncertified": int((at & paths.unproven).sum()),
        "segments_too_fast": int((at & paths.fast).sum()),
        "largest_jump_rad": float(paths.jump[at].max(initial=0.0)),
    }


def _shares(total: Mapping[str, float | int], margin: float) -> dict[str, float | None]:
    def share(what: str, of: str) -> float | None:
        return total[what] / total[of] if total[of] else None

    return {
        "segment_collision_rate": share("segments_colliding", "segments_feasible"),
        "segment_undecided_rate": share("segments_undecided", "segments_feasible"),
        "segment_uncertified_rate": share("segments_uncertified", "segments"),
        "segment_too_fast_rate": share("segments_too_fast", "segments"),
        "segment_margin_mm": margin * 1e3,
    }
