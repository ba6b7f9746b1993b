"""Acclaim skeletons (ASF): the bones that an AMC file's angles turn.

Bone b hangs on its parent's end; C is its axis frame at rest, M the rotation of its angles:

    R_b = R_parent C M C^-1        end_b = end_parent + R_b direction length

`direction` is given in the world at rest. Rotations apply in the order in which the file
lists them (axis "XYZ" is Rz Ry Rx), for C and for M alike.

Source: Acclaim ASF/AMC file specification; checked against an independent reader.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.human.rotation import about
from s3le.human.text import (
    SMALL_BYTES,
    listed,
    number,
    read_bytes,
    refusal,
    require,
    shown,
    split_lines,
)

INCH = 0.0254  # [m]
ROOT = "root"
_AXES = {"x": 0, "y": 1, "z": 2}
_SECTIONS = ("version", "name", "units", "documentation", "root", "bonedata", "hierarchy")
_IGNORED = ("id", "limits", "bodymass", "cofmass", "mass")  # of a bone or of the units


class Bone(NamedTuple):
    """One bone.

    Attributes:
        name: as in the file.
        parent: name of the bone it hangs on; empty for the root.
        offset: direction times length, at rest, in the file's units, shape (3,).
        axis: C, shape (3, 3).
        dof: channels in AMC order, of "tx ty tz rx ry rz"; empty for a rigid bone.
    """

    name: str
    parent: str
    offset: np.ndarray
    axis: np.ndarray
    dof: tuple[str, ...]


class Skeleton(NamedTuple):
    """The bones of one person, parents before children.

    Attributes:
        bones: by name, the root first.
        metres: length of one file unit [m].
        degrees: whether angles are in degrees (else radians).
    """

    bones: dict[str, Bone]
    metres: float
    degrees: bool


def read_asf(path: Path | str) -> Skeleton:
    """Read a skeleton.

    The unit is (1 / length) inches, as the :units section gives it: 0.45 makes 0.056444 m.

    Args:
        path: .asf or .asf.gz.

    Raises:
        ClipError: with file, line and token, anything unexpected: an unknown section or
            keyword, a wrong count, a value that is no finite number, a bone that is
            missing, doubled or not in the hierarchy, a translating bone, a root away from 0.
    """
    data = read_bytes(path, SMALL_BYTES)
    require(path, data, "ASF text")
    sections = _sections(path, data)
    metres, degrees = _units(path, sections["units"])
    bones = {ROOT: _root(path, sections["root"])}
    for block in _blocks(path, sections["bonedata"]):
        line, bone = _bone(path, block, degrees)
        if bone.name in bones:
            raise refusal(path, line, f"bone {shown(bone.name)} is there twice")
        bones[bone.name] = bone
    return Skeleton(_ordered(path, bones, sections["hierarchy"]), metres, degrees)


Lines = list[tuple[int, list[bytes]]]  # line number from 1, its words


def _sections(path: Path | str, data: bytes) -> dict[str, Lines]:
    sections: dict[str, Lines] = {}
    here: Lines | None = None
    for line, text in enumerate(split_lines(path, data), 1):
        words = text.split()
        if not words or words[0].startswith(b"#"):
            continue
        if words[0].startswith(b":"):
            key = words[0][1:].decode("latin-1").lower()
            if key not in _SECTIONS or key in sections:
                why = "is there twice" if key in sections else "is not one of an ASF file"
                raise refusal(path, line, f"section {shown(words[0])} {why}")
            here = sections[key] = []
        elif here is None:
            raise refusal(path, line, f"expected a section such as :units, got {shown(words[0])}")
        else:
            here.append((line, words))
    for key in ("units", "root", "bonedata", "hierarchy"):
        if not sections.get(key):
            raise refusal(path, None, f"section :{key} is missing or empty; a truncated file?")
    return sections


def _units(path: Path | str, lines: Lines) -> tuple[float, bool]:
    found = _fields(path, lines, {"length": 1, "angle": 1})
    line, (length,) = found["length"]
    value = number(path, line, length, "length")
    if not 1e-6 <= value <= 1e6:
        raise refusal(path, line, f"length must be in [1e-6, 1e6], got {shown(length)}")
    line, (angle,) = found["angle"]
    if angle.lower() not in (b"deg", b"rad"):
        raise refusal(path, line, f"angle must be deg or rad, got {shown(angle)}")
    return INCH / value, angle.lower() == b"deg"


def _root(path: Path | str, lines: Lines) -> Bone:
    found = _fields(path, lines, {"order": 6, "axis": 1, "position": 3, "orientation": 3})
    line, words = found["order"]
    dof = tuple(word.decode("latin-1").lower() for word in words)
    if sorted(dof) != ["rx", "ry", "rz", "tx", "ty", "tz"]:
        raise refusal(path, line, f"root order must name TX TY TZ RX RY RZ once, got {dof}")
    for key in ("position", "orientation"):
        line, words = found[key]
        if any(number(path, line, word, f"root {key}") for word in words):
            raise refusal(path, line, f"a root {key} other than 0 0 0 is not supported")
    line, (order,) = found["axis"]
    _order(path, line, order)
    return Bone(ROOT, "", np.zeros(3), np.eye(3), dof)


def _bone(path: Path | str, block: Lines, degrees: bool) -> tuple[int, Bone]:
    required = {"name": 1, "direction": 3, "length": 1, "axis": 4}
    found = _fields(path, block, required, optional={"dof": None})
    line, (name,) = found["name"]
    at, words = found["direction"]
    direction = np.array([number(path, at, word, "direction") for word in words])
    if not (np.abs(direction) <= 1.01).all() or not 0.99 <= np.linalg.norm(direction) <= 1.01:
        raise refusal(path, at, f"direction must be a unit vector, got {direction}")
    at, (word,) = found["length"]
    length = number(path, at, word, "length")
    if not 0.0 <= length <= 1e6:
        raise refusal(path, at, f"length must be in [0, 1e6], got {shown(word)}")
    at, (*words, order) = found["axis"]
    angles = np.array([number(path, at, word, "axis") for word in words])
    axis = np.eye(3)
    for letter in _order(path, at, order):
        angle = np.radians(angles[_AXES[letter]]) if degrees else angles[_AXES[letter]]
        axis = about(_AXES[letter], np.array([angle]))[0] @ axis
    at, words = found.get("dof", (line, []))
    dof = tuple(word.decode("latin-1").lower() for word in words)
    if len(set(dof)) < len(dof) or not set(dof) <= {"rx", "ry", "rz"}:
        raise refusal(path, at, f"dof must be among rx ry rz, each once, got {' '.join(dof)!r}")
    return line, Bone(name.decode("latin-1"), "", direction * length, axis, dof)


def _order(path: Path | str, line: int, word: bytes) -> str:
    order = word.decode("latin-1").lower()
    if sorted(order) != ["x", "y", "z"]:
        raise refusal(path, line, f"axis order must be such as XYZ, got {shown(word)}")
    return order


def _blocks(path: Path | str, lines: Lines) -> list[Lines]:
    blocks: list[Lines] = []
    open_at = 0
    for line, words in lines:
        if words == [b"begin"] and not open_at:
            open_at = line
            blocks.append([(line, words)])
        elif words == [b"end"] and open_at:
            open_at = 0
        elif words[0] == b"begin":
            raise refusal(path, line, f"begin within the block of line {open_at}; no end there?")
        elif open_at:
            blocks[-1].append((line, words))
        else:
            raise refusal(path, line, f"expected begin, got {shown(words[0])}")
    if open_at:
        raise refusal(path, open_at, "this begin has no end; a truncated file?")
    return blocks


def _fields(
    path: Path | str,
    lines: Lines,
    required: dict[str, int],
    optional: dict[str, None] | None = None,
) -> dict[str, tuple[int, list[bytes]]]:
    """Words behind each keyword, with the line; counts are checked where a number is given."""
    counts: dict[str, int | None] = {**required, **(optional or {})}
    found: dict[str, tuple[int, list[bytes]]] = {}
    for line, words in lines:
        key = words[0].decode("latin-1").lower()
        if key in found:
            raise refusal(path, line, f"{shown(key)} is there twice")
        if key in counts:
            if counts[key] not in (None, len(words) - 1):
                why = f"{key} takes {counts[key]} values, got {len(words) - 1}"
                raise refusal(path, line, why)
            found[key] = line, words[1:]
        elif key not in _IGNORED and key != "begin" and not re.match(r"\(|-?\d|\)", key):
            raise refusal(path, line, f"{shown(key)} is not expected here")  # (: limits go on
    for key in required:
        if key not in found:
            raise refusal(path, lines[0][0], f"{key} is missing in the block that starts here")
    return found


def _ordered(path: Path | str, bones: dict[str, Bone], lines: Lines) -> dict[str, Bone]:
    """The bones with their parents, parents first."""
    parent: dict[str, str] = {ROOT: ""}
    children: dict[str, list[str]] = {}
    blocks = _blocks(path, lines)
    if len(blocks) != 1:
        raise refusal(path, lines[0][0], f"hierarchy must be one begin .. end, got {len(blocks)}")
    for line, words in blocks[0][1:]:
        above, *below = (word.decode("latin-1") for word in words)
        for name in (above, *below):
            if name not in bones:
                raise refusal(path, line, f"bone {shown(name)} is not in :bonedata")
        for name in below:
            if name in parent:
                raise refusal(path, line, f"bone {shown(name)} has two parents")
            parent[name] = above
            children.setdefault(above, []).append(name)
    ordered, todo = {}, [ROOT]
    while todo:
        name = todo.pop(0)
        ordered[name] = bones[name]._replace(parent=parent[name])
        todo += children.get(name, [])
    if lost := sorted(bones.keys() - ordered.keys()):
        raise refusal(path, lines[0][0], f"not below the root: {listed(lost)}")
    return ordered
