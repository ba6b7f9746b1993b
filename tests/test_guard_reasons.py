"""Each row says why it is what it is, and what is no pose or time is refused."""

import numpy as np
import pytest
from guarded import ROUNDED, adversary, begun, colliding, driven

from s3le.errors import ParameterError
from s3le.kernels import batch

# --- reasons


def test_a_slow_joint_is_named():
    guard = begun()
    i = guard.robot.joint_names.index("LElbj")
    wanted = guard.robot.anchor.copy()
    wanted[i] += 0.7 if wanted[i] < -1.0 else -0.7
    reasons = [guard.step(wanted, 0.02).reason for _ in range(40)]
    assert reasons[0] == "slowed by LElbj" and reasons[-1] == "as wanted"
    assert (guard.q == wanted).all()


def test_a_joint_that_is_wanted_beyond_its_limits_is_held_there():
    guard = begun()
    i = guard.robot.joint_names.index("WaistYaw")
    wanted = guard.robot.anchor.copy()
    wanted[i] = guard.robot.upper[i] + 0.2
    reasons = [guard.step(wanted, 0.02).reason for _ in range(60)]
    assert reasons[0] == "slowed by WaistYaw" and reasons[-1] == "held by limits of WaistYaw"
    assert guard.q[i] == pytest.approx(guard.robot.upper[i], abs=1e-12)


def test_bodies_in_the_way_are_named():
    guard = begun()
    wanted = colliding("coman", 14, -0.06, -0.03)[0]
    reasons = [guard.step(wanted, 0.02).reason for _ in range(200)]
    names = {body.name for body in guard.robot.bodies}
    kind, pair = reasons[-1].split(" by ")
    a, b = pair.split(" against ")
    assert kind == "held" and {a, b} <= names
    d = batch.pair_distances(guard.robot.chain, guard.q[None])[0]
    assert sorted([a, b]) == sorted(guard.robot.pair_name(int(d.argmin())).split(" and "))
    assert any(reason.startswith("moved away from ") for reason in reasons)
    assert not any(guard.step(wanted, 0.02).v.any() for _ in range(50))  # it stands, unshaken


# --- what is refused


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        (lambda r: np.where(np.arange(r.n_dof) == 3, np.nan, r.anchor), "{3} is not finite"),
        (lambda r: np.where(np.arange(r.n_dof) == 0, -np.inf, r.anchor), "{0} is not finite"),
        (lambda r: r.anchor[:-1], "must have shape"),
        (lambda r: r.anchor[None], "must have shape"),
        (lambda r: ["a"] * r.n_dof, "must hold numbers"),
        (lambda r: [1.0, [2.0]], "rows of one length"),
        (lambda r: dict(zip(r.joint_names[1:], r.anchor[1:], strict=True)), "lacks {0}"),
        (lambda r: dict(zip(r.joint_names, r.anchor, strict=True)) | {"LElbow": 1.0},
         "'LElbow', which is no joint of the robot; did you mean LElbj?"),
        (lambda r: np.degrees(0.5 * (r.lower + r.upper) + 0.4), "as degrees it would be"),
        (lambda r: np.where(np.arange(r.n_dof) == 4, 1e300, r.anchor), "beyond its limits"),
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused_and_the_guard_goes_on(wanted, says):
    guard = begun()
    driven(guard, adversary(guard, 10, 30.0, 15), np.full(10, 1.0 / 30.0))
    state = guard.state()
    for name in guard.robot.joint_names:
        says = says.replace(f"{{{guard.robot.joint_names.index(name)}}}", name)
    with pytest.raises(ParameterError, match=says.replace("?", r"\?")):
        guard.step(wanted(guard.robot), 1.0 / 30.0)
    assert all((guard.state()[key] == value).all() for key, value in state.items()
               if key != "before") and guard.state()["before"] == state["before"]  # fmt: skip
    assert guard.step(guard.robot.anchor, 1.0 / 30.0).certified


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, 1e-9, "1", True, None])
def test_what_is_no_time_is_refused(dt):
    guard = begun()
    with pytest.raises(ParameterError, match="dt must be"):
        guard.step(guard.robot.anchor, dt)


def test_a_chunk_names_its_row():
    guard = begun()
    wanted = np.repeat(guard.robot.anchor[None], 5, axis=0)
    wanted[3, 2] = np.nan
    with pytest.raises(ParameterError, match=f"row 3: {guard.robot.joint_names[2]} is not finite"):
        guard.chunk(wanted, 0.02)
    for bad, says in (
        ({"dt": [0.1, 0.2]}, "dt must be"), ({"dt": -1.0}, "dt must be"),
        ({"dt": 0.1, "advance": 6}, "advance"), ({"dt": 0.1, "advance": -1}, "advance"),
        ({"dt": 0.1, "advance": "all"}, "advance"),
    ):  # fmt: skip
        with pytest.raises(ParameterError, match=says):
            guard.chunk(np.nan_to_num(wanted), **bad)
    with pytest.raises(ParameterError, match="shape"):
        guard.chunk(wanted[:0], 0.02)


def test_joints_that_the_robot_holds_may_be_named():
    guard = begun("g1")
    named = dict(zip(guard.robot.joint_names, guard.robot.anchor, strict=True))
    assert guard.step(named | {"left_knee_joint": 0.3}, 0.02).reason == "as wanted"
    assert list(guard.robot.anchor) == list(guard.q)


def test_a_jump_is_driven_as_far_as_the_joints_can():
    guard = begun()
    far = colliding("coman", 16, 0.004, 1.0)[0]
    made = guard.step(far, 0.02)
    assert made.certified and np.abs(made.v).max() <= 60.0 * 0.02 * ROUNDED
