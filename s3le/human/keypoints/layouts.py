"""Which joint of an estimator's list is which of the ten points, by number or by name.

Sources: the joint lists of SMPL and smplx, MediaPipe Pose, OpenPose BODY_25, FrankMocap
(docs/joint_order.md, the 49 of SPIN), Human3.6M with 17 joints, and COCO.
"""

from collections.abc import Mapping, Sequence
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


class Named(NamedTuple):
    """What names make of a list of joints: its layout, and points that no name stands for."""

    layout: Layout
    missing: tuple[str, ...]

    def used(self) -> list[int]:
        """Indices of all joints that are looked at, rising."""
        front = self.layout.front or ()
        return sorted({j for own in (*self.layout.points, *front, self.layout.legs) for j in own})

    def among(self, used: Sequence[int]) -> "Named":
        """The same where only these joints are kept, in this order."""
        at = {joint: place for place, joint in enumerate(used)}
        points, front, legs = self.layout.points, self.layout.front, self.layout.legs

        def there(own: Joints) -> Joints:
            return tuple(at[j] for j in own)

        layout = Layout(
            (len(used),),
            tuple(there(own) for own in points),
            front and (there(front[0]), there(front[1])),
            there(legs),
        )
        return self._replace(layout=layout)


def by_names(names: Sequence[str], given: Mapping[str, str] | None = None) -> Named:
    """Where the points are among named joints, by the one table of names (s3le.human.rigs).

    Args:
        names: joint names in the file's order.
        given: names of joints by point, as rigs.match takes them.

    Raises:
        ParameterError: given names what is not there.
    """
    rig = rigs.match(names, given)
    at, more = rig.joints, rig.more
    behind: Joints = ()
    before: Joints = ()
    if {"nose", "r_ear", "l_ear"} <= more.keys():
        behind, before = (more["r_ear"], more["l_ear"]), (more["nose"], more["nose"])
    if {f"{s}_{p}" for s in "rl" for p in ("ankle", "toe")} <= more.keys():
        behind += (more["r_ankle"], more["l_ankle"])
        before += (more["r_toe"], more["l_toe"])
    legs = []
    for side in "rl":
        legs += [*at.get(f"{side}_pelvis", ()), *(
            more[one] for p in ("knee", "ankle") if (one := f"{side}_{p}") in more
        )]  # fmt: skip
    layout = Layout(
        (len(names),),
        tuple(at.get(point, ()) for point in POINTS),
        (behind, before) if behind else None,
        tuple(legs) if len(legs) == 6 else (),
    )
    return Named(layout, rig.missing)
