"""A whole person who stands, trunk and arms along skeletons: what tools for whole bodies are told.

Only numpy is needed. The person faces x, left is y, up is z; the pelvis is upright and the legs
stand straight, for these clips are of trunk and arms alone. A tool that wants rotations gets those
that bring each part from a T-pose to where it is: the trunk's from its bone and the shoulders', an
arm's from its two bones and the elbow, which is a hinge; where an arm is nearly straight the hinge
stays as it was.
"""

from typing import NamedTuple

import numpy as np
from plain import shortest

HEIGHT = 1.75  # [m]
JOINTS = (
    "Pelvis", "L_Hip", "R_Hip", "Spine1", "L_Knee", "R_Knee", "Spine2", "L_Ankle", "R_Ankle",
    "Spine3", "L_Foot", "R_Foot", "Neck", "L_Collar", "R_Collar", "Head", "L_Shoulder",
    "R_Shoulder", "L_Elbow", "R_Elbow", "L_Wrist", "R_Wrist",
)  # fmt: skip
TRUNK, NECK, SHOULDER, UPPER, FORE = 0.50, 0.16, 0.18, 0.28, 0.25  # [m]
PELVIS = 0.95  # [m], over the floor
STANDS = {  # [m] from the pelvis; the left side
    "Hip": (0.0, 0.09, -0.05), "Knee": (0.0, 0.09, -0.46), "Ankle": (0.0, 0.09, -0.87),
    "Foot": (0.13, 0.09, -0.92),
}  # fmt: skip
SIDES = {"R": (1, -1.0), "L": (4, 1.0)}  # side -> its first bone, and where it lies on y
STIFF = 0.1  # of how an elbow is bent (its sine): from there on its hinge follows at once


def points(x: np.ndarray) -> np.ndarray:
    """Places [m], (m, 22, 3), of JOINTS for skeletons (m, 21)."""
    u = x.reshape(-1, 7, 3)
    pelvis = np.tile([-0.5, 0.0, PELVIS], (len(u), 1))  # it faces the origin
    at = {"Pelvis": pelvis}
    for name, (forward, aside, up) in STANDS.items():
        at[f"L_{name}"] = pelvis + [forward, aside, up]
        at[f"R_{name}"] = pelvis + [forward, -aside, up]
    for i, share in enumerate((0.25, 0.5, 0.75), start=1):
        at[f"Spine{i}"] = pelvis + share * TRUNK * u[:, 0]
    at["Neck"] = pelvis + TRUNK * u[:, 0]
    at["Head"] = at["Neck"] + NECK * u[:, 0]
    for side, (first, _) in SIDES.items():
        at[f"{side}_Collar"] = at["Neck"] + 0.4 * SHOULDER * u[:, first]
        at[f"{side}_Shoulder"] = at["Neck"] + SHOULDER * u[:, first]
        at[f"{side}_Elbow"] = at[f"{side}_Shoulder"] + UPPER * u[:, first + 1]
        at[f"{side}_Wrist"] = at[f"{side}_Elbow"] + FORE * u[:, first + 2]
    return np.stack([at[name] for name in JOINTS], axis=1)


class Turns(NamedTuple):
    """Rotations from the T-pose, (3, 3) each; a hand is turned as its forearm is."""

    chest: np.ndarray
    upper: dict[str, np.ndarray]  # by side
    fore: dict[str, np.ndarray]

    def of(self, joint: str) -> np.ndarray:
        """Of what a joint of JOINTS carries."""
        side, _, part = joint.rpartition("_")
        if part in ("Shoulder", "Elbow", "Wrist"):
            return (self.upper if part == "Shoulder" else self.fore)[side]
        below = part in STANDS or joint == "Pelvis"
        return np.eye(3) if below else self.chest


class Turned:
    """Finds rotations frame by frame; it remembers how the elbows' hinges lay."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._before: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def step(self, x: np.ndarray) -> Turns:
        """Rotations of the next skeleton (21,)."""
        u = x.reshape(7, 3)
        left = u[SIDES["L"][0]] - u[SIDES["R"][0]]
        up, aside, back = _frame(u[0], left).T
        chest = np.stack([-back, aside, up], axis=1)
        upper, fore = {}, {}
        for side, (first, aside) in SIDES.items():
            a, f = u[first + 1], u[first + 2]
            rest, hinge = np.array([0.0, aside, 0.0]), np.array([0.0, 0.0, -aside])
            if side in self._before:
                was, lay = self._before[side]
                lay = shortest(was, a) @ lay
            else:
                lay = shortest(chest @ rest, a) @ chest @ hinge
            lies = np.cross(a, f) + STIFF * lay
            if np.linalg.norm(lies) < 1e-6:
                lies = lay
            there, still = _frame(a, lies), _frame(rest, hinge)
            self._before[side] = (a, there[:, 1])
            upper[side] = there @ still.T
            fore[side] = shortest(a, f) @ upper[side]
        return Turns(chest, upper, fore)


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The rotation whose first column is a unit vector and whose second is near another."""
    second = second - (second @ first) * first
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)
