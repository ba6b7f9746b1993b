import json

import numpy as np
import pytest
from handmade import SHARED, broken, deepmimic, write
from hypothesis import given, settings
from hypothesis import strategies as st

from s3le.errors import ClipError
from s3le.human.deepmimic import read_deepmimic
from s3le.skeleton import POINTS, face_forward, features

QUARTER = np.sqrt(0.5)
CHEST, R_SHOULDER, R_ELBOW, L_SHOULDER, L_ELBOW = 8, 25, 29, 39, 43  # first columns


def one(tmp_path, text, fps=None):
    return read_deepmimic(write(tmp_path / "punch.txt", text), fps)


def at(clip, frame, point):
    return clip.points[frame, POINTS.index(point)]


def test_the_rest_pose_stands_with_hanging_arms(tmp_path):
    clip = one(tmp_path, deepmimic({}))
    want = {
        "hip": (0, 0, 1), "r_pelvis": (0, -0.084887, 1), "l_pelvis": (0, 0.084887, 1),
        "neck": (0, 0, 1.460045),
        "l_shoulder": (-0.02405, 0.18311, 1.479651), "r_shoulder": (-0.02405, -0.18311, 1.479651),
        "l_elbow": (-0.02405, 0.18311, 1.204863), "r_elbow": (-0.02405, -0.18311, 1.204863),
        "l_hand": (-0.02405, 0.18311, 0.945916), "r_hand": (-0.02405, -0.18311, 0.945916),
    }  # fmt: skip
    for point, place in want.items():
        assert at(clip, 0, point) == pytest.approx(place, abs=1e-12)  # [m]


@pytest.mark.parametrize(
    ("frame", "point", "place"),
    [
        ({L_ELBOW: [np.pi / 2]}, "l_hand", (0.258947 - 0.02405, 0.18311, 1.204863)),  # bent: front
        ({L_SHOULDER: [QUARTER, 0, 0, QUARTER]}, "l_elbow", (0.250738, 0.18311, 1.479651)),
        # about file x by a quarter, -y goes to -z, which is left
        ({L_SHOULDER: [QUARTER, QUARTER, 0, 0]}, "l_elbow", (-0.02405, 0.457898, 1.479651)),
        ({CHEST: [QUARTER, 0, 0, -QUARTER]}, "neck", (0.223894, 0, 1.236151)),  # bow
        ({4: [QUARTER, 0, QUARTER, 0]}, "l_pelvis", (-0.084887, 0, 1)),  # root a quarter left
        ({1: [1, 2, 3]}, "hip", (1, -3, 2)),
    ],
    ids=["elbow", "reach", "raise", "bow", "turn", "root"],
)
def test_one_joint_moves_as_a_hand_computation_says(tmp_path, frame, point, place):
    assert at(one(tmp_path, deepmimic(frame)), 0, point) == pytest.approx(place, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(xyz=st.tuples(*[st.floats(-9, 9)] * 3), bend=st.floats(-3, 3))
def test_bones_keep_their_length(tmp_path_factory, xyz, bend):
    wxyz = list(np.array([1.0, *xyz]) / np.linalg.norm([1.0, *xyz]))
    frame = {CHEST: wxyz, R_SHOULDER: wxyz, R_ELBOW: [bend]}
    clip = one(tmp_path_factory.mktemp("dm"), deepmimic(frame))
    upper, lower = ("r_shoulder", "r_elbow", 0.274788), ("r_elbow", "r_hand", 0.258947)
    for tail, head, length in (upper, lower):
        bone = at(clip, 0, head) - at(clip, 0, tail)
        assert np.linalg.norm(bone) == pytest.approx(length, abs=1e-12)  # [m]


def test_even_durations_keep_the_frames_whatever_the_last_one_says(tmp_path):
    tree = json.loads(deepmimic({}, {1: [0.1]}, {1: [0.2]}))
    for last in (0.0, 0.0333333, 5.0):
        tree["Frames"][-1][0] = last
        clip = one(tmp_path, json.dumps(tree))
        assert clip.fps == 30.0
        assert clip.points[:, 0, 0] == pytest.approx([0, 0.1, 0.2])


def test_uneven_durations_become_times(tmp_path):
    # The root moves at 1 m/s; a frame that lasts twice as long is met half-way.
    times = np.cumsum([0, 0.05, 0.1, 0.05, 0.05, 0.1])
    tree = json.loads(deepmimic(*[{1: [t]} for t in times]))
    for row, duration in zip(tree["Frames"], [*np.diff(times), 0.0], strict=True):
        row[0] = duration
    clip = one(tmp_path, json.dumps(tree))
    assert clip.fps == 20.0
    assert clip.points[:, 0, 0] == pytest.approx(np.arange(8) * 0.05, abs=1e-9)  # [m]


def test_a_given_rate_overrides_the_durations(tmp_path):
    assert one(tmp_path, deepmimic({}, {}), fps=24).fps == 24.0


def rows(change):
    tree = json.loads(deepmimic({}, {}, {}))
    change(tree["Frames"])
    return json.dumps(tree)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "looks like an empty file, not JSON text"),
        ("HIERARCHY\n", "looks like BVH text, not JSON text"),
        ('{"Frames": [', "punch.txt:1: not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("{}", 'no list "Frames"'),
        ("[]", 'no list "Frames"'),
        ('{"Frames": []}', 'no list "Frames"'),
        ('{"Frames": [], "Loop": "none", "Frames": []}', "punch.txt: 'Frames' is there twice"),
        ('{"Frames": {"0": 1}}', 'no list "Frames"'),
        ('{"Frames": [1]}', "frame 0 must be 44 numbers, got int"),
        (rows(lambda f: f[1].pop()), "frame 1 must be 44 numbers, got 43 values"),
        (rows(lambda f: f[1].__setitem__(5, "x")), "frame 1 must be numbers, got 'x'"),
        (rows(lambda f: f[1].__setitem__(5, True)), "frame 1 must be numbers, got True"),
        (rows(lambda f: f[1].__setitem__(5, None)), "frame 1 must be numbers, got None"),
        (rows(lambda f: f[1].__setitem__(5, float("nan"))), "NaN is no number of a motion"),
        (rows(lambda f: f[1].__setitem__(5, float("inf"))), "Infinity is no number of a motion"),
        (rows(lambda f: f[1].__setitem__(5, 7)).replace(" 7,", " 1e999,"), "value 5 is inf"),
        (rows(lambda f: f[1].__setitem__(5, 10**400)), "too large"),
        (rows(lambda f: f[2].__setitem__(4, 0.0)), "frame 2: values 4 to 7 are no unit quatern"),
        (rows(lambda f: f[1].__setitem__(0, 0.0)), "frame 1 lasts 0 s"),
        (rows(lambda f: f[0].__setitem__(0, -1.0)), "frame 0 lasts -1 s"),
        (rows(lambda f: f[0].__setitem__(0, 1e9)), r"frame 0 lasts 1e\+09 s"),
        (rows(lambda f: f[1].__setitem__(43, 10**30)), "frame 1 .* turns a joint by 1e.30 rad"),
        (rows(lambda f: f[1].__setitem__(1, 1e300)), "frame 1 .* beyond 10000 m"),
    ],
    ids=lambda value: value[:24] if " " in value else "text",
)
def test_a_faulty_file_is_refused_with_its_reason(tmp_path, text, why):
    with pytest.raises(ClipError, match=why):
        one(tmp_path, text)


def test_durations_that_would_swell_a_small_file_are_refused(tmp_path):
    tree = json.loads(deepmimic({}, {}, {}, {}, duration=1e-4))
    tree["Frames"][1][0] = 10.0
    with pytest.raises(ClipError, match="too uneven to be one motion"):
        one(tmp_path, json.dumps(tree))


def test_no_damaged_file_does_anything_but_read_or_be_refused(tmp_path):
    for copy in broken(deepmimic({}, {L_ELBOW: [1.5]}, {}).encode(), 500, seed=4):
        try:
            assert np.isfinite(one(tmp_path, copy).points).all()
        except ClipError:
            pass


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real clips beside the project")
@pytest.mark.parametrize(("name", "frames", "fps"), [("dance_a", 98, 60), ("punch", 65, 30)])
def test_real_files_stand_upright_with_the_left_arm_on_the_left(name, frames, fps):
    clip = read_deepmimic(SHARED / "other" / "deepmimic" / f"humanoid3d_{name}.txt")
    assert clip.points.shape == (frames, 10, 3) and clip.fps == fps
    x, ok = features(face_forward(clip.points)[0])
    assert ok.all() and x[:, 2].mean() > 0.8 and x[:, 13].mean() > 0.8
