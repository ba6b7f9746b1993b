"""Rates and clocks: in whichever unit and under whichever key, a rate of people or a question."""

import json

import bodies
import numpy as np
import pytest
from test_keypoints import NAMES, same, save

from s3le.errors import ClipError
from s3le.human import points_parquet
from s3le.human.read import read_clip

BODY = bodies.body()
CAMERA = BODY @ bodies.INTO["camera"].T
AT = np.arange(12)


def said(clip):
    return " ".join(clip.reading.told)


@pytest.mark.parametrize("fps", [5.0, 24.0, 29.97, 60.0, 120.0, 250.0, 1000.0])
@pytest.mark.parametrize(("unit", "per"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
def test_a_clock_is_in_the_unit_that_gives_a_rate_of_people(tmp_path, fps, unit, per):
    time = 100.0 * per + AT / fps * per
    path = save(tmp_path, "a.npz", {"world": CAMERA, "time": time})
    if unit == "ms" and fps == 1000.0:  # steps of one are frames
        with pytest.raises(ClipError, match="counts frames"):
            read_clip(path)
        path = save(tmp_path, "a.npz", {"world": CAMERA, "time_ms": time})
    clip = read_clip(path)
    assert clip.fps == pytest.approx(fps, rel=1e-6)
    assert ("which are in" in said(clip)) == (unit != "s") and len(clip.points) == 12
    same(clip, BODY)
    assert read_clip(path, 25.0).fps == 25.0


@pytest.mark.parametrize(
    ("content", "fps"),
    [
        ({"fps": "60"}, 60), ({"fps": np.array("60")}, 60), ({"fps": "29.97 fps"}, 29.97),
        ({"fps": "30000/1001"}, 30000 / 1001), ({"frame_rate": np.array([50])}, 50),
        ({"mocap_frame_rate": 120}, 120), ({"mocap_framerate": 120.0}, 120), ({"FPS": 25}, 25),
        ({"sampling_rate": 100}, 100), ({"framesPerSecond": 24}, 24), ({"hz": 90}, 90),
        ({"fps": np.full(12, 60)}, 60), ({"dt": 1 / 60}, 60), ({"dt": 16.667}, 60),
        ({"dt": 16667}, 60), ({"frame_time": 0.0083333}, 120), ({"dt_ms": 40}, 25),
        ({"timestep": "0.02"}, 50), ({"timestamp_usec": AT * 40_000}, 25),
        ({"timestamp_ns": AT * 40_000_000}, 25), ({"timestamps": AT[:, None] / 25}, 25),
        ({"time": np.round(AT / 60, 3)}, 60), ({"time": np.round(AT * 1001 / 30)}, 30),
        ({"fps": 60, "time": AT / 60}, 60), ({"fps": 60, "time": np.round(AT / 60, 2)}, 60),
        ({"fps": None, "dt": 0.01}, 100),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["npz", "json"])
def test_a_rate_is_understood_under_its_keys_as_number_text_or_step(tmp_path, content, fps, kind):
    content = {key: value for key, value in content.items() if value is not None or kind == "json"}
    content["world"] = CAMERA
    if kind == "json":
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in content.items()}
        path = save(tmp_path, "a.json", json.dumps(plain, default=float))
    else:
        path = save(tmp_path, "a.npz", content)
    clip = read_clip(path)
    assert clip.fps == pytest.approx(fps, rel=2e-4) and len(clip.points) == 12
    assert "for the file has no rate" not in said(clip)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({"time": AT}, "its time counts frames .*give --fps"),
        ({"time": AT * 1.0 + 7}, "its time counts frames .*give --fps"),
        ({"time": AT / 3}, "its time gives 3 Hz in seconds, .*5 to 1000 Hz; give --fps"),
        ({"time": AT * 500.0}, "give --fps"),  # 2 Hz in ms, 2000 Hz in us
        ({"time": AT / 4000}, "give --fps"),
        ({"time": AT * 1e9}, "give --fps"),
        ({"time": -AT / 30}, "does not rise; .*give --fps"),
        ({"fps": 1.0}, "its rate is 1 Hz, people are recorded at 5 to 1000 Hz; give --fps"),
        ({"fps": 2000}, "its rate is 2000 Hz"),
        ({"fps": "fast"}, "its 'fps' is 'fast', which is no rate; give --fps"),
        ({"fps": 0}, "its 'fps' is '0', which is no rate; give --fps"),
        ({"fps": -30}, "its 'fps' is '-30', which is no rate; give --fps"),
        ({"dt": 1.0}, "its 'dt' is '1.0', which is no rate; give --fps"),
        ({"dt": 0.5}, "its 'dt' is '0.5', which is no rate; give --fps"),
        ({"fps": 30, "time": AT / 60}, "its rate is 30 Hz, its times give 60 Hz; say which"),
    ],
)  # fmt: skip
def test_a_clock_that_gives_no_rate_of_people_is_asked_for(tmp_path, content, why):
    path = save(tmp_path, "a.npz", {"world": CAMERA} | content)
    with pytest.raises(ClipError, match=why):
        read_clip(path)
    assert read_clip(path, 30.0).fps == 30.0


@pytest.mark.parametrize(
    ("head", "values", "fps"),
    [
        ("time", AT / 50, 50), ("time_ms", AT * 20, 50), ("Time (s)", AT / 50, 50),
        ("timestamp", AT * 20_000, 50), ("timestamp[us]", AT * 20_000, 50),
        ("fps", AT * 0 + 50, 50), ("dt", AT * 0 + 0.02, 50), ("t", AT * 20, 50), ("Frame", AT, 30),
    ],
)  # fmt: skip
def test_a_column_of_a_table_is_a_clock_by_its_name(tmp_path, head, values, fps):
    points = bodies.points(CAMERA)
    lines = [",".join([head, *[f"{name}_{axis}" for name in NAMES["snake"] for axis in "xyz"]])]
    lines += [",".join(map(str, [v, *own.ravel()])) for v, own in zip(values, points, strict=True)]
    clip = read_clip(save(tmp_path, "a.csv", "\n".join(lines)))
    assert clip.fps == fps and np.allclose(clip.points, bodies.points(BODY), atol=1e-6)


def test_uneven_times_in_any_unit_become_even_ones_of_the_same_motion(tmp_path):
    time = np.r_[0.0, np.cumsum(np.where(AT[1:] % 3 == 0, 0.05, 0.025))]
    clips = [
        read_clip(save(tmp_path, "a.npz", {"world": CAMERA, "time": time * per}))
        for per in (1.0, 1e3, 1e6)
    ]
    for clip in clips:
        assert clip.fps == 40.0 and "uneven times" in said(clip)
        assert np.allclose(clip.points, clips[0].points, atol=1e-9)
    assert len(clips[0].points) == round(time[-1] * 40) + 1


def test_frames_that_numbers_leave_out_are_gaps(tmp_path):
    numbers = np.array([10, 12, 14, 16, 22, 24, 26, 28, 30, 32, 34, 36])
    clip = read_clip(save(tmp_path, "a.npz", {"world": CAMERA, "frame_ids": numbers, "fps": 50}))
    assert clip.fps == 50.0 and len(clip.points) == 14
    assert np.flatnonzero(np.isnan(clip.points).any(axis=(1, 2))).tolist() == [4, 5]
    assert "2 frames are left out between others, by 'frame_ids'" in said(clip)
    wild = {"world": CAMERA, "frame_ids": np.r_[AT[:-1], 10**6]}
    with pytest.raises(ClipError, match="12 rows for 1000001 frames by their numbers"):
        read_clip(save(tmp_path, "b.npz", wild))


def test_points_in_parquet_are_at_a_rate_of_people(tmp_path):
    points, fine = bodies.points(BODY), np.full(12, "seen")
    for fps in (2.0, 30.0):
        at = tmp_path / f"{fps:g}.parquet"
        points_parquet.write(at, fps, AT / fps, points, np.ones(12), fine, {})
    assert read_clip(tmp_path / "30.parquet").fps == 30.0
    with pytest.raises(ClipError, match="its rate is 2 Hz, .*give --fps"):
        read_clip(tmp_path / "2.parquet")
    assert read_clip(tmp_path / "2.parquet", 20.0).fps == 20.0
