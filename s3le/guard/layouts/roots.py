"""Where a file says that the base link is, for those who write its motion into another layout.

Only what a layout's makers agree on is known: GMR's root_pos and root_rot (x y z w), the seven
numbers before the joints of mjlab's and Unitree's CSV (x y z w) and of MuJoCo's qpos (w x y z),
mjlab's bodies, the first of which is the base (w x y z), and columns that name each number.
Numbers come as they lie in the file, in another order at most.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from s3le.guard.layouts.arrays import Place
from s3le.motion.columns import ROOT, find
from s3le.motion.trajectory import Placed

POSITIONS, TURNS = ("root_pos", "root_trans", "root_trans_offset"), ("root_rot",)
BODIES = ("body_pos_w", "body_quat_w")
NAMES = (*POSITIONS, *TURNS, *BODIES)  # of arrays
KNOWN = (
    "root_pos and root_rot (x y z w), seven numbers before the joints of qpos (w x y z) or of a "
    "CSV without names (x y z w), or columns root_x to root_qw"
)
_BASE = r"(?:root|base|floating_base|pelvis|free_?joint)"
_POSITION = re.compile(rf"(?:{_BASE}[_. ]*(?:pos|position|trans|translation)?[_. ]*|t)?([xyz])")
_TURN = re.compile(rf"(?:{_BASE}[_. ]*)?(?:quaternion|quat|rotation|rot|q)[_. ]*q?([wxyz])")


def of_arrays(
    table: Mapping[str, np.ndarray], place: Place | None = None, xyzw: bool = False
) -> Placed | None:
    """Where the base is, of named arrays; None: they do not say it in a way that is known.

    Args:
        table: arrays by name.
        place: where the joints lie in them.
        xyzw: who writes this layout puts w last in what stands before the joints.
    """
    position, turn = find(table, POSITIONS), find(table, TURNS)
    if position is not None and turn is not None:
        return _placed(position[1], turn[1])
    if place is not None and place.skip == ROOT and (xyzw or place.keys[0].lower() == "qpos"):
        before = table[place.keys[0]][:, :ROOT]
        return _placed(before[:, :3], before[:, [3, 4, 5, 6] if xyzw else [4, 5, 6, 3]])
    bodies = [find(table, (name,)) for name in BODIES]
    if all(one is not None and one[1].ndim == 3 for one in bodies):
        where, turned = (one[1][:, 0] for one in bodies if one is not None)
        return _placed(where, turned[:, [1, 2, 3, 0]]) if turned.shape[1:] == (4,) else None
    return None


def columns(names: Sequence[str]) -> list[int] | None:
    """Which columns hold position x y z and quaternion x y z w; None: not all seven are named."""
    found = []
    for pattern, letters in ((_POSITION, "xyz"), (_TURN, "xyzw")):
        at: dict[str, list[int]] = {letter: [] for letter in letters}
        for i, name in enumerate(names):
            if (match := pattern.fullmatch(name.strip().lower())) is not None:
                at[match[1]].append(i)
        if any(len(one) != 1 for one in at.values()):
            return None
        found += [one[0] for one in at.values()]
    return found


def of_columns(seven: Sequence[np.ndarray]) -> Placed | None:
    """Where the base is, of the columns that `columns` found, (m,) each."""
    return _placed(np.stack(seven[:3], axis=1), np.stack(seven[3:], axis=1))


def _placed(position: np.ndarray, turn: np.ndarray) -> Placed | None:
    if position.shape[1:] != (3,) or turn.shape[1:] != (4,):
        return None
    if position.dtype.kind not in "fiu" or turn.dtype.kind not in "fiu":
        return None
    return Placed(np.array(position, float), np.array(turn, float))
