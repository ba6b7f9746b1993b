"""glTF 2.0 and GLB: the animation of a skeleton as places of its named joints.

Only what places joints is read: nodes, their animation, and the numbers for these. Keys of all
joints are sampled at one rate, positions and scales linearly, rotations along the shortest arc.
Source: the glTF 2.0 specification of Khronos; y up, z forward, metres.
"""

import base64
import binascii
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.mocap.clip import FPS_RANGE
from s3le.mocap.keypoints.found import Found
from s3le.mocap.keypoints.layouts import by_names, pick
from s3le.mocap.keypoints.upright import scale_of
from s3le.mocap.keypoints.written import read_json
from s3le.mocap.rotation import from_quaternion
from s3le.mocap.text import MAX_BYTES, listed, read_bytes, refusal

MOST_NODES = 10_000
MOST_FRAMES = 200_000
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_PATHS = {"translation": 3, "rotation": 4, "scale": 3}
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


class _Keys(NamedTuple):
    """The keys of one path of one node."""

    time: np.ndarray  # [s], (k,), rising
    value: np.ndarray  # (k, 3 or 4)
    step: bool


def read_gltf(path: Path | str, names: Mapping[str, str] | None = None) -> Found:
    """The joints of the one skeleton whose names are known, through its one animation.

    Args:
        path: .glb, or .gltf with its buffers inside or in files beside it.
        names: what the file calls our joints, as rigs.match takes it.

    Raises:
        ClipError: damage, no skeleton with known names, no animation or several, splines.
    """
    path = Path(path)
    data = read_bytes(path)
    try:
        tree, buffers = _container(path, data)
        return _motion(path, tree, buffers, names)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as damage:
        words = (str(damage).splitlines() or [""])[0][:120]
        raise refusal(path, None, f"is no sound glTF ({type(damage).__name__}: {words})") from None


def _container(path: Path, data: bytes) -> tuple[Any, list[bytes]]:
    """The JSON of a file and its buffers."""
    binary = b""
    if path.suffix.lower() == ".glb":
        if len(data) < _HEAD.size or data[:4] != b"glTF":
            raise refusal(path, None, "is no GLB (its first bytes are not glTF)")
        _, version, length = _HEAD.unpack_from(data)
        if version != 2 or length != len(data):
            raise refusal(
                path, None, f"version {version} of {length} bytes, wanted 2 of {len(data)}"
            )
        at, chunks = _HEAD.size, []
        while at < length:
            size, kind = _CHUNK.unpack_from(data.ljust(at + _CHUNK.size, b"\0"), at)
            at += _CHUNK.size
            if at + size > length:
                raise refusal(path, None, f"a chunk of {size} bytes, the file has {length - at}")
            chunks.append((kind, data[at : at + size]))
            at += size
        if not chunks or chunks[0][0] != b"JSON":
            raise refusal(path, None, "is no GLB (its first chunk is not JSON)")
        data = chunks[0][1].rstrip(b" \0")
        binary = next((content for kind, content in chunks if kind == b"BIN\0"), b"")
    tree = read_json(path, data)
    return tree, [_buffer(path, one, binary) for one in tree.get("buffers", [])]


def _buffer(path: Path, one: Mapping, binary: bytes) -> bytes:
    uri = one.get("uri")
    if uri is None:
        return binary
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise refusal(path, None, f"a buffer in it is no base64 ({error})") from None
    if Path(uri).name != uri:
        raise refusal(path, None, f"its buffer {uri[:60]!r} is not beside it; nothing else is read")
    return read_bytes(path.with_name(uri), MAX_BYTES)


def _numbers(path: Path, tree: Mapping, buffers: list[bytes], number: int) -> np.ndarray:
    """The numbers of an accessor, float64 of shape (count, width)."""
    one = tree["accessors"][_whole(number)]
    view = tree["bufferViews"][_whole(one["bufferView"])]
    dtype, width = np.dtype(_TYPES[one["componentType"]]), _WIDTH[one["type"]]
    if "sparse" in one or (dtype.kind != "f" and not one.get("normalized")):
        raise refusal(path, None, "holds numbers in a form that is not read (sparse, whole)")
    data = buffers[_whole(view["buffer"])]
    begin, size = _whole(view.get("byteOffset", 0)), _whole(view["byteLength"])
    data = data[begin : begin + size][_whole(one.get("byteOffset", 0)) :]
    count, row = _whole(one["count"]), dtype.itemsize * width
    stride = _whole(view.get("byteStride", row)) or row
    if stride < row or not count or (count - 1) * stride + row > len(data):
        raise refusal(path, None, f"an accessor of {count} rows, its bytes end before")
    table = np.ndarray((count, width), dtype, data, 0, (stride, dtype.itemsize))
    with np.errstate(invalid="ignore"):  # what is not finite is refused below
        table = table.astype(float)
    if dtype.kind != "f":
        table = np.maximum(table / np.iinfo(dtype).max, -1.0)
    if not np.isfinite(table).all():
        raise refusal(path, None, "holds numbers that are not finite")
    return table


def _whole(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r:.30} is no index or size")
    return value


def _motion(
    path: Path, tree: Mapping, buffers: list[bytes], given: Mapping[str, str] | None
) -> Found:
    nodes = tree.get("nodes", [])
    if not 0 < len(nodes) <= MOST_NODES:
        raise refusal(path, None, f"{len(nodes)} nodes, wanted 1 to {MOST_NODES}")
    parent = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parent.setdefault(_whole(child), number) != number or child >= len(nodes):
                raise refusal(path, None, f"node {child} has two parents, or is not there")
    names = [str(node.get("name", f"node {i}")) for i, node in enumerate(nodes)]
    groups = [skin["joints"] for skin in tree.get("skins", [])] or [list(range(len(nodes)))]
    groups = [list(group) for group in {tuple(map(_whole, group)): None for group in groups}]
    if given:  # a group that lacks what is stated is not the one meant
        stated = [g for g in groups if {names[i] for i in g} >= set(given.values())]
        groups = stated or groups
    able = [g for g in groups if not by_names([names[i] for i in g], given).missing]
    if len(able) != 1:
        why = "several skeletons" if able else "no skeleton whose joints have known names"
        there = listed(names[i] for group in groups[:3] for i in group)
        raise refusal(
            path, None, f"holds {why}; its joints: {there}; say which is which: --names MAP"
        )
    joints, named = able[0], by_names([names[i] for i in able[0]], given)
    used = named.used()
    chains = {joints[j]: _chain(path, parent, joints[j]) for j in used}
    keys = _keys(path, tree, buffers, {node for chain in chains.values() for node in chain})
    time, fps = _times(path, keys)
    local: dict[int, np.ndarray] = {}
    world: dict[int, np.ndarray] = {}
    for chain in chains.values():
        for above, node in zip((None, *chain), chain, strict=False):
            if node not in world:
                local[node] = _local(nodes[node], {p: keys.get((node, p)) for p in _PATHS}, time)
                world[node] = local[node] if above is None else world[above] @ local[node]
    at = np.stack([world[joints[j]][:, :3, 3] for j in used], axis=1)
    own = tuple(names[joints[j]] for j in used)
    layout, what = named.among(used).layout, "the joints of its skeleton"
    if (scale := scale_of(pick(at, layout.points))) != 1.0:
        what += ", scaled to a person's size (only directions matter)"
    return Found(at * scale, own, None, fps, None, what, None, None, "y-up", layout)


def _chain(path: Path, parent: Mapping[int, int], node: int) -> list[int]:
    """A node and all above it, the highest first."""
    chain = [node]
    while chain[-1] in parent:
        chain.append(parent[chain[-1]])
        if len(chain) > 1000:
            raise refusal(path, None, "its nodes hang on each other in a circle, or too deep")
    return chain[::-1]


def _keys(
    path: Path, tree: Mapping, buffers: list[bytes], wanted: set[int]
) -> dict[tuple[int, str], _Keys]:
    """The keys of the wanted nodes in the one animation that moves any of them."""
    moved = []
    for animation in tree.get("animations", []):
        own = {}
        for channel in animation["channels"]:
            node, what = channel["target"].get("node"), channel["target"]["path"]
            if node in wanted and what in _PATHS:
                own[node, what] = animation["samplers"][_whole(channel["sampler"])]
        if own:
            moved.append((str(animation.get("name", len(moved))), own))
    if len(moved) > 1:
        there = listed(name for name, _ in moved)
        raise refusal(path, None, f"holds {len(moved)} animations ({there}); keep one in the file")
    if not moved:
        raise refusal(path, None, "no animation moves its skeleton")
    keys = {}
    for (node, what), sampler in moved[0][1].items():
        how = sampler.get("interpolation", "LINEAR")
        if how not in ("LINEAR", "STEP"):
            raise refusal(path, None, f"interpolates by {how[:20]}; export it with sampled keys")
        time = _numbers(path, tree, buffers, sampler["input"])[:, 0]
        value = _numbers(path, tree, buffers, sampler["output"])
        if value.shape != (len(time), _PATHS[what]) or not (np.diff(time) > 0.0).all():
            raise refusal(path, None, f"keys of {what} that do not rise in time or lack values")
        keys[node, what] = _Keys(time, value, how == "STEP")
    return keys


def _times(path: Path, keys: Mapping[Any, _Keys]) -> tuple[np.ndarray, float]:
    """Moments [s] from the first key to the last, at the rate of the densest keys."""
    steps = [np.median(np.diff(own.time)) for own in keys.values() if len(own.time) > 1]
    if not steps:
        return np.zeros(1), 1.0  # one pose has no rate
    rate = 1.0 / float(min(steps))
    if abs(round(rate) - rate) <= 1e-2 * rate and round(rate):
        rate = float(round(rate))
    first = min(own.time[0] for own in keys.values())
    span = max(own.time[-1] for own in keys.values()) - first
    if not FPS_RANGE[0] <= rate <= FPS_RANGE[1] or span * rate > MOST_FRAMES:
        raise refusal(path, None, f"{span * rate:.0f} frames at {rate:g} Hz by its keys")
    return first + np.arange(int(span * rate + 1e-3) + 1) / rate, rate


def _local(node: Mapping, keys: Mapping[str, _Keys | None], time: np.ndarray) -> np.ndarray:
    """A node's transform to its parent at moments, (n, 4, 4)."""
    made = np.zeros((len(time), 4, 4)) + np.eye(4)
    if "matrix" in node and not any(keys.values()):
        made[:] = np.array(node["matrix"], float).reshape(4, 4).T
        return made
    place, turn, scale = (
        np.broadcast_to(_rest(node, what), (len(time), width)) if keys[what] is None
        else _sampled(keys[what], time, what == "rotation")
        for what, width in _PATHS.items()
    )  # fmt: skip
    made[:, :3, :3] = _matrix(turn) * scale[:, None, :]
    made[:, :3, 3] = place
    return made


def _rest(node: Mapping, what: str) -> np.ndarray:
    value = np.array(node.get(what, _REST[what]), float)
    if value.shape != (_PATHS[what],) or not np.isfinite(value).all():
        raise ValueError(f"a node's {what} is {value.shape}")
    return value


def _sampled(keys: _Keys, time: np.ndarray, rotation: bool) -> np.ndarray:
    """Values at moments; before the first and after the last key they stand."""
    if len(keys.time) == 1:
        return np.repeat(keys.value, len(time), axis=0)
    left = np.clip(np.searchsorted(keys.time, time + 1e-6, "right") - 1, 0, len(keys.time) - 2)
    span = keys.time[left + 1] - keys.time[left]
    share = np.clip((time - keys.time[left]) / span, 0.0, 1.0)[:, None]
    if keys.step:
        share = np.floor(share + 1e-6)
    a, b = keys.value[left], keys.value[left + 1]
    if not rotation:
        return (1.0 - share) * a + share * b
    cos = (a * b).sum(axis=1, keepdims=True)
    b = np.where(cos < 0.0, -b, b)  # the shorter way
    angle = np.arccos(np.clip(np.abs(cos), 0.0, 1.0))
    sin = np.sin(angle)
    near = sin < 1e-6
    safe = np.where(near, 1.0, sin)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    return first * a + np.where(near, share, np.sin(share * angle) / safe) * b


def _matrix(xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices of quaternions, scalar last, (n, 3, 3)."""
    length = np.linalg.norm(xyzw, axis=1, keepdims=True)
    if not (np.abs(length - 1.0) < 0.1).all():
        raise ValueError("a rotation is no unit quaternion")
    return from_quaternion((xyzw / length)[:, [3, 0, 1, 2]])
