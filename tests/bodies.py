"""People by hand, in every list of joints that is read; shared by the tests of keypoints."""

import numpy as np

from s3le.human.keypoints import smpl
from s3le.skeleton import POINTS

# Our x forward, y left, z up in the axes of files.
INTO = {
    "camera": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
    "y-up": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "z-up": np.eye(3),
}
_BODY = {  # SMPL's joint for each that the lists have: right and left
    "hip": (0, 0), "neck": (12, 12), "shoulder": (17, 16), "elbow": (19, 18), "hand": (21, 20),
    "pelvis": (2, 1), "knee": (5, 4), "ankle": (8, 7), "toe": (11, 10), "head": (15, 15),
}  # fmt: skip
_LISTS = {  # place in the list: part and side
    "h36m17": {0: "hip", 1: "pelvis r", 2: "knee r", 3: "ankle r", 4: "pelvis l", 5: "knee l",
               6: "ankle l", 8: "neck", 9: "nose", 10: "head", 11: "shoulder l", 12: "elbow l",
               13: "hand l", 14: "shoulder r", 15: "elbow r", 16: "hand r"},
    "coco17": {0: "nose", 3: "ear", 4: "ear", 5: "shoulder l", 6: "shoulder r", 7: "elbow l",
               8: "elbow r", 9: "hand l", 10: "hand r", 11: "pelvis l", 12: "pelvis r",
               13: "knee l", 14: "knee r", 15: "ankle l", 16: "ankle r"},
    "mediapipe": {0: "nose", 7: "ear", 8: "ear", 11: "shoulder l", 12: "shoulder r",
                  13: "elbow l", 14: "elbow r", 15: "hand l", 16: "hand r", 23: "pelvis l",
                  24: "pelvis r", 25: "knee l", 26: "knee r", 27: "ankle l", 28: "ankle r"},
    "body25": {0: "nose", 1: "neck", 2: "shoulder r", 3: "elbow r", 4: "hand r", 5: "shoulder l",
               6: "elbow l", 7: "hand l", 8: "hip", 9: "pelvis r", 10: "knee r", 11: "ankle r",
               12: "pelvis l", 13: "knee l", 14: "ankle l", 17: "ear", 18: "ear"},
}  # fmt: skip
_LISTS["spin49"] = _LISTS["body25"] | {19: "toe l", 22: "toe r", 21: "ankle l", 24: "ankle r"}
COUNT = {"h36m17": 17, "coco17": 17, "mediapipe": 33, "body25": 25, "spin49": 49, "smpl": 24}


def pose(frames: int = 12) -> np.ndarray:
    """SMPL rotations [rad] of somebody who stands, turns and moves the arms, (n, 72)."""
    t = np.linspace(0.0, 1.0, frames)
    turns = np.zeros((frames, 24, 3))
    turns[:, 0, 1] = 0.7 * np.sin(3.0 * t)
    turns[:, 16, 2] = -1.0 + 0.5 * t  # left upper arm down, then up
    turns[:, 17, 2] = 1.2 - 0.3 * t
    turns[:, 18, 1] = -0.8 * t
    turns[:, 19, 1] = 0.5
    turns[:, 3, 0] = 0.1 * t
    return turns.reshape(frames, 72)


def body(frames: int = 12) -> np.ndarray:
    """SMPL's joints of this person, x forward, y left, z up [m], (n, 22, 3)."""
    return smpl.joints(pose(frames)) @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)


def points(joints: np.ndarray) -> np.ndarray:
    """The ten points of SMPL's joints, (n, 10, 3)."""
    sides = {"r": 0, "l": 1}
    at = [
        _BODY[p][0] if p in ("hip", "neck") else _BODY[p[2:]][sides[p[0]]] for p in POINTS
    ]
    return joints[:, at]


def listed(layout: str, joints: np.ndarray) -> np.ndarray:
    """SMPL's joints (n, 22, 3) as another list of joints, (n, count, 3)."""
    n, count = len(joints), COUNT[layout]
    if layout == "smpl":
        return np.concatenate([joints, joints[:, 20:22]], axis=1)
    across = np.cross(joints[:, 1] - joints[:, 2], joints[:, 12] - joints[:, 0])
    forward = across / np.linalg.norm(across, axis=1, keepdims=True)
    made = np.zeros((n, count, 3)) + joints[:, 15:16]
    for place, what in _LISTS[layout].items():
        part, _, side = what.partition(" ")
        if part == "nose":
            made[:, place] = joints[:, 15] + 0.1 * forward
        elif part == "ear":
            made[:, place] = joints[:, 15]
        else:
            made[:, place] = joints[:, _BODY[part][side == "l"]]
    return made


def tilted(joints: np.ndarray, degrees: float) -> np.ndarray:
    """Camera joints as a camera sees them that looks down by so much."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return joints @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
