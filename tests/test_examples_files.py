"""Examples of the guard on files and in LeRobot; they want the guard in a program."""

import pickle
import sys
from importlib.util import find_spec
from pathlib import Path

import layouts as made
import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
pytestmark = pytest.mark.skipif(
    find_spec("s3le.guard.guard") is None, reason="the guard in a program is not here"
)


@pytest.fixture(autouse=True)
def examples(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    yield
    for name in ("repair_gmr", "lerobot_step"):
        sys.modules.pop(name, None)


def test_a_gmr_file_is_repaired_and_the_rest_of_it_is_untouched(tmp_path):
    import repair_gmr

    from s3le.guard import Guard

    path = made.gmr(tmp_path, dtype="f4")
    tree = pickle.loads(path.read_bytes())  # ours
    elbow = made.joints().index("left_elbow_joint")
    tree["dof_pos"][10:20, elbow] += 1.5  # beyond its range, and too fast
    path.write_bytes(pickle.dumps(tree))
    told = repair_gmr.repair(Guard.load("g1"), path, tmp_path / "new.pkl")
    assert told["NOT CERTIFIED"] == 0 and sum(told.values()) == made.ROWS - 1
    again = pickle.loads((tmp_path / "new.pkl").read_bytes())
    assert list(again) == list(tree) and again["fps"] == tree["fps"]
    for key in ("root_pos", "root_rot", "local_body_pos"):
        assert np.array_equal(again[key], tree[key])
    own = [made.joints().index(joint) for joint in made.robot().joint_names]
    rest = np.setdiff1d(np.arange(len(made.joints())), own)
    assert again["dof_pos"].dtype == tree["dof_pos"].dtype
    assert np.array_equal(again["dof_pos"][:, rest], tree["dof_pos"][:, rest])
    assert again["dof_pos"][:, elbow].max() < 2.1 < tree["dof_pos"][:, elbow].max()


@pytest.mark.parametrize("degrees", [False, True])
def test_a_lerobot_step_guards_joints_and_lets_the_rest_pass(degrees):
    import lerobot_step

    from s3le.errors import StateError

    step = lerobot_step.GuardStep("g1", fps=30.0, degrees=degrees)
    scale = np.rad2deg(1.0) if degrees else 1.0
    names = step.guard.robot.joint_names
    q = step.guard.robot.anchor.copy()

    def sent(wanted, measured=None):
        named = {f"{n}.pos": v * scale for n, v in zip(names, wanted, strict=True)}
        seen = {} if measured is None else {
            f"{n}.pos": v * scale for n, v in zip(names, measured, strict=True)
        }  # fmt: skip
        out = step({"action": {**named, "gripper.pos": 7.5}, "observation": seen})["action"]
        assert out.pop("gripper.pos") == 7.5 and set(out) == set(named)
        return np.array([out[f"{n}.pos"] for n in names]) / scale

    assert np.allclose(sent(q, q), q, atol=1e-9)
    far = q + 1.0
    made_of = sent(far, q)
    assert 0.0 < np.abs(made_of - q).max() < 0.9 and step.reason
    with pytest.raises(StateError, match="is measured at"):
        sent(far, q + 0.5)
    step.reset()
    assert np.allclose(sent(q, q), q, atol=1e-9)
    assert type(step)(**step.get_config()).fps == 30.0
