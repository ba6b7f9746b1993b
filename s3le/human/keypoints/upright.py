"""From an estimator's axes and units to ours: x forward, y left, z up, metres.

What a file does not say is read off the body, and told: up is where trunks point; a camera's
tilt is how people lean who stand on straight legs; metres or millimetres show in a trunk.
Where the body does not decide, nothing is guessed.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ClipError
from s3le.human.keypoints.handed import refuse_mirrored
from s3le.human.keypoints.how import LEFT_HANDED, How
from s3le.human.keypoints.layouts import Layout, pick
from s3le.skeleton import POINTS

LEAN = 40.0  # [deg] that the median trunk may lean from the axis that is taken for up
STRAIGHT = 155.0  # [deg] of a knee that stands
STANDING = 10  # frames that a tilt needs to be estimated
SCATTER = 8.0  # [deg] median deviation among them that still is one tilt
LEVEL = 3.0  # [deg], a smaller tilt is none
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
TRUNK = (0.2, 1.2)  # [m] from hip to neck
PERSON = 0.5  # [m] of the trunk of a skeleton in no unit

_AT = {name: place for place, name in enumerate(POINTS)}
_UP = {"camera": (0.0, -1.0, 0.0), "y-up": (0.0, 1.0, 0.0), "z-up": (0.0, 0.0, 1.0)}
FROM = {  # rows: our x, y, z in the file's axes
    "camera": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
    "y-up": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z-up": np.eye(3),
    "y-up-left": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z-up-left": np.diag([1.0, -1.0, 1.0]),
}


class Upright(NamedTuple):
    """Points in our frame and what was found to bring them there."""

    points: np.ndarray  # [m], (n, 10, 3), NaN where unknown
    axes: str
    pitch: float | None  # [deg], of a camera
    unit: str
    told: list[str]  # what was assumed or estimated


def looks_human(points: np.ndarray) -> str:
    """Why ten points (n, 10, 3) are no body's, in a few words; empty where they may be one's.

    Lengths are medians over frames; NaN is left out.
    """
    if not np.isfinite(points).all(axis=(1, 2)).any():
        return "no frame has all of its joints"
    length = {name: _length(points, *ends) for name, ends in _BONES.items()}
    shoulders = points[:, [_AT["r_shoulder"], _AT["l_shoulder"]]].mean(axis=1)
    # Some skeletons have the neck joint low in the chest.
    trunk = max(length["trunk"], _median(shoulders - points[:, _AT["hip"]]))
    if not trunk > 0.0:
        return "the trunk has no length"
    for name, (low, high) in _SHARES.items():
        if not low <= length[name] / trunk <= high:
            return f"{name} is {length[name] / trunk:.2g} trunks long, wanted {low:g} to {high:g}"
    for one, other in (("right upper arm", "left upper arm"), ("right forearm", "left forearm")):
        ratio = length[one] / length[other]
        if not 0.55 <= ratio <= 1.8:
            return f"{one} is {ratio:.2g} times the {other}"
    middle = points[:, [_AT["r_shoulder"], _AT["l_shoulder"]]].mean(axis=1)
    if not _median(middle - points[:, _AT["neck"]]) <= 0.5 * trunk:
        return "the neck is not between the shoulders"
    if why := hip_is_off(points):
        return why
    shoulders = points[:, _AT["l_shoulder"]] - points[:, _AT["r_shoulder"]]
    hips = points[:, _AT["l_pelvis"]] - points[:, _AT["r_pelvis"]]
    if not np.nanmedian((shoulders * hips).sum(axis=1)) > 0.0:
        return "left and right of shoulders and hips do not agree"
    return ""


def hip_is_off(points: np.ndarray) -> str:
    """Why the hip of ten points (n, 10, 3) is not between the thighs; empty where it is."""
    middle = points[:, [_AT["r_pelvis"], _AT["l_pelvis"]]].mean(axis=1)
    off, trunk = _median(middle - points[:, _AT["hip"]]), _median(middle - points[:, _AT["neck"]])
    return "" if off <= 0.8 * trunk else f"the hip is {off / trunk:.2g} trunks from the thighs"


_BONES = {
    "trunk": ("hip", "neck"),
    "shoulder width": ("r_shoulder", "l_shoulder"),
    "hip width": ("r_pelvis", "l_pelvis"),
    "right upper arm": ("r_shoulder", "r_elbow"),
    "left upper arm": ("l_shoulder", "l_elbow"),
    "right forearm": ("r_elbow", "r_hand"),
    "left forearm": ("l_elbow", "l_hand"),
}
_SHARES = {
    "shoulder width": (0.25, 1.3),
    "hip width": (0.08, 0.9),
    **{name: (0.2, 1.1) for name in _BONES if "arm" in name},
}


def _length(points: np.ndarray, one: str, other: str) -> float:
    return _median(points[:, _AT[one]] - points[:, _AT[other]])


def _median(lines: np.ndarray) -> float:
    known = lines[np.isfinite(lines).all(axis=1)]
    return float(np.median(np.linalg.norm(known, axis=1))) if len(known) else float("nan")


def stand(path: str, joints: np.ndarray, layout: Layout, points: np.ndarray, how: How) -> Upright:
    """Bring points into our axes and metres.

    Args:
        path: for messages.
        joints: all joints in the file's axes and unit, (n, j, 3).
        layout: where what is in them.
        points: the ten points among them, (n, 10, 3).
        how: what is known already.

    Raises:
        ClipError: up, the unit or what is left and right cannot be told.
    """
    told = []
    seen = np.isfinite(points).all(axis=(1, 2))
    trunk = points[seen, _AT["neck"]] - points[seen, _AT["hip"]]
    unit = _unit(path, float(np.median(np.linalg.norm(trunk, axis=1))))
    if unit != "m":
        told.append(f"lengths are in {unit}, by a trunk's")
    axes = how.axes
    if axes is None:
        axes = "camera" if how.pitch is not None else _axes(path, trunk)
        told.append(f"axes {axes}, by where trunks point" if how.pitch is None else "axes camera")
    turn, pitch = FROM[axes], None
    if axes == "camera":
        pitch = how.pitch
        if pitch is None:
            pitch, words = _tilt(joints[seen], layout)
            told.append(words)
        c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
        turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ turn
    refuse_mirrored(path, joints[seen], layout, points[seen], axes in LEFT_HANDED)
    # A product per frame would round alike; one for all is a hundred times as fast.
    return Upright(points * UNITS[unit] @ turn.T, axes, pitch, unit, told)


def _unit(path: str, trunk: float) -> str:
    for unit, metres in UNITS.items():
        if TRUNK[0] <= trunk * metres <= TRUNK[1]:
            return unit
    raise ClipError(
        f"{path}: a trunk is {trunk:.3g} long, which is no person's in {', '.join(UNITS)} "
        f"({TRUNK[0]:g} to {TRUNK[1]:g} m); scale the joints to metres"
    )


def scale_of(points: np.ndarray) -> float:
    """What brings points (n, 10, 3) in no unit to a person's size; 1 in any of UNITS."""
    trunk = _length(points, "hip", "neck")
    known = any(TRUNK[0] <= trunk * metres <= TRUNK[1] for metres in UNITS.values())
    return 1.0 if known or not 1e-6 <= trunk <= 1e9 else PERSON / trunk


def _axes(path: str, trunk: np.ndarray) -> str:
    """Which way is up, by where most trunks (n, 3) point."""
    length = np.linalg.norm(trunk, axis=1, keepdims=True)
    has = length[:, 0] > 0.0
    way = np.median(trunk[has] / length[has], axis=0)
    way = way / max(np.linalg.norm(way), 1e-9)
    lean = {axes: np.degrees(np.arccos(np.clip(way @ up, -1, 1))) for axes, up in _UP.items()}
    best = min(lean, key=lean.__getitem__)
    if lean[best] <= LEAN:
        return best
    raise ClipError(
        f"{path}: trunks point along ({', '.join(f'{v:.2f}' for v in way)}), which is not up by "
        f"any axes; say which: --axes {' or '.join(_UP)}"
    )


def _tilt(joints: np.ndarray, layout: Layout) -> tuple[float, str]:
    """A level camera's people stand upright: its pitch [deg], and how it was found."""
    level = "the camera is taken for level (else --pitch DEG)"
    if not layout.legs:
        return 0.0, f"{level}: there are no legs to judge by"
    legs = joints[:, list(layout.legs)].reshape(-1, 2, 3, 3)  # side, joint, xyz
    upper, lower = legs[:, :, 0] - legs[:, :, 1], legs[:, :, 1] - legs[:, :, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        bend = (upper * lower).sum(axis=2)
        bend /= np.linalg.norm(upper, axis=2) * np.linalg.norm(lower, axis=2)
        standing = (bend >= np.cos(np.radians(180.0 - STRAIGHT))).all(axis=1)
    feet = legs[:, :, 2].mean(axis=1)
    up = (pick(joints, (layout.points[_AT["neck"]],))[:, 0] - feet)[standing]
    if len(up) < STANDING:
        return 0.0, f"{level}: only {len(up)} frames stand on straight legs"
    angle = np.degrees(np.arctan2(-up[:, 2], -up[:, 1]))
    pitch = float(np.median(angle))
    scatter = float(np.median(np.abs(angle - pitch)))
    if not (scatter <= SCATTER and abs(pitch) <= 45.0):
        return 0.0, f"{level}: who stands leans by {pitch:.0f} +- {scatter:.0f} degrees"
    if abs(pitch) < LEVEL:
        return 0.0, f"the camera is level, by {len(up)} frames on straight legs"
    return round(pitch, 2), (
        f"the camera looks {'down' if pitch > 0 else 'up'} by {abs(pitch):.1f} degrees, by "
        f"{len(up)} frames on straight legs (else --pitch DEG)"
    )
