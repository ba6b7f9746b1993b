"""Which joint of a BVH file is which of the ten points, for the families of files seen.

`LeftShoulder` is the clavicle in files that also have `LeftArm`, and the shoulder joint in
files that have `LeftCollar`; one name alone never decides.
"""

import re
from typing import NamedTuple

from s3le.skeleton import POINTS

_ROLES = ("pelvis", "shoulder", "elbow", "hand")
_PREFIX = re.compile(r"^(.*:|mixamorig\d*_?)")  # mixamorig:, mixamorig1_, character:


class Family(NamedTuple):
    """The joint names of one family of files.

    Attributes:
        name: for messages.
        hip, neck: candidates, the first one present wins.
        roles: for pelvis, shoulder, elbow and hand, candidates with {} for the side.
        sides: what stands for right and left.
        only_with: a joint that must be there for the family to be considered; empty: none.
        rest_frame: whether its converters put a rest pose in front of the motion.
    """

    name: str
    hip: tuple[str, ...]
    neck: tuple[str, ...]
    roles: tuple[tuple[str, ...], ...]
    sides: tuple[str, str]
    only_with: str
    rest_frame: bool = False

    def candidates(self, point: str) -> tuple[str, ...]:
        """Joint names that may be this point, the preferred one first."""
        if point in ("hip", "neck"):
            return self.hip if point == "hip" else self.neck
        side, role = point.split("_")
        names = self.roles[_ROLES.index(role)]
        return tuple(name.format(self.sides[side == "l"]) for name in names)


_ARMS = (("{}UpLeg",), ("{}Arm",), ("{}ForeArm",), ("{}Hand",))
_COLLARS = (("{}Hip", "{}UpLeg"), ("{}Shoulder",), ("{}Elbow",), ("{}Wrist",))
_DAZ = (("{}Thigh",), ("{}Shldr",), ("{}ForeArm",), ("{}Hand",))
_BANDAI = (("UpperLeg_{}",), ("UpperArm_{}",), ("LowerArm_{}",), ("Hand_{}",))
_WORDS = ("Right", "Left")

# Sources: the headers of the CMU conversions by B. Hahne (cgspeed), of LAFAN1, Mixamo,
# Bandai-Namco Research and of Xia et al. 2015.
FAMILIES = (
    Family("cgspeed", ("Hips",), ("Neck",), _ARMS, _WORDS, "LHipJoint", True),
    Family("LAFAN1 or Mixamo", ("Hips",), ("Neck",), _ARMS, _WORDS, ""),
    Family(
        "cgspeed 3dsMax", ("Hips",), ("lowerneck", "Neck"), _COLLARS, _WORDS, "lowerneck", True
    ),
    Family("Collar-style", ("Hips",), ("Neck",), _COLLARS, _WORDS, "LeftCollar"),
    Family("cgspeed DAZ", ("hip",), ("neck",), _DAZ, ("r", "l"), "lThigh", True),
    Family("Bandai-Namco", ("Hips",), ("Neck",), _BANDAI, ("R", "L"), "UpperLeg_L"),
)


class Match(NamedTuple):
    """What a family makes of a file.

    Attributes:
        family: the one that explains most.
        joints: index of the joint of each point.
        missing: points without a joint.
        doubled: names of points' joints that the file has more than once.
    """

    family: Family
    joints: dict[str, int]
    missing: tuple[str, ...]
    doubled: tuple[str, ...]


def match(names: list[str]) -> Match:
    """The family that explains most of the ten points of a file's joints.

    Args:
        names: joint names in file order; a prefix such as `mixamorig:` is ignored.

    Returns:
        Match of the first family with the fewest points missing.
    """
    bare = [_PREFIX.sub("", name) for name in names]
    index = {name: i for i, name in enumerate(bare)}
    best = None
    for family in FAMILIES:
        if family.only_with and family.only_with not in index:
            continue
        if family.roles is _COLLARS and "LeftCollar" not in index:
            continue
        joints = {}
        for point in POINTS:
            for name in family.candidates(point):
                if name in index:
                    joints.setdefault(point, index[name])
        missing = tuple(point for point in POINTS if point not in joints)
        doubled = tuple(bare[i] for i in joints.values() if bare.count(bare[i]) > 1)
        if best is None or len(missing) < len(best.missing):
            best = Match(family, joints, missing, doubled)
    return best
