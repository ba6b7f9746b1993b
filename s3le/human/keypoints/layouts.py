"""Which joint of an estimator's list is which of the ten points, by number or by name.

Sources: the joint lists of SMPL and smplx, MediaPipe Pose, OpenPose BODY_25, FrankMocap
(docs/joint_order.md, the 49 of SPIN), Human3.6M with 17 joints, and COCO.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from s3le.human import rigs
from s3le.skeleton import POINTS

Joints = tuple[int, ...]  # one joint, or several of which the mean is meant


class Layout(NamedTuple):
    """Where the points are in a list of joints.

    Attributes:
        sizes: how many joints such a list has.
        points: joints of each of skeleton.POINTS.
        front: two places, the second of which lies farther forward; None: nobody can tell.
        legs: right hip, knee, ankle, left hip, knee, ankle; empty: not known.
    """

    sizes: tuple[int, ...]
    points: tuple[Joints, ...]
    front: tuple[Joints, Joints] | None = None
    legs: tuple[int, ...] = ()


def _points(hip: Joints, pelvis: Joints, neck: Joints, right: Joints, left: Joints) -> tuple:
    return (hip, pelvis[:1], pelvis[1:], neck, *[(j,) for j in (*right, *left)])


_SMPL = _points((0,), (2, 1), (12,), (17, 19, 21), (16, 18, 20))
_BODY = _points((8,), (9, 12), (1,), (2, 3, 4), (5, 6, 7))

LAYOUTS = {
    "smpl": Layout(  # 22 HumanML3D, 24 SMPL, 45 smplx' SMPL, 52 SMPL-H, 55 SMPL-X, 71 ROMP
        (22, 24, 45, 52, 55, 71, 127, 144), _SMPL, ((7, 8), (10, 11)), (2, 5, 8, 1, 4, 7)
    ),
    "mediapipe": Layout(
        (33,),
        _points((23, 24), (24, 23), (11, 12), (12, 14, 16), (11, 13, 15)),
        ((7, 8), (0,)),
        (24, 26, 28, 23, 25, 27),
    ),
    "body25": Layout((25,), _BODY, ((17, 18), (0,)), (9, 10, 11, 12, 13, 14)),
    "spin49": Layout((49,), _BODY, ((21, 24), (19, 22)), (9, 10, 11, 12, 13, 14)),
    "h36m17": Layout(
        (17,), _points((0,), (1, 4), (8,), (14, 15, 16), (11, 12, 13)), None, (1, 2, 3, 4, 5, 6)
    ),
    "coco17": Layout(  # 133: COCO-WholeBody
        (17, 133),
        _points((11, 12), (12, 11), (5, 6), (6, 8, 10), (5, 7, 9)),
        ((3, 4), (0,)),
        (12, 14, 16, 11, 13, 15),
    ),
}
SIZES = sorted({size for layout in LAYOUTS.values() for size in layout.sizes})


def for_size(count: int) -> dict[str, Layout]:
    """The layouts that lists of so many joints may have."""
    return {name: layout for name, layout in LAYOUTS.items() if count in layout.sizes}


def pick(joints: np.ndarray, points: Sequence[Joints]) -> np.ndarray:
    """Places (n, len(points), 3) of joints (n, j, 3), means where several joints are meant."""
    if all(len(own) == 1 for own in points):
        return joints[:, [own[0] for own in points]]
    return np.stack([joints[:, list(own)].mean(axis=1) for own in points], axis=1)


# --- by name


_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_SIDES = {"left": "l", "right": "r", "l": "l", "r": "r"}
_EMPTY = {"joint", "jnt", "op", "kp", "smpl", "body"}  # words that say nothing
_UPPER = ("upperarm", "upper arm", "arm", "shldr")
_FORE = ("forearm", "fore arm", "lowerarm", "lower arm")
_PAIRED = {  # of each side; the first that is there
    "pelvis": ("hip", "thigh", "upleg", "up leg", "upper leg"),
    "shoulder": (*_UPPER, "shoulder", "sho"),
    "elbow": ("elbow", "elb", "elblow", *_FORE),
    "hand": ("wrist", "wri", "hand"),
    "knee": ("knee",),
    "ankle": ("ankle",),
}
_SINGLE = {
    "hip": ("pelvis", "mid hip", "midhip", "middle hip", "hips", "root", "hip", "hip center"),
    "neck": ("neck", "upperneck", "upper neck", "thorax", "mid shoulder", "midshoulder"),
    "nose": ("nose",),
}
_PARTS = {name for names in _PAIRED.values() for name in names}


def _plain(name: str) -> str:
    """A joint's name as side and part in small letters: `LShoulder` is `l shoulder`."""
    words = [w.lower() for w in _WORDS.findall(name.rpartition(":")[2])]
    if len(words) == 1 and words[0][:1] in "lr" and words[0][1:] in _PARTS:
        words = [words[0][0], words[0][1:]]  # lshoulder
    for word in ("left", "right"):
        if len(words) == 1 and words[0].startswith(word) and words[0][len(word) :] in _PARTS:
            words = [word, words[0][len(word) :]]  # leftshoulder
    words = [w for w in words if w not in _EMPTY]
    sides = [_SIDES[w] for w in words if w in _SIDES]
    part = " ".join(w for w in words if w not in _SIDES)
    return f"{sides[0]} {part}" if len(sides) == 1 else part if not sides else ""


class Named(NamedTuple):
    """What names make of a list of joints: its layout, and points that no name stands for."""

    layout: Layout
    missing: tuple[str, ...]


def by_names(names: Sequence[str]) -> Named:
    """Where the points are among named joints.

    Names as BVH files have them are read as there (s3le.human.rigs); both sides must be named
    alike. Without a joint of its own
    the hip is between the hip joints, and the neck between the shoulders.
    """
    index: dict[str, int] = {}
    for place, name in enumerate(names):
        index.setdefault(_plain(name), place)

    def found(point: str) -> Joints:
        side, _, part = point.rpartition("_")
        if not side:
            return next(((index[o],) for o in _SINGLE[part] if o in index), ())
        options = _PAIRED[part]
        if part == "shoulder" and any(f"{s} {o}" in index for s in "lr" for o in _FORE):
            options = _UPPER  # beside a forearm, a shoulder is the clavicle
        both = (o for o in options if all(f"{s} {o}" in index for s in "lr"))
        return next(((index[f"{side} {o}"],) for o in both), ())

    rig = rigs.match(list(names))
    if rig.missing or rig.doubled:
        at = {point: found(point) for point in POINTS}
        at["hip"] = at["hip"] or at["r_pelvis"] + at["l_pelvis"]
        at["neck"] = at["neck"] or at["r_shoulder"] + at["l_shoulder"]
    else:
        at = {point: (rig.joints[point],) for point in POINTS}
    legs = [at["r_pelvis"], found("r_knee"), found("r_ankle")]
    legs += [at["l_pelvis"], found("l_knee"), found("l_ankle")]
    layout = Layout(
        (len(names),),
        tuple(at[point] for point in POINTS),
        None,
        tuple(j for own in legs for j in own) if all(len(own) == 1 for own in legs) else (),
    )
    halves = {"hip": ("r_pelvis", "l_pelvis"), "neck": ("r_shoulder", "l_shoulder")}
    missing = tuple(
        point for point in POINTS
        if not at[point] and not (point in halves and any(not at[h] for h in halves[point]))
    )  # fmt: skip
    return Named(layout, missing)
