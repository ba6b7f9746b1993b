"""Streams of joints: one line out for one line in, and a stop is heard whatever a line holds."""

import json
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from follower import Plain
from worlds import MARGIN, coman

from s3le.errors import ParameterError
from s3le.guard import Guard, live
from s3le.guard.live import LiveJoints
from s3le.kernels import batch
from s3le.retarget.live import Live
from s3le.safety import audit


@cache
def guard() -> Guard:
    return Guard(coman())


def begun(rate: float = 50.0) -> LiveJoints:
    guard().start()
    return LiveJoints(guard(), rate)


def sent(stream, line):
    return json.loads(stream.answer(line if isinstance(line, bytes) else json.dumps(line).encode()))


def away(by: float = 0.5) -> np.ndarray:
    """The anchor with its elbows bent."""
    q = coman().anchor.copy()
    for name in ("LElbj", "RElbj"):
        q[coman().joint_names.index(name)] -= by
    return q


def test_the_greeting_says_what_the_lines_mean():
    said = json.loads(begun().greeting())
    assert said["joints"] == coman().joint_names and said["robot_hash"] == coman().digest
    assert said["q"] == coman().anchor.tolist() and said["margin"] == MARGIN


def test_lines_of_joints_are_answered_as_the_guard_answers():
    stream, q = begun(), away()
    said = [sent(stream, {"q": q.tolist()}) for _ in range(40)]
    guard().start()
    rows = [guard().step(q, 0.02) for _ in range(40)]
    assert [one["q"] for one in said] == [row.q.tolist() for row in rows]
    assert [one["reason"] for one in said] == [row.reason for row in rows]
    assert all(one["certified"] is True for one in said)
    assert said[0]["reason"].startswith("slowed by") and said[-1]["reason"] == "as wanted"
    assert said[-1]["t"] == pytest.approx(0.8) and said[-1]["clearance"] >= MARGIN
    named = dict(zip(coman().joint_names, q.tolist(), strict=True))
    assert sent(begun(), {"q": named})["q"] == said[0]["q"]


def test_what_a_stream_of_joints_says_holds():
    rng, stream = np.random.default_rng(0), begun()
    q, t = [coman().anchor], [0.0]
    for _ in range(60):
        wanted = rng.uniform(coman().lower - 0.3, coman().upper + 0.3)
        for _ in range(5):
            said = sent(stream, {"q": wanted.tolist(), "dt": 0.02})
            assert said["certified"]
            q.append(said["q"])
            t.append(said["t"])
    report = audit.audit(coman(), np.array(t), np.array(q), audit.demands(coman()))
    assert report.holds, report.complaint


def test_null_brakes_and_a_stop_is_latched():
    stream, far = begun(), {"q": away(1.2).tolist()}
    for _ in range(4):
        sent(stream, far)
    assert sent(stream, {"q": None})["reason"] == "braked"
    assert sent(stream, far)["reason"].startswith("slowed by")
    said = [sent(stream, far | {"stop": True})["reason"] for _ in range(30)]
    assert said[0] == "braked" and said[-1] == "stopped"
    assert sent(stream, far)["reason"] == "stopped"
    assert sent(stream, far | {"stop": False})["reason"].startswith("slowed by")


@pytest.mark.parametrize(
    "line",
    [
        {"stop": True},
        {"stop": True, "dt": -1},
        {"stop": "now"},
        {"stop": True, "q": ["x"]},
        {"stop": 1, "t": "late"},
    ],
)
def test_a_stop_is_heard_whatever_else_a_line_holds(line):
    stream = begun()
    for _ in range(10):
        sent(stream, {"q": away().tolist()})
    sent(stream, line)
    assert guard().stopped
    assert sent(stream, {"q": away().tolist()})["reason"] in ("braked", "stopped")


def test_a_measured_pose_that_is_far_off_stops_the_stream():
    stream = begun()
    said = sent(stream, {"q": away().tolist(), "measured": (coman().anchor + 0.2).tolist()})
    assert "from where it should be" in said["error"] and guard().stopped
    assert sent(stream, {"q": away().tolist()})["reason"] == "stopped"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"{", "not JSON"),
        (b"[1]", "wanted an object"),
        ({"dt": 0.02}, 'wanted "q"'),
        ({"q": [1.0]}, "must have shape"),
        ({"q": {"LElbow": 1.0}}, "did you mean LElbj"),
        ({"q": "far"}, "must hold numbers"),
        ({"q": [True] * 11}, "must hold numbers"),
        (b'{"q": [NaN,0,0,0,0,0,0,0,0,0,0]}', "is not finite"),
        ({"q": [90.0] * 11}, "give radians"),
        ({"q": [0.0] * 11, "speed": 1}, "unknown key 'speed'"),
        ({"q": [0.0] * 11, "dt": 0}, "dt must be above 0"),
        ({"q": [0.0] * 11, "dt": 1e9}, "since the last frame"),
        ({"x": [0.0] * 21}, "unknown key 'x'"),
    ],
)
def test_a_bad_line_is_an_error_and_moves_nothing(line, words):
    stream = begun()
    said = sent(stream, line)
    assert said["line"] == 1 and words in said["error"]
    assert (guard().q == coman().anchor).all()
    assert sent(stream, {"q": coman().anchor.tolist()})["reason"] == "as wanted"


def test_the_first_good_line_decides_what_a_stream_is_of():
    x = batch.skeletons(coman().chain, coman().anchor[None])[0].tolist()
    stream = Live(Plain(), 50.0, 1.0, guard=guard)
    guard().start()
    assert "must have shape" in sent(stream, {"q": [1.0]})["error"]
    assert "mode" in sent(stream, {"x": x})
    assert "begin another" in sent(stream, {"q": away().tolist()})["error"]
    stream = Live(Plain(), 50.0, 1.0, guard=guard)
    assert sent(stream, {"q": away().tolist()})["reason"].startswith("slowed by")
    assert "begin another" in sent(stream, {"x": x})["error"]
    assert sent(stream, {"stop": True})["reason"] in ("braked", "stopped")


def test_a_stream_of_joints_needs_no_poses_of_a_human():
    lines = f"{json.dumps({'q': away().tolist()})}\nnonsense\n"
    said = subprocess.run(
        [sys.executable, "-m", "s3le.cli", "stream", "--joints", "--robot", "coman"],
        input=lines, capture_output=True, text=True, check=True, timeout=300,
    )  # fmt: skip
    greeting, good, bad = map(json.loads, said.stdout.splitlines())
    assert greeting["joints"] == coman().joint_names
    assert good["reason"].startswith("slowed by") and bad["line"] == 2
    assert "poses" not in said.stderr


@pytest.mark.parametrize("rate", [0.0, float("nan"), 1e9])
def test_a_rate_out_of_range_is_refused(rate):
    with pytest.raises(ParameterError, match="rate must be in"):
        begun(rate)


def test_a_line_that_is_too_long_is_one_line():
    import io

    got = list(live.lines(io.BytesIO(b"a\n" + b"b" * 300_000 + b"\nc\n")))
    assert [line[:1] for line in got] == [b"a", b"b", b"c"]
