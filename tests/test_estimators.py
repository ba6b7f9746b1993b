"""What estimators write, by each one's own keys and form: the same body comes out of all."""

import bz2
import gzip
import lzma
import pickle
import zlib

import bodies
import estimators
import numpy as np
import pytest
from test_keypoints import NAMES, same, save

from s3le.errors import ClipError
from s3le.human.keypoints import smpl
from s3le.human.keypoints.how import How
from s3le.human.read import read_clip

BODY = bodies.body()
CAMERA = BODY @ bodies.INTO["camera"].T
POSE = bodies.pose()
VECTORS = POSE.reshape(len(POSE), 24, 3)
MATRICES = smpl.rotations(VECTORS)
PLACE = np.linspace([0.0, 0.9, 0.0], [1.0, 0.9, 2.0], len(POSE))


def rows(path, data):
    path.write_bytes(data)
    return path


def quaternions(vectors):
    """xyzw of axis times angle (..., 3)."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    axis = vectors / np.maximum(angle, 1e-12)
    return np.concatenate([axis * np.sin(angle / 2), np.cos(angle / 2)], axis=-1)


def upright_z(pose):
    """The same motion where z is up: the root's rotation is that much more."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turned = turn @ smpl.rotations(pose[:, :3])
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1))
    axis = np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1)
    return np.concatenate([axis * (angle / (2 * np.sin(angle)))[:, None], pose[:, 3:]], axis=1)


# --- rotations


@pytest.mark.parametrize(
    ("content", "what", "placed"),
    [
        ({"root_orient": POSE[:, :3], "pose_body": POSE[:, 3:66], "trans": PLACE}, "pose_body", 1),
        ({"root_orient": POSE[None, :, :3], "pose_body": POSE[None, :, 3:66],
          "trans": PLACE[None]}, "pose_body", 1),
        ({"poses_root": POSE[:, :3], "poses_body": POSE[:, 3:], "trans": PLACE}, "poses_body", 1),
        ({"smpl_poses": POSE, "smpl_trans": PLACE * 90, "smpl_scaling": np.array([90.0])},
         "smpl_poses", 1),
        ({"smpl_poses": POSE, "smpl_trans": PLACE, "full_pose": CAMERA}, "smpl_poses", 1),
        ({"pose_world": POSE, "trans_world": PLACE, "pose": POSE * 0, "trans": PLACE * 0},
         "pose_world", 1),
        ({"poses": VECTORS}, "poses", 0),
        ({"poses": MATRICES}, "poses", 0),
        ({"poses": MATRICES.reshape(len(POSE), -1)}, "poses", 0),
        ({"poses": quaternions(VECTORS)}, "poses", 0),
        ({"poses": quaternions(VECTORS)[..., [3, 0, 1, 2]].reshape(len(POSE), -1)}, "poses", 0),
        ({"pred_rotmat": MATRICES, "pred_pose": np.zeros((12, 144)), "pred_trans": PLACE[:, None]},
         "pred_rotmat", 1),
        ({"global_orient": MATRICES[:, :1], "body_pose": MATRICES[:, 1:], "transl": PLACE},
         "body_pose", 1),
        ({"global_orient": MATRICES[:, 0], "body_pose": VECTORS[:, 1:22]}, "body_pose", 0),
    ],
)  # fmt: skip
def test_rotations_are_found_by_their_keys_and_read_by_their_shape(tmp_path, content, what, placed):
    clip = read_clip(save(tmp_path, "a.npz", content))
    same(clip, BODY)
    assert what in clip.reading.what
    assert clip.reading.how[:2] == ("smpl", "y-up")
    want = PLACE[:, [2, 0, 1]] if placed else np.zeros((12, 3))
    assert np.allclose(clip.points[:, 0], want)
    w_first = "w first" in str(clip.reading.told)
    assert (w_first or "w last" in str(clip.reading.told)) == (content.get("poses", POSE).size
                                                              == 12 * 24 * 4)  # fmt: skip


def test_rows_of_motion_x_and_phuma_are_rotations_and_places(tmp_path):
    motion_x = np.zeros((12, 322))
    motion_x[:, :66], motion_x[:, 309:312] = POSE[:, :66], PLACE
    clip = read_clip(save(tmp_path, "a.npy", motion_x))
    same(clip, BODY)
    assert np.allclose(clip.points[:, 0], PLACE[:, [2, 0, 1]])
    z_up = upright_z(POSE)
    clip = read_clip(save(tmp_path, "b.npy", np.concatenate([PLACE, z_up[:, :66]], axis=1)))
    same(clip, BODY)
    assert clip.reading.how.axes == "z-up"
    assert np.allclose(clip.points[:, 0], PLACE @ bodies.INTO["z-up"])
    with pytest.raises(ClipError, match="may be PHUMA's, or rotations of 23 joints"):
        read_clip(save(tmp_path, "c.npy", POSE[:, 3:]))  # nothing tells
    with pytest.raises(ClipError, match="HumanML3D's features .*give the joints beside them"):
        read_clip(save(tmp_path, "d.npy", np.zeros((12, 263))))


def test_rotations_that_can_be_read_in_two_ways_or_are_none_are_refused(tmp_path):
    for content, why in (
        (np.zeros((12, 24, 6)), "6 numbers a joint, which are written in three ways"),
        (np.zeros((12, 144)), "6 numbers a joint"),
        (quaternions(VECTORS) * 2, "4 numbers a joint that are no unit quaternions"),
        (quaternions(np.full((12, 24, 3), 1.5)), "nothing tells whether w is first or last"),
        (MATRICES * 1.1, "matrices that are no rotations"),
        (MATRICES[..., [1, 0, 2], :], "matrices that are no rotations"),
        (np.zeros((12, 75)), r"no joints that are known here \(poses \(12, 75\)\)"),
        (np.zeros((12, 24, 5)), r"no joints that are known here \(poses \(12, 24, 5\)\)"),
        (VECTORS * 1e5, "turns a joint by more than 1000 rad"),
    ):
        with pytest.raises(ClipError, match=why):
            read_clip(save(tmp_path, "a.npz", {"poses": content}))


def test_places_under_a_key_of_rotations_are_places(tmp_path):
    places = bodies.listed("smpl", BODY @ bodies.INTO["z-up"].T)
    clip = read_clip(save(tmp_path, "a.npz", {"full_pose": places}))
    same(clip, BODY)
    assert any("'full_pose' holds places" in words for words in clip.reading.told)
    clip = read_clip(save(tmp_path, "b.npz", {"full_pose": VECTORS}))  # MoSh's are rotations
    same(clip, BODY)


def test_of_several_persons_rotations_are_the_chosen_ones(tmp_path):
    two = {"root_orient": np.stack([POSE[:, :3]] * 2), "trans": np.stack([PLACE * 0, PLACE]),
           "pose_body": np.stack([POSE[::-1, 3:66], POSE[:, 3:66]])}  # fmt: skip
    path = save(tmp_path, "a.npz", two)
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 1\); choose one: --person N"):
        read_clip(path)
    clip = read_clip(path, how=How(person=1))
    same(clip, BODY)
    assert np.allclose(clip.points[:, 0], PLACE[:, [2, 0, 1]])
    path = rows(tmp_path / "b.pkl", pickle.dumps({"poses": [POSE[::-1], POSE], "sequence": "a"}))
    same(read_clip(path, how=How(person=1)), BODY)


# --- torch and joblib


def test_gvhmrs_result_is_the_motion_in_the_world(tmp_path):
    clip = read_clip(rows(tmp_path / "hmr4d_results.pt", estimators.gvhmr(POSE)))
    same(clip, BODY, within=1e-5)
    assert "'smpl_params_global'" in clip.reading.what
    assert np.allclose(clip.points[:, 0], 1.0)


def test_what_torch_itself_writes_is_read_without_it(tmp_path):
    torch = pytest.importorskip("torch")
    pose = torch.tensor(POSE)
    world = {"body_pose": pose[:, 3:66], "global_orient": pose[:, :3].half().double(),
             "betas": torch.zeros(1, 10).expand(12, 10), "transl": torch.zeros(12, 3)}  # fmt: skip
    world["global_orient"] = pose[:, :3]
    more = {"b": torch.zeros(3, dtype=torch.bfloat16), "s": torch.Size([1]), "n": torch.arange(4),
            "p": torch.nn.Parameter(torch.zeros(2)), "e": torch.zeros(0, 3)}  # fmt: skip
    torch.save({"smpl_params_global": world, "net_outputs": more}, tmp_path / "a.pt")
    same(read_clip(tmp_path / "a.pt"), BODY)
    torch.save({"pose": pose}, tmp_path / "b.pth", _use_new_zipfile_serialization=False)
    with pytest.raises(ClipError, match=r"no file of torch.save since 1.6; with torch: torch.save"):
        read_clip(tmp_path / "b.pth")
    track = {"pred_rotmat": torch.tensor(MATRICES), "pred_trans": torch.zeros(12, 1, 3),
             "frame": torch.arange(12), "pred_pose": torch.zeros(12, 144)}  # fmt: skip
    np.save(tmp_path / "hps_track_0.npy", track)  # as TRAM does
    same(read_clip(tmp_path / "hps_track_0.npy"), BODY)
    rows(tmp_path / "c.pkl", pickle.dumps({"pose": pose.float()}))
    same(read_clip(tmp_path / "c.pkl"), BODY, within=1e-5)


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_whams_joblib_pickle_is_the_motion_in_the_world(tmp_path, protocol):
    data = estimators.wham(POSE, protocol)
    for name, pack in (("a", bytes), ("z", zlib.compress), ("g", gzip.compress),
                       ("b", bz2.compress), ("x", lzma.compress)):  # fmt: skip
        clip = read_clip(rows(tmp_path / f"{name}.pkl", pack(data)))
        same(clip, BODY)
        assert "'pose_world'" in clip.reading.what
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 4\)"):
        read_clip(rows(tmp_path / "two.pkl", estimators.wham(POSE, protocol, (0, 4))))


def test_what_joblib_itself_writes_is_read_without_it(tmp_path):
    joblib = pytest.importorskip("joblib")
    for pack in (0, 3, ("xz", 2)):
        joblib.dump({0: {"pose_world": np.asfortranarray(POSE)}}, tmp_path / "a.pkl", compress=pack)
        same(read_clip(tmp_path / "a.pkl"), BODY)


def test_four_d_humans_tracks_are_gaps_where_nobody_was(tmp_path):
    held = estimators.phalp(MATRICES, absent=(3, 4))
    clip = read_clip(rows(tmp_path / "demo_a.pkl", zlib.compress(estimators.joblib(held), 3)))
    known = np.isfinite(clip.points).all(axis=(1, 2))
    assert np.flatnonzero(~known).tolist() == [3, 4]
    same(clip._replace(points=clip.points[known]), BODY[known], within=1e-5)
    two = estimators.joblib(estimators.phalp(MATRICES, second=True))
    with pytest.raises(ClipError, match=r"holds 2 persons \(7, 9\)"):
        read_clip(rows(tmp_path / "two.pkl", two))
    assert read_clip(tmp_path / "two.pkl", how=How(person=9)).reading.how.person == 9


def test_prompt_hmrs_people_are_persons_with_gaps_by_their_frames(tmp_path):
    world = {"pose": np.pad(POSE[:, :66], ((0, 0), (0, 99))), "trans": PLACE}
    frames = np.r_[np.arange(6), np.arange(8, 14)]
    people = {1: {"frames": frames, "track_id": 1, "smplx_world": world,
                  "smplx_cam": {"pose": np.zeros((12, 165))}}}  # fmt: skip
    held = {"camera_world": {"Rwc": np.eye(3)}, "people": people}
    clip = read_clip(rows(tmp_path / "results.pkl", estimators.joblib(held)))
    assert len(clip.points) == 14
    assert np.flatnonzero(np.isnan(clip.points).any(axis=(1, 2))).tolist() == [6, 7]
    same(clip._replace(points=clip.points[np.isfinite(clip.points).all(axis=(1, 2))]), BODY)
    assert "2 frames are left out between others, by 'frames'" in clip.reading.told


# --- people frame by frame


def test_mmposes_instances_are_frames_of_a_person(tmp_path):
    joints = bodies.listed("h36m17", BODY)
    tree = estimators.mmpose(joints)
    clip = read_clip(save(tmp_path, "a.json", tree))
    same(clip, BODY)
    assert clip.reading.how[:2] == ("h36m17", "z-up") and clip.reading.how.person is None
    same(read_clip(save(tmp_path, "b.json", tree["instance_info"])), BODY)  # as predictions are
    del tree["instance_info"][4:6]
    tree["instance_info"][1]["instances"] = []
    tree["instance_info"][7]["instances"][0]["keypoint_scores"][16] = 0.01
    clip = read_clip(save(tmp_path, "c.json", tree))
    assert np.flatnonzero(np.isnan(clip.points).any(axis=(1, 2))).tolist() == [1, 4, 5, 9]
    two = estimators.mmpose(joints)
    for frame in two["instance_info"]:
        frame["instances"] *= 2
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 1\); choose one: --person N"):
        read_clip(save(tmp_path, "d.json", two))
    same(read_clip(tmp_path / "d.json", how=How(person=1)), BODY)
    flat = estimators.mmpose(joints[..., :2] * 300)
    with pytest.raises(ClipError, match="retargeting needs 3D"):
        read_clip(save(tmp_path, "e.json", flat))


def test_mmposes_own_names_of_joints_are_used_where_they_say_all(tmp_path):
    order = [3, 0, 9, 1, 2, 5, 4, 7, 6, 8]
    points = bodies.points(BODY)[:, order]
    tree = estimators.mmpose(points)
    tree["meta_info"]["keypoint_id2name"] = {str(i): NAMES["snake"][j] for i, j in enumerate(order)}
    clip = read_clip(save(tmp_path, "a.json", tree))
    assert np.allclose(clip.points, bodies.points(BODY), atol=1e-6)


def test_the_kinects_bodies_are_named_joints_at_the_sensors_clock(tmp_path):
    joints = bodies.listed("smpl", CAMERA)
    clip = read_clip(save(tmp_path, "a.json", estimators.kinect(joints)))
    assert clip.fps == 30.0 and clip.reading.unit == "mm" and clip.reading.how.axes == "camera"
    same(clip, BODY, within=1e-3, trunk=1e-3)
    assert "30 Hz by its times" in " ".join(clip.reading.told)
    two = save(tmp_path, "b.json", estimators.kinect(joints, bodies=(2, 5)))
    with pytest.raises(ClipError, match=r"holds 2 persons \(2, 5\)"):
        read_clip(two)
    same(read_clip(two, how=How(person=5)), BODY, within=1e-3, trunk=1e-3)


# --- TRC


CENTRES = list(NAMES["short"])


def test_joint_centres_in_trc_read_as_the_table_of_their_names(tmp_path):
    points = bodies.points(BODY) @ bodies.INTO["y-up"].T
    (tmp_path / "a.trc").write_text(
        estimators.trc(
            [*CENTRES, "r_shoulder_study"], np.concatenate([points, points[:, :1]], axis=1)
        )
    )
    clip = read_clip(tmp_path / "a.trc")
    assert clip.fps == 60.0 and clip.reading.how.axes == "y-up"
    assert np.allclose(clip.points, bodies.points(BODY), atol=1e-5)
    points[3, 7] = np.nan
    (tmp_path / "b.trc").write_bytes(
        estimators.trc(CENTRES, points, 120.0, 40).replace("\n", "\r\n").encode("utf-8-sig")
    )
    clip = read_clip(tmp_path / "b.trc")
    assert clip.fps == 120.0 and np.isnan(clip.points[3]).all()
    assert "its head announces 40 frames, there are 12" in clip.reading.told


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda t: t.replace("RHip", "RASI").replace("LHip", "LASI"), "a.trc:4: no joint for r_pel"
         ".*markers lie on the skin"),
        (lambda t: "x" + t, "is no TRC .*PathFileType"),
        (lambda t: t.replace("Frame#", "x"), "fourth line does not begin with Frame#"),
        (lambda t: t.replace("LHip", "RHip"), "a.trc:4: 10 names of joints, wanted .* each once"),
        (lambda t: t.replace("\t60\t", "\tx\t", 1), None),
        (lambda t: t.replace("\n60\t", "\nx\t", 1), "a.trc:3: DataRate must be a number"),
        (lambda t: t.replace("\n60\t", "\n2\t", 1), "its rate is 2 Hz, .* give --fps"),
        (lambda t: t.replace("\n60\t", "\n30\t", 1), "its rate is 30 Hz, its times give 60"),
        (lambda t: t[:-9] + "1_0\n", "a.trc:18: 'LWrist' must be a number, got|fields for"),
        (lambda t: t[: t.rindex("\t")], "a.trc:18: 31 fields for 10 joints, wanted 32"),
        (lambda t: t.partition("\n0\t")[0] + "\n", "no frames"),
    ],
)  # fmt: skip
def test_trc_that_is_none_is_refused_with_its_line(tmp_path, change, why):
    points = bodies.points(BODY) @ bodies.INTO["y-up"].T
    (tmp_path / "a.trc").write_text(change(estimators.trc(CENTRES, points)))
    if why is None:
        assert len(read_clip(tmp_path / "a.trc").points) == 12
        return
    with pytest.raises(ClipError, match=why):
        read_clip(tmp_path / "a.trc")


# --- shares of a picture


@pytest.mark.parametrize("flipped", [False, True])
def test_landmarks_in_shares_of_a_picture_are_no_metres(tmp_path, flipped):
    joints = bodies.listed("mediapipe", CAMERA)
    hips = joints[:, [23, 24]].mean(axis=1, keepdims=True)
    around = joints - hips
    same(read_clip(save(tmp_path, "world.npy", around)), BODY, trunk=0.05)
    shares = around * (9 / 16, 1.0, 9 / 16) * 0.5 + (0.5, 0.5, 0.0)
    if flipped:
        shares = shares * (1, -1, -1) + (0, 1, 0)
    for name, content in (
        ("a.npy", shares),
        ("b.npz", {"landmarks": shares}),
        ("c.json", {"pose_landmarks": shares.tolist()}),
        ("cut.npy", shares + (0.0, -0.45 if flipped else 0.45, 0.0)),  # legs below the picture
    ):
        with pytest.raises(ClipError, match=r"x and y lie from 0 to 1.*pose_world_landmarks"):
            read_clip(save(tmp_path, name, content))
    others = bodies.listed("h36m17", CAMERA)  # of another estimator, with a depth of its own
    others = (others - others[:, :1]) * 0.45 + (0.5, 0.5, -0.7)
    if flipped:
        others = others * (1, -1, -1) + (0.0, 1.0, -1.4)
    with pytest.raises(ClipError, match="x and y lie from 0 to 1"):
        read_clip(save(tmp_path, "h36m.npy", others))
    both = {"pose_landmarks": shares.tolist(), "pose_world_landmarks": around.tolist()}
    same(read_clip(save(tmp_path, "d.json", both)), BODY, trunk=0.05)
