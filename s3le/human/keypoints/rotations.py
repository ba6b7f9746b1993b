"""SMPL's rotations under the keys of those who write them, as matrices of its joints.

The shape says what the numbers are: three a joint are axis times angle, four a quaternion, three
by three (or nine) a matrix. Nothing is guessed: six numbers a joint are written in three ways and
are refused, and so is any shape that can be read in two.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.human.clip import MOST_TURNED
from s3le.human.keypoints import smpl, upright
from s3le.human.keypoints.layouts import LAYOUTS, pick
from s3le.human.keypoints.values import numbers
from s3le.human.rotation import from_quaternion
from s3le.human.text import refusal

_WORLD = (  # (rotation of the root, of the others, place), the world's before a camera's
    ("smplorientworld", "smplpose", "roottransworld"),  # GLAMR
    ("", "poseworld", "transworld"),  # WHAM
    ("rootorientworld", "posebody", "transworld"),
    ("smplorientcam", "smplpose", "roottranscam"),
)
_BODY = (
    ("globalorient", "bodypose", "transl"),  # smplx, GVHMR, 4D-Humans
    ("rootorient", "posebody", "trans"),  # AMASS, GMR, SLAHMR
    ("posesroot", "posesbody", "trans"),  # EMDB
    ("rootpose", "bodypose", "transl"),
    ("smplxrootpose", "smplxbodypose", "camtrans"),  # OSX, SMPLer-X
    ("", "smplposes", "smpltrans"),  # AIST++, EDGE
    ("", "poses", "trans"),  # AMASS, 3DPW
    ("", "pose", "trans"),  # WHAM, VIBE, PromptHMR
    ("", "predrotmat", "predtrans"),  # TRAM, HMR
    ("", "predpose", "predtrans"),
    ("", "smplthetas", "camtrans"),  # ROMP
    ("", "thetas", ""),
    ("", "fullpose", "trans"),  # MoSh; EDGE's holds places
)
_WHOLE = (22, 24, 52, 55)  # joints with the root: body, SMPL, SMPL-H, SMPL-X
_OTHERS = (21, 23, 51, 54)
_WIDTHS = (3, 4, 6, 9)  # numbers a joint
TURNED = 0.8  # [rad] at least, of a root where z is up: SMPL's own body stands along y
_OFF = 0.02  # of a unit quaternion or an orthonormal matrix
_LARGE, _SMALL = 0.9, 0.5  # scalar parts of SMPL's rotations, most of which are small; others


class Posed(NamedTuple):
    """Joints of SMPL's list, as rotations or as places gave them."""

    joints: np.ndarray  # (n, at least 22, 3)
    what: str
    told: tuple[str, ...]
    person: int | None


class _Way(NamedTuple):
    """How an array can be read: axes before the joints, joints, numbers of each."""

    lead: tuple[int, ...]
    joints: int
    width: int


Choice = Callable[[list[int]], tuple[int | None, int]]  # of one of several persons


def posed(path: Path | str, tree: Mapping, keys: Mapping[str, Any], choice: Choice) -> Posed | None:
    """SMPL's joints in a dict of a file, or None where it holds no rotations.

    Args:
        path: for messages.
        tree: arrays and lists by their keys.
        keys: those keys by clocks.key of them.
        choice: which of several persons.

    Raises:
        ClipError: rotations of a shape or with numbers that leave open what is meant.
    """
    for root, others, place in (*_WORLD, *_BODY):
        if others not in keys or (root and root not in keys):
            continue
        names = [f"'{keys[name]}'" for name in (root, others) if name]
        given = [tree[keys[name]] for name in (root, others) if name]
        read = [numbers(path, v, name) for v, name in zip(given, names, strict=True)]
        arrays = [array for array in read if array is not None]
        if len(arrays) < len(read):
            continue
        what = " and ".join(names)
        found = _fitting(arrays)
        if not found:
            continue  # another key may fit; if none does, all are listed with their shapes
        if len(found) > 1:
            raise refusal(path, None, f"{what} can be read in {len(found)} ways by shape")
        person, parts = _of_one(arrays, found[0], choice)
        if (at := _places(what, parts, found[0])) is not None:
            return at._replace(person=person)
        made, told = zip(*(_matrices(path, part, what) for part in parts), strict=True)
        origin = _place(path, tree, keys, place, found[0][0].lead, person)
        local = np.concatenate(made, axis=1)
        said = tuple(dict.fromkeys(word for word in told if word))
        return Posed(smpl.placed(local, origin), f"SMPL's rotations {what}", said, person)
    return None


def flat(path: Path | str, array: np.ndarray) -> Posed | None:
    """SMPL's joints in rows without keys: Motion-X's 322 numbers, PHUMA's 69; None: other rows.

    Raises:
        ClipError: rows of rotations that are not such, or of features.
    """
    width = array.shape[1]
    if width == 263:
        raise refusal(path, None, "263 numbers a frame are HumanML3D's features (new_joint_vecs); "
                      "give the joints beside them (new_joints)")  # fmt: skip
    if width == 322:
        pose, place, what = array[:, :66], array[:, 309:312], "Motion-X's 322 numbers a frame"
    elif width == 69:
        pose, place, what = array[:, 3:], array[:, :3], "PHUMA's 69 numbers a frame"
        with np.errstate(over="ignore", invalid="ignore"):
            turned = np.nan_to_num(np.linalg.norm(pose[:, :3], axis=1))
        if not np.median(turned) > TURNED:
            raise refusal(path, None, "69 numbers a frame may be PHUMA's, or rotations of 23 "
                          "joints without the root's; save them as .npz with trans, global_orient "
                          "and body_pose")  # fmt: skip
    else:
        return None
    local, _ = _matrices(path, pose.reshape(len(pose), 22, 3), what)
    return Posed(smpl.placed(local, place), what, (), None)


def _ways(shape: tuple[int, ...], counts: tuple[int, ...]) -> list[_Way]:
    """How an array of this shape can hold the rotations of so many joints."""
    ways = []
    if len(shape) >= 2 and shape[-2:] == (3, 3):
        if len(shape) >= 3 and shape[-3] in counts:
            ways.append(_Way(shape[:-3], shape[-3], 9))
        if 1 in counts:
            ways.append(_Way(shape[:-2], 1, 9))
    if len(shape) >= 2 and shape[-1] in _WIDTHS and shape[-2] in counts:
        ways.append(_Way(shape[:-2], *shape[-2:]))
    for joints in counts:
        ways += [_Way(shape[:-1], joints, w) for w in _WIDTHS if joints * w == shape[-1]]
    return [way for way in ways if len(way.lead) <= 2]


def _fitting(arrays: list[np.ndarray]) -> list[tuple[_Way, ...]]:
    """The ways in which all arrays have the same frames and, where there are, persons."""
    if len(arrays) == 1:
        return list({(way,): None for way in _ways(arrays[0].shape, _WHOLE)})
    roots, others = _ways(arrays[0].shape, (1,)), _ways(arrays[1].shape, _OTHERS)
    return list({(a, b): None for a in roots for b in others if a.lead == b.lead})


def _of_one(
    arrays: list[np.ndarray], ways: tuple[_Way, ...], choice: Choice
) -> tuple[int | None, list[np.ndarray]]:
    """One person's rotations, (n, joints, width) of each array."""
    lead = ways[0].lead
    parts = [a.reshape(*lead, way.joints, way.width) for a, way in zip(arrays, ways, strict=True)]
    if len(lead) < 2:
        return None, [part.reshape(-1, *part.shape[-2:]) for part in parts]
    if lead[1] == 1:  # frames of one person each
        return None, [part[:, 0] for part in parts]
    person, at = choice(list(range(lead[0])))
    return person, [part[at] for part in parts]


def _place(
    path: Path | str,
    tree: Mapping,
    keys: Mapping[str, Any],
    name: str,
    lead: tuple[int, ...],
    person: int | None,
) -> np.ndarray | None:
    """Where the root is, (n, 3), or None where no array of such a shape says it."""
    at = numbers(path, tree[keys[name]], f"'{keys[name]}'") if name in keys else None
    if at is None or at.shape[-1] != 3 or at.size != 3 * int(np.prod(lead)):
        return None
    at = at.reshape(*lead, 3)
    at = at.reshape(-1, 3) if len(lead) < 2 else at[:, 0] if lead[1] == 1 else at[person or 0]
    scale = numbers(path, tree[keys["smplscaling"]], "scale") if "smplscaling" in keys else None
    if scale is not None and scale.size == 1 and scale.ravel()[0] > 0.0:
        at = at / scale.ravel()[0]  # AIST++ places people in its own unit
    return at


def _places(what: str, parts: list[np.ndarray], ways: tuple[_Way, ...]) -> Posed | None:
    """Joints that are places under a key of rotations, as EDGE's full_pose: they give a body."""
    if len(parts) > 1 or ways[0].width != 3:
        return None
    with np.errstate(invalid="ignore"):
        joints = np.where(np.abs(parts[0]) < MOST_TURNED, parts[0], np.nan)
    if upright.looks_human(pick(joints, LAYOUTS["smpl"].points)):
        return None
    told = (f"{what} holds places, for as such it gives a body",)
    return Posed(parts[0], what, told, None)


def _matrices(path: Path | str, rotations: np.ndarray, what: str) -> tuple[np.ndarray, str]:
    """Rotations (n, j, 3, 4 or 9 numbers) as matrices (n, j, 3, 3), and what was assumed."""
    known = np.isfinite(rotations).all(axis=2)
    seen = rotations[known]
    width = rotations.shape[2]
    if width == 6:
        raise refusal(
            path,
            None,
            f"{what} has 6 numbers a joint, which are written in three "
            "ways (rows or columns of a matrix); save axis times angle, or matrices",
        )
    if width == 3:
        if not (np.abs(seen) < MOST_TURNED).all():
            raise refusal(path, None, f"{what} turns a joint by more than {MOST_TURNED:g} rad")
        return smpl.rotations(rotations), ""
    made = np.full((*rotations.shape[:2], 3, 3), np.nan)
    if width == 9:
        square = seen.reshape(-1, 3, 3)
        with np.errstate(over="ignore", invalid="ignore"):
            off = np.abs(square @ square.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
        if not (off < _OFF and (np.linalg.det(square) > 0.0).all()):
            raise refusal(path, None, f"{what} holds matrices that are no rotations")
        made[known] = square
        return made, ""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(seen, axis=1, keepdims=True)
    if not (np.abs(length - 1.0) < _OFF).all():
        raise refusal(path, None, f"{what} has 4 numbers a joint that are no unit quaternions")
    first, last = (float(np.median(np.abs(seen[:, i]))) if len(seen) else 0.0 for i in (0, 3))
    if not (max(first, last) >= _LARGE and min(first, last) <= _SMALL):
        raise refusal(path, None, f"{what} holds quaternions of which nothing tells whether w is "
                      "first or last; save axis times angle, or matrices")  # fmt: skip
    order = [3, 0, 1, 2] if last > first else [0, 1, 2, 3]
    made[known] = from_quaternion((seen / length)[:, order])
    where = "last" if last > first else "first"
    return made, f"quaternions with w {where}, for most of a body's rotations are small"
