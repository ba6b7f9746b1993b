"""`s3le video`: films made here, estimators that misbehave in real processes, and a real one."""

import json
import stat
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from command import ROOT, run
from filmed import REAL, film, looked, person, scene

from s3le.errors import VideoError
from s3le.human import points_parquet
from s3le.human.skeletons import read_frames
from s3le.skeleton import POINTS
from s3le.video import convert, process, track, worker
from s3le.video.convert import Choices
from s3le.video.decode import Video

pytestmark = pytest.mark.wide


# --- films


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
