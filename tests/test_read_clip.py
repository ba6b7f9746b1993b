import gzip
import io
import os
import time

import numpy as np
import pytest
from handmade import amc, asf, bvh, deepmimic, write
from hypothesis import given
from hypothesis import strategies as st

from s3le.errors import ClipError, ParameterError
from s3le.human import text
from s3le.human.clip import Clip, at_constant_rate, frame_indices, resample
from s3le.human.read import digest, first_bytes, is_clip, read_clip

ROW = [0.0] * 12


def line(n, fps=120.0):
    """A clip whose every coordinate is the frame's number."""
    return Clip("line", fps, np.tile(np.arange(float(n))[:, None, None], (1, 10, 3)))


# --- one door for every format ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content", "fps"),
    [
        ("a.bvh", bvh([ROW], step="0.04"), 25),
        ("a.bvh.gz", bvh([ROW]), 120),
        ("A.BVH", bvh([ROW]), 120),
        ("a.txt", deepmimic({}, {}), 30),
        ("a.json", deepmimic({}, {}), 30),
        ("a.json.gz", deepmimic({}, {}), 30),
        ("01_02.amc", amc({}), 120),
        ("01_02.amc.gz", amc({}), 120),
        ("79_02.amc", amc({}), 60),
    ],
)
def test_the_suffix_chooses_the_reader(tmp_path, name, content, fps):
    write(tmp_path / "79.asf", asf())
    clip = read_clip(write(tmp_path / name, content))
    assert clip.fps == fps and clip.points.shape[1:] == (10, 3)
    assert clip.name == name.split(".")[0]
    assert read_clip(tmp_path / name, fps=50).fps == 50


@pytest.mark.parametrize(
    ("name", "content", "seen", "wanted"),
    [
        ("a.amc", bvh([ROW]), "BVH text", "AMC text"),
        ("a.amc", asf(), "ASF text", "AMC text"),
        ("a.bvh", amc({}), "AMC text", "BVH text"),
        ("a.bvh", deepmimic({}), "JSON text", "BVH text"),
        ("a.bvh", "<!DOCTYPE html>", "an HTML or XML page", "BVH text"),
        ("a.bvh", b"PK\x03\x04....", "a zip archive", "BVH text"),
        ("a.bvh", gzip.compress(b"HIERARCHY", mtime=0), "gzip data (name it .gz)", "BVH text"),
        ("a.bvh", b"Kaydara FBX Binary  \0", "a binary FBX scene", "BVH text"),
        ("a.bvh", " \r\n\t\n", "an empty file", "BVH text"),
        ("a.txt", "notes", "text of no motion format known here", "JSON text"),
        ("a.json.gz", b"", "an empty file", "JSON text"),
    ],
)
def test_a_mislabelled_file_is_refused_with_what_it_looks_like(
    tmp_path, name, content, seen, wanted
):
    write(tmp_path / "x.asf", asf())
    path = write(tmp_path / name, content)
    with pytest.raises(ClipError) as error:
        read_clip(path)
    assert str(error.value) == f"{path}: looks like {seen}, not {wanted}"


def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(ClipError, match="motion files end in .amc, .bvh, .json, .txt, .parq"):
        read_clip(write(tmp_path / "a.xyz", b"\x02\x50"))


def test_an_amc_takes_the_skeleton_of_its_subject_or_the_only_one(tmp_path):
    path = write(tmp_path / "01_02.amc", amc({}))
    with pytest.raises(ClipError, match="needs its skeleton 01.asf beside it; there: none"):
        read_clip(path)
    write(tmp_path / "me.asf", asf())
    assert len(read_clip(path).points) == 1
    write(tmp_path / "you.asf", "not read")
    with pytest.raises(ClipError, match="needs its skeleton 01.asf .* there: me.asf, you.asf"):
        read_clip(path)
    write(tmp_path / "01.asf.gz", asf())
    assert len(read_clip(path).points) == 1


@pytest.mark.parametrize("suffix", [".bvh", ".amc", ".txt", ".json", ".npz", ".csv", ".glb", ""])
@pytest.mark.parametrize(
    ("name", "what"),
    [("gone", "no such file|motion files end in"), ("folder", "is a folder"),
     ("pipe", r"is a named pipe \(FIFO\)"), ("null", "is a device")],
)  # fmt: skip
def test_what_is_not_a_regular_file_is_called_what_it_is_without_waiting(
    tmp_path, name, what, suffix
):
    (tmp_path / "01.asf").write_text(asf())
    (tmp_path / f"folder{suffix}").mkdir()
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"null{suffix}").symlink_to("/dev/zero")
    with pytest.raises(ClipError, match=what):
        read_clip(tmp_path / f"{name}{suffix}")


def test_pipes_in_a_folder_are_no_clips(tmp_path):
    for name in ("a.parquet", "a.txt", "a.bvh"):
        os.mkfifo(tmp_path / name)
        assert not is_clip(tmp_path / name)
        assert first_bytes(tmp_path / name) == b""
        with pytest.raises(OSError, match="is a named pipe"):
            digest(tmp_path / name)


# mtime: a test is called the same in every process that collects it, whatever the second.
CUT = gzip.compress(b"HIERARCHY" * 99, mtime=0)[:-9]


@pytest.mark.parametrize("content", [b"", b"HIERARCHY\n", CUT])
def test_damaged_gzip_is_refused(tmp_path, content):
    path = tmp_path / "a.bvh.gz"
    path.write_bytes(content)
    with pytest.raises(ClipError, match="cannot be read|an empty file"):
        read_clip(path)


def test_a_gzip_bomb_is_refused_at_the_stated_size(tmp_path, monkeypatch):
    monkeypatch.setattr(text.read_bytes, "__defaults__", (1 << 20, None))
    packed = io.BytesIO()
    with gzip.GzipFile(fileobj=packed, mode="wb") as stream:
        stream.write(b"HIERARCHY\n")
        for _ in range(64):
            stream.write(b" " * (1 << 20))
    path = tmp_path / "a.bvh.gz"
    path.write_bytes(packed.getvalue())
    with pytest.raises(ClipError, match="longer than the 1 MiB that are read"):
        read_clip(path)


@pytest.mark.parametrize("count", ["1000000000000", "1e12", "-1", "99999999999999999999999"])
def test_a_header_that_promises_too_much_costs_nothing(tmp_path, count, caplog):
    content = bvh([ROW]).replace("Frames: 1", f"Frames: {count}")
    begin = time.perf_counter()
    if count == "1000000000000":
        assert len(read_clip(write(tmp_path / "a.bvh", content)).points) == 1
        assert f"Frames: {count}, but the file has 1 whole ones" in caplog.text
    else:
        with pytest.raises(ClipError, match="Frames"):
            read_clip(write(tmp_path / "a.bvh", content))
    assert time.perf_counter() - begin < 1.0  # [s]


def test_five_thousand_frames_read_in_half_a_second(tmp_path):
    write(tmp_path / "1.asf", asf())
    frames = [{"root": f"{i / 7:.5f} 1 2 3 4 5", "lhumerus": f"{i % 90} 1 2"} for i in range(5000)]
    path = write(tmp_path / "1_1.amc", amc(*frames))
    seconds = []
    for _ in range(3):
        begin = time.perf_counter()
        assert len(read_clip(path).points) == 5000
        seconds.append(time.perf_counter() - begin)
    assert min(seconds) < 0.5  # [s]


# --- time -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fps", "rate", "frames", "want"),
    [
        (120, 30, 9, [0, 4, 8]),
        (120, 30, 8, [0, 4]),
        (60, 30, 5, [0, 2, 4]),
        (30, 30, 3, [0, 1, 2]),
        (40, 30, 5, [0, 4 / 3, 8 / 3, 4]),
        (16, 32, 3, [0, 0.5, 1, 1.5, 2]),
        (24, 30, 5, [0, 0.8, 1.6, 2.4, 3.2, 4]),
        (120, 30, 1, [0]),
    ],
)
def test_samples_lie_at_exact_multiples_of_the_new_period(fps, rate, frames, want):
    clip = resample(line(frames, fps), rate)
    assert clip.fps == rate and clip.name == "line"
    assert clip.points[:, 3, 2] == pytest.approx(want, abs=1e-12)
    assert not clip.points.flags.writeable


@given(
    n=st.integers(1, 3000),
    fps=st.sampled_from([23.976, 24, 25, 29.97, 30, 50, 60, 100, 120, 1 / 0.0083333]),
    rate=st.sampled_from([10, 24, 29.97, 30, 60, 144]),
)
def test_indices_stay_inside_the_clip_and_reach_its_end(n, fps, rate):
    left, weight = frame_indices(n, fps, rate)
    assert left[0] == 0 and weight[0] == 0
    assert ((left >= 0) & (left <= n - 1)).all() and ((weight >= 0) & (weight < 1)).all()
    assert (left[weight > 0] < n - 1).all()
    assert np.allclose((left + weight) / fps, np.arange(len(left)) / rate, rtol=0, atol=1e-6 / fps)
    assert (n - 1) / fps - (len(left) - 1) / rate < 1 / rate + 1e-9  # [s] left over


def test_the_clips_own_rate_changes_nothing():
    clip = line(7, 29.97)
    assert np.array_equal(resample(clip, 29.97).points, clip.points)


def test_a_frame_of_nan_reaches_only_samples_between_its_neighbours():
    points = line(13).points.copy()
    points[[3, 8]] = np.nan
    lost = np.isnan(resample(Clip("nan", 120.0, points), 240).points[:, 0, 0])
    assert np.flatnonzero(lost).tolist() == [5, 6, 7, 15, 16, 17]
    lost = np.isnan(resample(Clip("nan", 120.0, points), 30).points[:, 0, 0])
    assert np.flatnonzero(lost).tolist() == [2]  # frame 8 itself; frame 3 is not sampled


def test_resampling_leaves_the_clip_as_it_was():
    clip = line(9)
    before = clip.points.copy()
    resample(clip, 30)
    assert np.array_equal(clip.points, before)


@given(spans=st.lists(st.floats(1e-3, 0.2), min_size=1, max_size=40), rate=st.floats(5, 200))
def test_uneven_times_are_met_linearly(spans, rate):
    times = np.concatenate([[0.0], np.cumsum(spans)])  # [s]
    points = np.tile(times[:, None, None], (1, 10, 3))
    sampled = at_constant_rate(points, times, rate)
    assert np.allclose(sampled[:, 0, 0], np.arange(len(sampled)) / rate, rtol=0, atol=1e-6)
    assert times[-1] - (len(sampled) - 1) / rate < 1 / rate + 1e-9


@pytest.mark.parametrize(("n", "fps", "rate"), [(0, 30, 30), (1, 0, 30), (1, 30, float("nan"))])
def test_impossible_rates_and_lengths_are_refused(n, fps, rate):
    with pytest.raises(ParameterError):
        frame_indices(n, fps, rate)
