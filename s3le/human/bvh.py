"""Biovision hierarchies (BVH): any channel order, names by the table of all formats.

A joint's rotation is the product of its rotation channels in the order listed; a position
channel, on whatever joint, replaces that component of OFFSET (LAFAN1 and Bandai-Namco files
would be wrong if it were added). Points of cgspeed files: the thorax bone is lost there, so
the neck lies lower than in the AMC; the pelvis points are the thighs, not the hip joints.
"""

import logging
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from s3le.errors import ParameterError
from s3le.human import stance
from s3le.human.amc import CMU_FPS, cmu_rate
from s3le.human.clip import FPS_RANGE, Clip, Reading, clip_name, make_clip, refuse_wild_angles
from s3le.human.keypoints.handed import refuse_mirrored
from s3le.human.keypoints.how import LEFT_HANDED, How
from s3le.human.keypoints.layouts import Named, by_names, pick
from s3le.human.keypoints.upright import hip_is_off
from s3le.human.rigs import match
from s3le.human.rotation import about, turn
from s3le.human.text import (
    SMALL_BYTES,
    floats,
    integer,
    leave_out_last,
    listed,
    number,
    printed,
    read_bytes,
    refusal,
    require,
    shown,
    split_lines,
)
from s3le.skeleton import POINTS

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "cmu": 0.0254 / 0.45}  # [m] per file unit
ARM_RANGE = (0.3, 0.9)  # [m] shoulder to wrist, of a child and of a giant
ARM = 0.55  # [m] of whoever's arm is of such a length in no unit
REST_ARM = np.cos(np.radians(20.0))  # least |y| of the arms' directions in a T-pose
_CHANNELS = {
    f"{axis}{kind}": (kind, i) for i, axis in enumerate("xyz") for kind in ("position", "rotation")
}
_CHUNK = 2**20  # [bytes] of frames split and converted at a time, which bounds their memory
_KEYWORDS = {"ROOT", "JOINT", "End", "OFFSET", "CHANNELS", "}"}
_BOM, _END_OF_FILE = b"\xef\xbb\xbf", b"\x1a"  # of Windows' editors, and of DOS
_TURNS = {  # rows: our x, y, z in the file's axes; z up as Blender makes it of y up
    "y-up": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    "z-up": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "camera": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
    "y-up-left": ((0, 0, 1), (-1, 0, 0), (0, 1, 0)),
    "z-up-left": ((1, 0, 0), (0, -1, 0), (0, 0, 1)),
}
log = logging.getLogger(__name__)


class Joint(NamedTuple):
    """One joint: name, index of its parent (-1: none), rest offset, channels, first column."""

    name: str
    parent: int
    offset: np.ndarray
    channels: tuple[tuple[str, int], ...]
    column: int


def read_bvh(
    path: Path | str, fps: float | None = None, unit: str | None = None, how: How | None = None
) -> Clip:
    """Read a motion and place the ten points in every frame.

    The unit, where it is not given, is the one of UNITS in which the arm (shoulder to elbow
    to hand, mean of both sides, first frame) is ARM_RANGE long; the ranges do not overlap. Where
    there is none, the arm is taken for ARM long: directions do not depend on it. Up is found as
    s3le.human.stance says. The rest pose that cgspeed's converters put in front is dropped where
    it is there: root not rotated at all, both arms within 20 deg of the left-right axis.

    CMU's trials that were recorded at 60 Hz are known by their names (amc.cmu_rate): their
    conversions say 120 Hz. More or fewer frames than announced are read with a warning. A last
    line without a line end is read: Frames says whether it is all there. If it says more, or the
    last number alone has fewer decimals than the others, it was cut, and the last frame is left
    out.

    Args:
        path: .bvh or .bvh.gz.
        fps: frames per second [Hz], instead of the file's Frame Time.
        unit: a key of UNITS, instead of the guess.
        how: axes and names, instead of what is found.

    Returns:
        Clip in metres, z up. Its reading says what was assumed or stated, if anything was.

    Raises:
        ClipError: with file, line and token, anything but one hierarchy and complete frames of
            finite numbers; or joints of no known names, with the points not found and the names
            that the file has; a body that is mirrored; or nothing that tells which axis is up.
        ParameterError: fps is no sensible rate, unit is not a key of UNITS, or how names a joint
            that is not there.
    """
    if unit is not None and unit not in UNITS:
        raise ParameterError(f"unit must be one of {', '.join(UNITS)}, got {unit!r}")
    how = how or How()
    data = read_bytes(path).removeprefix(_BOM)
    while (bare := data.rstrip())[-1:] == _END_OF_FILE:
        data = bare[:-1]
    require(path, data, "BVH text")
    lines = split_lines(path, data)
    motion = next((i for i, text in enumerate(lines) if text.strip().upper() == b"MOTION"), None)
    if motion is None:
        raise refusal(path, len(lines), "no MOTION line; a truncated file?")
    if sum(map(len, lines[:motion])) > SMALL_BYTES:
        raise refusal(path, motion + 1, f"a hierarchy of more than {SMALL_BYTES} bytes")
    joints = _hierarchy(path, lines[:motion])
    found, used, rest_frame = _points(path, joints, how)
    columns = sum(len(joint.channels) for joint in joints)
    ended = data[-1:].isspace()
    values, own_fps = _motion(path, lines, motion, columns, fps, ended)
    turns = [kind == "rotation" for joint in joints for kind, _ in joint.channels]
    refuse_wild_angles(path, np.radians(values[:, turns]))
    fps, told = (fps, []) if fps is not None else _cmu(path, own_fps)
    with np.errstate(over="ignore", invalid="ignore"):  # make_clip refuses what comes of it
        at = _placed(joints, values, used)
        points = pick(at, found.layout.points)  # (n, 10, 3)
        axes = how.axes
        if axes is None:
            axes, words = _up(path, joints, used, found, at, points)
            told += words
        if why := hip_is_off(points):
            raise refusal(path, None, f"{why}: say which joint it is, with --names MAP")
        refuse_mirrored(path, at, found.layout, points, axes in LEFT_HANDED)
        scale, words = (UNITS[unit], []) if unit is not None else _unit(path, points[0])
        told += words
        points = points @ np.array(_TURNS[axes], float).T * scale
        if rest_frame and _begins_at_rest(points, values, joints):
            points = points[1:]
    clip = make_clip(path, fps, points)
    if told or how != How():
        what = "the joints of its hierarchy"
        clip = clip._replace(reading=Reading(what, how, unit or "by its arms", tuple(told)))
    return clip


def joint_positions(
    joints: list[Joint], values: np.ndarray, wanted: set[int]
) -> dict[int, np.ndarray]:
    """Where joints are, in the file's units and axes.

    Args:
        joints: parents before children.
        values: the motion's table, rotations in degrees, shape (n, n_channels).
        wanted: indices of the joints to place.

    Returns:
        Positions by joint index, each of shape (n, 3).
    """
    needed, inner = set(), set()
    for index in wanted:
        while index >= 0 and index not in needed:
            needed.add(index)
            index = joints[index].parent
            inner.add(index)
    turned: dict[int, np.ndarray | None] = {-1: None}  # (n, 3, 3); None is no rotation
    places: dict[int, np.ndarray] = {-1: np.zeros(3)}
    for index in sorted(needed):
        joint = joints[index]
        above = turned[joint.parent]
        offset, rotation = joint.offset, above if index in inner else None
        for column, (kind, axis) in enumerate(joint.channels, joint.column):
            if kind == "position":
                if offset.ndim == 1:
                    offset = np.tile(offset, (len(values), 1))  # (n, 3)
                offset[:, axis] = values[:, column]
            elif index in inner:
                step = about(axis, np.radians(values[:, column]))
                rotation = step if rotation is None else rotation @ step
        places[index] = places[joint.parent] + (offset if above is None else turn(above, offset))
        turned[index] = rotation
    return {index: np.broadcast_to(places[index], (len(values), 3)) for index in wanted}


def _hierarchy(path: Path | str, lines: list[bytes]) -> list[Joint]:
    words = [(word, line) for line, text in enumerate(lines, 1) for word in text.split()]
    words.append((b"", len(lines) + 1))  # the end, which nothing below accepts
    at = 0

    def expect(*wanted: bytes) -> bytes:
        nonlocal at
        word, line = words[at]
        found = next((one for one in wanted if one.upper() == word.upper()), None)
        if found is None:
            want = " or ".join(w.decode() for w in wanted)
            raise refusal(path, line, f"expected {want}, got {shown(word or b'the end')}")
        at += 1
        return found

    def values(count: int, what: str) -> list[float]:
        nonlocal at
        taken = words[at : at + count]
        if len(taken) < count:
            raise refusal(path, words[-1][1], f"the hierarchy ends within {what}")
        at += count
        return [number(path, line, word, what) for word, line in taken]

    expect(b"HIERARCHY")
    expect(b"ROOT")
    joints: list[Joint] = []
    open_joints: list[int] = []
    column = 0
    while True:
        name = []
        while words[at][0] not in (b"{", b""):
            name.append(printed(words[at][0]))
            at += 1
        line = words[at][1]
        expect(b"{")
        if not name or not _KEYWORDS.isdisjoint(name) or set("{}") & set("".join(name)):
            raise refusal(path, line, f"no name of a joint: {shown(' '.join(name))}")
        expect(b"OFFSET")
        offset = np.array(values(3, "OFFSET"))
        parent = open_joints[-1] if open_joints else -1
        channels = []
        if words[at][0].upper() == b"CHANNELS":
            at += 1
            word, line = words[at]
            count = integer(path, line, word, "number of channels")
            at += 1
            for word, line in words[at : at + min(count, 7)]:
                channel = _CHANNELS.get(word.decode("latin-1").lower())
                if channel is None or channel in channels:
                    raise refusal(path, line, f"no channel of this joint: {shown(word)}")
                channels.append(channel)
            if count > 6:
                raise refusal(path, line, f"a joint has at most 6 channels, got {count}")
            at += count
        open_joints.append(len(joints))
        joints.append(Joint(" ".join(name), parent, offset, tuple(channels), column))
        column += len(channels)
        while True:
            if not open_joints:
                if words[at][0] == b"":
                    return joints
                expect(b"MOTION")
            word = expect(b"JOINT", b"End", b"}")
            if word == b"JOINT":
                break
            if word == b"End":
                expect(b"Site")
                expect(b"{")
                expect(b"OFFSET")
                values(3, "OFFSET")
                expect(b"}")
            else:
                open_joints.pop()


def _motion(
    path: Path | str, lines: list[bytes], motion: int, columns: int, fps: float | None,
    ended: bool,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """The table of channel values (n, columns), and the rate [Hz]: fps, else of Frame Time."""
    head = [i for i in range(motion + 1, min(motion + 20, len(lines))) if lines[i].strip()][:2]
    if len(head) < 2:
        raise refusal(path, len(lines), "no Frames: and Frame Time: lines; a truncated file?")
    key, _, number = lines[head[0]].partition(b":")
    if key.upper().split() != [b"FRAMES"]:
        raise refusal(path, head[0] + 1, f"expected Frames:, got {shown(lines[head[0]])}")
    count = integer(path, head[0] + 1, number.strip(), "Frames")
    key, _, step = lines[head[1]].partition(b":")
    if key.upper().split() != [b"FRAME", b"TIME"]:
        raise refusal(path, head[1] + 1, f"expected Frame Time:, got {shown(lines[head[1]])}")
    rate = _rate(path, head[1] + 1, step.strip()) if fps is None else fps
    rows = lines[head[1] + 1 :]
    first = head[1] + 2  # line number of rows[0]
    kept = [row for row in rows if row.strip()] if not all(rows) else rows
    parts, n = [], 0
    for chunk in _chunks(kept):
        words = list(map(bytes.split, chunk))
        complete = set(map(len, words)) <= {columns, 0}  # 0: a line of blanks
        values = floats(chain.from_iterable(words)) if complete else None
        if values is None:
            _explain(path, rows, first, columns)
        parts.append(values)
        n += len(values) // columns if columns else 0
    why = f"Frames: {count}, but the file has {n}"
    if not n:
        raise refusal(path, head[0] + 1, f"{why}; a truncated file?")
    values = np.concatenate(parts).reshape(n, columns)
    cut = not ended and (n < count or _cut_short(lines[-1].split()))
    if n != count:
        log.warning("%s", refusal(path, head[0] + 1, f"{why} whole ones; these are read"))
    if cut:
        fewer = "its last number has fewer decimals than all others (no line end)"
        leave_out_last(path, n, f"{why} and ends within a line" if n < count else fewer)
    return values[: n - cut], rate


def _chunks(rows: list[bytes]) -> Iterator[list[bytes]]:
    """The rows in runs of about _CHUNK bytes, of one row at least."""
    begin = size = 0
    for end, row in enumerate(rows, 1):
        size += len(row)
        if size >= _CHUNK or end == len(rows):
            yield rows[begin:end]
            begin, size = end, 0


def _explain(path: Path | str, rows: list[bytes], first: int, columns: int) -> NoReturn:
    """Refuse the first row, numbered from `first`, that is not `columns` numbers."""
    for line, row in enumerate(rows, first):
        words = row.split()
        if len(words) not in (0, columns):
            raise refusal(path, line, f"a frame takes {columns} values, got {len(words)}")
        for word in words:
            number(path, line, word, "a channel value")
    raise AssertionError("a row was refused in bulk but not by itself")


def _cut_short(words: list[bytes]) -> bool:
    """Whether the last of these numbers alone has fewer decimals than the others, which agree."""
    decimals = [len(word.partition(b".")[2]) for word in words]
    return len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]


def _rate(path: Path | str, line: int, word: bytes) -> float:
    """1 / Frame Time, taken as whole [Hz] where the digits written allow it."""
    step = number(path, line, word, "Frame Time")
    low, high = FPS_RANGE
    if not 1.0 / high <= step <= 1.0 / low:
        raise refusal(
            path, line, f"Frame Time must be in [{1 / high:g}, {1 / low:g}] s, got {shown(word)}"
        )
    mantissa, _, exponent = word.lower().partition(b"e")
    digits = len(mantissa.partition(b".")[2]) - int(exponent or 0)
    whole = max(1, round(1.0 / step))
    return float(whole) if abs(1.0 / whole - step) <= 0.5000001 * 10.0**-digits else 1.0 / step


def _cmu(path: Path | str, own: float) -> tuple[float, list[str]]:
    """The rate [Hz] of a file that says `own`, and what is to be said about it."""
    known = cmu_rate(clip_name(path))
    if abs(own - CMU_FPS) > 0.5 or known == CMU_FPS:
        return own, []
    return known, [
        f"{known:g} Hz: CMU recorded this trial so, and its conversions say {CMU_FPS:g} "
        f"(else --fps {CMU_FPS:g})"
    ]


def _points(path: Path | str, joints: list[Joint], how: How) -> tuple[Named, list[int], bool]:
    """The joints of the ten points, refused unless they hang together as a body does.

    Returns:
        Triple (found, used, rest_frame): the layout of the used joints, their indices, and
        whether such files begin with a rest pose.
    """
    names = [joint.name for joint in joints]
    rig, found = match(names, how.names), by_names(names, how.names)
    if rig.missing:
        raise refusal(
            path, None,
            f"no joint for {', '.join(rig.missing)}; the file has {listed(names)}; say which is "
            "which: --names MAP",
        )  # fmt: skip
    if rig.doubled:
        raise refusal(path, None, f"more than one joint is called {listed(rig.doubled)}")
    for side in "rl":
        chain = [rig.joints[f"{side}_{p}"][0] for p in ("shoulder", "elbow", "hand")]
        for above, below in zip(chain, chain[1:], strict=False):
            parent = joints[below].parent
            while parent not in (above, -1):
                parent = joints[parent].parent
            if parent != above:
                raise refusal(path, None, f"{names[below]} does not hang on {names[above]}")
    used = found.used()
    return found.among(used), used, rig.rest_frame


def _placed(joints: list[Joint], values: np.ndarray, used: list[int]) -> np.ndarray:
    """Places of the used joints, (n, j, 3), in the file's unit and axes."""
    places = joint_positions(joints, values, set(used))
    return np.stack([places[j] for j in used], axis=1)


def _up(
    path: Path | str,
    joints: list[Joint],
    used: list[int],
    found: Named,
    at: np.ndarray,
    points: np.ndarray,
) -> tuple[str, list[str]]:
    still = [joint._replace(channels=()) for joint in joints]
    rest = pick(_placed(still, np.zeros((1, 0)), used), found.layout.points)[0]
    hip, neck = POINTS.index("hip"), POINTS.index("neck")
    return stance.up(
        path, rest[neck] - rest[hip], points[:, hip], points[:, neck], at, bool(found.layout.legs)
    )


def _unit(path: Path | str, points: np.ndarray) -> tuple[float, list[str]]:
    """Metres per file unit, from the length of the arms in one frame (10, 3)."""
    at = {name: points[i] for i, name in enumerate(POINTS)}
    arm = np.mean(
        [
            np.linalg.norm(at[f"{s}_elbow"] - at[f"{s}_shoulder"])
            + np.linalg.norm(at[f"{s}_hand"] - at[f"{s}_elbow"])
            for s in "rl"
        ]
    )
    for metres in UNITS.values():
        if ARM_RANGE[0] <= arm * metres <= ARM_RANGE[1]:
            return metres, []
    if not 1e-6 <= arm <= 1e9:
        raise refusal(path, None, f"an arm is {arm:g} units long; the file is damaged")
    words = f"an arm is {arm:g} units long and taken for {ARM:g} m: only directions matter"
    return ARM / float(arm), [words]


def _begins_at_rest(points: np.ndarray, values: np.ndarray, joints: list[Joint]) -> bool:
    """Whether frame 0 is a converter's rest pose: no root rotation and both arms sideways."""
    turns = [i for i, (kind, _) in enumerate(joints[0].channels) if kind == "rotation"]
    if len(points) < 2 or values[0, turns].any():
        return False
    for side in "rl":
        chain = [points[0, POINTS.index(f"{side}_{p}")] for p in ("shoulder", "elbow", "hand")]
        for tail, head in zip(chain, chain[1:], strict=False):
            bone = head - tail
            if not abs(bone[1]) >= REST_ARM * np.linalg.norm(bone):
                return False
    return True
