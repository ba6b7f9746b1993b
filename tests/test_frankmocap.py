"""A folder of an estimator's frames is one clip, with gaps where nobody was."""

import bodies
import numpy as np
import pytest
from frankmocaps import BODY, CAMERA, frankmocap

from s3le.errors import ClipError
from s3le.human.keypoints.how import How
from s3le.human.read import read_clip
from s3le.skeleton import features


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_frankmocaps_frames_are_a_clip_with_gaps_where_nobody_was(tmp_path, protocol):
    out = tmp_path / "dance"
    frankmocap(out / "mocap", [7, 8, 10, 11, 12], protocol)
    clip = read_clip(out, fps=25)
    assert clip.name == "dance" and clip.fps == 25.0
    assert np.isnan(clip.points).all(axis=(1, 2)).tolist() == [False, False, True] + [False] * 3
    rows = [0, 1, 3, 4, 5]
    got, want = (features(p)[0] for p in (clip.points[rows], bodies.points(BODY[:5])))
    assert np.allclose(got, want, rtol=0, atol=1e-6)
    assert clip.reading.how[:2] == ("spin49", "camera") and clip.reading.how.person is None
    assert np.array_equal(read_clip(out / "mocap", 25).points, clip.points, equal_nan=True)


def test_frankmocaps_people_and_other_files_are_told_apart(tmp_path):
    two = frankmocap(tmp_path / "two", [1, 2], people=2)
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 1\); choose one"):
        read_clip(two)
    assert read_clip(two, how=How(person=0)).reading.how.person == 0
    with pytest.raises(ClipError, match="not one of 2 frames has a joint that is known"):
        read_clip(two, how=How(person=1))
    with pytest.raises(ClipError, match="has none of pred_joints_img"):
        read_clip(frankmocap(tmp_path / "mesh", [1], key="pred_vertices_img"))
    with pytest.raises(ClipError, match="holds hands only"):
        read_clip(frankmocap(tmp_path / "hands", [1], key="left_hand"))
    with pytest.raises(ClipError, match="3 files for 100002 frames by their names"):
        read_clip(frankmocap(tmp_path / "far", [1, 3, 100_002]))
    several = frankmocap(tmp_path / "several", [1], name="a_{:05d}")
    frankmocap(several, [1], name="b_{:05d}")
    with pytest.raises(ClipError, match="several sequences: a_, b_"):
        read_clip(several)
    (two / "00002_prediction_result.pkl").write_bytes(b"cos\nsystem\n(S'touch pwned'\ntR.")
    with pytest.raises(ClipError, match=r"00002_prediction_result.pkl: refused, .*'os.system'"):
        read_clip(two)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ClipError, match="is a folder, and holds no frames of FrankMocap"):
        read_clip(tmp_path / "empty")


def test_openpose_frames_in_three_dimensions(tmp_path):
    import json

    joints = np.concatenate([bodies.listed("body25", CAMERA), np.ones((12, 25, 1))], axis=2)
    for i, row in enumerate(joints):
        people = [] if i == 4 else [{"pose_keypoints_3d": row.ravel().tolist()}]
        (tmp_path / f"v_{i:012d}_keypoints.json").write_text(json.dumps({"people": people}))
    clip = read_clip(tmp_path)
    assert np.flatnonzero(np.isnan(clip.points).all(axis=(1, 2))).tolist() == [4]
    assert clip.reading.how[:2] == ("body25", "camera")
    (tmp_path / "v_000000000003_keypoints.json").write_text("[]")
    with pytest.raises(ClipError, match='000003_keypoints.json: no list "people" in it'):
        read_clip(tmp_path)
