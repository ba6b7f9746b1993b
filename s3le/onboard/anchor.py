"""A pose that is feasible and hides as little as it can: the anchor of a robot file.

Pairs that overlap at the anchor are not kept apart, so of many poses the one is taken at which the
fewest do. The T-pose and its neighbours are asked first: their arms are far from everything.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from s3le.errors import RobotError
from s3le.kernels import batch
from s3le.robot import chain, sense
from s3le.robot import pairs as rules
from s3le.robot.model import Geometry
from s3le.skeleton import BONES, DIM

WISHED = 0.01  # [m], clearance of an anchor; margins are smaller
_SERVES = 0.005  # [m], the same of a named pose: parts that turn beside each other leave no more
_RANDOM = 100  # poses that are asked after the named ones
_LIFTS = (0.0, 0.35, 0.7, -0.4)  # [rad] that arms hang below the T-pose
ASKED = _RANDOM + len(_LIFTS) + 1


class Found(NamedTuple):
    """An anchor and how it was found."""

    q: np.ndarray  # [rad], (n_dof,)
    how: str  # "T-pose", "arms 20 deg lower", "zero", or "search"
    clearance: float  # [m] over the pairs that are watched there
    overlaps: int  # pairs that could move but are not watched


def search(robot: Geometry, neck: str) -> Found | None:
    """The best anchor found; None: no pose asked leaves a pair to watch and nothing in collision.

    Args:
        robot: its own anchor may be anything within limits.
        neck: skeleton.NECKS.
    """
    best: tuple[tuple, Found] | None = None
    for rank, (how, q) in enumerate(candidates(robot, neck)):
        found = _judged(robot, q, how)
        if found is None:
            continue
        near = rank if how != "search" else len(_LIFTS) + 1
        # A named pose may hide one pair more than a random one: people know what it looks like.
        score = (
            found.clearance < (WISHED if how == "search" else _SERVES),
            found.overlaps - 2 * (how != "search"), near, -found.clearance,
        )  # fmt: skip
        if best is None or score < best[0]:
            best = (score, found)
        if how == "search" and best[1].how != "search" and best[1].clearance >= _SERVES:
            break  # a named pose serves; what random ones would hide less is not worth its oddness
    return best[1] if best else None


def always(robot: Geometry, neck: str) -> list[frozenset[str]]:
    """Pairs of links that overlap in every pose asked, in an order that is always the same."""
    pairs = np.array(
        [(a, b) for a in range(len(robot.bodies)) for b in range(a + 1, len(robot.bodies))
         if robot.bodies[a].joint != robot.bodies[b].joint]
    ).reshape(-1, 2)  # fmt: skip
    apart = batch.pair_distances(chain.build(robot, pairs, neck), sense.poses(robot, 1000))
    links = [
        frozenset((robot.bodies[a].link, robot.bodies[b].link))
        for a, b in pairs[(apart < 0.0).all(axis=0)]
    ]
    return [pair for pair in dict.fromkeys(links) if len(pair) == 2]


def _judged(robot: Geometry, q: np.ndarray, how: str) -> Found | None:
    at = _at(robot, q)
    try:
        listed = rules.all_pairs(at, proven=False)
    except RobotError:
        return None
    if rules.anchor_collision(at, listed):
        return None
    watched = [pair.clearance for pair in listed if pair.reason == rules.WATCHED]
    overlaps = sum(pair.reason in rules.BY_DESIGN for pair in listed)
    return Found(q, how, float(min(watched)), overlaps)


def candidates(robot: Geometry, neck: str) -> Iterator[tuple[str, np.ndarray]]:
    """Poses in the order in which they are asked, with a word on each."""
    shown = chain.build(robot, np.empty((0, 2), np.int64), neck)
    middle = zero(robot)
    starts = np.concatenate([middle[None], sense.poses(robot, 24)])[None]
    room = 0.02 * (robot.upper - robot.lower)
    for lift in _LIFTS:
        x = _arms_out(lift)
        starts_here = starts.copy()
        solved = batch.follow(shown, x[None], starts_here, middle, 1e-3, 0.0, True)
        if not solved.feasible[0]:
            continue
        q = np.clip(solved.q[0], robot.lower + room, robot.upper - room)
        q = np.where(np.abs(q) < 2e-3, np.clip(0.0, robot.lower, robot.upper), np.round(q, 4))
        q = np.clip(q, robot.lower, robot.upper)
        got = batch.skeletons(shown, q[None])[0].reshape(len(BONES), 3)
        upper = [BONES.index(f"{side}_shoulder_to_elbow") for side in robot.arms]
        off = 1.0 - (got * x.reshape(len(BONES), 3)).sum(axis=1)
        if off[upper].max() < 0.1:  # 26 degrees: still the pose that it is called
            degrees = round(np.degrees(lift))
            yield ("T-pose" if not degrees else f"arms {abs(degrees)} deg "
                   f"{'below' if degrees > 0 else 'above'} the T-pose"), q  # fmt: skip
    yield "zero", middle
    for q in sense.poses(robot, _RANDOM + 1)[1:]:
        yield "search", np.round(robot.lower + (q - robot.lower) * 0.96 + room, 4)


def zero(robot: Geometry) -> np.ndarray:
    """All joints at zero, or as near as limits let [rad], (n_dof,)."""
    return np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)


def _arms_out(lift: float) -> np.ndarray:
    """Seven vectors of somebody upright whose straight arms hang this far below level."""
    out = {"hip_to_neck": (0.0, 0.0, 1.0)}
    for side, y in (("r", -1.0), ("l", 1.0)):
        out[f"neck_to_{side}_shoulder"] = (0.0, y, 0.0)
        arm = (0.0, y * np.cos(lift), -np.sin(lift))
        out[f"{side}_shoulder_to_elbow"] = out[f"{side}_elbow_to_hand"] = arm
    return np.array([out[bone] for bone in BONES]).reshape(DIM)


def _at(robot: Geometry, q: np.ndarray) -> Geometry:
    """The robot with another anchor."""
    return replace(robot, anchor=q)
