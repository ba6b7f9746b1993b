import json
import time

import numpy as np
import pytest
from handmade import SHARED, amc, asf, broken, write
from hypothesis import given, settings
from hypothesis import strategies as st

from s3le.errors import ClipError, ParameterError
from s3le.human import amc as reader
from s3le.human.amc import cmu_rate, read_amc, read_asf
from s3le.skeleton import POINTS, face_forward, features

REST = {  # x forward, y left, z up [m]
    "hip": (3, 1, 2), "r_pelvis": (3, 0.9, 2), "l_pelvis": (3, 1.1, 2), "neck": (3, 1, 2.5),
    "r_shoulder": (3, 0.8, 2.5), "r_elbow": (3, 0.5, 2.5), "r_hand": (3, 0.25, 2.5),
    "l_shoulder": (3, 1.2, 2.5), "l_elbow": (3, 1.5, 2.5), "l_hand": (3, 1.75, 2.5),
}  # fmt: skip


@pytest.fixture(scope="module")
def skeleton(tmp_path_factory):
    return read_asf(write(tmp_path_factory.mktemp("asf") / "01.asf", asf()))


def one(tmp_path, skeleton, text, fps=120.0):
    return read_amc(write(tmp_path / "01_01.amc", text), skeleton, fps)


def at(clip, frame, point):
    return clip.points[frame, POINTS.index(point)]


def test_angles_of_zero_are_the_rest_pose(tmp_path, skeleton):
    clip = one(tmp_path, skeleton, amc({}), fps=60)
    assert clip.name == "01_01" and clip.fps == 60.0 and clip.points.shape == (1, 10, 3)
    for point, place in REST.items():
        assert at(clip, 0, point) == pytest.approx(place, abs=1e-12)  # [m]
    assert not clip.points.flags.writeable


@pytest.mark.parametrize(
    ("bones", "elbow", "hand"),
    [
        ({"lhumerus": "0 0 -90"}, (3, 1.2, 2.2), (3, 1.2, 1.95)),  # arm hangs
        ({"lhumerus": "0 -90 0"}, (3.3, 1.2, 2.5), (3.55, 1.2, 2.5)),  # arm forward
        ({"lradius": "90"}, (3, 1.5, 2.5), (3.25, 1.5, 2.5)),  # about its own z, world -y
        ({"lhumerus": "90 0 90"}, (3, 1.2, 2.8), (3, 1.2, 3.05)),  # x first, then z
        # Rz(90) Rx(90) takes the forearm, local +z, to the world: Rx z = -y, Rz -y = +x (left).
        ({"lhumerus": "90 0 90", "lradius": "90"}, (3, 1.2, 2.8), (3, 1.45, 2.8)),
        ({"thorax": "90 0 0"}, (3.5, 1.5, 2), (3.5, 1.75, 2)),  # bow
        # a quarter turn to the left: the left arm, once along +y, points back
        ({"root": "0 0 0 0 90 0"}, (-0.5, 0, 0.5), (-0.75, 0, 0.5)),
    ],
    ids=["hang", "forward", "own axis", "order", "chain", "bow", "root"],
)
def test_the_left_arm_is_where_a_hand_computation_puts_it(tmp_path, skeleton, bones, elbow, hand):
    clip = one(tmp_path, skeleton, amc(bones))
    assert at(clip, 0, "l_elbow") == pytest.approx(elbow, abs=1e-12)
    assert at(clip, 0, "l_hand") == pytest.approx(hand, abs=1e-12)


def test_radians_in_the_motion_override_degrees_in_the_skeleton(tmp_path, skeleton):
    text = amc({"lhumerus": f"0 0 {-np.pi / 2:.17g}"}, keyword=":RADIANS")
    assert at(one(tmp_path, skeleton, text), 0, "l_elbow") == pytest.approx((3, 1.2, 2.2))


def test_the_skeletons_length_unit_scales_everything(tmp_path):
    text = asf().replace("length 0.0254", "length 0.045")
    clip = one(tmp_path, read_asf(write(tmp_path / "a.asf", text)), amc({}))
    assert at(clip, 0, "hip") == pytest.approx(np.array([3, 1, 2]) / 0.045 * 0.0254, abs=1e-12)


@pytest.mark.parametrize("name", ["01_01.amc", "01_01.amc.gz"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_line_ends_blank_lines_and_gzip_do_not_matter(tmp_path, skeleton, name, ending):
    text = amc({}, {"lhumerus": "1 2 3"})
    want = one(tmp_path, skeleton, text).points
    text = text.replace("\n2\n", "\n\n2\n").replace("\n", ending)
    clip = read_amc(write(tmp_path / name, text), skeleton, 120)
    assert clip.name == "01_01" and np.array_equal(clip.points, want)


def test_the_order_of_bones_may_change_from_frame_to_frame(tmp_path, skeleton):
    lines = amc({}, {"lhumerus": "1 2 3"}).splitlines()
    lines[-1], lines[-2] = lines[-2], lines[-1]
    want = one(tmp_path, skeleton, amc({}, {"lhumerus": "1 2 3"})).points
    assert np.array_equal(one(tmp_path, skeleton, "\n".join([*lines, ""])).points, want)


@pytest.mark.parametrize("first", [0, 1, 731])
def test_frames_may_begin_at_any_number(tmp_path, skeleton, first):
    assert len(one(tmp_path, skeleton, amc({}, {}, first=first)).points) == 2


@settings(max_examples=30, deadline=None)
@given(angles=st.lists(st.floats(-720, 720), min_size=15, max_size=15))
def test_bones_keep_their_length_at_any_angle(tmp_path_factory, skeleton, angles):
    words = iter([f"{angle:.17g}" for angle in angles])
    frame = {
        name: " ".join(next(words) for _ in bone.dof)
        for name, bone in skeleton.bones.items()
        if bone.dof and bone.name in ("thorax", "lclavicle", "lhumerus", "lradius", "rhumerus")
    }
    clip = one(tmp_path_factory.mktemp("amc"), skeleton, amc(frame))
    for tail, head, length in (
        ("hip", "neck", 0.5), ("neck", "l_shoulder", 0.2), ("l_shoulder", "l_elbow", 0.3),
        ("l_elbow", "l_hand", 0.25), ("r_shoulder", "r_elbow", 0.3), ("r_elbow", "r_hand", 0.25),
    ):  # fmt: skip
        bone = at(clip, 0, head) - at(clip, 0, tail)
        assert np.linalg.norm(bone) == pytest.approx(length, abs=1e-12)  # [m]


@pytest.mark.parametrize(
    ("old", "new", "where", "why"),
    [
        ("lradius 0", "lradius", "lradius", "lradius takes 1 values, got 0"),
        ("lradius 0", "lradius 0 0", "lradius", "lradius takes 1 values, got 2"),
        ("lradius 0", "lradius x", "lradius", "lradius must be a number, got 'x'"),
        ("lradius 0", "lradius nan", "lradius", "lradius must be a number, got 'nan'"),
        ("lradius 0", "lradius 1.#IND", "lradius", "lradius must be a number, got '1.#IND'"),
        ("lradius 0", "lradius 1_0", "lradius", "lradius must be a number, got '1_0'"),
        ("lradius 0", "lradius 1e999", "lradius", "lradius must be finite, got '1e999'"),
        ("lradius 0", "tail 0", "tail", "bone 'tail' is not in the skeleton"),
        ("lradius 0", "lhipjoint 0", "lhipjoint", "bone 'lhipjoint' has no dof in the skeleton"),
        ("lradius 0", "rradius 0", "rradius 0\n2", "bone 'rradius' is there twice in frame 1"),
        ("\n2\n", "\n3\n", "3", "frame 2 should follow, got '3'"),
        ("\n1\n", "\n", "root", "expected a frame number, got 'root'"),
        ("\n1\n", "\n1 1\n", "1 1", "a frame number stands alone, got '1 1'"),
        (":DEGREES", ":GRADES", ":GRADES", "keyword ':GRADES' is not one of an AMC file"),
    ],
)
def test_a_faulty_line_is_refused_with_file_line_and_token(
    tmp_path, skeleton, old, new, where, why
):
    text = amc({}, {}).replace(old, new, 1)
    line = text[: text.index("\n" + where) + 1].count("\n") + 1
    if "twice" in why:
        line = text[: text.index("rradius 0\n2")].count("\n") + 1
    with pytest.raises(ClipError) as error:
        one(tmp_path, skeleton, text)
    assert str(error.value) == f"{tmp_path / '01_01.amc'}:{line}: {why}"


def test_a_frame_without_a_bone_is_refused(tmp_path, skeleton):
    text = amc({}, {"thorax": ""}, {})
    with pytest.raises(ClipError, match="frame 2 ends without thorax"):
        one(tmp_path, skeleton, text)


def test_a_number_of_a_million_digits_is_refused_at_once(tmp_path, skeleton):
    begin = time.process_time()
    with pytest.raises(ClipError, match="rradius must be a number, got '0000"):
        one(tmp_path, skeleton, amc({"rradius": "0" * 10**6 + "x"}))
    assert time.process_time() - begin < 1.0  # [s]


def test_a_truncated_last_frame_is_refused(tmp_path, skeleton):
    lines = amc({}, {}, {}).splitlines(keepends=True)
    for lost in range(1, 9):
        with pytest.raises(ClipError, match="frame 3 ends without .*truncated"):
            one(tmp_path, skeleton, "".join(lines[:-lost]))


def test_a_number_that_may_be_cut_in_two_does_not_get_in(tmp_path, skeleton, caplog):
    text = amc({}, {"lradius": "12.53"})
    assert text.endswith("lradius 12.53\n")
    whole = one(tmp_path, skeleton, text).points
    for end in ("", "\r\n", " "):  # after any of them the number is whole
        assert np.array_equal(one(tmp_path, skeleton, text[:-1] + (end or "\n")).points, whole)
    assert caplog.text == ""
    for lost in range(1, 6):
        caplog.clear()
        read = one(tmp_path, skeleton, text[:-lost])
        assert np.array_equal(read.points, whole[:-1])
        (line,) = [record.getMessage() for record in caplog.records]
        assert line.endswith("(no line end); the last of its 2 frames is left out")
        assert "01_01.amc: nothing shows that its last number is whole" in line


def test_a_single_frame_that_may_be_cut_in_two_is_refused(tmp_path, skeleton):
    with pytest.raises(ClipError, match=r"and there is no other frame; a truncated file\?"):
        one(tmp_path, skeleton, amc({}).rstrip("\n"))


@pytest.mark.parametrize("angle", ["1e308", "-57296", "9" * 30])
def test_an_angle_of_no_joint_is_refused(tmp_path, skeleton, angle):
    why = r"frame 1 \(from 0\) turns a joint by .* rad, more than 1000"
    with pytest.raises(ClipError, match=why):
        one(tmp_path, skeleton, amc({}, {"rradius": angle}))
    assert len(one(tmp_path, skeleton, amc({"rradius": "57295"})).points) == 1


@pytest.mark.parametrize(("length", "arm"), [("0.28", "0.0499"), ("0.00254", "5.5")])
def test_a_person_of_a_size_that_only_a_wrong_unit_gives_is_refused(tmp_path, length, arm):
    text = asf().replace("length 0.0254", f"length {length}")
    skeleton = read_asf(write(tmp_path / "a.asf", text))
    why = f"an arm is {arm} m long, wanted \\[0.05, 5\\] m .*; the file is damaged or in another un"
    with pytest.raises(ClipError, match=why):
        one(tmp_path, skeleton, amc({}))


@pytest.mark.parametrize("length", ["0.27", "0.0029"])
def test_a_doll_and_a_giant_are_read(tmp_path, length):
    text = asf().replace("length 0.0254", f"length {length}")
    assert one(tmp_path, read_asf(write(tmp_path / "a.asf", text)), amc({}))


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "an empty file"),
        (b"\x02\x50\x01\0", "binary C3D markers"),
        (b"\0\1\2\3", "binary data"),
        (b"<html>", "an HTML or XML page"),
        (b"HIERARCHY\nROOT", "BVH text"),
        (b"#\n:version 1", "ASF text"),
        (b"hello", "text of no motion format known here"),
    ],
)
def test_what_is_no_motion_is_named(tmp_path, skeleton, content, what):
    with pytest.raises(ClipError, match=f"looks like {what}, not AMC text"):
        one(tmp_path, skeleton, content)


def test_a_nul_byte_further_on_is_placed(tmp_path, skeleton):
    data = amc({}, {}).encode() + b"3\nroot \0"
    with pytest.raises(ClipError, match=r"01_01.amc:23: .*NUL byte"):
        one(tmp_path, skeleton, data)


def test_a_position_beyond_reason_is_refused(tmp_path, skeleton):
    with pytest.raises(ClipError, match="frame 1 .*beyond 10000 m"):
        one(tmp_path, skeleton, amc({}, {"root": "1e300 0 0 0 0 0"}))


@pytest.mark.parametrize("fps", [0, -30, float("nan"), float("inf"), "120"])
def test_a_rate_that_is_none_is_refused(tmp_path, skeleton, fps):
    with pytest.raises(ParameterError, match="fps must be in"):
        one(tmp_path, skeleton, amc({}), fps)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("length 0.0254", "length 0", r"length must be in \[1e-6, 1e6\]"),
        ("angle deg", "angle grad", "angle must be deg or rad, got 'grad'"),
        ("order TX TY TZ RX RY RZ", "order TX TY TZ RX RY RY", "root order must name"),
        ("position 0 0 0", "position 0 1 0", "a root position other than 0 0 0"),
        ("direction 0 1 0", "direction 0 2 0", "direction must be a unit vector"),
        ("direction 0 1 0", "direction 0 1", "direction takes 3 values, got 2"),
        ("axis 90 0 0 XYZ", "axis 90 0 0 XYY", "axis order must be such as XYZ, got 'XYY'"),
        ("dof rx ry rz", "dof rx ry tz", "dof must be among rx ry rz"),
        ("name thorax", "name rradius", "bone 'rradius' is there twice"),
        ("lhumerus lradius\n", "lhumerus lulna\n", "bone 'lulna' is not in :bonedata"),
        ("    lhumerus lradius\n", "", "not below the root: lradius"),
        ("lhumerus lradius\n", "lhumerus lclavicle\n", "bone 'lclavicle' has two parents"),
        (":hierarchy", ":hierachy", "section ':hierachy' is not one of an ASF file"),
        (":units", ":root", "section ':root' is there twice"),
        ("rhumerus rradius\n  end\n", "", "this begin has no end"),
        ("id 3", "colour 3", "'colour' is not expected here"),
        ("  begin\n     id 2", "  begin\n  begin\n     id 2", "begin within the block of line 23"),
        ("  end\n  begin\n     id 2", "  begin\n     id 2", "begin within the block of line 16"),
        ("direction 0 1 0", "direction 1e308 1e308 0", "direction must be a unit vector"),
    ],
)
def test_a_faulty_skeleton_is_refused(tmp_path, old, new, why):
    assert old in asf()
    with pytest.raises(ClipError, match=why):
        read_asf(write(tmp_path / "01.asf", asf().replace(old, new, 1)))


def test_a_skeleton_without_a_wanted_bone_is_refused_by_name(tmp_path):
    text = asf().replace("rradius", "rforearm")
    skeleton = read_asf(write(tmp_path / "01.asf", text))
    with pytest.raises(ClipError, match="its skeleton has no rradius; it has root, lhipjoint"):
        one(tmp_path, skeleton, amc({}))


def test_an_angle_unit_of_radians_holds_for_axes_too(tmp_path):
    text = asf().replace("angle deg", "angle rad").replace("axis 90", f"axis {np.pi / 2:.17g}")
    skeleton = read_asf(write(tmp_path / "01.asf", text))
    assert not skeleton.degrees
    clip = one(tmp_path, skeleton, amc({"lradius": "90"}))  # the motion says degrees
    assert at(clip, 0, "l_hand") == pytest.approx((3.25, 1.5, 2.5))


@pytest.mark.parametrize(
    ("trial", "fps"), [("79_51", 60), ("05_02", 120), ("136_19", 60), ("136_18", 120), ("x", 120)]
)
def test_cmu_subjects_have_their_recording_rate(trial, fps):
    assert cmu_rate(trial) == fps


def test_no_damaged_motion_does_anything_but_read_or_be_refused(tmp_path, skeleton):
    for copy in broken(amc({}, {"lhumerus": "1.5 -2 3e1"}, {}).encode(), 400, seed=1):
        try:
            assert np.isfinite(one(tmp_path, skeleton, copy).points).all()
        except ClipError:
            pass


def test_no_damaged_skeleton_does_anything_but_read_or_be_refused(tmp_path):
    for copy in broken(asf().encode(), 400, seed=2):
        try:
            clip = one(tmp_path, read_asf(write(tmp_path / "01.asf", copy)), amc({}))
            assert np.isfinite(clip.points).all()
        except ClipError:
            pass


def test_reading_by_stride_and_line_by_line_agree(skeleton):
    lines = amc(*[{"lradius": f"{i}.5", "root": f"{i} 0 0 1 2 3"} for i in range(50)]).encode()
    fast = reader._by_stride(lines.splitlines(), 3, skeleton)
    slow = reader._by_line("-", lines.splitlines(), 3, skeleton)
    assert fast is not None and fast.keys() == slow.keys()
    assert all(np.array_equal(fast[key], slow[key]) for key in slow)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real clips beside the project")
def test_real_clips_agree_with_an_independent_reader():
    golden = json.loads((SHARED / "golden_fk.json").read_text())
    checked = 0
    for trial, want in golden.items():
        subject = trial.partition("_")[0]
        folder = SHARED / "cmu" / subject
        if not (folder / f"{trial}.amc.gz").is_file():
            continue
        checked += 1
        skeleton = read_asf(folder / f"{subject}.asf")
        clip = read_amc(folder / f"{trial}.amc.gz", skeleton, 120)
        for point, bone in reader.CMU_POINTS.items():
            places = np.array(want["joint_pos_asf_units"][bone])[:, [2, 0, 1]] / 0.45 * 0.0254
            ours = clip.points[want["frames0"], POINTS.index(point)]
            assert np.allclose(ours, places, rtol=0, atol=1e-6)  # [m]
        x, _ = features(face_forward(clip.points)[0])
        want = np.array(want["unit_vectors_mid_neck"])
        assert np.allclose(x[golden[trial]["frames0"]], want.reshape(-1, 21), rtol=0, atol=1e-6)
    assert checked >= 2
