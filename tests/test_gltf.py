import base64
import json
import struct

import bodies
import numpy as np
import pytest
from test_keypoints import same

from s3le.errors import ClipError, ParameterError
from s3le.human.keypoints import smpl
from s3le.human.keypoints.how import How, recorded
from s3le.human.read import read_clip
from s3le.skeleton import POINTS

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


def with_keys(tree, binary, node, time, values, how="LINEAR", what="rotation"):
    """The scene with other keys for one node; and its buffer."""
    kind = "VEC4" if what == "rotation" else "VEC3"
    for table, form in ((time, "SCALAR"), (values, kind)):
        data = np.asarray(table, "<f4").tobytes()
        tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary),
                                    "byteLength": len(data)})  # fmt: skip
        tree["accessors"].append({"bufferView": len(tree["bufferViews"]) - 1, "type": form,
                                  "componentType": 5126, "count": len(table)})  # fmt: skip
        binary += data
    animation, count = tree["animations"][0], len(tree["accessors"])
    animation["samplers"].append({"input": count - 2, "output": count - 1, "interpolation": how})
    channels = [c for c in animation["channels"]
                if (c["target"]["node"], c["target"]["path"]) != (node, what)]  # fmt: skip
    channels.append({"sampler": len(animation["samplers"]) - 1,
                     "target": {"node": node, "path": what}})  # fmt: skip
    animation["channels"] = channels
    return binary


def only(tree, node):
    """Keep the keys of one node alone."""
    animation = tree["animations"][0]
    animation["channels"] = [c for c in animation["channels"] if c["target"]["node"] == node]


def about_z(degrees):
    """xyzw of turns about z."""
    half = np.radians(np.atleast_1d(degrees)) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1)


def upper_arm(clip, moments):
    """Height of the left upper arm's direction at moments [s]; up is 1."""
    arm = clip.points[:, POINTS.index("l_elbow")] - clip.points[:, POINTS.index("l_shoulder")]
    arm = arm[np.rint(np.asarray(moments) * clip.fps).astype(int)]
    return arm[:, 2] / np.linalg.norm(arm, axis=1)


def test_keys_that_an_exporter_has_thinned_out_are_met_where_they_are(tmp_path):
    tree, binary = scene()
    time = np.array([*range(6), *np.arange(51, 60) / 10, *range(6, 13)])
    wave = [(51 + i) / 10 for i in range(0, 9, 2)]  # up at 5.1, 5.3, ..., 5.9 s
    angle = np.where(np.isin(np.round(time, 3), np.round(wave, 3)), 60.0, -80.0)
    binary = with_keys(tree, binary, 16, time, about_z(angle))
    only(tree, 16)
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    clip = read_clip(tmp_path / "a.glb")
    assert clip.fps == 30.0 and len(clip.points) == 361
    assert (upper_arm(clip, wave) > 0.8).all()
    assert (upper_arm(clip, [0, 1, 3.5, 5.0, 5.2, 5.4, 5.6, 5.8, 6, 9]) < -0.97).all()
    assert "keys at uneven times, sampled at 30 Hz" in clip.reading.told


def test_keys_a_second_apart_are_an_arc_and_no_line(tmp_path):
    tree, binary = scene()
    turned = about_z([-80.0, 70.0, -80.0]) * [[1], [-1], [1]]  # the same turn, the other sign
    binary = with_keys(tree, binary, 16, [0.0, 1.0, 2.0], turned)
    only(tree, 16)
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    clip = read_clip(tmp_path / "a.glb")
    assert clip.fps == 30.0 and len(clip.points) == 61
    at = np.array([0.2, 0.5, 0.8])
    middle = upper_arm(clip, [0.0])[0], upper_arm(clip, [1.0])[0]
    begin, end = np.degrees(np.arcsin(middle))
    want = np.sin(np.radians(begin + (end - begin) * at))
    assert np.allclose(upper_arm(clip, at), want, atol=0.02)


def test_steps_hold_their_value_until_the_next_key(tmp_path):
    tree, binary = scene()
    binary = with_keys(tree, binary, 16, [0.0, 0.25, 1.0], about_z([-80, 60, -80]), "STEP")
    only(tree, 16)
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    up = upper_arm(read_clip(tmp_path / "a.glb"), [0.0, 0.2, 0.25, 0.5, 0.95, 1.0])
    assert (up > 0.5).tolist() == [False, False, True, True, True, False]


def test_splines_go_through_their_keys_with_their_tangents(tmp_path):
    tree, binary = scene()
    turned = about_z([-60.0, 60.0, -60.0])
    tangents = np.stack([turned * 0, turned, turned * 0], axis=1).reshape(-1, 4)
    binary = with_keys(tree, binary, 16, [0.0, 1.0, 2.0], tangents, "CUBICSPLINE")
    binary = with_keys(tree, binary, 0, [0.0, 2.0],
                       [[1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [3, 0, 0], [0, 0, 0]],
                       "CUBICSPLINE", "translation")  # fmt: skip
    tree["animations"][0]["channels"] = tree["animations"][0]["channels"][-2:]
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    clip = read_clip(tmp_path / "a.glb")
    at = np.array([0.0, 0.2, 0.5, 0.9, 1.0])
    # p(u) = (u^3 - 2 u^2 + u) d m0 + (-2 u^3 + 3 u^2) p1 in d = 2 s, x of the file is our y
    u = at / 2.0
    want = (u**3 - 2 * u**2 + u) * 2.0 * 1.0 + (-2 * u**3 + 3 * u**2) * 3.0
    moved = clip.points[np.rint(at * clip.fps).astype(int), 0, 1]
    assert np.allclose(moved - moved[0], want, atol=1e-5)
    both = upper_arm(clip, [0.5])[0]  # tangents are zero: in the middle it is half way
    (tmp_path / "b.glb").write_bytes(packed(*_still(0.0)))
    assert both == pytest.approx(upper_arm(read_clip(tmp_path / "b.glb"), [0.0])[0], abs=1e-4)


def _still(degrees):
    tree, binary = scene()
    binary = with_keys(tree, binary, 16, [0.0], about_z(degrees))
    only(tree, 16)
    return tree, binary


def several(tree):
    """The scene's animation, and one of other names that stands still or moves no joint."""
    first = tree["animations"][0]
    still = {"name": "idle", "samplers": first["samplers"][:1],
             "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]}  # fmt: skip
    camera = {"name": "camera", "samplers": first["samplers"][:1],
              "channels": [{"sampler": 0, "target": {"node": 23, "path": "rotation"}}]}  # fmt: skip
    tree["nodes"].append({"name": "Camera"})
    tree["animations"] = [camera, still, first]


def test_of_several_animations_one_is_chosen_by_name_or_number(tmp_path):
    tree, binary = scene()
    several(tree)
    path = tmp_path / "a.glb"
    path.write_bytes(packed(tree, binary))
    with pytest.raises(ClipError, match=r"2 animations \(1 idle, 2 dance\); choose: --animation"):
        read_clip(path)
    for word in ("dance", "2"):
        clip = read_clip(path, how=How(animation=word))
        same(clip, BODY, within=1e-4, trunk=1e-4)
        assert clip.reading.how.animation == word and "'dance'" in clip.reading.what
        assert recorded(clip.reading.how.about()).animation == word
    for word in ("0", "camera", "walk", "3", "-1"):
        with pytest.raises(ClipError, match=rf"no animation '{word}'; there: 1 idle, 2 dance"):
            read_clip(path, how=How(animation=word))
    tree["animations"][1]["name"] = "dance"
    path.write_bytes(packed(tree, binary))
    with pytest.raises(ClipError, match="two animations have that name .*give its number"):
        read_clip(path, how=How(animation="dance"))
    np.save(tmp_path / "a.npy", bodies.listed("smpl", BODY))
    with pytest.raises(ParameterError, match="no animations to choose from"):
        read_clip(tmp_path / "a.npy", how=How(animation="dance"))


VRM = {0: "hips", 1: "leftUpperLeg", 2: "rightUpperLeg", 4: "leftLowerLeg", 5: "rightLowerLeg",
       7: "leftFoot", 8: "rightFoot", 12: "neck", 15: "head", 13: "leftShoulder",
       14: "rightShoulder", 16: "leftUpperArm", 17: "rightUpperArm", 18: "leftLowerArm",
       19: "rightLowerArm", 20: "leftHand", 21: "rightHand", 3: "spine"}  # fmt: skip


def test_a_vrm_animation_names_its_bones_itself(tmp_path):
    tree, binary = scene()
    for number, node in enumerate(tree["nodes"]):
        node["name"] = f"J_Bip_{number}"
    del tree["skins"]
    bones = {name: {"node": node} for node, name in VRM.items()}
    tree["extensions"] = {
        "VRMC_vrm_animation": {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
    }
    path = tmp_path / "dance.vrma"
    path.write_bytes(packed(tree, binary))
    clip = read_clip(path)
    assert clip.fps == 25.0
    same(clip, BODY, within=1e-4, trunk=1e-4)
    bones["leftHand"] = bones["head"]
    path.write_bytes(packed(tree, binary))
    with pytest.raises(ClipError, match="two bones are one node"):
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
        (change(["animations", 0, "samplers", 3, "interpolation"], "BEZIER"), "sampled keys"),
        (change(["animations", 0, "samplers", 3, "interpolation"], "CUBICSPLINE"), "lack values"),
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
