import itertools
import re

import numpy as np
import pytest
from handmade import SHARED, broken, bvh, write

from s3le.errors import ClipError, ParameterError
from s3le.human.amc import read_amc, read_asf
from s3le.human.bvh import UNITS, read_bvh
from s3le.human.keypoints.how import How
from s3le.human.rigs import match
from s3le.human.text import MOST_LINES
from s3le.skeleton import POINTS, face_forward, features

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]
ZERO = [0.0] * 12
REST = {  # x forward, y left, z up [m], of a file row of zeros
    "hip": (0, 0, 0), "r_pelvis": (0, -0.1, 0), "l_pelvis": (0, 0.1, 0), "neck": (0, 0, 0.5),
    "r_shoulder": (0, -0.2, 0.5), "r_elbow": (0, -0.5, 0.5), "r_hand": (0, -0.75, 0.5),
    "l_shoulder": (0, 0.2, 0.5), "l_elbow": (0, 0.5, 0.5), "l_hand": (0, 0.75, 0.5),
}  # fmt: skip
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="needs the real clips beside the project"
)


def one(tmp_path, text, *args, **kwargs):
    return read_bvh(write(tmp_path / "walk.bvh", text), *args, **kwargs)


def at(clip, frame, point):
    return clip.points[frame, POINTS.index(point)]


def is_rest(clip, frame=0):
    return all(np.allclose(at(clip, frame, p), REST[p], rtol=0, atol=1e-6) for p in POINTS)


def test_a_row_of_zeros_is_the_rest_pose(tmp_path):
    clip = one(tmp_path, bvh([ZERO]))
    assert clip.name == "walk" and clip.fps == 120.0 and clip.points.shape == (1, 10, 3)
    assert is_rest(clip) and not clip.points.flags.writeable


@pytest.mark.parametrize(
    ("order", "bone"),
    [  # the product R1 R2 R3 of quarter turns on file x, the last one listed first
        ("XYZ", (0, 0, 1)),  # Rz x = y, Ry y = y, Rx y = z
        ("XZY", (0, 1, 0)),  # Ry x = -z, Rz -z = -z, Rx -z = y
        ("YXZ", (1, 0, 0)),  # Rz x = y, Rx y = z, Ry z = x
        ("YZX", (0, 1, 0)),  # Rx x = x, Rz x = y, Ry y = y
        ("ZXY", (-1, 0, 0)),  # Ry x = -z, Rx -z = y, Rz y = -x
        ("ZYX", (0, 0, -1)),  # Rx x = x, Ry x = -z, Rz -z = -z
    ],
)
def test_quarter_turns_compose_in_the_order_listed(tmp_path, order, bone):
    clip = one(tmp_path, bvh([[0] * 9 + [90, 90, 90]], order))
    forearm = at(clip, 0, "l_hand") - at(clip, 0, "l_elbow")
    assert forearm == pytest.approx(0.25 * np.array(bone)[[2, 0, 1]], abs=1e-9)  # [m]


@pytest.mark.parametrize("order", ORDERS)
def test_any_channel_order_agrees_with_scipy(tmp_path, order):
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    row = [1, 2, 3, 20, -40, 70, 15, 95, -30, 80, -10, 130]
    clip = one(tmp_path, bvh([row], order), how=How(axes="y-up"))  # it leans far
    root, upper, fore = (
        rotation.from_euler(order, row[i : i + 3], degrees=True) for i in (3, 6, 9)
    )
    elbow = np.array([1, 2, 3]) + root.apply(
        np.array([0, 0.5, 0]) + [0.2, 0, 0] + upper.apply([0.3, 0, 0])
    )
    hand = elbow + (root * upper * fore).apply([0.25, 0, 0])
    assert at(clip, 0, "l_elbow") == pytest.approx(elbow[[2, 0, 1]], abs=1e-9)
    assert at(clip, 0, "l_hand") == pytest.approx(hand[[2, 0, 1]], abs=1e-9)


def test_each_joint_may_have_its_own_channel_order(tmp_path):
    text = bvh([[0] * 6 + [90, 90, 0, 0, 0, 0]], "ZYX")
    fore = "LeftForeArm\n{\nOFFSET 0.3 0 0\nCHANNELS 3 "
    text = text.replace(
        fore + "Zrotation Yrotation Xrotation", fore + "Xrotation Zrotation Yrotation"
    )
    upper = "LeftArm\n{\nOFFSET 0.2 0 0\nCHANNELS 3 "
    text = text.replace(upper + "Zrotation Yrotation", upper + "Yrotation Zrotation")
    clip = one(tmp_path, text)  # Ry Rz of x: Rz x = y, Ry y = y, up in the file
    assert at(clip, 0, "l_elbow") == pytest.approx((0, 0.2, 0.8), abs=1e-6)


def test_a_position_channel_replaces_the_offset(tmp_path):
    text = bvh([ZERO, [5, 6, 7] + [0.0] * 9]).replace(
        "Hips\n{\nOFFSET 0 0 0", "Hips\n{\nOFFSET 9 9 9"
    )
    clip = one(tmp_path, text)
    assert at(clip, 0, "hip") == pytest.approx((0, 0, 0))
    assert at(clip, 1, "hip") == pytest.approx((7, 5, 6))


def test_position_channels_off_the_root_replace_their_components_only(tmp_path):
    fore = "LeftForeArm\n{\nOFFSET 0.3 0 0\nCHANNELS "
    text = bvh([[0] * 9 + [0.4, 0, 0, 0]])
    text = text.replace(fore + "3", fore + "4 Xposition")
    assert at(one(tmp_path, text), 0, "l_elbow") == pytest.approx((0, 0.6, 0.5), abs=1e-6)


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_is_seen_from_the_arms(tmp_path, unit):
    assert is_rest(one(tmp_path, bvh([ZERO], scale=1 / UNITS[unit])))


@pytest.mark.parametrize("scale", [3.0, 9.0, 39.37, 50.0, 0.0097, 1e-5, 1e8])
def test_a_size_of_no_unit_is_read_as_a_persons_and_said(tmp_path, scale):
    clip = one(tmp_path, bvh([ZERO], scale=scale))
    arm = 0.55 * scale
    assert clip.reading.told == (
        f"an arm is {arm:g} units long and taken for 0.55 m: only directions matter",
    )
    assert is_rest(clip)


def test_a_unit_may_be_given_and_a_body_without_size_is_refused(tmp_path):
    text = bvh([ZERO], scale=3.0)
    with pytest.raises(ClipError, match="an arm is 0 units long"):
        one(tmp_path, re.sub(r"OFFSET -?0\.(3|25) ", "OFFSET 0 ", bvh([ZERO])))
    assert at(one(tmp_path, text, unit="m"), 0, "neck")[2] == pytest.approx(1.5)
    with pytest.raises(ParameterError, match="unit must be one of m, cm, mm, cmu, got 'inch'"):
        one(tmp_path, text, unit="inch")


def test_z_up_is_seen_from_the_rest_pose(tmp_path):
    clip = one(tmp_path, bvh([ZERO], upright="z"))
    assert clip.reading.told == ("axes z-up, by its rest pose",)
    points, _, _ = face_forward(clip.points)
    for point, place in REST.items():
        assert points[0, POINTS.index(point)] == pytest.approx(place, abs=1e-6)


@pytest.mark.parametrize(
    ("step", "fps"),
    [(".0083333", 120), ("0.033333", 30), ("0.0333", 30), ("0.025", 40), ("1.6666667e-02", 60),
     ("0.033367", 1 / 0.033367), ("0.1", 10), ("0.013", 77)],
)  # fmt: skip
def test_frame_time_is_a_whole_rate_where_its_digits_allow(tmp_path, step, fps):
    assert one(tmp_path, bvh([ZERO], step=step)).fps == pytest.approx(fps, rel=1e-12)


@pytest.mark.parametrize("step", ["0", "-0.1", "1e9", "1e-9"])
def test_a_wrong_frame_time_is_refused_unless_the_rate_is_given(tmp_path, step):
    text = bvh([ZERO], step=step)
    with pytest.raises(ClipError, match=r"walk.bvh:\d+: Frame Time must be in"):
        one(tmp_path, text)
    assert one(tmp_path, text, fps=60).fps == 60.0


def with_hip_joint(text):
    """The same figure as cgspeed's conversions have it: a joint between hip and thigh."""
    return text.replace(
        "JOINT LeftUpLeg\n{\nOFFSET 0.1 0 0\nEnd Site\n{\nOFFSET 0 0 0\n}\n}\n",
        "JOINT LHipJoint\n{\nOFFSET 0 0 0\nJOINT LeftUpLeg\n{\nOFFSET 0.1 0 0\nEnd Site\n"
        "{\nOFFSET 0 0 0\n}\n}\n}\n",
    )


MOVING = [0, 0, 0, 1, 2, 3, 60, 0, 0, 0, 0, 0]


def test_an_added_rest_pose_is_dropped_from_cgspeed_files_only(tmp_path):
    text = bvh([ZERO, MOVING, MOVING])
    assert len(one(tmp_path, with_hip_joint(text)).points) == 2
    assert len(one(tmp_path, text).points) == 3


@pytest.mark.parametrize("first", [MOVING, [0, 0, 0, 0.1] + [0] * 8, [0] * 6 + [60] + [0] * 5])
def test_a_first_frame_that_moves_is_kept(tmp_path, first):
    assert len(one(tmp_path, with_hip_joint(bvh([first, MOVING]))).points) == 2


def test_a_rest_pose_alone_is_kept(tmp_path):
    assert len(one(tmp_path, with_hip_joint(bvh([ZERO]))).points) == 1


def test_left_shoulder_is_the_joint_where_there_is_a_collar(tmp_path):
    arms = ("{}Collar", "{}Shoulder", "{}Elbow", "{}Wrist")
    text = bvh([ZERO], arms=arms).replace("UpLeg", "Hip")
    assert is_rest(one(tmp_path, text))
    arms = ("{}Pad", "{}Shoulder", "{}ForeArm", "{}Wrist")  # joint or clavicle: who knows
    with pytest.raises(ClipError, match="no joint for r_shoulder, l_shoulder"):
        one(tmp_path, bvh([ZERO], arms=arms))


@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig1_", "Character:"])
def test_a_prefix_of_all_names_is_ignored(tmp_path, prefix):
    assert is_rest(one(tmp_path, bvh([ZERO], prefix=prefix)))


@pytest.mark.parametrize(
    ("names", "rest", "shoulder"),
    [
        ("joint_Root Hips Spine Chest Neck Head Shoulder_L UpperArm_L LowerArm_L Hand_L "
         "Shoulder_R UpperArm_R LowerArm_R Hand_R UpperLeg_L UpperLeg_R", False, "UpperArm_L"),
        ("hip abdomen chest neck head rCollar rShldr rForeArm rHand lCollar lShldr lForeArm "
         "lHand rButtock rThigh lButtock lThigh", True, "lShldr"),
        ("Hips LeftUpLeg RightUpLeg Spine Neck LeftShoulder LeftArm LeftForeArm LeftHand "
         "RightShoulder RightArm RightForeArm RightHand", False, "LeftArm"),
        ("Hips LHipJoint LeftUpLeg RightUpLeg Spine Neck LeftShoulder LeftArm LeftForeArm "
         "LeftHand RightShoulder RightArm RightForeArm RightHand", True, "LeftArm"),
        ("Hips LHipJoint LeftHip RightHip Chest lowerneck Neck LeftCollar LeftShoulder LeftElbow "
         "LeftWrist RightCollar RightShoulder RightElbow RightWrist", True, "LeftShoulder"),
    ],
    ids=lambda value: "" if " " in str(value) else str(value),
)  # fmt: skip
def test_families_are_told_apart_by_their_names(names, rest, shoulder):
    names = names.split()
    found = match(names)
    assert (found.rest_frame, found.missing) == (rest, ())
    assert names[found.joints["l_shoulder"][0]] == shoulder


def test_a_body_without_arms_is_refused_with_what_is_missing_and_what_is_there(tmp_path):
    text = bvh([ZERO]).replace("LeftForeArm", "Sleeve")
    with pytest.raises(ClipError) as error:
        one(tmp_path, text)
    assert str(error.value) == (
        f"{tmp_path / 'walk.bvh'}: no joint for l_elbow; the file has Hips, "
        "LeftUpLeg, RightUpLeg, Neck, LeftShoulder, LeftArm, Sleeve, LeftHand, RightShoulder, "
        "RightArm, RightForeArm, RightHand; say which is which: --names MAP"
    )
    named = one(tmp_path, text, how=How(names={"l_elbow": "Sleeve"}))
    assert is_rest(named) and named.reading.how.names == {"l_elbow": "Sleeve"}
    with pytest.raises(ParameterError, match="l_elbow is to be 'Slave', .* did you mean Sleeve"):
        one(tmp_path, text, how=How(names={"l_elbow": "Slave"}))
    with pytest.raises(ParameterError, match="'elbow' is none of hip, .* did you mean"):
        one(tmp_path, text, how=How(names={"elbow": "Sleeve"}))


def test_two_joints_of_one_name_are_refused(tmp_path):
    with pytest.raises(ClipError, match="more than one joint is called LeftArm"):
        one(tmp_path, bvh([ZERO]).replace("LeftShoulder", "LeftArm"))


def test_a_bandai_namco_file_has_positions_on_every_joint(tmp_path):
    arms = ("Shoulder_{}", "UpperArm_{}", "LowerArm_{}", "Hand_{}")
    text = bvh([ZERO], arms=arms, order="ZXY")
    for old, new in (("Right", "R"), ("Left", "L")):
        text = text.replace(f"_{old}", f"_{new}").replace(f"{old}UpLeg", f"UpperLeg_{new}")
    text = text.replace("ROOT Hips\n{\nOFFSET 0 0 0", "ROOT Hips\n{\nOFFSET 8 8 8", 1)
    root = "ROOT joint_Root\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition "
    root += "Zrotation Xrotation Yrotation\nJOINT Hips"
    text = text.replace("ROOT Hips", root).replace("}\nMOTION", "}\n}\nMOTION")
    fore = "LowerArm_L\n{\nOFFSET 0.3 0 0\nCHANNELS 3"
    text = text.replace(fore, fore[:-1] + "6 Xposition Yposition Zposition")
    text = text.rstrip("\n").rsplit("\n", 1)[0] + "\n"
    rows = [0, 0, 0, 0, 0, 90] + [0, 1, 0, 0, 0, 0] + [0, 0, 0] + [0.4, 0, 0, 0, 0, 0]
    clip = one(tmp_path, text + " ".join(map(str, rows)))
    assert at(clip, 0, "hip") == pytest.approx((0, 0, 1))  # the channels, not OFFSET 8 8 8
    # Ry(90) of the root takes file x to -z: the left arm points back.
    assert at(clip, 0, "l_elbow") == pytest.approx((-0.6, 0, 1.5))
    assert at(clip, 0, "l_hand") == pytest.approx((-0.85, 0, 1.5))


def test_an_elbow_that_does_not_hang_on_its_shoulder_is_refused(tmp_path):
    text = (
        bvh([ZERO])
        .replace("LeftArm", "X")
        .replace("RightArm", "LeftArm")
        .replace("X\n", "RightArm\n")
    )
    with pytest.raises(ClipError, match="RightForeArm does not hang on RightArm"):
        one(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("HIERARCHY", "HIERARCHY x", r"walk.bvh:1: expected ROOT, got 'x'"),
        ("ROOT", "JOINT", "walk.bvh:2: expected ROOT, got 'JOINT'"),
        ("Xposition", "Xpos", r"walk.bvh:5: no channel of this joint: 'Xpos'"),
        ("Yposition", "Xposition", r"walk.bvh:5: no channel of this joint: 'Xposition'"),
        ("CHANNELS 6", "CHANNELS 7", "walk.bvh:6: no channel of this joint: 'JOINT'"),
        ("CHANNELS 6", "CHANNELS 5", "walk.bvh:5: expected JOINT or End or }, got 'Xrotation'"),
        ("CHANNELS 6", "CHANNELS 99999999999999999999", "number of channels must be a whole"),
        ("JOINT LeftUpLeg", "JOINT Left}UpLeg", "walk.bvh:7: no name of a joint: 'Left}UpLeg'"),
        ("JOINT LeftUpLeg", "JOINT {a: LeftUpLeg", "walk.bvh:7: no name of a joint: '{a: LeftUp"),
        ("\n0 0 0 0", "\n0 0 0 1e9", r"frame 0 \(from 0\) turns a joint by 1.74533e\+07 rad"),
        ("OFFSET 0.1", "OFFSET nan", r"walk.bvh:8: OFFSET must be a number, got 'nan'"),
        ("Frames: 2", "Frames: 1e12", "Frames must be a whole number, got '1e12'"),
        ("Frames: 2", "Frame: 2", "expected Frames:, got 'Frame: 2'"),
        ("Frame Time", "Frame Tim", "expected Frame Time:"),
        ("MOTION", "MOTIONS", "no MOTION line"),
        ("\n0 0", "\n0", r"walk.bvh:\d+: a frame takes 12 values, got 11"),
        ("\n0 0 0", "\n0 0 inf", r"walk.bvh:\d+: a channel value must be a number, got 'inf'"),
        ("\n0 0 0", "\n0 0 1e999", "must be finite, got '1e999'"),
        ("\n0 0 0", "\n0 0 1_0", "must be a number, got '1_0'"),
    ],
)
def test_a_faulty_file_is_refused_with_its_place(tmp_path, old, new, why):
    text = bvh([ZERO, MOVING])
    assert old in text
    where = text.index("MOTION") if old.startswith("\n") else 0
    with pytest.raises(ClipError, match=why):
        one(tmp_path, text[:where] + text[where:].replace(old, new, 1))


def test_every_cut_through_a_file_is_refused_or_between_two_lines(tmp_path, caplog):
    text = bvh([ZERO, MOVING]).rstrip("\n")
    between = text.rindex("\n") + 1
    for end in range(len(text)):
        if end == between:
            assert len(one(tmp_path, text[:end]).points) == 1
            assert "Frames: 2, but the file has 1 whole ones; these are read" in caplog.text
            continue
        with pytest.raises(ClipError):
            one(tmp_path, text[:end])


def test_whole_rows_more_or_fewer_than_frames_are_read_with_a_warning(tmp_path, caplog):
    text = bvh([ZERO, MOVING, MOVING])
    want = one(tmp_path, text).points
    assert caplog.text == ""
    for count in ("2", "4", "999999999999999"):
        caplog.clear()
        clip = one(tmp_path, text.replace("Frames: 3", f"Frames: {count}"))
        assert np.array_equal(clip.points, want)
        assert f"walk.bvh:{text[: text.index('Frames')].count(chr(10)) + 1}: Frames: {count}" in (
            caplog.text
        )
        with pytest.raises(ClipError, match="a frame takes 12 values, got 3"):
            one(tmp_path, text.replace("Frames: 3", f"Frames: {count}") + "1 2 3\n")
    fewer = text.replace("Frames: 3", "Frames: 4").rstrip("\n")  # and the last number may be cut
    assert np.array_equal(one(tmp_path, fewer).points, want[:2])
    assert "ends within a line; the last of its 3 frames is left out" in caplog.text


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text + b"\x1a",
        lambda text: text + b"\r\n\x1a\x1a\n",
        lambda text: re.sub(rb"HIERARCHY|ROOT|JOINT|End Site|OFFSET|CHANNELS|MOTION|Frames|"
                            rb"Frame Time", lambda found: found[0].lower(), text),
        lambda text: re.sub(rb"[XYZ](position|rotation)|End Site|Frame Time",
                            lambda found: found[0].upper(), text),
        lambda text: text.replace(b"\n", b"\r\n"),
    ],
    ids=["BOM", "Ctrl-Z", "Ctrl-Z twice", "lower case", "upper case", "CRLF"],
)  # fmt: skip
def test_what_editors_and_exporters_do_to_a_file_changes_nothing(tmp_path, change, caplog):
    text = bvh([ZERO, MOVING]).encode()
    assert np.array_equal(one(tmp_path, change(text)).points, one(tmp_path, text).points)
    assert caplog.text == ""


def test_a_frame_whose_last_number_has_fewer_decimals_than_the_others_does_not_get_in(
    tmp_path, caplog
):
    rows = [[f"{value:.6f}" for value in row] for row in (ZERO, MOVING)]
    head = bvh([ZERO, MOVING]).partition("Frame Time")[0] + "Frame Time: 0.01\n"
    text = head + "\n".join(map(" ".join, rows))
    whole = one(tmp_path, text).points
    assert len(whole) == 2  # although the last line has no end
    assert len(one(tmp_path, text[:-3] + "\n").points) == 2 and caplog.text == ""
    for lost in range(1, 8):
        caplog.clear()
        assert np.array_equal(one(tmp_path, text[:-lost]).points, whole[:1])
        assert "fewer decimals than all others (no line end); the last of its 2" in caplog.text
    with pytest.raises(ClipError, match="a frame takes 12 values, got 11"):
        one(tmp_path, text[:-8].rstrip())


def test_a_frame_of_a_million_characters_is_read_and_one_without_end_is_not(tmp_path):
    text = bvh([ZERO, MOVING])
    last = text.rstrip("\n").rindex(" ")
    assert len(one(tmp_path, text[:last] + " " * 2**20 + text[last:]).points) == 2
    with pytest.raises(ClipError, match=r"bvh:\d+: longer than the 4 MiB of a line that are read"):
        one(tmp_path, text[:last] + " 1" * 2**21 + text[last:])


def test_more_lines_than_any_motion_has_are_refused_before_they_take_memory(tmp_path):
    for ends in (b"\n", b"\r"):
        data = bvh([ZERO]).encode() + (b"a" + ends) * (MOST_LINES + 1)
        with pytest.raises(ClipError, match="more than the 8388608 lines that are read"):
            one(tmp_path, data)


def test_a_motion_is_converted_in_runs_of_bounded_size(tmp_path, monkeypatch):
    want = one(tmp_path, bvh([MOVING] * 5)).points
    for size in (1, 100, 10**9):
        monkeypatch.setattr("s3le.human.bvh._CHUNK", size)
        assert np.array_equal(one(tmp_path, bvh([MOVING] * 5)).points, want)


def test_no_damaged_file_does_anything_but_read_or_be_refused(tmp_path):
    for copy in broken(bvh([ZERO, MOVING, MOVING]).encode(), 600, seed=3):
        try:
            assert np.isfinite(one(tmp_path, copy).points).all()
        except ClipError:
            pass


@needs_shared
@pytest.mark.parametrize("trial", ["02_05", "05_02", "49_09"])
def test_cgspeed_files_are_the_amc_but_for_the_lost_thorax(trial):
    folder = SHARED / "cmu" / trial[:2]
    original = read_amc(folder / f"{trial}.amc.gz", read_asf(folder / f"{trial[:2]}.asf"), 120)
    converted = read_bvh(SHARED / "cmu_bvh" / f"{trial}.bvh.gz")
    assert converted.points.shape == original.points.shape  # the rest pose in front is gone
    x, y = (features(clip.points)[0].reshape(-1, 7, 3) for clip in (original, converted))
    angle = np.degrees(np.arccos(np.clip(np.sum(x * y, axis=2), -1, 1))).max(axis=0)
    assert (angle[1:] < 0.01).all()  # [deg]
    assert 1 < angle[0] < 20  # hip to neck, [deg]


@needs_shared
@pytest.mark.parametrize(
    ("path", "frames", "fps"),
    [
        ("other/cmu_3dsmax_bvh/131_01.bvh", 994, 120),
        ("other/cmu_daz_bvh/60_10_salsa.bvh", 1197, 60),  # less the rest pose in front
        ("other/misc/aitviewer_sample.bvh", 1300, 40),
        ("other/xia2015/xia_angry_13_000.bvh", 140, 120),
    ],
)
def test_real_files_of_other_families_stand_upright_and_agree_with_pybvh(path, frames, fps):
    pybvh = pytest.importorskip("pybvh")
    clip = read_bvh(SHARED / path)
    assert clip.points.shape == (frames, 10, 3) and clip.fps == fps
    x, ok = features(face_forward(clip.points)[0])
    assert ok.all() and x[:, 2].mean() > 0.8  # hip to neck: up
    assert x[:, 13].mean() > 0.8  # neck to left shoulder: left
    assert 0.6 < clip.points[:, 0, 2].mean() < 1.2  # hip height [m]
    other = pybvh.read_bvh_file(str(SHARED / path))
    names = list(other.joint_names)
    theirs = other.joint_positions()[:, [match(names).joints[p][0] for p in POINTS]]
    theirs = theirs[-frames:][..., [2, 0, 1]]
    scale = np.linalg.norm(np.ptp(clip.points, axis=(0, 1))) / np.linalg.norm(
        np.ptp(theirs, axis=(0, 1))
    )
    assert min(abs(scale / metres - 1) for metres in UNITS.values()) < 1e-9
    assert np.allclose(clip.points, theirs * scale, rtol=0, atol=1e-6)  # [m]
