import base64
import json
import struct

import bodies
import numpy as np
import pytest
from test_keypoints import same

from s3le.errors import ClipError
from s3le.mocap.keypoints import smpl
from s3le.mocap.keypoints.how import How
from s3le.mocap.read import read_clip

NAMES = ("Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot",
         "RightFoot", "Spine2", "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder",
         "RightShoulder", "Head", "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftHand",
         "RightHand")  # fmt: skip
PARENT = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
POSE = bodies.pose(9)
BODY = bodies.body(9)


def quaternions(vectors):
    """xyzw of axis times angle (n, 3)."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = vectors / np.maximum(angle, 1e-12)
    return np.concatenate([axis * np.sin(angle / 2), np.cos(angle / 2)], axis=1)


def scene(rate=25.0, scale=1.0, prefix="mixamorig:", interpolation="LINEAR"):
    """A skinned body that moves as bodies.pose: its tree and its buffer."""
    rest = smpl.joints(np.zeros((1, 72)))[0]
    nodes, chunks, views, accessors, samplers, channels = [], [], [], [], [], []

    def numbers(table, kind):
        data = np.asarray(table, "<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": sum(map(len, chunks)), "byteLength": len(data)})
        chunks.append(data)
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "type": kind,
                          "count": len(table)})  # fmt: skip
        return len(accessors) - 1

    time = numbers(np.arange(len(POSE)) / rate, "SCALAR")
    for i, name in enumerate(NAMES):
        offset = rest[i] - (rest[PARENT[i]] if i else 0.0)
        nodes.append({"name": prefix + name, "translation": (offset / scale).tolist(),
                      "children": [j for j, p in enumerate(PARENT) if p == i]})  # fmt: skip
        turn = numbers(quaternions(POSE[:, 3 * i : 3 * i + 3]), "VEC4")
        samplers.append({"input": time, "output": turn, "interpolation": interpolation})
        channels.append({"sampler": i, "target": {"node": i, "path": "rotation"}})
    nodes.append({"name": "Armature", "children": [0], "scale": [scale] * 3})
    tree = {
        "asset": {"version": "2.0"}, "nodes": nodes, "skins": [{"joints": list(range(22))}],
        "animations": [{"name": "dance", "channels": channels, "samplers": samplers}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, chunks))}],
    }  # fmt: skip
    return tree, b"".join(chunks)


def packed(tree, binary):
    """A GLB."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    whole = struct.pack("<I4s", len(text), b"JSON") + text
    whole += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(whole)) + whole


@pytest.mark.parametrize("scale", [1.0, 0.01])
@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig", ""])
def test_a_skeleton_that_moves_is_a_clip(tmp_path, scale, prefix):
    path = tmp_path / "dance.glb"
    path.write_bytes(packed(*scene(scale=scale, prefix=prefix)))
    clip = read_clip(path)
    assert clip.fps == 25.0 and len(clip.points) == 9 and clip.reading.how.axes == "y-up"
    same(clip, BODY, within=1e-4, trunk=1e-4)


def test_buffers_may_be_inside_or_beside_but_nowhere_else(tmp_path):
    tree, binary = scene()
    path = tmp_path / "a.gltf"
    (tmp_path / "a.bin").write_bytes(binary)
    inside = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    for uri in ("a.bin", inside):
        tree["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(tree))
        same(read_clip(path), BODY, within=1e-4, trunk=1e-4)
    for uri in ("../a.bin", "/etc/passwd", "http://x/y", "data:;base64,%%", ".."):
        tree["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(tree))
        with pytest.raises(ClipError, match="not beside it|no base64|is a folder"):
            read_clip(path)


def test_keys_at_other_times_are_met_along_the_shortest_arc(tmp_path):
    tree, binary = scene(rate=5.0)
    path = tmp_path / "a.glb"
    dense = np.arange(17, dtype="<f4") / 10  # one joint has keys twice as often
    tree["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(binary), "byteLength": 68},
        {"buffer": 0, "byteOffset": len(binary) + 68, "byteLength": 272},
    ]
    tree["accessors"] += [
        {"bufferView": len(tree["bufferViews"]) - 2 + i, "componentType": 5126, "type": kind,
         "count": 17} for i, kind in enumerate(("SCALAR", "VEC4"))
    ]  # fmt: skip
    still = np.tile(quaternions(POSE[:1, 3:6]), (17, 1)).astype("<f4")
    count = len(tree["accessors"])
    tree["animations"][0]["samplers"][1] = {"input": count - 2, "output": count - 1}
    path.write_bytes(packed(tree, binary + dense.tobytes() + still.tobytes()))
    clip = read_clip(path)
    assert clip.fps == 10.0 and len(clip.points) == 17
    same(clip._replace(points=clip.points[::2]), BODY, within=1e-4, trunk=1e-4)
    turned = np.diff(clip.points[:, 6], axis=0)  # a hand's steps do not jump between keys
    assert np.linalg.norm(turned, axis=1).max() < 2.0 * np.linalg.norm(turned, axis=1).mean()


def change(place, value):
    def done(tree):
        *way, last = place
        for key in way:
            tree = tree[key]
        if value is None:
            del tree[last]
        else:
            tree[last] = value

    return done


@pytest.mark.parametrize(
    ("how", "why"),
    [
        (change(["nodes", 16, "name"], "Thing"), "no skeleton whose joints have known names"),
        (change(["nodes", 16, "children"], [0]), "two parents|circle"),
        (change(["nodes", 20, "children"], [22]), "circle"),
        (change(["nodes", 16, "children"], [99]), "not there"),
        (change(["nodes"], []), "0 nodes"),
        (change(["accessors", 1, "count"], 10**9), "its bytes end before"),
        (change(["accessors", 1, "count"], -1), "no sound glTF"),
        (change(["accessors", 1, "type"], "MAT4"), "no sound glTF"),
        (change(["accessors", 1, "componentType"], 5121), "form that is not read"),
        (change(["accessors", 1, "sparse"], {}), "form that is not read"),
        (change(["bufferViews", 1, "byteStride"], 4), "its bytes end before"),
        (change(["bufferViews", 1, "buffer"], 7), "no sound glTF"),
        (change(["animations", 0, "samplers", 3, "interpolation"], "CUBICSPLINE"), "sampled keys"),
        (change(["animations", 0, "samplers", 3, "input"], 1), "no sound|do not rise"),
        (change(["animations", 0, "channels"], None), "no sound glTF"),
        (change(["animations"], None), "no animation moves its skeleton"),
        (change(["nodes", 0, "translation"], [1, 2]), "no sound glTF"),
        (change(["nodes", 22, "scale"], [1e30] * 3), "not one of|no person's|no body"),
        (lambda tree: tree["animations"].append(tree["animations"][0]), "holds 2 animations"),
        (lambda tree: tree["skins"].append({"joints": list(range(23))}), "several skeletons"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(tmp_path, how, why):
    tree, binary = scene()
    how(tree)
    path = tmp_path / "a.glb"
    path.write_bytes(packed(tree, binary))
    with pytest.raises(ClipError, match=why) as error:
        read_clip(path)
    assert str(path) in str(error.value)


def test_damaged_containers_are_refused(tmp_path):
    good = packed(*scene())
    path = tmp_path / "a.glb"
    for data in (b"", good[:11], good[:400], good[:-1], good[:8] + good[12:], b"glTF" + good[:99],
                 good[:12] + b"\xff\xff\xff\xff" + good[16:], b"{}"):  # fmt: skip
        path.write_bytes(data)
        with pytest.raises(ClipError, match="a.glb"):
            read_clip(path)


@pytest.mark.parametrize("size", [0.003, 6.0, 8.0, 2e4])
def test_a_skeleton_in_no_unit_is_scaled_to_a_person_and_said(tmp_path, size):
    tree, binary = scene()
    tree["nodes"][-1]["scale"] = [size] * 3
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    clip = read_clip(tmp_path / "a.glb")
    same(clip, BODY, within=1e-4, trunk=1e-4)
    assert "scaled to a person's size" in clip.reading.what


@pytest.mark.parametrize("family", ["iPi", "SOMA", "Unreal", "VRoid", "Biped", "MikuMikuDance"])
def test_names_in_a_scene_are_those_of_every_other_format(tmp_path, monkeypatch, family):
    monkeypatch.setitem(globals(), "NAMES", tuple(bodies.named(family)))
    (tmp_path / "a.glb").write_bytes(packed(*scene(prefix="")))
    same(read_clip(tmp_path / "a.glb"), BODY, within=1e-4, trunk=1e-4)


def test_a_map_of_names_reads_a_scene_and_its_mirror_is_refused(tmp_path, monkeypatch):
    names = ["Sleeve" if name == "LeftForeArm" else name for name in NAMES]
    monkeypatch.setitem(globals(), "NAMES", tuple(names))
    (tmp_path / "a.glb").write_bytes(packed(*scene(prefix="")))
    with pytest.raises(ClipError, match="no skeleton .* say which is which: --names MAP"):
        read_clip(tmp_path / "a.glb")
    same(
        read_clip(tmp_path / "a.glb", how=How(names={"l_elbow": "Sleeve"})), BODY,
        within=1e-4, trunk=1e-4,
    )  # fmt: skip
    tree, binary = scene(prefix="")
    tree["nodes"][-1]["scale"] = [1.0, 1.0, -1.0]  # as a left-handed program forgets to turn it
    (tmp_path / "b.glb").write_bytes(packed(tree, binary))
    with pytest.raises(ClipError, match="the face or the toes point backwards"):
        read_clip(tmp_path / "b.glb", how=How(names={"l_elbow": "Sleeve"}))
