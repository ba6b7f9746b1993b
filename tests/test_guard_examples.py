"""The examples of the guard in a program run, and what they give holds."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import coman

from s3le.errors import ParameterError
from s3le.guard import Guard
from s3le.safety.audit import audit, demands

EXAMPLES = Path(__file__).parents[1] / "examples"


def module(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def told(name: str, *words: str) -> str:
    return subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *words],
        capture_output=True, text=True, check=True, timeout=300, cwd=EXAMPLES.parent,
    ).stdout  # fmt: skip


def test_teleoperation_counts_its_deadlines():
    said = told("teleoperation", "--robot", "coman", "--seconds", "2", "--rate", "100")
    assert (
        "200 steps at 100 Hz" in said and "missed deadlines" in said and " 0 not certified" in said
    )


def trajectory(points: list[tuple[float, np.ndarray]], names: list[str]) -> SimpleNamespace:
    """A message, as far as anybody looks at it."""
    return SimpleNamespace(
        header=None, joint_names=names,
        points=[
            SimpleNamespace(positions=q, time_from_start=SimpleNamespace(
                sec=int(at), nanosec=round((at - int(at)) * 1e9)))
            for at, q in points
        ],
    )  # fmt: skip


def answered(message: SimpleNamespace) -> tuple[np.ndarray, np.ndarray, list[str]]:
    kinds = [lambda **fields: SimpleNamespace(**fields)] * 3
    made, reasons = module("ros2_trajectory").guarded(Guard(coman()), message, *kinds)
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in made.points]
    return np.array(times), np.array([p.positions for p in made.points]), reasons


def test_a_trajectory_through_the_body_comes_out_certified():
    made = coman()
    through = np.random.default_rng(3).uniform(made.lower, made.upper)
    times, q, reasons = answered(trajectory([(1.0, through), (1.5, made.anchor)], made.joint_names))
    t, q = np.r_[0.0, times], np.vstack([made.anchor, q])
    report = audit(made, t, q, demands(made))
    assert report.holds, report.complaint
    assert np.abs(np.diff(q, n=2, axis=0)).max() <= 60.0 * 0.01**2 * (1.0 + 1e-9)
    np.testing.assert_allclose(q[-1], made.anchor, atol=1e-9)
    assert "as wanted" in reasons and len(reasons) == len(times)


def test_the_joints_of_a_trajectory_may_stand_in_any_order():
    made = coman()
    goal = made.anchor.copy()
    goal[-1] -= 0.4
    straight = answered(trajectory([(1.0, goal)], made.joint_names))[1]
    turned = answered(trajectory([(1.0, goal[::-1])], made.joint_names[::-1]))[1]
    assert straight.tobytes() == turned.tobytes()
    np.testing.assert_allclose(straight[-1], goal, atol=1e-9)


@pytest.mark.parametrize("times", [[], [1.0, 1.0], [2.0, 1.0]])
def test_a_trajectory_without_a_course_is_refused(times):
    with pytest.raises(ParameterError, match="rise"):
        answered(trajectory([(t, coman().anchor) for t in times], coman().joint_names))


def test_messages_of_ros_2_go_in_and_out_over_the_wire():
    pytest.importorskip("rosbags")
    said = told("ros2_trajectory", "--robot", "coman")
    assert "2 points in" in said and "as wanted" in said
