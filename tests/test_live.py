"""The stream: one line out for one line in, whatever comes, and never an uncertified pose."""

import io
import json
import math

import numpy as np
import pytest
from follower import Plain
from hypothesis import given, settings
from hypothesis import strategies as st
from streaming import retargeter
from worlds import MARGIN, coman

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.retarget import live
from s3le.robot.certificate import Certifier
from s3le.safety import audit
from s3le.skeleton import POINTS

TILT = math.radians(60.0)


def begun(cls=Plain, rate=30.0):
    return live.Live(cls(), rate, TILT)


def anchor_x():
    return batch.skeletons(coman().chain, coman().anchor[None])[0]


def anchor_points():
    points = batch.points(coman().chain, coman().anchor[None])[0]
    # The robot's pelvis points both lie at the hip; a person's do not.
    at = dict(zip(POINTS, points.tolist(), strict=True))
    at["r_pelvis"], at["l_pelvis"] = [0.0, -0.1, 0.0], [0.0, 0.1, 0.0]
    return at


def sent(stream, line):
    return json.loads(stream.answer(line if isinstance(line, bytes) else json.dumps(line).encode()))


def test_the_greeting_names_the_joints():
    said = json.loads(begun().greeting())
    assert said["joints"] == coman().joint_names and said["robot"] == "coman"
    assert said["q"] == coman().anchor.tolist() and said["margin"] == MARGIN


def test_each_frame_gives_a_pose_and_time_adds_up():
    stream = begun()
    one = sent(stream, {"x": anchor_x().tolist(), "dt": 0.02})
    two = sent(stream, {"x": anchor_x().tolist()})
    assert one["t"] == 0.02 and two["t"] == pytest.approx(0.02 + 1 / 30, abs=1e-8)
    assert len(one["q"]) == 11 and one["clearance"] >= MARGIN and isinstance(one["mode"], str)


def test_points_in_order_or_by_name_are_the_same():
    at = anchor_points()
    by_name = sent(begun(), {"points": at})
    in_order = sent(begun(), {"points": [at[name] for name in POINTS]})
    assert by_name == in_order and "q" in by_name


def test_the_heading_of_points_is_said_unwrapped_and_of_vectors_is_none():
    at = np.array([anchor_points()[name] for name in POINTS])
    stream = begun()
    for yaw in (0.0, 2.0, 4.0, 6.0, 7.5):
        c, s = math.cos(yaw), math.sin(yaw)
        turned = at @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        said = sent(stream, {"points": turned.tolist()})
        assert said["heading"] == pytest.approx(yaw, abs=1e-9)
    assert "error" in sent(stream, {"points": [[0, 0, 0]] * 10})
    assert sent(stream, {"x": anchor_x().tolist()})["heading"] == 0.0


def test_times_instead_of_steps():
    stream, x = begun(), anchor_x().tolist()
    times = [sent(stream, {"x": x, "t": t})["t"] for t in (100.0, 100.5, 100.75)]
    assert np.diff(times) == pytest.approx([0.5, 0.25])
    assert "t must rise" in sent(stream, {"x": x, "t": 100.7})["error"]
    assert sent(stream, {"x": x, "t": 101.0})["t"] == pytest.approx(times[-1] + 0.25)


def test_time_passes_over_lines_that_cannot_be_used():
    stream, x = begun(rate=10.0), anchor_x().tolist()
    assert sent(stream, {"x": x})["t"] == pytest.approx(0.1)
    for bad in (b"{", b"[]", {"x": [0] * 21}):
        assert "error" in sent(stream, bad)
    assert sent(stream, {"x": x})["t"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 60_000, "not JSON"),
        (b"3", "wanted an object"),
        (b"{}", "either"),
        ({"x": [0.0] * 21, "points": []}, "either"),
        ({"x": [0.0] * 21}, "seven unit vectors"),
        ({"x": [1.0] * 20}, "21 finite numbers"),
        ({"x": "x" * 21}, "21 finite numbers"),
        ({"x": [True] * 21}, "21 finite numbers"),
        ({"x": [None] * 21}, "21 finite numbers"),
        (b'{"x": [' + b"NaN," * 20 + b"NaN]}", "21 finite numbers"),
        (b'{"x": [' + b"1e999," * 20 + b"1]}", "21 finite numbers"),
        ({"points": [[0, 0, 0]] * 10}, "cannot be used (pelvis)"),
        ({"points": [[0, 0]] * 10}, "10x3 finite numbers"),
        ({"points": {"hip": [0, 0, 0]}}, "lacks r_pelvis"),
        ({"points": [[1e9, 0, 0]] * 10}, "within 10000 m"),
        (b'{"x": [], "dt": 0}', "dt must be above 0"),
        (b'{"x": [], "dt": -1}', "dt must be above 0"),
        (b'{"x": [], "dt": "1"}', "must be a number"),
        (b'{"x": [], "dt": true}', "must be a number"),
        (b'{"x": [], "dt": NaN}', "must be finite"),
        (b'{"x": [], "dt": 1e9}', "since the last frame"),
        (b'{"x": [' + b"0," * 70_000 + b"0]}", "at most"),
    ],
)
def test_a_bad_line_is_an_error_and_the_stream_goes_on(line, words):
    stream = begun()
    said = sent(stream, line)
    assert said["line"] == 1 and words in said["error"]
    assert "q" in sent(stream, {"x": anchor_x().tolist()})


def test_a_long_line_is_one_line_and_memory_stays_bounded():
    source = io.BytesIO(b"a\n" + b"b" * 300_000 + b"\nc\n" + b"d" * 200_000)
    got = list(live.lines(source))
    assert [line[:1] for line in got] == [b"a", b"b", b"c", b"d"]
    assert max(map(len, got)) == live.LONGEST_LINE + 1


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_input_moves_the_robot_where_nothing_was_proven(seed):
    rng = np.random.default_rng(seed)
    made, stream = coman(), begun()
    q, t = [made.anchor], [0.0]
    for _ in range(12):
        x = rng.normal(size=(7, 3))
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        dt = float(rng.choice([1e-4, 1 / 30, 0.2, 3.0]))
        said = sent(stream, {"x": x.ravel().tolist(), "dt": dt})
        if "q" in said:
            q.append(said["q"])
            t.append(t[-1] + dt)
    report = audit.audit(made, np.array(t), np.array(q), audit.demands(made))
    assert report.holds, report.complaint


def test_a_pose_that_the_independent_check_refuses_is_held_whatever_the_settings_say(monkeypatch):
    """A retargeter that is told not to check is checked all the same."""
    it = retargeter(check=False)
    stream = live.Live(it, 30.0, TILT)
    monkeypatch.setattr(Certifier, "one", lambda *_: (np.nan, np.nan))
    for _ in range(3):
        said = sent(stream, {"x": anchor_x().reshape(7, 3)[:, [0, 2, 1]].ravel().tolist()})
        assert said["mode"] in ("held", "lead_in") and said["q"] == coman().anchor.tolist()
    checker = coman().certifier()
    monkeypatch.undo()
    assert checker.one(np.array(said["q"]))[0] >= MARGIN


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 1e9])
def test_a_rate_out_of_range_is_refused(rate):
    with pytest.raises(ParameterError, match="rate must be in"):
        begun(rate=rate)
