import json
import re
import subprocess
import sys

import bodies
import numpy as np
import pytest
from handmade import write

from s3le.errors import ClipError, ParameterError
from s3le.human.keypoints.how import How
from s3le.human.namesmap import read_names
from s3le.human.read import read_clip
from s3le.human.rigs import MORE, match
from s3le.skeleton import POINTS, face_forward, features

BODY = bodies.body()
YUP = (BODY + (0, 0, 0.9)) @ bodies.INTO["y-up"].T
WANT = features(face_forward(bodies.points(BODY))[0])[0]
WHERE = {  # SMPL's joint of each point and of what tells front from back
    "hip": 0, "neck": 12, "r_pelvis": 2, "l_pelvis": 1, "r_shoulder": 17, "l_shoulder": 16,
    "r_elbow": 19, "l_elbow": 18, "r_hand": 21, "l_hand": 20, "r_knee": 5, "l_knee": 4,
    "r_ankle": 8, "l_ankle": 7, "r_toe": 11, "l_toe": 10,
}  # fmt: skip


def check(clip):
    got = features(face_forward(clip.points)[0])[0]
    assert np.allclose(got[:, 3:], WANT[:, 3:], rtol=0, atol=1e-6)
    assert (got[:, :3] * WANT[:, :3]).sum(axis=1).min() > 0.97  # hip and neck may be midpoints


@pytest.mark.parametrize("family", bodies.FAMILIES)
def test_each_familys_joints_are_found_under_its_names(family):
    names = bodies.named(family)
    found = match(names)
    assert found.missing == () == found.doubled
    derived = {"hip": (2, 1), "neck": (17, 16)}
    for point, joint in WHERE.items():
        own = found.joints.get(point, (found.more.get(point),))
        if names[joint].startswith("extra"):
            assert own == derived.get(point, (None,)), point
        else:
            assert own == (joint,), point
    assert match(names[::-1]).missing == ()  # in whatever order


@pytest.mark.parametrize("family", bodies.FAMILIES)
def test_each_familys_names_are_read_in_bvh_csv_and_npz(tmp_path, family):
    names = bodies.named(family)
    check(read_clip(write(tmp_path / "a.bvh", bodies.bvh_of(YUP, names, rest="y"))))
    np.savez(tmp_path / "a.npz", joints=YUP, joint_names=names, fps=30.0)
    check(read_clip(tmp_path / "a.npz"))
    head = ",".join(f"{name}_{axis}" for name in names for axis in "xyz")
    rows = "\n".join(",".join(f"{v:.9f}" for v in row) for row in YUP.reshape(len(YUP), -1))
    check(read_clip(write(tmp_path / "a.csv", f"{head}\n{rows}\n"), fps=30.0))


def test_helpers_of_a_rig_do_not_stand_in_for_its_joints():
    names = (
        "ik_hand_root ik_hand_l ik_hand_r ik_foot_l ik_foot_r root pelvis thigh_l thigh_r "
        "calf_twist_01_l calf_l calf_r foot_l foot_r neck_02 neck_01 upperarm_twist_01_l "
        "upperarm_l upperarm_r lowerarm_twist_01_l lowerarm_l lowerarm_r hand_l hand_r clavicle_l "
        "clavicle_r"
    ).split()
    found = match(names)
    at = {point: names[own[0]] for point, own in found.joints.items()}
    assert at["hip"] == "pelvis" and at["neck"] == "neck_01"
    assert at["l_hand"] == "hand_l" and at["l_shoulder"] == "upperarm_l"
    assert at["l_elbow"] == "lowerarm_l" and names[found.more["l_ankle"]] == "foot_l"


def test_a_hip_joint_of_cgspeed_is_no_thigh_and_asfs_thorax_no_neck():
    names = "Hips LHipJoint LeftHip RHipJoint RightHip".split()
    assert match(names).joints["l_pelvis"] == (2,)
    names = [n for n in bodies.named("ASF") if n != "lowerneck"] + ["thorax"]
    assert (
        match(names).joints["neck"]
        == match(names).joints["r_shoulder"] + (match(names).joints["l_shoulder"])
    )


ODD = dict(zip((*WHERE,), (f"knob {i}" for i in range(len(WHERE))), strict=True))


def odd_names():
    names = [f"other {i}" for i in range(22)]
    for point, name in ODD.items():
        names[WHERE[point]] = name
    return names


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_a_map_of_names_is_for_what_is_in_no_table_in_every_door(tmp_path, suffix):
    text = json.dumps(ODD) if suffix == ".json" else "".join(f"{k}: {v}\n" for k, v in ODD.items())
    how = How(names=read_names(write(tmp_path / f"map{suffix}", text)))
    names = odd_names()
    path = write(tmp_path / "a.bvh", bodies.bvh_of(YUP, names, rest="y"))
    with pytest.raises(ClipError, match="no joint for .*; the file has .*knob 0"):
        read_clip(path)
    clip = read_clip(path, how=how)
    check(clip)
    assert clip.reading.how.names == ODD
    np.savez(tmp_path / "a.npz", joints=YUP, joint_names=names, fps=30.0)
    with pytest.raises(ClipError, match="say which is which: --names MAP"):
        read_clip(tmp_path / "a.npz")
    check(read_clip(tmp_path / "a.npz", how=how))
    tree = {name: YUP[:, i].tolist() for i, name in enumerate(names)} | {"fps": 30}
    path = write(tmp_path / "b.json", json.dumps(tree))
    with pytest.raises(ClipError, match="--names MAP"):
        read_clip(path)
    clip = read_clip(path, how=how)
    check(clip)
    check(read_clip(path, how=clip.reading.how))  # as a viewer reads it later


def test_the_way_round_from_mvnx_works(tmp_path):
    names = bodies.named("Xsens' segments")
    segments = "".join(f'<segment label="{name}"/>' for name in names)
    joints = BODY + (0.0, 0.0, 0.9)
    frames = [("identity", joints[0] * 0.0), *(("normal", row) for row in joints)]
    text = "".join(
        f'<frame type="{kind}"><position>{" ".join(f"{v:.9f}" for v in row.ravel())}</position>'
        "</frame>" for kind, row in frames
    )  # fmt: skip
    write(tmp_path / "walk.mvnx", (
        '<mvnx xmlns="http://www.xsens.com/mvn/mvnx"><subject frameRate="240"><segments>'
        f"{segments}</segments><frames>{text}</frames></subject></mvnx>"))  # fmt: skip
    with pytest.raises(ClipError, match=".mvnx is not read") as error:
        read_clip(tmp_path / "walk.mvnx")
    code = re.search(r'python -c "(.*)"', str(error.value))[1]
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    clip = read_clip(tmp_path / "walk.npz")
    assert clip.fps == 240.0
    check(clip)


@pytest.mark.parametrize(
    ("suffix", "command"),
    [("fbx", "import_scene.fbx(filepath='a.fbx')"), ("usdc", "usd_import(filepath='a.usdc')"),
     ("usdz", "usd_import(filepath='a.usdz')"), ("blend", "open_mainfile(filepath='a.blend')")],
)  # fmt: skip
def test_the_way_round_by_blender_is_a_line_to_copy(tmp_path, suffix, command):
    path = write(tmp_path / f"a.{suffix}", "x")
    with pytest.raises(ClipError) as error:
        read_clip(path)
    code = re.search(r'--python-expr "(.*)"', str(error.value))[1]
    compile(code, "line", "exec")
    assert command in code and code.endswith("bpy.ops.export_scene.gltf(filepath='a.glb')")


def test_what_a_map_leaves_out_is_looked_up_and_what_it_says_wins():
    names = [*bodies.named("LAFAN1"), "LeftHandTip"]
    found = match(names, {"l_hand": "LeftHandTip"})
    assert found.joints["l_hand"] == (22,) and found.joints["r_hand"] == (21,)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("elbow: a", "'elbow' is none of hip, .*; did you mean l_elbow|r_elbow"),
        ("r_elbow: 3", "r_elbow is to be 3, wanted a joint's name"),
        ("- a", "expected a mapping with a joint's name"),
        ("{}", "empty"),
        ("a: [", "not readable as YAML"),
        ("a: &x b\nc: *x", "aliases"),
    ],
)
def test_a_faulty_map_is_refused_with_its_path(tmp_path, text, why):
    with pytest.raises(ParameterError, match=why) as error:
        read_names(write(tmp_path / "m.yaml", text))
    assert str(error.value).startswith(str(tmp_path / "m.yaml"))
    with pytest.raises(ParameterError, match="no such file"):
        read_names(tmp_path / "none.yaml")


def test_a_map_that_a_file_cannot_follow_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", BODY)
    with pytest.raises(ParameterError, match="its joints have no names"):
        read_clip(tmp_path / "a.npy", how=How(names={"hip": "x"}))
    (tmp_path / "a.txt").write_text("{}")
    with pytest.raises(ParameterError, match="says itself what --names would"):
        read_clip(tmp_path / "a.txt", how=How(names={"hip": "x"}))
    for names in ({"x": "y"}, {"hip": ""}, {"hip": 3}):
        with pytest.raises(ParameterError):
            How(names=names).check()
    assert set(WHERE) <= {*POINTS, *MORE}
