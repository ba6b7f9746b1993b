"""Biovision hierarchies (BVH): any channel order, several families of joint names.

A joint's rotation is the product of its rotation channels in the order listed; a position
channel, on whatever joint, replaces that component of OFFSET (LAFAN1 and Bandai-Namco files
would be wrong if it were added). Points of cgspeed files: the thorax bone is lost there, so
the neck lies lower than in the AMC; the pelvis points are the thighs, not the hip joints.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from s3le.errors import ParameterError
from s3le.human.clip import FPS_RANGE, Clip, make_clip, refuse_wild_angles
from s3le.human.rigs import Match, match
from s3le.human.rotation import about, turn
from s3le.human.text import (
    SMALL_BYTES,
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

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "cmu": 0.0254 / 0.45}  # [m] per file unit
ARM_RANGE = (0.3, 0.9)  # [m] shoulder to wrist, of a child and of a giant
REST_ARM = np.cos(np.radians(20.0))  # least |y| of the arms' directions in a T-pose
_CHANNELS = {f"{axis}{kind}": (kind, i) for i, axis in enumerate("xyz") for kind in
             ("position", "rotation")}
_CHUNK = 2**20  # [bytes] of frames split and converted at a time, which bounds their memory
_KEYWORDS = {"ROOT", "JOINT", "End", "OFFSET", "CHANNELS", "}"}


class Joint(NamedTuple):
    """One joint: name, index of its parent (-1: none), rest offset, channels, first column."""

    name: str
    parent: int
    offset: np.ndarray
    channels: tuple[tuple[str, int], ...]
    column: int


def read_bvh(path: Path | str, fps: float | None = None, unit: str | None = None) -> Clip:
    """Read a motion and place the ten points in every frame.

    The unit, where it is not given, is the one of UNITS in which the arm (shoulder to elbow
    to hand, mean of both sides, first frame) is ARM_RANGE long; the ranges do not overlap.
    Y is up, unless the rest pose has the neck above the hip along z and the clip agrees. The
    rest pose that cgspeed's converters put in front is dropped where it is there: root not
    rotated at all, both arms within 20 deg of the left-right axis.

    A last line without a line end is read: Frames says whether it is all there. If its last
    number alone has fewer decimals than the others, it was cut, and the last frame is left out.

    Args:
        path: .bvh or .bvh.gz.
        fps: frames per second [Hz], instead of the file's Frame Time, which is wrong in
            conversions of CMU's 60 Hz trials.
        unit: a key of UNITS, instead of the guess.

    Returns:
        Clip in metres, z up.

    Raises:
        ClipError: with file, line and token, anything but one hierarchy and the announced
            number of complete frames of finite numbers; or joints of no known family, with
            the points not found and the names that the file has; or an unknown size.
        ParameterError: fps is no sensible rate, unit is not a key of UNITS.
    """
    if unit is not None and unit not in UNITS:
        raise ParameterError(f"unit must be one of {', '.join(UNITS)}, got {unit!r}")
    data = read_bytes(path)
    require(path, data, "BVH text")
    lines = split_lines(path, data)
    motion = next((i for i, line in enumerate(lines) if line.strip() == b"MOTION"), None)
    if motion is None:
        raise refusal(path, len(lines), "no MOTION line; a truncated file?")
    if sum(map(len, lines[:motion])) > SMALL_BYTES:
        raise refusal(path, motion + 1, f"a hierarchy of more than {SMALL_BYTES} bytes")
    joints = _hierarchy(path, lines[:motion])
    found = _points(path, joints)
    columns = sum(len(joint.channels) for joint in joints)
    values, own_fps = _motion(path, lines, motion, columns, read_rate=fps is None)
    if not data[-1:].isspace() and _cut_short(lines[-1].split()):
        why = "its last number has fewer decimals than all others (no line end)"
        leave_out_last(path, len(values), why)
        values = values[:-1]
    turns = [kind == "rotation" for joint in joints for kind, _ in joint.channels]
    refuse_wild_angles(path, np.radians(values[:, turns]))
    with np.errstate(over="ignore", invalid="ignore"):  # make_clip refuses what comes of it
        places = joint_positions(joints, values, set(found.joints.values()))
        points = np.stack([places[found.joints[p]] for p in POINTS], axis=1)  # (n, 10, 3)
        scale = UNITS[unit] if unit is not None else _unit(path, points[0])
        points = _z_up(points, joints, found) * scale
        if found.family.rest_frame and _begins_at_rest(points, values, joints):
            points = points[1:]
    return make_clip(path, own_fps if fps is None else fps, points)


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
        if word not in wanted:
            want = " or ".join(w.decode() for w in wanted)
            raise refusal(path, line, f"expected {want}, got {shown(word or b'the end')}")
        at += 1
        return word

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
            name.append(words[at][0].decode("latin-1"))
            at += 1
        line = words[at][1]
        expect(b"{")
        if not name or not _KEYWORDS.isdisjoint(name) or set("{}") & set("".join(name)):
            raise refusal(path, line, f"no name of a joint: {shown(' '.join(name))}")
        expect(b"OFFSET")
        offset = np.array(values(3, "OFFSET"))
        parent = open_joints[-1] if open_joints else -1
        channels = []
        if words[at][0] == b"CHANNELS":
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
    path: Path | str, lines: list[bytes], motion: int, columns: int, read_rate: bool
) -> tuple[np.ndarray, float | None]:
    """The table of channel values (n, columns), and the rate [Hz] of Frame Time if asked for."""
    head = [i for i in range(motion + 1, min(motion + 20, len(lines))) if lines[i].strip()][:2]
    if len(head) < 2:
        raise refusal(path, len(lines), "no Frames: and Frame Time: lines; a truncated file?")
    key, _, count = lines[head[0]].partition(b":")
    if key.split() != [b"Frames"]:
        raise refusal(path, head[0] + 1, f"expected Frames:, got {shown(lines[head[0]])}")
    count = integer(path, head[0] + 1, count.strip(), "Frames")
    key, _, step = lines[head[1]].partition(b":")
    if key.split() != [b"Frame", b"Time"]:
        raise refusal(path, head[1] + 1, f"expected Frame Time:, got {shown(lines[head[1]])}")
    rate = _rate(path, head[1] + 1, step.strip()) if read_rate else None
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
    if n != count or not n:
        why = f"Frames: {count}, but the file has {n}; a truncated file?"
        raise refusal(path, head[0] + 1, why)
    return np.concatenate(parts).reshape(n, columns), rate


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
        raise refusal(path, line, f"Frame Time must be in [{1 / high:g}, {1 / low:g}] s, "
                                  f"got {shown(word)}")
    mantissa, _, exponent = word.lower().partition(b"e")
    digits = len(mantissa.partition(b".")[2]) - int(exponent or 0)
    whole = max(1, round(1.0 / step))
    return float(whole) if abs(1.0 / whole - step) <= 0.5000001 * 10.0**-digits else 1.0 / step


def _points(path: Path | str, joints: list[Joint]) -> Match:
    """The joints of the ten points, refused unless they hang together as a body does."""
    names = [joint.name for joint in joints]
    found = match(names)
    if found.missing:
        wanted = "; ".join(
            f"{p} (as {' or '.join(found.family.candidates(p))})" for p in found.missing
        )
        raise refusal(path, None, f"no joint for {wanted}; the file has {listed(names)}")
    if found.doubled:
        raise refusal(path, None, f"more than one joint is called {listed(found.doubled)}")
    for side in "rl":
        chain = [found.joints[p] for p in ("hip", f"{side}_shoulder", f"{side}_elbow",
                                           f"{side}_hand")]
        for above, below in zip(chain, chain[1:], strict=False):
            parent = joints[below].parent
            while parent not in (above, -1):
                parent = joints[parent].parent
            if parent != above:
                raise refusal(path, None, f"{names[below]} does not hang on {names[above]}")
    return found


def _unit(path: Path | str, points: np.ndarray) -> float:
    """Metres per file unit, from the length of the arms in one frame (10, 3)."""
    at = {name: points[i] for i, name in enumerate(POINTS)}
    arm = np.mean([
        np.linalg.norm(at[f"{s}_elbow"] - at[f"{s}_shoulder"])
        + np.linalg.norm(at[f"{s}_hand"] - at[f"{s}_elbow"])
        for s in "rl"
    ])
    for metres in UNITS.values():
        if ARM_RANGE[0] <= arm * metres <= ARM_RANGE[1]:
            return metres
    raise refusal(path, None, f"an arm is {arm:g} units long, which is no arm in "
                              f"{', '.join(UNITS)}; give the unit")


def _z_up(points: np.ndarray, joints: list[Joint], found: Match) -> np.ndarray:
    """Points (n, 10, 3) with z up and x forward, from y up or, where the file says so, z up."""
    rest = joint_positions(
        [joint._replace(channels=()) for joint in joints], np.zeros((1, 0)),
        {found.joints["hip"], found.joints["neck"]},
    )
    trunk = (rest[found.joints["neck"]] - rest[found.joints["hip"]])[0]
    moving = (points[:, POINTS.index("neck")] - points[:, POINTS.index("hip")]).mean(axis=0)
    if trunk[2] > 0.8 * np.linalg.norm(trunk) and moving[2] > moving[1]:
        return np.stack([-points[..., 1], points[..., 0], points[..., 2]], axis=-1)
    return points[..., [2, 0, 1]]


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
