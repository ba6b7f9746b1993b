import csv
import json
import os
import re

import bodies
import numpy as np
import pytest
from handmade import SHARED

from s3le.errors import ClipError, ParameterError
from s3le.human import dataset
from s3le.human.keypoints import smpl
from s3le.human.keypoints.how import How, recorded
from s3le.human.keypoints.layouts import LAYOUTS, by_names, pick
from s3le.human.read import READ, digest, read_clip
from s3le.skeleton import POINTS, face_forward, features

NAMES = {  # of the points' joints, as files spell them
    "snake": ("pelvis", "right_hip", "left_hip", "neck", "right_shoulder", "right_elbow",
              "right_wrist", "left_shoulder", "left_elbow", "left_wrist"),
    "short": ("MidHip", "RHip", "LHip", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder",
              "LElbow", "LWrist"),
    "h36m": ("Hip", "RHip", "LHip", "Thorax", "RShoulder", "RElbow", "RWrist", "LShoulder",
             "LElbow", "LWrist"),
    "mixamo": ("mixamorig:Hips", "RightUpLeg", "LeftUpLeg", "Neck", "RightArm", "RightForeArm",
               "RightHand", "LeftArm", "LeftForeArm", "LeftHand"),
    "small": ("root", "rhip", "lhip", "thorax", "rshoulder", "relbow", "rwrist", "lshoulder",
              "lelbow", "lwrist"),
    "behind": ("hip_center", "hip_right", "hip_left", "neck", "shoulder.R", "elbow.R", "wrist.R",
               "shoulder.L", "elbow.L", "wrist.L"),
}  # fmt: skip
BODY = bodies.body()
CAMERA = BODY @ bodies.INTO["camera"].T


def same(clip, joints, within=1e-6, trunk=1e-6):
    """The clip is these joints of SMPL (x forward, y left, z up), by the seven vectors."""
    points = bodies.points(joints)
    got, want = (features(face_forward(p)[0])[0] for p in (clip.points, points))
    assert np.allclose(got[:, 3:], want[:, 3:], rtol=0, atol=within)
    assert np.allclose(got[:, :3], want[:, :3], rtol=0, atol=max(trunk, within))


def save(folder, name, content):
    path = folder / name
    if name.endswith(".npz"):
        np.savez(path, **content)
    elif name.endswith(".npy"):
        np.save(path, content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


# --- lists of joints, axes, units


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("axes", bodies.INTO)
def test_a_list_of_joints_is_known_by_its_length_and_up_by_the_trunks(tmp_path, layout, axes):
    joints = bodies.listed(layout, BODY) @ bodies.INTO[axes].T
    clip = read_clip(save(tmp_path, "a.npy", joints))
    same(clip, BODY, trunk=0.05 if layout in ("coco17", "mediapipe") else 1e-6)  # own hip or none
    assert clip.reading.how[:2] == (layout, axes) and clip.fps == 30.0
    assert any("30 Hz" in words for words in clip.reading.told)
    again = read_clip(tmp_path / "a.npy", how=clip.reading.how)  # as a viewer reads it later
    assert np.array_equal(again.points, clip.points)


def test_seventeen_joints_are_told_apart_by_the_body_and_wrong_words_are_refused(tmp_path):
    for layout, other in (("h36m17", "coco17"), ("coco17", "h36m17")):
        path = save(tmp_path, f"{layout}.npy", bodies.listed(layout, CAMERA))
        assert read_clip(path).reading.how.layout == layout
        with pytest.raises(ClipError, match=f"by {other} the joints are no body"):
            read_clip(path, how=How(layout=other))
    noise = np.random.default_rng(3).normal(size=(9, 17, 3))
    with pytest.raises(ClipError, match="17 joints that no layouts explain .*--layout h36m17 or"):
        read_clip(save(tmp_path, "noise.npy", noise))
    with pytest.raises(ClipError, match="18 joints a frame; known are smpl 22/24"):
        read_clip(save(tmp_path, "n.npy", noise[:, :1].repeat(18, axis=1)))
    with pytest.raises(ClipError, match="17 joints, smpl has 22"):
        read_clip(tmp_path / "noise.npy", how=How(layout="smpl"))


@pytest.mark.parametrize(("unit", "factor"), [("m", 1), ("cm", 100), ("mm", 1000)])
def test_the_unit_is_told_by_a_trunk(tmp_path, unit, factor):
    clip = read_clip(save(tmp_path, "a.npy", CAMERA * factor))
    assert clip.reading.unit == unit
    assert np.allclose(clip.points, bodies.points(BODY), atol=1e-6)
    assert any(f"in {unit}" in words for words in clip.reading.told) == (unit != "m")


@pytest.mark.parametrize("factor", [0.1, 3.0, 1e5, 1e-9])
def test_bodies_of_no_size_are_refused(tmp_path, factor):
    with pytest.raises(ClipError, match="a trunk is .* long, which is no person's"):
        read_clip(save(tmp_path, "a.npy", CAMERA * factor))


@pytest.mark.parametrize("pitch", [-20.0, 12.0, 35.0])
def test_a_tilted_camera_is_stated_or_seen_on_straight_legs(tmp_path, pitch):
    path = save(tmp_path, "a.npy", bodies.tilted(CAMERA, pitch))
    same(read_clip(path, how=How(pitch=pitch)), BODY)
    clip = read_clip(path)
    assert clip.reading.how.pitch == pytest.approx(pitch, abs=2.5)  # [deg], for who leans a little
    assert any("the camera looks" in words for words in clip.reading.told)
    same(clip, BODY, within=0.05)
    sitting = bodies.pose().reshape(-1, 24, 3)
    sitting[:, [1, 2], 0], sitting[:, [4, 5], 0] = -1.5, 1.5
    seated = smpl.joints(sitting.reshape(-1, 72)) * (1, -1, -1)
    clip = read_clip(save(tmp_path, "b.npy", bodies.tilted(seated, pitch)))
    assert clip.reading.how.pitch == 0.0
    assert any("taken for level" in words for words in clip.reading.told)


def test_who_lies_leaves_up_open_and_a_word_settles_it(tmp_path):
    lying = CAMERA @ np.array([[0.7, 0.7, 0.0], [-0.7, 0.7, 0.0], [0.0, 0.0, 1.0]])
    path = save(tmp_path, "a.npy", lying)
    with pytest.raises(ClipError, match="not up by any axes; say which: --axes camera or y-up"):
        read_clip(path)
    assert read_clip(path, how=How(axes="camera")).reading.how.axes == "camera"


def test_a_mirrored_body_is_refused(tmp_path):
    with pytest.raises(ClipError, match="face or the toes point backwards"):
        read_clip(save(tmp_path, "a.npy", CAMERA * (1, 1, -1)))


# --- names


@pytest.mark.parametrize("style", NAMES)
@pytest.mark.parametrize("kind", ["json", "csv", "npz"])
def test_named_joints_in_any_spelling_and_order(tmp_path, style, kind):
    order = [3, 0, 9, 1, 2, 5, 4, 7, 6, 8]
    points = CAMERA @ np.eye(3)
    points = bodies.points(points)
    joints = {NAMES[style][i]: points[:, i] for i in order}
    joints["spine_x2"] = points[:, 0]
    if kind == "json":
        path = save(tmp_path, "a.json", {"fps": 50} | {k: v.tolist() for k, v in joints.items()})
    elif kind == "npz":
        path = save(tmp_path, "a.npz", {"fps": 50.0} | joints)
    else:
        path = tmp_path / "a.csv"
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream, delimiter=";" if style == "snake" else ",")
            writer.writerow(["time", *[f"{name}_{axis}" for name in joints for axis in "xyz"]])
            for i in range(len(points)):
                writer.writerow([i / 50, *[v for way in joints.values() for v in way[i]]])
    clip = read_clip(path)
    assert clip.fps == 50.0
    assert np.allclose(clip.points, bodies.points(BODY), atol=1e-6)


def test_names_that_leave_a_point_open_are_not_guessed():
    named = by_names(["left_hip", "right_hip", "left_shoulder", "left_elbow", "left_wrist"])
    assert named.missing == ("r_shoulder", "r_elbow", "r_hand")
    full = by_names(["r_" + p for p in ("hip", "shoulder", "elbow", "wrist")]
                    + ["l_" + p for p in ("hip", "shoulder", "elbow", "wrist")])  # fmt: skip
    assert not full.missing and full.layout.points[0] == (0, 4)  # between the hip joints
    clavicle = by_names(["LeftShoulder", "LeftUpperArm", "LeftLowerArm", "LeftHand",
                         "RightShoulder", "RightUpperArm", "RightLowerArm", "RightHand",
                         "Hips", "LeftUpperLeg", "RightUpperLeg", "Neck"])  # fmt: skip
    assert clavicle.layout.points[POINTS.index("l_shoulder")] == (1,)


@pytest.mark.parametrize(
    ("head", "why"),
    [
        ("a_x,a_y", "joint 'a' has x and y only"),
        ("a_x,a_z", "joint 'a' has no y"),
        ("time,hello", "column 'hello' is neither time nor"),
        ("a_x,a_x", "column 'a_x' is there twice"),
        ("a_x,a.x", "joint 'a' has x twice"),
        ("time,frame", "no column is a joint's"),
    ],
)
def test_a_table_without_sense_is_refused_with_its_column(tmp_path, head, why):
    with pytest.raises(ClipError, match=re.escape(why)):
        read_clip(save(tmp_path, "a.csv", f"{head}\n" + ",".join(["1"] * len(head.split(",")))))


def test_a_table_says_where_it_is_broken(tmp_path):
    points = bodies.points(CAMERA)
    head = ",".join(f"{name}_{axis}" for name in NAMES["snake"] for axis in "xyz")
    rows = [",".join(map(str, row.ravel())) for row in points]
    good = [head, *rows]
    assert len(read_clip(save(tmp_path, "a.csv", "\n".join(good))).points) == len(rows)
    for line, change, why in (
        (2, lambda r: r + ",1", "a.csv:3: 31 fields for 30 columns"),
        (3, lambda r: r.replace(",", ",1_0,", 1).rpartition(",")[0], "got '1_0'"),
        (1, lambda r: "x" + r, "a.csv:2: 'pelvis_x' must be a number"),
    ):
        copy = [*good]
        copy[line] = change(copy[line])
        with pytest.raises(ClipError, match=re.escape(why)):
            read_clip(save(tmp_path, "a.csv", "\n".join(copy)))
    fields = good[4].split(",")
    copy = [*good[:4], ",".join(["", "nan", *fields[2:]]), *good[5:]]
    clip = read_clip(save(tmp_path, "a.csv", "\n".join(copy)))
    assert np.isnan(clip.points).all(axis=(1, 2)).tolist() == [i == 3 for i in range(12)]
    assert dataset.skeletons(clip.points, "midpoint", 1.0).dropped["not_finite"] == 1


def test_tables_of_numbered_or_nameless_joints(tmp_path):
    joints = bodies.listed("h36m17", CAMERA)
    flat = joints.reshape(len(joints), -1)
    bare = "\n".join(",".join(map(str, row)) for row in flat)
    same(read_clip(save(tmp_path, "a.csv", bare)), BODY)
    head = "\t".join(f"{axis}{i}" for i in range(17) for axis in "xyz")
    same(read_clip(save(tmp_path, "b.csv", f"{head}\n" + bare.replace(",", "\t"))), BODY)
    table = head.replace("16", "18") + "\n" + bare.replace(",", "\t")
    with pytest.raises(ClipError, match="numbered joints with numbers left out"):
        read_clip(save(tmp_path, "c.csv", table))
    same(read_clip(save(tmp_path, "d.json", flat.tolist())), BODY)
    seen = np.dstack([joints, np.ones(joints.shape[:2])]).reshape(len(joints), -1)
    same(read_clip(save(tmp_path, "e.npy", seen)), BODY)
    with pytest.raises(ClipError, match="72 numbers a frame"):
        read_clip(save(tmp_path, "f.npy", np.zeros((4, 72)) + 0.5), how=How(layout="coco17"))


# --- 2D, persons, rates, confidence


def test_two_dimensions_are_refused_whatever_their_form(tmp_path):
    joints = bodies.listed("body25", CAMERA)
    pixels = np.dstack([joints[..., :2] * 300 + 500, np.full(joints.shape[:2], 0.9)])
    pixels[:, ::3, 2] = 0.4
    shares = pixels / (1000, 1000, 1)
    for name, content in (
        ("a.npy", joints[..., :2]),
        ("b.npy", pixels),
        ("c.npy", shares),
        ("d.npy", joints * (1, 1, 0)),
        ("e.npz", {"kp_2d": joints[..., :2], "score": joints[..., 0]}),
        ("f.json", {"people": [{"pose_keypoints_2d": [1.0] * 75, "pose_keypoints_3d": []}]}),
        ("g.json", {"keypoints": pixels.tolist()}),
    ):
        with pytest.raises(ClipError, match="retargeting needs 3D"):
            read_clip(save(tmp_path, name, content))


def test_of_several_persons_one_is_chosen_by_name(tmp_path):
    two = np.stack([CAMERA, CAMERA[::-1]], axis=1)  # (n, persons, j, 3)
    path = save(tmp_path, "a.npz", {"joints": two})
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 1\); choose one: --person N"):
        read_clip(path)
    with pytest.raises(ClipError, match="holds no person 2; there: 0, 1"):
        read_clip(path, how=How(person=2))
    clip = read_clip(path, how=How(person=1))
    same(clip, BODY[::-1])
    assert clip.reading.how.person == 1
    tracks = {"7": {"joints3d": CAMERA.tolist()}, "12": {"joints3d": CAMERA[::-1].tolist()}}
    path = save(tmp_path, "b.json", tracks)
    with pytest.raises(ClipError, match=r"holds 2 persons \(7, 12\)"):
        read_clip(path)
    same(read_clip(path, how=How(person=12)), BODY[::-1])
    romp = {"joints": np.concatenate([CAMERA[:2], CAMERA[:2]], axis=1)[:, :24],
            "track_ids": np.array([1, 2])}  # fmt: skip
    with pytest.raises(ClipError, match="holds 2 persons"):
        read_clip(save(tmp_path, "c.npz", romp))


def test_frames_of_dicts_with_gaps_times_and_visibility(tmp_path):
    joints = bodies.listed("mediapipe", CAMERA)
    frames = [
        {"timestamp": i * 0.04,
         "pose_world_landmarks": [dict(zip("xyz", xyz, strict=True), visibility=0.9)
                                  for xyz in row.tolist()]}
        for i, row in enumerate(joints)
    ]  # fmt: skip
    frames[4]["pose_world_landmarks"] = None
    frames[6]["pose_world_landmarks"][16]["visibility"] = 0.05  # a hand
    frames[7]["pose_world_landmarks"][0]["visibility"] = 0.0  # a nose, which nobody follows
    path = save(tmp_path, "a.json", {"frames": frames})
    clip = read_clip(path)
    assert clip.fps == 25.0
    assert np.flatnonzero(np.isnan(clip.points).all(axis=(1, 2))).tolist() == [4, 6]
    assert any("1 frames with a joint below confidence 0.1" in w for w in clip.reading.told)
    kept = read_clip(path, how=How(confidence=0.0))
    assert np.isnan(kept.points).all(axis=(1, 2)).sum() == 1
    with pytest.raises(ClipError, match="not one of 12 frames has all joints"):
        read_clip(path, how=How(confidence=1.0))


def test_the_rate_is_the_given_one_the_files_or_said_to_be_assumed(tmp_path):
    path = save(tmp_path, "a.npz", {"joints": CAMERA, "mocap_framerate": np.float64(120)})
    assert read_clip(path).fps == 120.0 and read_clip(path, 24).fps == 24.0
    time = np.arange(12) / 40 + np.where(np.arange(12) % 2, 0.005, 0.0)
    clip = read_clip(save(tmp_path, "b.npz", {"joints": CAMERA, "time": time}))
    assert any("uneven times" in words for words in clip.reading.told)
    for wrong, why in (({"fps": 1e9}, "its rate is 1e.09 Hz"), ({"time": -time}, "does not rise")):
        with pytest.raises(ClipError, match=why):
            read_clip(save(tmp_path, "c.npz", {"joints": CAMERA} | wrong))
    with pytest.raises(ParameterError):
        read_clip(path, fps=-1.0)


# --- rotations


def test_rotations_of_smpl_become_joints(tmp_path):
    pose = bodies.pose()
    y_up = smpl.joints(pose)
    place = np.linspace([0, 0, 0], [1, 1, 2], len(pose))
    more = np.concatenate([pose, np.zeros((len(pose), 84))], axis=1)  # with hands, as AMASS has
    for name, content in (
        ("a.npz", {"poses": more, "trans": place, "mocap_framerate": 60.0, "gender": "female"}),
        ("b.npz", {"smpl_pose": pose[:, 3:], "smpl_orient_world": pose[:, :3],
                   "root_trans_world": place}),
        ("c.npz", {"global_orient": pose[:, :3], "body_pose": pose[:, 3:66], "transl": place}),
    ):  # fmt: skip
        clip = read_clip(save(tmp_path, name, content))
        same(clip, y_up @ bodies.INTO["y-up"])
        assert np.allclose(clip.points[:, 0], place[:, [2, 0, 1]])
        assert clip.reading.how[:2] == ("smpl", "y-up")
    with pytest.raises(ClipError, match="more than 1000 rad"):
        read_clip(save(tmp_path, "d.npz", {"poses": more * 1e5}))


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real samples beside the project")
def test_rotations_give_the_directions_that_the_estimator_itself_gives():
    sample = np.load(SHARED / "video" / "romp_single_frame.npz")
    places = LAYOUTS["smpl"].points
    own = smpl.joints(sample["smpl_thetas"])
    a, b = (
        features(pick(j.astype(float), places), "joint")[0].reshape(7, 3)
        for j in (sample["joints"], own)
    )
    assert np.degrees(np.arccos((a * b).sum(axis=1))).max() < 3.0  # another shape than ours


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real samples beside the project")
@pytest.mark.parametrize(
    ("name", "layout", "axes", "frames", "usable", "fps"),
    [
        ("mediapipe_sports2d_demo.npz", "mediapipe", "camera", 230, 190, 30),
        ("mediapipe_pose2sim_single_cam03.npz", "mediapipe", "camera", 100, 100, 60),
        ("glamr_running_smpl.npz", "smpl", "z-up", 203, 203, 30),
        ("romp_single_frame.npz", "smpl", "camera", 1, 1, 30),
        ("humanml3d_new_joints_012314.npy", "smpl", "y-up", 170, 155, 30),
        ("smpl45_keypoints_pyroki.npy", "smpl", "z-up", 122, 122, 30),
    ],
)
def test_real_samples_stand_upright_with_the_left_arm_on_the_left(
    name, layout, axes, frames, usable, fps
):
    clip = read_clip(SHARED / "video" / name)
    assert clip.points.shape == (frames, 10, 3) and clip.fps == fps
    assert clip.reading.how[:2] == (layout, axes)
    kept = dataset.skeletons(clip.points, "midpoint", np.radians(60.0))
    assert len(kept.rows) >= usable
    assert np.median(kept.x[:, 2]) > 0.88 and np.median(kept.x[:, 13]) > 0.85


# --- the door


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.c3d", "x", "joint centres"),
        ("a.fbx", "x", "bpy.ops.import_scene.fbx"),
        ("a.glb", "x", "its first bytes are not glTF"),
        ("a.zip", "x", "unpack it"),
        ("a.npy", "x", "looks like text of no motion format known here, not an array of numpy's"),
        ("a.npz", "", "looks like an empty file, not an archive of numpy's"),
        ("a.csv", "", "an empty file"),
        ("a.pkl", "", "an empty file"),
        ("a.json", "{}", "no joints that are known here"),
        ("a.json", '{"a": 1, "a": 2}', "'a' is there twice"),
        ("a.json", '{"joints": [[[1, 2, Infinity]]]}', "Infinity is no number"),
        ("a.json", '{"joints": [[[1, 2, 3], [1, 2]]]}', "of unequal lengths"),
        ("a.json", '{"joints": [[[1, 2, "3"]]]}', "must be numbers, got '3'"),
        ("a.json", '{"joints": [[[1, 2, true]]]}', "must be numbers, got True"),
        ("a.json", '{"joints": [[[1, 2, 1' + "0" * 400 + "]]]}", "a number that is too large"),
        ("a.json", '{"joints": ' + "[" * 9 + "]" * 9 + "}", "too deep"),
        ("a.json", "[" * 99_999, "not valid JSON"),
        ("a.json", '{"joints": []}', "holds no joints"),
        ("a.json", "[1, 2, 3]", "3 numbers a frame"),
        ("a.json", '{"people": []}', "nobody is in any"),
    ],
    ids=lambda value: value[:20],
)
def test_what_holds_no_joints_is_refused_in_one_line(tmp_path, name, content, why):
    with pytest.raises(ClipError) as error:
        (tmp_path / name).write_text(content)
        read_clip(tmp_path / name)
    assert why in str(error.value) and str(tmp_path) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_pickled_arrays_stay_closed_and_others_of_the_archive_are_read(tmp_path):
    words = np.array({"a": 1}, dtype=object)
    clip = read_clip(save(tmp_path, "a.npz", {"joints": CAMERA, "results": words}))
    same(clip, BODY)
    with pytest.raises(ClipError, match="of its arrays results stay closed, which are pickled"):
        read_clip(save(tmp_path, "b.npz", {"results": words}))
    with pytest.raises(ClipError, match=r"no joints that are known here \(a int\)"):
        read_clip(save(tmp_path, "c.npy", words))  # a dict, read as data


def test_options_for_keypoints_are_refused_where_a_file_says_it_itself(tmp_path):
    (tmp_path / "a.bvh").write_text("HIERARCHY\n")
    with pytest.raises(ParameterError, match="says itself what --layout, --pitch would"):
        read_clip(tmp_path / "a.bvh", how=How(layout="smpl", pitch=3.0))
    for how in (How(layout="x"), How(axes="x"), How(pitch=95.0), How(confidence=2.0),
                How(axes="z-up", pitch=3.0)):  # fmt: skip
        with pytest.raises(ParameterError):
            read_clip(tmp_path / "a.npy", how=how)


def test_a_motion_file_says_how_its_clip_was_read_and_nonsense_in_it_is_nothing():
    how = How("mediapipe", "camera", 12.5, 3, 0.4)
    assert recorded({"x": 1} | how.about()) == how
    named = How(axes="z-up-left", names={"l_elbow": "Sleeve"})
    assert recorded(named.about()) == named
    assert recorded({"clip_read_names": {"sleeve": "x"}}) == How()
    assert recorded({key: str(value) for key, value in how.about().items()}) == how
    assert recorded(how.about() | {"clip_read_axes": "up", "clip_read_person": "nan"}) == (
        how._replace(axes=None, person=None)
    )
    assert recorded({}) == How()


def test_a_digest_is_of_a_file_or_of_a_folder_of_frames(tmp_path):
    first = save(tmp_path, "a.json", {"people": []})
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "a_000_keypoints.json").write_text("{}")
    before = digest(folder)
    assert digest(first) != before == digest(folder)
    (folder / "a_000_keypoints.json").write_text("{ }")
    assert digest(folder) != before


def test_a_folder_and_a_pipe_are_called_what_they_are(tmp_path):
    (tmp_path / "a.npz").mkdir()
    os.mkfifo(tmp_path / "b.npz")
    for name, why in (("a.npz", "is a folder"), ("b.npz", "is a named pipe"),
                      ("c.npz", "no such file")):  # fmt: skip
        with pytest.raises(ClipError, match=why):
            read_clip(tmp_path / name)


def test_every_suffix_that_is_read_is_in_the_refusal_of_others(tmp_path):
    with pytest.raises(ClipError) as error:
        read_clip(save(tmp_path, "a.xyz", "x"))
    assert all(suffix in str(error.value) for suffix in READ)
