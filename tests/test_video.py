"""Joints that a camera saw become skeletons: what is filled, cut, filtered, left out and said."""

import numpy as np
import pytest
from filmed import AT, made, person

from s3le.errors import ClipError, ParameterError, VideoError
from s3le.human import points_parquet
from s3le.human.read import is_clip, read_clip
from s3le.human.skeletons import read_frames
from s3le.skeleton import POINTS
from s3le.video import convert, smooth, track
from s3le.video.convert import Choices, Looked

pytestmark = pytest.mark.wide


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
