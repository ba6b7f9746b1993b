"""Acclaim motion (AMC) on its skeleton (ASF), as CMU's motion capture database has it.

The files carry no frame rate: it is an argument, and `CMU_60_HZ` names the subjects that
were recorded at 60 instead of 120 Hz. Angles follow the AMC file's own keyword (:DEGREES or
:RADIANS), else the skeleton's. A skeleton file's grammar is in `asf`.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from s3le.errors import ClipError
from s3le.human.asf import ROOT, Skeleton, read_asf
from s3le.human.clip import Clip, make_clip, refuse_wild_angles
from s3le.human.rotation import about, turn
from s3le.human.text import (
    floats,
    integer,
    leave_out_last,
    listed,
    number,
    read_bytes,
    refusal,
    require,
    shown,
    split_lines,
)
from s3le.skeleton import POINTS

__all__ = ["CMU_60_HZ", "CMU_FPS", "cmu_rate", "joint_positions", "read_amc", "read_asf"]

# The bone whose end is each of skeleton.POINTS.
CMU_POINTS = {
    "hip": ROOT,
    "r_pelvis": "rhipjoint",
    "l_pelvis": "lhipjoint",
    "neck": "thorax",
    "r_shoulder": "rclavicle",
    "r_elbow": "rhumerus",
    "r_hand": "rradius",
    "l_shoulder": "lclavicle",
    "l_elbow": "lhumerus",
    "l_hand": "lradius",
}
CMU_FPS = 120.0  # [Hz], of most of CMU's trials
# Subjects whose trials CMU's index lists at 60 Hz; of subject 136 it is trial 19 alone.
CMU_60_HZ = frozenset((33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89))
_TRIAL = re.compile(r"0*([0-9]{1,3})_0*([0-9]{1,3})(?![0-9])(?:[^A-Za-z0-9].*)?")  # 60_10_salsa
_AXES = {"rx": 0, "ry": 1, "rz": 2, "tx": 0, "ty": 1, "tz": 2}


def cmu_rate(trial: str) -> float:
    """Frame rate [Hz] of a CMU trial such as "79_51" or "60_10_salsa"; 120 for any other name."""
    found = _TRIAL.fullmatch(trial)
    subject, number_ = map(int, found.groups()) if found else (0, 0)
    return 60.0 if subject in CMU_60_HZ or (subject, number_) == (136, 19) else CMU_FPS


def read_amc(
    path: Path | str, skeleton: Skeleton, fps: float, names: Mapping[str, str] | None = None
) -> Clip:
    """Read a motion and place the ten points in every frame.

    The format has no count of frames, so where nothing follows the last number it may be a part
    of one: 12.5 of 12.53. Such a file is read without its last frame, and a warning says so.

    Args:
        path: .amc or .amc.gz.
        skeleton: of the same person, from read_asf.
        fps: frames per second [Hz]; see cmu_rate.
        names: bones whose ends are points, by point, where they are not those of CMU_POINTS.

    Returns:
        Clip in metres, z up, x where the file's z was.

    Raises:
        ClipError: with file, line and token, anything but frames numbered one after the
            other that each give every moving bone of the skeleton once, with the right
            count of finite numbers; or a skeleton without the bones of CMU_POINTS.
        ParameterError: fps is no sensible rate.
    """
    ends_at = {point: (names or {}).get(point, bone) for point, bone in CMU_POINTS.items()}
    if lost := [bone for bone in ends_at.values() if bone not in skeleton.bones]:
        raise ClipError(
            f"{path}: its skeleton has no {', '.join(lost)}; it has {listed(skeleton.bones)}; say "
            "whose ends are meant: --names MAP"
        )
    data = read_bytes(path)
    require(path, data, "AMC text")
    lines = split_lines(path, data)
    start, degrees = _header(path, lines, skeleton)
    channels = _by_stride(lines, start, skeleton)
    if channels is None:  # not one fixed layout: read it line by line, or say where it breaks
        channels = _by_line(path, lines, start, skeleton)
    if not data[-1:].isspace():
        frames = len(next(iter(channels.values())))
        leave_out_last(path, frames, "nothing shows that its last number is whole (no line end)")
        channels = {key: values[:-1] for key, values in channels.items()}
    if degrees:
        channels = {key: np.radians(v) if key[1][0] == "r" else v for key, v in channels.items()}
    refuse_wild_angles(path, np.stack([v for k, v in channels.items() if k[1][0] == "r"], axis=1))
    with np.errstate(over="ignore", invalid="ignore"):  # make_clip refuses what comes of it
        ends = joint_positions(skeleton, channels, set(ends_at.values()))
        points = np.stack([ends[ends_at[point]] for point in POINTS], axis=1)  # (n, 10, 3)
        return make_clip(path, fps, points[..., [2, 0, 1]] * skeleton.metres)


Channels = dict[tuple[str, str], np.ndarray]  # (bone, dof) -> values, shape (n,)


def joint_positions(
    skeleton: Skeleton, channels: Channels, wanted: set[str]
) -> dict[str, np.ndarray]:
    """Where the ends of bones are.

    Args:
        skeleton: n_bones bones, parents first.
        channels: by bone and dof, [rad] or file units, each of shape (n,).
        wanted: names of the bones to place.

    Returns:
        Positions in the file's units and axes (y up), by bone, each of shape (n, 3).
    """
    needed = set()
    for name in wanted:
        while name and name not in needed:
            needed.add(name)
            name = skeleton.bones[name].parent
    turned: dict[str, np.ndarray] = {}  # R_b, (n, 3, 3)
    ends: dict[str, np.ndarray] = {}  # (n, 3)
    for bone in skeleton.bones.values():
        if bone.name not in needed:
            continue
        own = None  # M
        for dof in bone.dof:
            if dof[0] == "r":
                step = about(_AXES[dof], channels[bone.name, dof])
                own = step if own is None else step @ own
        if not bone.parent:
            assert own is not None  # a root names all three of its turns
            turned[bone.name] = own
            place = [channels[bone.name, dof] for dof in ("tx", "ty", "tz")]
            ends[bone.name] = np.stack(place, axis=1)
            continue
        above = turned[bone.parent]
        turned[bone.name] = above if own is None else above @ (bone.axis @ own @ bone.axis.T)
        ends[bone.name] = ends[bone.parent] + turn(turned[bone.name], bone.offset)
    return {name: ends[name] for name in wanted}


def _header(path: Path | str, lines: list[bytes], skeleton: Skeleton) -> tuple[int, bool]:
    """Index of the first frame's line, and whether angles are in degrees."""
    degrees = skeleton.degrees
    for index, text in enumerate(lines):
        words = text.split()
        if not words or words[0].startswith(b"#"):
            continue
        if not words[0].startswith(b":"):
            return index, degrees
        key = words[0].upper()
        if key in (b":DEGREES", b":RADIANS"):
            degrees = key == b":DEGREES"
        elif key != b":FULLY-SPECIFIED":
            raise refusal(path, index + 1, f"keyword {shown(words[0])} is not one of an AMC file")
    raise refusal(path, None, "no frames")


def _by_stride(lines: list[bytes], start: int, skeleton: Skeleton) -> Channels | None:
    """The values of a file whose frames all list the same bones in the same order, else None.

    Every bone is then every k-th line, so one split and one conversion read all its frames.
    """
    lines = lines[start:]
    if b"" in lines:
        lines = [line for line in lines if line.strip()]
    moving = {name.encode("latin-1"): bone for name, bone in skeleton.bones.items() if bone.dof}
    period = len(moving) + 1
    first = lines[:period]
    if len(lines) % period or len(first) < period:
        return None
    number_ = b" ".join(lines[::period]).split()
    n = len(lines) // period
    if len(number_) != n or not all(map(bytes.isdigit, number_)) or len(number_[0]) > 18:
        return None
    counted = range(int(number_[0]), int(number_[0]) + n)
    if [int(word) if len(word) <= 20 else -1 for word in number_] != list(counted):
        return None
    channels: Channels = {}
    for k in range(1, period):
        words = b" ".join(lines[k::period]).split()
        bone = moving.pop(words[0], None) if words else None
        width = len(bone.dof) + 1 if bone else 0
        if not bone or len(words) != n * width or words[::width].count(words[0]) != n:
            return None
        name = bone.name
        del words[::width]
        values = floats(words)
        if values is None:
            return None
        table = values.reshape(n, width - 1)
        channels |= {(name, dof): table[:, i] for i, dof in enumerate(bone.dof)}
    return channels


def _by_line(path: Path | str, lines: list[bytes], start: int, skeleton: Skeleton) -> Channels:
    """The values, whatever the bones' order, or a refusal that names the place.

    The reference for `_by_stride`, and slower by an order of magnitude.
    """
    moving = {name: bone for name, bone in skeleton.bones.items() if bone.dof}
    frames: list[dict[str, list[float]]] = []
    expected = opened = 0
    for line, text in enumerate(lines[start:], start + 1):
        words = text.split()
        if not words:
            continue
        name = words[0].decode("latin-1")
        if words[0][:1].isdigit():
            if len(words) > 1:
                raise refusal(path, line, f"a frame number stands alone, got {shown(text)}")
            given = integer(path, line, words[0], "frame number")
            if frames:
                _complete(path, line, opened, frames[-1], moving)
                if given != expected:
                    why = f"frame {expected} should follow, got {shown(words[0])}"
                    raise refusal(path, line, why)
            frames.append({})
            expected, opened = given + 1, given
        elif not frames:
            raise refusal(path, line, f"expected a frame number, got {shown(words[0])}")
        elif name not in skeleton.bones:
            raise refusal(path, line, f"bone {shown(name)} is not in the skeleton")
        elif name not in moving:
            raise refusal(path, line, f"bone {shown(name)} has no dof in the skeleton")
        elif name in frames[-1]:
            raise refusal(path, line, f"bone {shown(name)} is there twice in frame {opened}")
        elif len(words) - 1 != len(moving[name].dof):
            want = len(moving[name].dof)
            raise refusal(path, line, f"{name} takes {want} values, got {len(words) - 1}")
        else:
            frames[-1][name] = [number(path, line, word, name) for word in words[1:]]
    _complete(path, len(lines), opened, frames[-1], moving)
    return {
        (name, dof): np.array([frame[name][i] for frame in frames])
        for name, bone in moving.items()
        for i, dof in enumerate(bone.dof)
    }


def _complete(path: Path | str, line: int, frame: int, seen: dict, moving: dict) -> None:
    if lost := [name for name in moving if name not in seen]:
        why = f"frame {frame} ends without {listed(lost)}; a truncated file?"
        raise refusal(path, line, why)
