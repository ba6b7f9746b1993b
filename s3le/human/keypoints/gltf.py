"""glTF 2.0 and GLB: the animation of a skeleton as places of its named joints.

Only what places joints is read: nodes, their animation, and the numbers for these. Keys of all
joints are sampled at one rate (gltf_keys). In a VRM animation (.vrma) its extension says which node
is which bone. Source: the glTF 2.0 specification of Khronos, and VRMC_vrm_animation of the VRM
consortium; y up, z forward, metres.
"""

import base64
import binascii
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import ClipError
from s3le.human.keypoints import gltf_keys
from s3le.human.keypoints.clocks import Clock
from s3le.human.keypoints.found import Found
from s3le.human.keypoints.gltf_keys import LINEAR, SPLINE, STEP, Keys
from s3le.human.keypoints.how import How
from s3le.human.keypoints.layouts import by_names, pick
from s3le.human.keypoints.upright import scale_of
from s3le.human.keypoints.written import read_json
from s3le.human.rotation import from_quaternion
from s3le.human.text import MAX_BYTES, listed, read_bytes, refusal

MOST_NODES = 10_000
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_PATHS = {"translation": 3, "rotation": 4, "scale": 3}
_VRM = "VRMC_vrm_animation"  # the extension that names bones
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


def read_gltf(path: Path | str, how: How) -> Found:
    """The joints of the one skeleton whose names are known, through one animation.

    Args:
        path: .glb, .vrma, or .gltf with its buffers inside or in files beside it.
        how: which animation, by name or number, and what the file calls our joints.

    Raises:
        ClipError: damage, no skeleton with known names, no animation, or several of which none
            is chosen.
    """
    path = Path(path)
    data = read_bytes(path)
    try:
        tree, binary = _container(path, data)
        buffers = [_buffer(path, one, binary) for one in tree.get("buffers", [])]
        return _motion(path, tree, buffers, how)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as damage:
        words = (str(damage).splitlines() or [""])[0][:120]
        raise refusal(path, None, f"is no sound glTF ({type(damage).__name__}: {words})") from None


def beside(path: Path) -> list[Path]:
    """The files beside a scene that hold its buffers; none of a scene that cannot be read."""
    try:
        tree, _ = _container(path, read_bytes(path))
        named = [str(one.get("uri", "")) for one in tree.get("buffers", [])]
    except (ClipError, TypeError, AttributeError):
        return []
    named = [uri for uri in named if uri and not uri.startswith("data:")]
    return [path.with_name(uri) for uri in named if Path(uri).name == uri]


def _container(path: Path, data: bytes) -> tuple[Any, bytes]:
    """The JSON of a file, and the buffer that is in it."""
    binary = b""
    if path.suffix.lower() == ".glb" or data[:4] == b"glTF":
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
    return read_json(path, data), binary


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


def _motion(path: Path, tree: Mapping, buffers: list[bytes], how: How) -> Found:
    nodes = tree.get("nodes", [])
    if not 0 < len(nodes) <= MOST_NODES:
        raise refusal(path, None, f"{len(nodes)} nodes, wanted 1 to {MOST_NODES}")
    parent: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parent.setdefault(_whole(child), number) != number or child >= len(nodes):
                raise refusal(path, None, f"node {child} has two parents, or is not there")
    names, given = [str(node.get("name", f"node {i}")) for i, node in enumerate(nodes)], how.names
    groups = [skin["joints"] for skin in tree.get("skins", [])] or [list(range(len(nodes)))]
    if bones := _bones(tree, len(nodes)):
        names = [bones.get(i, name) for i, name in enumerate(names)]
        groups = [list(bones)]
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
    own = {node for chain in chains.values() for node in chain}
    number = _chosen(path, tree.get("animations", []), own, how)
    keys = _keys(path, tree, buffers, tree["animations"][number], own)
    time, fps, told = gltf_keys.times(path, keys.values())
    local: dict[int, np.ndarray] = {}
    world: dict[int, np.ndarray] = {}
    for chain in chains.values():
        for above, node in zip((None, *chain), chain, strict=False):
            if node not in world:
                local[node] = _local(nodes[node], {p: keys.get((node, p)) for p in _PATHS}, time)
                world[node] = local[node] if above is None else world[above] @ local[node]
    at = np.stack([world[joints[j]][:, :3, 3] for j in used], axis=1)
    what = "the joints of its skeleton"
    if len(tree["animations"]) > 1:
        what += f" in animation {number}, {_name(tree['animations'][number], number)!r:.60}"
    layout = named.among(used).layout
    if (scale := scale_of(pick(at, layout.points))) != 1.0:
        what += ", scaled to a person's size (only directions matter)"
    return Found(
        at * scale, tuple(names[joints[j]] for j in used), None, Clock(fps), what, axes="y-up",
        told=(told,) if told else (), by_name=layout,
    )  # fmt: skip


def _bones(tree: Mapping, count: int) -> dict[int, str]:
    """Which node is which bone, where a VRM animation says it."""
    given = tree.get("extensions", {}).get(_VRM, {}).get("humanoid", {}).get("humanBones", {})
    bones = {_whole(one["node"]): str(name) for name, one in given.items()}
    if len(bones) < len(given) or any(node >= count for node in bones):
        raise ValueError("two bones are one node, or a bone is none")
    return bones


def _chain(path: Path, parent: Mapping[int, int], node: int) -> list[int]:
    """A node and all above it, the highest first."""
    chain = [node]
    while chain[-1] in parent:
        chain.append(parent[chain[-1]])
        if len(chain) > 1000:
            raise refusal(path, None, "its nodes hang on each other in a circle, or too deep")
    return chain[::-1]


def _name(animation: Mapping, number: int) -> str:
    return str(animation.get("name", number))


def _chosen(path: Path, animations: list[Mapping], wanted: set[int], how: How) -> int:
    """The number of the animation that is meant, among those that move any of the wanted nodes."""
    moving = [
        number for number, animation in enumerate(animations)
        if any(c["target"].get("node") in wanted and c["target"]["path"] in _PATHS
               for c in animation["channels"])
    ]  # fmt: skip
    if not moving:
        raise refusal(path, None, "no animation moves its skeleton")
    there = listed(f"{i} {_name(animations[i], i)}" for i in moving)
    if how.animation is None:
        if len(moving) > 1:
            why = f"holds {len(moving)} animations ({there}); choose: --animation NAME or NUMBER"
            raise refusal(path, None, why)
        return moving[0]
    named = [i for i in moving if _name(animations[i], i) == how.animation]
    if len(named) > 1:
        raise refusal(path, None, f"two animations have that name ({there}); give its number")
    numbered = [i for i in moving if str(i) == how.animation]
    if not named and not numbered:
        raise refusal(path, None, f"holds no animation {how.animation!r:.60}; there: {there}")
    return (named or numbered)[0]


def _keys(
    path: Path, tree: Mapping, buffers: list[bytes], animation: Mapping, wanted: set[int]
) -> dict[tuple[int, str], Keys]:
    """The keys of the wanted nodes in an animation."""
    keys = {}
    for channel in animation["channels"]:
        node, what = channel["target"].get("node"), channel["target"]["path"]
        if node not in wanted or what not in _PATHS:
            continue
        sampler = animation["samplers"][_whole(channel["sampler"])]
        how = sampler.get("interpolation", LINEAR)
        if how not in (LINEAR, STEP, SPLINE):
            raise refusal(path, None, f"interpolates by {how[:20]}; export it with sampled keys")
        time = _numbers(path, tree, buffers, sampler["input"])[:, 0]
        value = _numbers(path, tree, buffers, sampler["output"])
        each = 3 if how == SPLINE else 1
        if value.shape != (each * len(time), _PATHS[what]) or not (np.diff(time) > 0.0).all():
            raise refusal(path, None, f"keys of {what} that do not rise in time or lack values")
        if each == 3:
            value = value.reshape(len(time), 3, -1)
        keys[node, what] = Keys(time, value, how, what == "rotation")
    return keys


def _local(node: Mapping, keys: Mapping[str, Keys | None], time: np.ndarray) -> np.ndarray:
    """A node's transform to its parent at moments, (n, 4, 4)."""
    made = np.zeros((len(time), 4, 4)) + np.eye(4)
    if "matrix" in node and not any(keys.values()):
        made[:] = np.array(node["matrix"], float).reshape(4, 4).T
        return made
    place, turn, scale = (
        np.broadcast_to(_rest(node, what), (len(time), width)) if (moved := keys[what]) is None
        else gltf_keys.sampled(moved, time)
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


def _matrix(xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices of quaternions, scalar last, (n, 3, 3)."""
    length = np.linalg.norm(xyzw, axis=1, keepdims=True)
    if not (np.abs(length - 1.0) < 0.1).all():
        raise ValueError("a rotation is no unit quaternion")
    return from_quaternion((xyzw / length)[:, [3, 0, 1, 2]])
