"""A URDF's joints as a tree with geometry at zero: who hangs on whom, where, about which axis."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("L", "R"), ("l", "r"))
_ARM = re.compile(r"arm|shoulder|elb|wrist|hand|gripper|finger|humer|clav|Sh[LSYPR]|Wr", re.I)
_LEG = re.compile(r"hip|knee|ank|leg|foot|feet|thigh|calf|toe|sole|crotch|wheel", re.I)


@dataclass
class Tree:
    """Joints by pinocchio's index (1 and up; 0: the base), at zero or as near as limits let."""

    model: pin.Model

    @cached_property
    def still(self) -> np.ndarray:
        """The configuration zero, each angle brought into its range."""
        q = pin.neutral(self.model)
        for joint in self.model.joints[1:]:
            if joint.nq == 1:
                low = self.model.lowerPositionLimit[joint.idx_q]
                high = self.model.upperPositionLimit[joint.idx_q]
                if low <= high:
                    q[joint.idx_q] = min(max(0.0, low), high)
        return q

    @cached_property
    def data(self) -> pin.Data:
        """The model placed there."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, self.still)
        return data

    @cached_property
    def children(self) -> list[list[int]]:
        """Of each joint the ones that hang on it directly."""
        out: list[list[int]] = [[] for _ in range(self.model.njoints)]
        for j in range(1, self.model.njoints):
            out[self.model.parents[j]].append(j)
        return out

    def name(self, joint: int) -> str:
        """As the URDF has it."""
        return self.model.names[joint]

    def turns(self, joint: int) -> bool:
        """Is it a joint of one angle?"""
        item = self.model.joints[joint]
        return item.nv == 1 and "R" in item.shortname().removeprefix("JointModel")

    def at(self, joint: int) -> np.ndarray:
        """Origin [m], (3,), in the base frame."""
        return np.array(self.data.oMi[joint].translation)

    def axis(self, joint: int) -> np.ndarray:
        """Unit axis (3,) in the base frame."""
        kind = self.model.joints[joint]
        data = kind.createData()
        kind.calc(data, self.still)
        return np.array(self.data.oMi[joint].rotation @ np.array(data.S).reshape(6)[3:])

    def path(self, joint: int) -> list[int]:
        """Joints from the base to this one, both ends included but the base."""
        out = []
        while joint > 0:
            out.append(joint)
            joint = self.model.parents[joint]
        return out[::-1]

    def below(self, joint: int) -> list[int]:
        """This joint and all that hang on it."""
        out = [joint]
        for child in self.children[joint]:
            out += self.below(child)
        return out

    def link(self, joint: int) -> str:
        """The link that a joint hangs on."""
        frame = self.model.frames[self.model.getFrameId(self.name(joint), pin.FrameType.JOINT)]
        parent = self.model.frames[frame.parentFrame]
        return parent.name

    def frames(self, joints: Iterable[int]) -> list[pin.Frame]:
        """Links and fixed joints that these joints carry."""
        wanted = set(joints)
        kinds = (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT)
        return [f for f in self.model.frames if f.parentJoint in wanted and f.type in kinds]

    def place(self, frame: pin.Frame) -> np.ndarray:
        """Origin of a frame [m], (3,), in the base frame."""
        return np.array(self.data.oMi[frame.parentJoint].act(frame.placement.translation))

    def reach(self, joint: int) -> float:
        """How far the farthest joint or frame below lies from this joint [m]."""
        here = self.at(joint)
        under = self.below(joint)
        spots = [self.at(j) for j in under] + [self.place(f) for f in self.frames(under)]
        return float(max(np.linalg.norm(spot - here) for spot in spots))

    def named_like_arm(self, joint: int) -> bool:
        """Does its own name speak of an arm?"""
        return _ARM.search(self.name(joint)) is not None

    def resembles_arm(self, joint: int) -> int:
        """Names below that speak of an arm, less those that speak of a leg."""
        words = [self.name(j) for j in self.below(joint)]
        words += [frame.name for frame in self.frames(self.below(joint))]
        return sum(bool(_ARM.search(w)) for w in words) - sum(bool(_LEG.search(w)) for w in words)


def twin(name: str, names: set[str]) -> str | None:
    """The name of the right joint for that of a left one; None: it is no left one."""
    for left, right in _SIDES:
        for found in re.finditer(left, name):
            other = name[: found.start()] + right + name[found.end() :]
            if other in names:
                return other
        every = name.replace(left, right)
        if every != name and every in names:
            return every
    return None


def named_pairs(tree: Tree) -> list[tuple[int, int]]:
    """Left and right joints, by their names, that limbs begin with."""
    names = set(tree.model.names)
    pairs = {}
    for j in range(1, tree.model.njoints):
        other = twin(tree.name(j), names)
        if other is not None:
            pairs[j] = tree.model.getJointId(other)
    return [
        (j, other) for j, other in pairs.items()
        if pairs.get(tree.model.parents[j]) != tree.model.parents[other]
        or tree.model.parents[j] == tree.model.parents[other]
    ]  # fmt: skip


def mirrored_pairs(tree: Tree) -> list[tuple[int, int]]:
    """Joints on one parent whose limbs mirror each other; the first lies farther along +y."""
    found = []
    for kids in tree.children:
        for i, a in enumerate(kids):
            for b in kids[i + 1 :]:
                if _mirror(tree, a, b):
                    found.append((a, b) if tree.at(a)[1] >= tree.at(b)[1] else (b, a))
    return found


def _mirror(tree: Tree, a: int, b: int) -> bool:
    """Do two limbs mirror each other in a plane, joint for joint, to a centimetre?"""
    one, two = main_chain(tree, a), main_chain(tree, b)
    if len(one) != len(two):
        return False
    apart = [tree.at(j) - tree.at(k) for j, k in zip(one, two, strict=True)]
    widest = max(apart, key=lambda v: float(np.linalg.norm(v)))
    if np.linalg.norm(widest) < 0.02:
        return False
    way = widest / np.linalg.norm(widest)
    middle = (tree.at(one[0]) + tree.at(two[0])) @ way / 2
    for j, k, gap in zip(one, two, apart, strict=True):
        across = gap - (gap @ way) * way
        centre = (tree.at(j) + tree.at(k)) @ way / 2
        if np.linalg.norm(across) > 0.01 or abs(centre - middle) > 0.01:
            return False
    return True


def main_chain(tree: Tree, root: int) -> list[int]:
    """Turning joints from a limb's first to where it ends or opens into fingers."""
    chain = [root]
    while len(chain) < 12:
        kids = tree.children[chain[-1]]
        long = [j for j in kids if tree.reach(j) >= 0.12]
        if len(kids) > 1:
            named = [j for j in long if re.search(r"elb|fore|wrist|Wr", tree.name(j))]
            kids = named or long
        if len(kids) != 1 or not tree.turns(kids[0]):
            break
        chain.append(kids[0])
    return chain
