"""Whether a body is a mirror image: left and right exchanged, or axes that are left-handed.

Faces and toes point forward, knees bend so that the shin goes back, elbows so that the forearm
comes forward. A mirror turns all of these about and changes nothing else, so that they are the only
ones to ask. Each is asked by itself and only in frames in which it can tell.
"""

from pathlib import Path

import numpy as np

from s3le.errors import ClipError
from s3le.human.keypoints.layouts import Layout, pick
from s3le.skeleton import POINTS

WRONG = 0.8  # share of the frames that can tell which refuses a file
BENT = np.sin(np.radians(20.0))  # least sine of a joint's bend that tells where it bends to
OFTEN, MANY = 0.1, 10  # share of limbs in frames, and their number, that is enough to tell
RAISED = np.cos(np.radians(120.0))  # an upper arm higher than this may turn its elbow anywhere
_AT = {name: place for place, name in enumerate(POINTS)}
WAYS = "left and right are exchanged, or the axes are left-handed: say --axes y-up-left (Unity) or "
WAYS += "z-up-left (Unreal), or which is which with --names"


def refuse_mirrored(
    path: Path | str, joints: np.ndarray, layout: Layout, points: np.ndarray, mirrored: bool = False
) -> None:
    """Refuse a body of which a part points or bends the wrong way.

    Args:
        path: for messages.
        joints: all joints, (n, j, 3), in any unit; NaN where unknown.
        layout: where what is in them.
        points: the ten points among them, (n, 10, 3).
        mirrored: whether the axes are known to be left-handed.

    Raises:
        ClipError: in more than WRONG of the frames that can tell.
    """
    left = points[:, _AT["l_pelvis"]] - points[:, _AT["r_pelvis"]]
    up = points[:, _AT["neck"]] - points[:, _AT["hip"]]
    forward = _unit(np.cross(left, up)) * (-1.0 if mirrored else 1.0)
    asked = {"elbows bend": elbows(points, forward)}
    if layout.legs:
        asked["knees bend"] = knees(joints[:, list(layout.legs)], left, -1.0 if mirrored else 1.0)
    if layout.front is not None:
        behind, before = np.moveaxis(pick(joints, layout.front), 1, 0)
        asked["the face or the toes point"] = ((before - behind) * forward).sum(axis=1)[None]
    for what, signs in reversed(asked.items()):
        tells = np.isfinite(signs)
        if not tells.any() or (len(signs) == 2 and not _enough(tells)):
            continue
        share = float((signs[tells] < 0.0).mean())
        if share > WRONG:
            raise ClipError(f"{path}: in {share:.0%} of the frames {what} backwards: {WAYS}")


def _enough(tells: np.ndarray) -> bool:
    """Whether (2, n) limbs say enough: both sides or many frames, and not a few of very many."""
    return bool(tells.mean() >= OFTEN and (tells.any(axis=1).all() or tells.sum() >= MANY))


def knees(legs: np.ndarray, left: np.ndarray, hand: float) -> np.ndarray:
    """Positive where knees bend as knees do, NaN where they are straight or unknown.

    Args:
        legs: right hip, knee, ankle, left hip, knee, ankle, (n, 6, 3).
        left: from the right hip to the left one, (n, 3).
        hand: 1, or -1 in left-handed axes.

    Returns:
        Signs, (2, n).
    """
    legs = legs.reshape(-1, 2, 3, 3)
    thigh, shin = _unit(legs[:, :, 1] - legs[:, :, 0]), _unit(legs[:, :, 2] - legs[:, :, 1])
    axis = np.cross(thigh, shin)
    along = hand * (axis * _unit(left)[:, None]).sum(axis=2)
    # Half of the bend at least about the line of the hips: a leg turned out says little.
    return np.where(np.abs(along) >= BENT, along, np.nan).T


def elbows(points: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Positive where forearms come forward, NaN where arms are straight, raised or unknown.

    Forward for an arm that does not hang is where the shortest turn from hanging takes it.

    Args:
        points: the ten points, (n, 10, 3).
        forward: of the body, unit vectors (n, 3).

    Returns:
        Signs, (2, n).
    """
    down = _unit(points[:, _AT["hip"]] - points[:, _AT["neck"]])
    forward = _unit(forward - (forward * down).sum(axis=1, keepdims=True) * down)
    signs = []
    for side in "rl":
        arm = (f"{side}_{part}" for part in ("shoulder", "elbow", "hand"))
        shoulder, elbow, hand = (points[:, _AT[point]] for point in arm)
        upper, fore = _unit(elbow - shoulder), _unit(hand - elbow)
        cos = (down * upper).sum(axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            # Of the turn that takes down to upper: where it takes forward.
            there = forward - (forward * upper).sum(axis=1, keepdims=True) / (1.0 + cos) * (
                down + upper
            )
        bend = fore - (fore * upper).sum(axis=1, keepdims=True) * upper
        tells = (np.linalg.norm(bend, axis=1) >= BENT) & (cos[:, 0] >= RAISED)
        along = (bend * there).sum(axis=1)
        signs.append(np.where(tells & (np.abs(along) >= BENT), along, np.nan))
    return np.stack(signs)


def _unit(lines: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return lines / np.linalg.norm(lines, axis=-1, keepdims=True)
