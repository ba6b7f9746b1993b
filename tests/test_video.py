"""`s3le video`: films made here, estimators that misbehave in real processes, and a real one."""

import json
import os
import stat
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from s3le.cli.main import app
from s3le.errors import ClipError, ParameterError, VideoError
from s3le.human import points_parquet
from s3le.human.read import is_clip, read_clip
from s3le.human.skeletons import read_frames
from s3le.skeleton import POINTS
from s3le.video import convert, process, smooth, track, worker
from s3le.video.convert import Choices, Looked
from s3le.video.decode import Video
from s3le.video.estimator import JOINTS

ROOT = Path(__file__).parents[1]
AT = {name: i for i, name in enumerate(JOINTS)}
STANDING = {  # [m] in a camera's frame, x right, y down, z away: a person who faces the camera
    "shoulder": (0.18, -0.50, 0.0), "elbow": (0.25, -0.25, 0.0), "hand": (0.25, -0.05, -0.1),
    "hip": (0.10, 0.0, 0.0), "knee": (0.10, 0.42, 0.0), "ankle": (0.10, 0.84, 0.0),
}  # fmt: skip

pytestmark = pytest.mark.wide


def person(n=60, fps=30.0, u=0.5):
    """Joints of somebody who stands and swings the arms, (n, 12, 6)."""
    joints = np.full((n, 12, 6), 0.95)
    swing = 0.15 * np.sin(2 * np.pi * 0.8 * np.arange(n) / fps)
    for name, i in AT.items():
        x, y, z = STANDING[name[2:]]
        side = 1.0 if name[0] == "l" else -1.0  # who faces the camera has the left on its right
        joints[:, i, :3] = side * x, y, z
        if name.endswith(("elbow", "hand")):
            joints[:, i, 2] += side * swing
    joints[:, :, 4] = u + joints[:, :, 0] * 0.2
    joints[:, :, 5] = 0.5 + joints[:, :, 1] * 0.2
    return joints


def looked(joints, time=None, change=None):
    time = np.arange(len(joints)) / 30.0 if time is None else time
    change = np.full(len(joints), 0.002) if change is None else change
    about = {"mean_fps": (len(time) - 1) / (time[-1] - time[0]), "frames": len(time)}
    return Looked(time, joints, change, about)


def made(joints, time=None, change=None, **choices):
    return convert.skeletons(looked(joints, time, change), Choices(**choices))


# --- what joints become


def test_who_faces_the_camera_has_left_to_the_left_and_up_above():
    points = dict(zip(POINTS, track.ten_points(person(1), 0.1, 0.0)[0], strict=True))
    assert points["hip"] == pytest.approx([0, 0, 0], abs=1e-12)
    assert points["neck"] == pytest.approx([0, 0, 0.5]) and points["l_shoulder"][1] > 0.1
    assert points["l_hand"][0] == pytest.approx(0.1)  # stretched towards the camera


@pytest.mark.parametrize(("pitch", "roll"), [(20.0, 0.0), (-15.0, 0.0), (20.0, 12.0)])
def test_a_tilted_camera_is_undone_and_its_pitch_found(pitch, roll):
    level = person()
    p, r = np.radians([pitch, roll])
    pitched = np.array([  # the world as the tilted camera has it: first pitch, then roll
        [1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)],
    ])  # fmt: skip
    rolled = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    seen = level.copy()
    seen[:, :, :3] = level[:, :, :3] @ (rolled @ pitched).T
    up = (rolled @ pitched) @ [0, -1, 0]
    assert np.sign(up[0]) == np.sign(roll)  # roll: uprights lean to the right
    assert np.sign(up[2]) == -np.sign(pitch)  # looking down: what is up comes nearer
    found = track.standing_pitch(seen, 0.1, r)
    assert np.degrees(found.angle) == pytest.approx(pitch, abs=0.1) and found.frames == 60
    straight, turned = (
        track.ten_points(level, 0.1, 0.0), track.ten_points(seen, 0.1, p, r)
    )  # fmt: skip
    assert turned == pytest.approx(straight, abs=1e-9)


def test_nobody_stands_so_the_camera_is_taken_as_level_and_that_is_said():
    sitting = person()
    for side in "rl":
        sitting[:, AT[f"{side}_knee"], :3] += [0.0, -0.42, -0.42]
        sitting[:, AT[f"{side}_ankle"], :3] += [0.0, -0.42, -0.42]
    about = made(sitting).about
    assert about["choices"]["pitch"] == 0.0 and "taken as level" in about["pitch_from"]


def test_rows_say_why_they_are_not_known_and_short_holes_are_filled():
    joints = person(90)
    joints[20:23] = np.nan  # 0.13 s
    joints[40:60] = np.nan
    joints[70:, AT["l_hand"], 3] = 0.05  # from here on hidden
    out = made(joints, fill=0.2, smooth=0.0)
    words = out.status
    assert set(words[20:23]) == {"filled"} and set(words[40:60]) == {"nobody"}
    assert set(words[70:]) == {"hidden"} and set(words[:20]) == {"seen"}
    known = np.isfinite(out.points).all(axis=(1, 2))
    assert (known == np.isin(words, ("seen", "filled"))).all()
    hand = POINTS.index("l_hand")
    assert np.isnan(out.points[70:, hand]).all()  # only that limb is lost
    assert np.isfinite(np.delete(out.points[70:], hand, axis=1)).all()
    whole = made(person(90), smooth=0.0).points
    assert np.abs(out.points[20:23] - whole[20:23]).max() < 0.01  # [m]
    assert out.about["gaps"] == 1 and out.about["longest_gap_s"] == pytest.approx(20 / 30)
    unfilled = made(joints, fill=0.05, smooth=0.0)
    assert set(unfilled.status[20:23]) == {"nobody"}


def test_nothing_is_interpolated_or_filtered_across_a_cut():
    joints = np.concatenate([person(30, u=0.3), person(30, u=0.7)])
    joints[30:, :, :3] *= 1.3
    change = np.full(60, 0.002)
    change[30] = 0.08
    out = made(joints, change=change, fill=1.0)
    assert out.status[30] == "cut" and out.about["cuts"] == 1 and out.about["jumps"] == 0
    assert np.isnan(out.points[30]).all()
    alone = made(person(30, u=0.3), fill=1.0)
    assert np.array_equal(out.points[:30], alone.points)  # what follows has no part in it
    assert out.about["gaps"] == 1


def test_a_change_of_light_is_no_cut_and_a_hard_cut_needs_no_jump():
    change = np.full(60, 0.002)
    change[30] = 0.1
    assert made(person(), change=change).about["cuts"] == 0  # the person stays where it was
    change[30] = 0.3
    assert made(person(), change=change).about["cuts"] == 1
    shaky = np.full(60, 0.05)  # a camera in motion: every frame changes
    shaky[30] = 0.2
    assert made(person(), change=shaky).about["cuts"] == 0


@pytest.mark.parametrize("gap", [0, 6])
def test_a_jump_to_another_person_is_told_and_separates(gap):
    joints = np.concatenate([person(30, u=0.2), person(30, u=0.8)])
    joints[30 : 30 + gap] = np.nan  # it may lose the one before it finds the other
    out = made(joints, fill=1.0)
    assert out.about["jumps"] == 1 and out.status[30 + gap] == "jump"
    assert np.isnan(out.points[30 : 30 + gap + 1]).all()
    walking = person(60)
    walking[:, :, 4] += np.linspace(0.0, 0.3, 60)[:, None]
    assert made(walking).about["jumps"] == 0


def turned(joints, angle):
    """The same, turned about the vertical by angles [rad], (n,)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    out, (x, z) = joints.copy(), (joints[:, :, 0], joints[:, :, 2])
    out[:, :, 0], out[:, :, 2] = c * x + s * z, c * z - s * x
    return out


OTHER_SIDE = [3, 4, 5, 0, 1, 2, 7, 6, 9, 8, 11, 10]


def test_frames_that_take_front_for_back_are_left_out():
    joints = person(60)
    wrong = np.r_[20:34, 40]
    joints[wrong] = joints[wrong][:, OTHER_SIDE]  # left for right
    out = made(joints, fill=0.0, smooth=0.0)
    assert (np.flatnonzero(out.status == "flip") == wrong).all() and out.about["flips"] == 2
    between = np.zeros(60)
    between[[20, 34]] = np.radians([105.0, 80.0])  # seen half-way, there and back
    half = turned(joints, between)
    half[20] = turned(person(60), between)[20]
    assert set(np.flatnonzero(made(half, fill=0.0).status == "flip")) == {*range(20, 35), 40}


def test_who_really_turns_is_not_flipped():
    for seconds, fps in ((2.0, 30.0), (1.0, 60.0), (2.0, 15.0)):
        n = int(3 * seconds * fps)  # three times round
        spin = turned(person(n), 2 * np.pi * np.arange(n) / fps / seconds)
        out = made(spin, time=np.arange(n) / fps)
        assert set(out.status) == {"seen"}, (seconds, fps)


def test_the_filter_keeps_slow_motion_and_straight_lines_and_takes_noise():
    t = np.arange(300) / 30.0
    line = np.stack([t, -2 * t, 0.5 * t], axis=1)
    assert smooth.low_pass(line, 30.0, 6.0) == pytest.approx(line, abs=1e-9)  # to the very ends
    for hertz, left in ((0.5, 0.99), (6.0, np.sqrt(0.5))):
        wave = np.sin(2 * np.pi * hertz * np.arange(600) / 120.0)[:, None]
        ratio = smooth.low_pass(wave, 120.0, 6.0)[100:500].std() / wave[100:500].std()
        assert ratio == pytest.approx(left, abs=0.01)
    assert np.array_equal(smooth.low_pass(line, 30.0, 0.0), line)


def test_uneven_times_become_a_constant_rate():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.choice([1 / 30, 1 / 24, 1 / 20], 200))
    points = np.sin(time)[:, None, None] * np.ones((200, 2, 3))
    out = smooth.at_rate(time, points, np.zeros(200, int), 25.0, 0.2, 0.0)
    assert np.diff(out.time) == pytest.approx(1 / 25)
    assert np.abs(out.points[:, 0, 0] - np.sin(out.time)).max() < 1e-3
    slow = smooth.at_rate(time[::10], points[::10], np.zeros(20, int), 25.0, 0.2, 6.0)
    assert np.isfinite(slow.points).all()  # what is usual for a video is no hole
    hole = np.delete(np.arange(200), np.r_[80:120])
    gap = smooth.at_rate(time[hole], points[hole], np.zeros(160, int), 25.0, 0.2, 6.0)
    lost = np.isnan(gap.points[:, 0, 0])
    assert lost.any() and (time[78] < gap.time[lost]).all() and (gap.time[lost] < time[121]).all()


@pytest.mark.parametrize(
    ("joints", "choices", "message"),
    [
        (np.full((30, 12, 6), np.nan), {}, "nobody is seen in any of its 30 frames"),
        (person(1), {}, "single frame"),
        (person(30), {"rate": 1e4, "last": 900.0}, "lasts 900 s.*at most 2000000"),
        (person(30), {"visibility": 0.99}, "never all visible to 0.99"),
    ],
)
def test_a_video_that_gives_no_skeletons_is_refused(joints, choices, message):
    time = np.arange(len(joints)) / 30.0
    time[-1] = choices.pop("last", time[-1])
    with pytest.raises(VideoError, match=message):
        convert.skeletons(Looked(time, joints, 0 * time, {"mean_fps": 30.0}), Choices(**choices))


@pytest.mark.parametrize("name", ["pitch", "roll", "visibility", "fill", "smooth", "rate"])
@pytest.mark.parametrize("value", [float("nan"), -1e9])
def test_choices_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name):
        Choices(**{name: value}).check()


# --- the file


@pytest.fixture
def file(tmp_path):
    joints = person(90)
    joints[40:60] = np.nan
    path = tmp_path / "walk.parquet"
    convert.write(made(joints), path)
    return path


def test_the_file_is_a_clip_like_any_other(file):
    clip = read_clip(file)
    assert clip.name == "walk" and clip.fps == pytest.approx(30.0) and len(clip.points) == 90
    frames = read_frames(file, "midpoint")
    assert len(frames.x) == 70 and frames.dropped["not_finite"] == 20
    assert frames.gap == pytest.approx(21 / 30)
    assert read_clip(file, fps=60.0).fps == 60.0
    assert points_parquet.about(file)["rows_by_status"] == {"seen": 70, "nobody": 20}
    again = file.with_name("again.parquet")
    joints = person(90)
    joints[40:60] = np.nan
    convert.write(made(joints), again)
    assert again.read_bytes() == file.read_bytes()


def test_a_folder_gives_its_clips_and_not_its_motions(file):
    import pyarrow as pa
    import pyarrow.parquet as pq

    motion = file.with_name("motion.parquet")
    pq.write_table(pa.table({"time": [0.0, 0.1], "elbow": [0.0, 0.1]}), motion)
    assert is_clip(file) and not is_clip(motion) and not is_clip(file.with_name("none.parquet"))
    with pytest.raises(ClipError, match="no skeletons of `s3le video`.*s3le audit"):
        read_clip(motion)


def edited(path, **columns):
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    for name, values in columns.items():
        if values is None:
            table = table.drop_columns(name)
        else:
            i = table.column_names.index(name)
            table = table.set_column(i, name, pa.array(values))
    pq.write_table(table, path)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"hip_x": None}, "'hip_x' is missing"),
        ({"hip_x": np.full(90, np.nan)}, "in not one of 90 frames"),
        ({"neck_z": np.full(90, np.inf)}, "puts neck_z at inf m"),
        ({"neck_z": np.full(90, 3e5)}, "another unit"),
        ({"l_hand_z": np.full(90, 900.0)}, "arm is"),
        ({"time": np.zeros(90)}, "not 30 frames a second"),
        ({"time": np.full(90, np.nan)}, "not 30 frames a second"),
        ({"hip_x": ["a"] * 90}, "not made of numbers"),
        ({"hip_x": [None] + [0.0] * 89}, "not made of numbers"),
    ],
)
def test_a_file_that_was_edited_is_refused_in_one_line(file, columns, message):
    edited(file, **columns)
    with pytest.raises(ClipError, match=message) as refusal:
        read_clip(file)
    assert str(file) in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize("cut", [0, 4, 500, -100])
def test_a_file_that_is_cut_short_is_refused(file, cut):
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(ClipError, match="no sound Parquet"):
        read_clip(file)


# --- films


def film(path, pictures, times=None, turn=0, fps=25, aspect=None):
    """A film of uint8 pictures; times [s] make its rate vary."""
    av = pytest.importorskip("av")
    from fractions import Fraction

    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=fps, options={"crf": "18", "g": "10"})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.codec_context.thread_count = "yuv420p", 1
        if times is not None:
            stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if aspect:
            stream.codec_context.sample_aspect_ratio = aspect
        if turn:
            stream.set_display_rotation(turn)
        for i, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            if times is not None:
                frame.pts, frame.time_base = round(times[i] * 1000), Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def scene(n=20, shade=40, size=(48, 64)):
    """A dark film with a bright bar at the top."""
    pictures = [np.full((*size, 3), shade, np.uint8) for _ in range(n)]
    for i, picture in enumerate(pictures):
        picture[:12] = 220
        picture[-4:, : i + 1] = 120
    return pictures


@pytest.mark.parametrize(
    ("turn", "bright"),
    [(0, np.s_[2:8, 20:40]), (90, np.s_[20:40, 2:8]), (-90, np.s_[20:40, -8:-2]),
     (180, np.s_[-8:-2, 20:40])],
)  # fmt: skip
def test_a_rotated_phone_is_turned_upright(tmp_path, turn, bright):
    video = Video(film(tmp_path / "a.mp4", scene(), turn=turn))
    pictures = list(video.pictures())
    assert len(pictures) == 20
    rgb = pictures[5].rgb
    assert rgb.shape == ((48, 64, 3) if turn in (0, 180) else (64, 48, 3))
    assert video.size == (rgb.shape[1], rgb.shape[0])
    assert rgb[bright].mean() > 180 and rgb.mean() < 130


def test_wide_pixels_are_made_square(tmp_path):
    video = Video(film(tmp_path / "a.mp4", scene(3), aspect=2))
    assert {picture.rgb.shape for picture in video.pictures()} == {(48, 128, 3)}


def test_a_large_film_is_made_smaller(tmp_path):
    video = Video(film(tmp_path / "a.mp4", scene(2, size=(16, 2880))))
    assert {picture.rgb.shape for picture in video.pictures()} == {(11, 1920, 3)}


def test_times_are_the_frames_own_where_the_rate_varies(tmp_path):
    times = np.cumsum([0.0] + [0.04, 0.08, 0.02, 0.2] * 4)
    video = Video(film(tmp_path / "a.mkv", scene(len(times)), times))
    seen = [picture.time for picture in video.pictures()]
    assert np.array(seen) - seen[0] == pytest.approx(times, abs=2e-3)


def test_a_part_of_a_video_is_read_and_no_part_is_told(tmp_path):
    path = film(tmp_path / "a.mp4", scene(25))
    seen = [picture.time for picture in Video(path, 0.2, 0.6).pictures()]
    assert seen == pytest.approx(np.arange(5, 16) / 25)
    with pytest.raises(VideoError, match="nothing from 3 to inf s; it lasts 0.96 s"):
        list(Video(path, 3.0).pictures())


def test_a_cut_shows_in_the_picture(tmp_path):
    path = film(tmp_path / "a.mp4", scene(20) + scene(20, shade=200))
    change = np.array([picture.change for picture in Video(path).pictures()])
    assert change[20] > track.CUT and np.delete(change, 20).max() < 0.02


def broken(tmp_path, kind):
    path = tmp_path / "a.mp4"
    if kind == "absent":
        return path
    if kind == "text":
        path.write_text("no video at all\n" * 50)
    elif kind == "empty":
        path.touch()
    elif kind == "playlist":
        path.write_text(f"#EXTM3U\n#EXTINF:1,\n{film(tmp_path / 'b.mp4', scene())}\n")
    elif kind == "sound":
        av = pytest.importorskip("av")
        with av.open(str(path), "w") as out:
            stream = out.add_stream("aac", rate=8000, layout="mono")
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
            frame.rate, frame.pts = 8000, 0
            out.mux(stream.encode(frame))
            out.mux(stream.encode())
    elif kind == "cut short":
        data = film(path, scene()).read_bytes()
        path.write_bytes(data[: len(data) // 2])
    elif kind == "no frames":
        av = pytest.importorskip("av")
        with av.open(str(path), "w") as out:
            stream = out.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            out.start_encoding()
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("absent", "no such file"),
        ("text", "no video that can be read"),
        ("empty", "no video that can be read"),
        ("playlist", "no video that can be read"),
        ("sound", "only sound"),
        ("cut short", "no video that can be read"),
        ("no frames", "no(t one frame| pictures)"),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(tmp_path, kind, message):
    pytest.importorskip("av")
    path = broken(tmp_path, kind)
    with pytest.raises(VideoError, match=message) as refusal:
        list(Video(path).pictures())
    assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)
    assert Video(path).expected() is None or kind == "cut short"


def test_a_film_that_breaks_off_gives_what_it_has(tmp_path):
    path = film(tmp_path / "a.mkv", scene(60))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    assert 5 < len(list(Video(path).pictures())) < 60


# --- the pipe


def far_end(tmp_path, body):
    """An interpreter and a script that speaks as told."""
    script = tmp_path / "far.py"
    script.write_text(
        textwrap.dedent(f"""
        import importlib.util, json, os, struct, sys, time
        spec = importlib.util.spec_from_file_location("worker", {str(worker.__file__)!r})
        w = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(w)
        pipe, frames = os.fdopen(1, "wb", 0), sys.stdin.buffer
        def say(*what): pipe.write(w.message(*what))
        def hello(): say(w.HELLO, json.dumps({{"estimator": "fake", "version": "1"}}).encode())
        def frame():
            head = frames.read(w.HEADER.size)
            if not head: sys.exit(0)
            *_, width, height, size = w.HEADER.unpack(head)
            return width, height, frames.read(size)
        def joints(*numbers): say(w.JOINTS, struct.pack("<72f", *numbers))
    """)
        + textwrap.dedent(body)
    )
    return Path(sys.executable), script


GOOD = """
    hello()
    for i in range(10**9):
        width, height, pixels = frame()
        if i % 3 == 2: say(w.NOBODY)
        else: joints(*[float(i), width / 10, height / 10, pixels[0], 0.0, 1.0] * 12)
"""


def test_pictures_go_through_the_pipe_and_answers_come_back_in_order(tmp_path):
    pictures = [np.full((720, 1280, 3), i, np.uint8) for i in range(7)]  # more than a pipe holds
    with process.Process(*far_end(tmp_path, GOOD)) as estimator:
        assert estimator.name == "fake 1"
        answers = list(estimator.joints(iter(pictures)))
    assert len(answers) == 7 and np.isnan(answers[2]).all() and np.isnan(answers[5]).all()
    assert answers[4][0].tolist() == [4.0, 128.0, 72.0, 4.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("sys.exit('no module named mediapipe')", r"status 1 \(no module named mediapipe\).*make"),
        ("print('why\\nW0000 noise', file=sys.stderr); sys.exit(3)", r"status 3 \(why\)"),
        ("hello(); frame(); os.abort()", r"ended with status -6 \(it said nothing\)"),
        ("hello(); frame(); say(w.FAILED, 'out of\\nluck'.encode())", "gave up: out of"),
        ("say(w.FAILED, b'no model')", "gave up: no model; set it up with: make video"),
        ("pipe.write(b'Traceback: something else')", "does not speak this project's protocol"),
        ("pipe.write(b'S3LV' + bytes([9]) + bytes(9))", "version 9 of the protocol, wanted 1"),
        ("say(w.HELLO, b'[' * 4000)", "does not speak"),
        ("say(w.HELLO, b'{}')", "does not speak"),
        ("pipe.write(w.HEADER.pack(b'S3LV', 1, w.HELLO, 0, 0, 2**31))", "does not speak"),
        ("hello(); frame(); say(w.JOINTS, b'short'); frames.read()", "does not speak"),
        ("hello(); frame(); hello()", "does not speak"),
        ("hello(); frame(); joints(*[1e30] * 72); frames.read()", "does not speak"),
        ("hello(); frame(); frame(); time.sleep(60)", "took more than 0.5 s to answer a frame"),
        ("hello(); time.sleep(60)", "took more than 0.5 s to take a frame"),
        ("time.sleep(60)", "took more than 0.3 s to start"),
    ],
)
def test_an_estimator_that_misbehaves_ends_in_one_line(tmp_path, body, message):
    pictures = [np.zeros((720, 1280, 3), np.uint8)] * 3
    begin = 0.3 if body.startswith("time") else 20.0
    with pytest.raises(VideoError, match=message) as refusal:
        with process.Process(*far_end(tmp_path, body), begin=begin, answer=0.5) as estimator:
            list(estimator.joints(pictures))
    assert "\n" not in str(refusal.value)


def test_an_environment_that_is_not_there_is_named_with_what_makes_it(tmp_path):
    with pytest.raises(VideoError, match="nowhere: no environment.*make video"):
        process.interpreter(tmp_path / "nowhere")
    with pytest.raises(VideoError, match="cannot be run.*make video"):
        process.Process(tmp_path / "python")


# --- the command


def environment(tmp_path, body=GOOD):
    """An environment whose interpreter is a real process that speaks as told, whatever it runs."""
    python, script = far_end(tmp_path, body)
    fake = tmp_path / "env" / "bin" / "python"
    fake.parent.mkdir(parents=True)
    fake.write_text(f"#!/bin/sh\nexec {python} {script}\n")
    fake.chmod(fake.stat().st_mode | stat.S_IXUSR)
    return tmp_path / "env"


SEEN = f"""
    hello()
    rows = {person(1)[0].ravel().tolist()}
    for i in range(10**9):
        frame()
        if 20 <= i < 30: say(w.NOBODY)
        else: joints(*rows)
"""


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_video_becomes_a_clip_and_the_summary_says_how(tmp_path):
    path = film(tmp_path / "phone.mp4", scene(50), turn=90)
    out = tmp_path / "skeletons.parquet"
    said = run("video", path, "--out", out, "--environment", environment(tmp_path, SEEN))
    assert said.exit_code == 0, said.output
    assert "phone.mp4: 50 frames at 25 Hz, a person in 80%; 40 of 50 rows known" in said.output
    assert "1 gaps (longest 0.40 s), 0 cuts, 0 jumps" in said.output
    assert "turned by 90 deg" in said.output and "camera looks down by 0.0 deg" in said.output
    frames = read_frames(out, "midpoint")
    assert len(frames.x) == 40 and frames.fps == pytest.approx(25.0)
    told = points_parquet.about(out)
    assert told["estimator"] == "fake 1" and told["frames_by_status"] == {"seen": 40, "nobody": 10}
    assert len(told["video_sha256"]) == 64


def test_one_video_of_two_fails_and_the_other_is_written(tmp_path):
    good = film(tmp_path / "good.mp4", scene(40))
    bad = tmp_path / "bad.mp4"
    bad.write_text("no video")
    where = environment(tmp_path, SEEN)
    said = run("video", bad, good, "--out", tmp_path / "clips", "--environment", where)
    assert said.exit_code == 1 and "1 of 2 videos failed" in said.output
    assert f"VideoError: {bad}: is no video" in said.output
    assert [p.name for p in (tmp_path / "clips").iterdir()] == ["good.parquet"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.mp4", "b.mp4", "--out", "c.parquet"], "need a folder"),
        (["a.mp4", "--out", "c.bvh"], "ends in .parquet"),
        (["a.mp4", "x/a.mp4", "--out", "clips"], "2 videos are called 'a'"),
        (["a.mp4", "--out", "c.parquet", "--fill", "nan"], "fill must be"),
        (["a.mp4", "--out", "c.parquet", "--environment", "nowhere"], "make video"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_is_read(
    tmp_path, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    said = run("video", *words)
    assert said.exit_code == 2 and message in said.output
    assert not list(tmp_path.iterdir())


# --- the real one


REAL = Path(os.environ.get("S3LE_VIDEO", ROOT / "data" / "downloads" / "video" / "demo.mp4"))


@pytest.mark.skipif(
    not (REAL.is_file() and (ROOT / process.ENVIRONMENT / "bin" / "python").exists()),
    reason="needs make video and make videos",
)
def test_mediapipe_finds_the_person_of_a_real_video(tmp_path):
    pytest.importorskip("av")
    pictures = []
    for picture in Video(REAL).pictures():
        pictures.append(picture)
        if len(pictures) == 45:
            break
    with process.Process(process.interpreter()) as estimator:
        assert estimator.name == "mediapipe 0.10.21"
        joints = np.stack(list(estimator.joints(p.rgb for p in pictures)))
    time = np.array([p.time for p in pictures])
    change = np.array([p.change for p in pictures])
    out = convert.skeletons(looked(joints, time, change), Choices())
    known = np.isfinite(out.points).all(axis=(1, 2))
    assert known.mean() > 0.5
    height = out.points[known][:, POINTS.index("neck"), 2]
    assert ((0.3 < height) & (height < 0.7)).mean() > 0.9  # [m], upright
    assert json.dumps(out.about, allow_nan=False)
