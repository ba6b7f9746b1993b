"""Which joint of a file is which of the ten points, by its name: one table for every format.

A name is taken apart into a prefix (`mixamorig:`, `Bip01`, `J_Bip_`, `Robot_`), a side and a part;
what the parts are called is in the tables below. One prefix serves a whole body, so that
`ik_hand_l` does not stand in for `hand_l`. What clashes is told apart by what else is there:
`LeftShoulder` is the clavicle beside `LeftArm` and the joint beside `LeftCollar`, `LeftLeg` is the
shin beside `LeftUpLeg` and the thigh beside `LeftShin`.

Sources: headers and joint lists of CMU's conversions by B. Hahne (cgspeed) and of its ASF, LAFAN1,
Mixamo, Bandai-Namco, Xia et al. 2015, 3ds Max Biped, HumanIK, Perception Neuron, Rokoko, Xsens
(BVH and segments), OptiTrack Motive, iPi, SOMA (BONES-SEED), Unreal, Unity and VRM, VRoid,
MikuMikuDance, DAZ, Character Creator, Rigify, MakeHuman, Advanced Skeleton, ARKit, Kinect, Theia,
SMPL, Human3.6M, COCO, MediaPipe and OpenPose.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from s3le.errors import ParameterError
from s3le.skeleton import POINTS

_UPPER = (
    "upperarm", "uparm", "uarm", "arm", "humerus", "shldr", "shldrbend", "bicep", "腕",
)  # fmt: skip
_FORE = (
    "forearm", "lowerarm", "loarm", "lowarm", "farm", "larm", "forearmbend", "radius", "ulna",
)  # fmt: skip
_SHOULDER = ("shoulder", "sho")
_COLLAR = ("collar", "clavicle", "scapula", "collarbone", "肩")
_SHIN = ("knee", "shin", "calf", "lowerleg", "loleg", "lowleg", "tibia", "shank", "ひざ")
_PAIRED = {  # of each side; the first that both sides have
    "shoulder": (*_UPPER, *_SHOULDER),
    "elbow": ("elbow", "elb", "elblow", *_FORE, "ひじ"),
    "hand": ("wrist", "wri", "hand", "手首"),
    "pelvis": (
        "upleg", "upperleg", "thigh", "thighbend", "femur", "hip", "leg", "足", "pelvis",
        "hipjoint",
    ),
    "knee": (*_SHIN, "leg"),
    "ankle": ("ankle", "foot", "足首"),
    "toe": ("toe", "toes", "toebase", "ball", "ballfoot", "bigtoe", "footindex", "foot", "つま先"),
    "ear": ("ear",),
}  # fmt: skip
_SINGLE = {
    "hip": (
        "hips", "pelvis", "midhip", "middlehip", "hipcenter", "spinebase", "lowertorso", "hip",
        "下半身", "root",
    ),
    "neck": (
        "lowerneck", "neck", "necklower", "necktwist", "upperneck", "首", "midshoulder",
        "shouldercenter", "spineshoulder", "thorax",
    ),
    "nose": ("nose",),
}  # fmt: skip
# Beside the ten points: what tells the front of a body from its back.
MORE = (*(f"{s}_{p}" for p in ("knee", "ankle", "toe", "ear") for s in "rl"), "nose")

_SIDED = {*_COLLAR, *(part for parts in _PAIRED.values() for part in parts)}
_ALONE = {part for parts in _SINGLE.values() for part in parts}
_SIDES = {"left": "l", "right": "r", "l": "l", "r": "r"}
_RUN_IN = {"left": "l", "right": "r", "l": "l", "r": "r", "左": "l", "右": "r"}  # lshoulder
_MIDDLE = {"c", "m", "center"}  # in place of a side, as J_Bip_C_Hips
_EMPTY = {"joint", "jnt", "bone", "kp", "keypoint"}  # words that say nothing
_LONGEST, _MOST = 200, 4  # letters of a name that is looked at, and words of a part in it
_HALVES = {"hip": "pelvis", "neck": "shoulder"}
# Runs of capitals, words with or without one, and letters that have no capitals.
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\d_a-zA-Z]+")
_SPACE = re.compile(r"^.*[:|]")  # mixamorig: and Maya's paths
_REST_FRAME = ({"LHipJoint"}, {"lThigh", "lShldr"})  # of cgspeed's and of its DAZ-friendly files

_Index = dict[str, dict[str, int]]  # prefix -> part with its side ("l arm") -> joint


class Match(NamedTuple):
    """Which joints of a file are which.

    Attributes:
        joints: indices of the joints of each point of POINTS that is found; of two: their mean.
        more: index of the joint of each of MORE that is found.
        missing: points that no joint stands for.
        doubled: names of joints of these that the file has more than once.
        rest_frame: whether files with such names have a converter's rest pose in front.
    """

    joints: dict[str, tuple[int, ...]]
    more: dict[str, int]
    missing: tuple[str, ...]
    doubled: tuple[str, ...]
    rest_frame: bool

    def used(self) -> list[int]:
        """Indices of all joints that are found, rising."""
        return sorted({*(j for own in self.joints.values() for j in own), *self.more.values()})


def match(names: Sequence[str], given: Mapping[str, str] | None = None) -> Match:
    """The joints of one body among names.

    Without a joint of its own the hip is between the thighs, and the neck between the shoulders.

    Args:
        names: joint names in the file's order.
        given: names of joints by point, of POINTS and MORE; what it leaves out is looked up.

    Raises:
        ParameterError: given has another key, or a name that the file does not have.
    """
    check_given(given or {})
    index = _index(names)
    bodies = [_body({**index.get("", {}), **own}, own) for own in index.values()]
    best = max(bodies, key=len, default={})
    best = best | {point: _stated(names, point, name) for point, name in (given or {}).items()}
    joints: dict[str, tuple[int, ...]] = {
        point: (best[point],) for point in POINTS if point in best
    }
    for middle, half in _HALVES.items():
        right, left = joints.get(f"r_{half}"), joints.get(f"l_{half}")
        if middle not in joints and right and left:
            joints[middle] = right + left
    more = {point: best[point] for point in MORE if point in best}
    times = Counter(names)
    bare = {_SPACE.sub("", name) for name in names}
    return Match(
        joints,
        more,
        tuple(point for point in POINTS if point not in joints and point not in _HALVES),
        tuple(sorted({names[j] for own in joints.values() for j in own if times[names[j]] > 1})),
        any(signs <= bare for signs in _REST_FRAME),
    )


def check_given(given: Mapping[str, str]) -> None:
    """Refuse what is no map from points to names.

    Raises:
        ParameterError: a key is none of POINTS and MORE, or a name is no word.
    """
    for point, name in given.items():
        if point not in (*POINTS, *MORE):
            near = get_close_matches(str(point), (*POINTS, *MORE), n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            there = ", ".join((*POINTS, *MORE))
            raise ParameterError(f"--names: {point!r} is none of {there}{hint}")
        if not isinstance(name, str) or not name:
            raise ParameterError(f"--names: {point} is to be {name!r}, wanted a joint's name")


def _stated(names: Sequence[str], point: str, name: str) -> int:
    if name in names:
        return names.index(name)
    near = get_close_matches(name, names, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ParameterError(f"--names: {point} is to be {name!r}, which the file has not{hint}")


def _index(names: Sequence[str]) -> _Index:
    """What each name says; of names that differ in a number the lowest counts, then the first."""
    order = sorted(range(len(names)), key=lambda i: _numbers(names[i]))
    index: _Index = {}
    for i in order:
        if read := _read(names[i]):
            index.setdefault(read[0], {}).setdefault(read[1], i)
    return index


def _numbers(name: str) -> list[int]:
    return [int(n) for n in re.findall(r"[0-9]{1,9}", _SPACE.sub("", name[:_LONGEST]))]


def _read(name: str) -> tuple[str, str] | None:
    """Prefix and part of a joint's name, `l arm` or `neck`; None: no part known here."""
    if len(name) > _LONGEST:
        return None
    found = _WORDS.findall(_SPACE.sub("", unicodedata.normalize("NFKC", name)))
    words = [word.lower() for word in found]
    words = [
        w
        for w, before in zip(words, ["", *words], strict=False)
        if w not in _EMPTY or before == "hip"
    ]  # LHipJoint is no hip
    sides = {_SIDES[word] for word in words if word in _SIDES}
    if len(sides) > 1:
        return None
    if sides:
        side = sides.pop()
        words = [word for word in words if word not in _SIDES]
        for first in range(max(len(words) - _MOST, 0), len(words)):
            if (part := "".join(words[first:])) in _SIDED:
                return " ".join(words[:first]), f"{side} {part}"
        return None
    for kept in (words, [word for word in words if word not in _MIDDLE]):
        for first in range(max(len(kept) - _MOST, 0), len(kept)):
            part = "".join(kept[first:])
            prefix = " ".join(word for word in kept[:first] if word not in _MIDDLE)
            if part in _ALONE:
                return prefix, part
            for mark, side in _RUN_IN.items():
                if part.startswith(mark) and part[len(mark) :] in _SIDED:
                    return prefix, f"{side} {part[len(mark) :]}"
                if len(mark) > 1 and part.endswith(mark) and part[: -len(mark)] in _SIDED:
                    return prefix, f"{side} {part[: -len(mark)]}"
    return None


def _of(part: str | None) -> tuple[str, str]:
    return f"r {part}", f"l {part}"


def _body(known: Mapping[str, int], own: Mapping[str, int]) -> dict[str, int]:
    """The joints of a body among parts: of pairs those of one prefix, of others any known."""

    def both(part: str) -> bool:
        return all(f"{side} {part}" in own for side in "lr")

    clavicle, fore = any(map(both, _COLLAR)), any(map(both, _FORE))
    options = dict(_PAIRED)
    if fore and not clavicle:  # beside a forearm alone, a shoulder may be either
        options["shoulder"] = _UPPER
    thigh = "leg" if any(map(both, _SHIN)) else None
    options["pelvis"] = tuple(part for part in _PAIRED["pelvis"] if part not in {"leg"} - {thigh})
    body: dict[str, int] = {}
    for point, parts in options.items():
        # Of one side alone too: the other is then what is missing, or stated.
        part = next(filter(both, parts), None)
        part = part or next((p for p in parts if not own.keys().isdisjoint(_of(p))), None)
        body |= {
            f"{side}_{point}": own[name]
            for side, name in zip("rl", _of(part), strict=True) if name in own
        }  # fmt: skip
    for toe, other in (("toe", "ankle"), ("knee", "pelvis")):  # one joint is not two points
        if body.get(f"r_{toe}") == body.get(f"r_{other}"):
            for side in "rl":
                body.pop(f"{side}_{toe}", None)
    for point, parts in _SINGLE.items():
        part = next((part for part in parts if part in known), None)
        # ASF's thorax, told by its bones' names, is the foot of the chest and no neck.
        if part is not None and not (part == "thorax" and both("humerus")):
            body[point] = known[part]
    return body
