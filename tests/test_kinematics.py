"""The kernels' kinematics against pinocchio, the skeleton's definition, algebra and differences."""

import shutil
import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import (
    ARMS_URDF,
    ARMS_YAML,
    MARGIN,
    arms_points,
    coman,
    edited,
    inside_limits,
    placed,
    relaxed,
    skeleton_and_jacobian,
    write_arms,
)

from s3le.errors import ParameterError
from s3le.kernels import batch, compiled
from s3le.robot import certificate
from s3le.robot.model import load
from s3le.robot.pairs import all_pairs
from s3le.robot.robot import Robot
from s3le.skeleton import NECKS, POINTS, features

ALGEBRA = 1e-12  # [m] or [-], float64
DIFFERENCE = 1e-6  # [1/rad], central differences
STEP = 1e-6  # [rad]
TILTED = edited(ARMS_YAML, ("[0.0, 0.0, 0.0]", "[0.4, -1.1, 2.3]"))


@pytest.fixture(params=["coman", "arms", "tilted arms"])
def made(request, tmp_path):
    if request.param == "coman":
        return coman()
    yaml = TILTED if request.param == "tilted arms" else ARMS_YAML
    return Robot.from_file(write_arms(tmp_path, yaml), MARGIN, "midpoint")


def test_points_are_pinocchio_s(made):
    q = np.concatenate([inside_limits(made, 20, 1), 30.0 * relaxed(made, 5, 2)])
    ours = batch.points(made.chain, q)
    for pose, at in zip(q, ours, strict=True):
        theirs = certificate.point_positions(made, pose)
        for role, where in zip(made.points, theirs, strict=True):
            assert at[POINTS.index(role)] == pytest.approx(where, abs=ALGEBRA), role


def test_points_of_planar_arms_are_algebra(tmp_path):
    made = Robot.from_file(write_arms(tmp_path), MARGIN, "midpoint")
    for q in inside_limits(made, 20, 3):
        want = arms_points(dict(zip(made.joint_names, q, strict=True)))
        at = batch.points(made.chain, q[None])[0]
        for role, where in want.items():
            assert at[POINTS.index(role)] == pytest.approx(where, abs=ALGEBRA), role


@pytest.mark.parametrize("neck", NECKS)
@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_the_robot_s_skeleton_is_the_one_of_its_points(name, neck):
    made = coman(name=name, neck=neck)
    q = relaxed(made, 40, 4)
    want, ok = features(batch.points(made.chain, q), neck)
    assert ok.all()
    assert np.allclose(batch.skeletons(made.chain, q), want, rtol=0, atol=ALGEBRA)


def test_a_tilted_base_turns_the_skeleton_and_nothing_else(tmp_path):
    plain = Robot.from_file(write_arms(tmp_path / "plain"), MARGIN, "midpoint")
    tilted = Robot.from_file(write_arms(tmp_path / "tilted", TILTED), MARGIN, "midpoint")
    q = inside_limits(plain, 30, 5)
    turned = batch.skeletons(plain.chain, q).reshape(-1, 7, 3) @ tilted.base_rotation.T
    assert np.allclose(
        batch.skeletons(tilted.chain, q), turned.reshape(-1, 21), rtol=0, atol=ALGEBRA
    )
    assert np.array_equal(batch.clearances(plain.chain, q), batch.clearances(tilted.chain, q))


def test_the_jacobian_is_the_slope_of_the_skeleton(made):
    for q in inside_limits(made, 6, 6):
        _, J = skeleton_and_jacobian(made, q)
        shifts = STEP * np.eye(made.n_dof)
        ahead = batch.skeletons(made.chain, q + shifts)
        back = batch.skeletons(made.chain, q - shifts)
        assert np.allclose(J, ((ahead - back) / (2 * STEP)).T, rtol=0, atol=DIFFERENCE)


@pytest.mark.parametrize("neck", NECKS)
def test_asking_for_the_jacobian_does_not_change_the_skeleton(neck):
    made = coman(neck=neck)
    for q in inside_limits(made, 5, 7):
        x, _ = skeleton_and_jacobian(made, q)
        assert np.array_equal(x, batch.skeletons(made.chain, q[None])[0])


def test_a_joint_axis_that_is_not_a_coordinate_axis_turns_as_pinocchio_has_it(tmp_path):
    urdf = edited(
        ARMS_URDF,
        ('<origin xyz="0 -0.2 0.5"/><axis xyz="1 0 0"/>',
         '<origin xyz="0 -0.2 0.5" rpy="0.2 -0.5 1.4"/><axis xyz="3 -1 2"/>'),
    )  # fmt: skip
    made = Robot.from_file(write_arms(tmp_path, urdf=urdf), 0.0, "midpoint")
    for q in inside_limits(made, 10, 8):
        at = batch.points(made.chain, q[None])[0, POINTS.index("r_hand")]
        index = list(made.points).index("r_hand")
        assert at == pytest.approx(certificate.point_positions(made, q)[index], abs=ALGEBRA)


def test_capsules_are_where_pinocchio_places_them():
    made = coman()
    for q in inside_limits(made, 5, 9):
        ends = placed(made, q)[3]
        drawn = batch.capsule_ends(made.chain, q[None])[0]
        at = certificate.placements(made, q)
        for k, body in enumerate(made.bodies):
            along = np.array(at[k].getRotation())[:, 2] * np.linalg.norm(body.b - body.a) / 2
            middle = np.array(at[k].getTranslation())
            assert ends[k, 2] == pytest.approx(middle, abs=ALGEBRA)
            assert np.allclose(ends[k, 1], middle + along, rtol=0, atol=ALGEBRA)
            assert np.allclose(drawn[k], ends[k, :2] @ made.base_rotation.T, atol=ALGEBRA)


def test_a_whole_turn_changes_nothing():
    made = coman()
    q = inside_limits(made, 20, 10)
    turned = q + 2 * np.pi * np.random.default_rng(11).integers(-3, 4, q.shape)
    here, there = (batch.skeletons(made.chain, pose) for pose in (q, turned))
    assert np.allclose(here, there, rtol=0, atol=ALGEBRA)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**31), joint=st.integers(0, 10), step=st.floats(-4, 4))
def test_a_joint_moves_what_hangs_on_it_and_nothing_else(seed, joint, step):
    made = coman()
    q = np.repeat(relaxed(made, 1, seed), 2, axis=0)
    q[1, joint] += step
    here, there = batch.points(made.chain, q)
    for role, point in made.points.items():
        if joint not in made.path_to(point.joint):
            at = POINTS.index(role)
            assert np.array_equal(here[at], there[at]), role  # to the bit


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**31), far=st.floats(0, 7))
def test_no_point_moves_farther_than_its_levers_and_angles_allow(seed, far):
    made = coman()
    q = np.repeat(relaxed(made, 1, seed), 2, axis=0)
    q[1] += far * np.random.default_rng(seed).uniform(-1, 1, q.shape[1])
    here, there = batch.points(made.chain, q)
    turned = np.abs(q[1] - q[0])  # [rad]
    for role, point in made.points.items():
        lever, allowed = np.linalg.norm(point.offset), 0.0  # [m]
        for joint in made.path_to(point.joint)[::-1]:
            allowed += lever * turned[joint]
            lever += np.linalg.norm(made.joints[joint].translation)
        at = POINTS.index(role)
        assert np.linalg.norm(there[at] - here[at]) <= allowed + ALGEBRA, role


PLACES = st.tuples(*[st.floats(-1, 1)] * 3)  # [m]
AXES = PLACES.filter(lambda axis: np.linalg.norm(axis) > 0.1)


@settings(deadline=None, max_examples=15)
@given(
    first=st.tuples(PLACES, st.tuples(*[st.floats(-4, 4)] * 3), AXES),
    second=st.tuples(PLACES, AXES),
    q=st.lists(st.floats(-30, 30), min_size=4, max_size=4),
)  # fmt: skip
def test_any_two_joints_put_the_hand_where_pinocchio_does(first, second, q):
    place, rpy, axis = (" ".join(map(repr, part)) for part in first)
    place2, axis2 = (" ".join(map(repr, part)) for part in second)
    urdf = edited(
        ARMS_URDF,
        ('<origin xyz="0 -0.2 0.5"/><axis xyz="1 0 0"/>',
         f'<origin xyz="{place}" rpy="{rpy}"/><axis xyz="{axis}"/>'),
        ('<origin xyz="0 0 -0.3"/><axis xyz="1 0 0"/>',
         f'<origin xyz="{place2}"/><axis xyz="{axis2}"/>'),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        robot = load(write_arms(Path(folder), urdf=urdf))
        own = {field.name: getattr(robot, field.name) for field in fields(robot)}
        made = Robot(**own, pairs=tuple(all_pairs(robot)), margin=0.0, neck="midpoint")
        theirs = certificate.point_positions(robot, np.array(q))
    ours = batch.points(made.chain, np.array([q]))[0]
    for role, where in zip(robot.points, theirs, strict=True):
        assert ours[POINTS.index(role)] == pytest.approx(where, abs=ALGEBRA), role


def test_a_pose_that_is_not_finite_has_a_skeleton_that_is_not():
    made = coman()
    q = inside_limits(made, 3, 12)
    q[1, made.joint_names.index("WaistYaw")] = np.nan
    x = batch.skeletons(made.chain, q)
    assert np.isnan(x[1]).any()
    assert np.array_equal(x[[0, 2]], batch.skeletons(made.chain, q[[0, 2]]))


@pytest.mark.parametrize("shape", [(11,), (3, 10), (3, 12), (2, 3, 11)], ids=str)
@pytest.mark.parametrize(
    "door", [batch.skeletons, batch.points, batch.capsule_ends, batch.clearances],
    ids=lambda door: door.__name__,
)  # fmt: skip
def test_poses_of_another_robot_are_refused_before_the_kernel_sees_them(door, shape):
    with pytest.raises(ParameterError) as refusal:
        door(coman().chain, np.zeros(shape))
    assert str(refusal.value) == f"poses must have shape (n, 11), got {shape}"


def test_no_poses_are_no_skeletons():
    assert batch.skeletons(coman().chain, np.empty((0, 11))).shape == (0, 21)


def test_stored_machine_code_is_keyed_by_the_text_of_every_kernel(tmp_path, monkeypatch):
    where = batch._project.stats.cache_path
    assert Path(where).name == f"kernels-{compiled.key()}"  # wherever the project lies
    for room in compiled._ROOMS:
        shutil.copytree(compiled._HERE.parent / room, tmp_path / room)
    monkeypatch.setattr(compiled, "_HERE", tmp_path / "kernels")
    assert compiled.key() in where
    for edited_file in (
        "kernels/solver.py", "safety/segment.py", "plan/causal.py", "plan/rounds.py",
    ):  # fmt: skip
        text = (tmp_path / edited_file).read_text()
        (tmp_path / edited_file).write_text(text + "# edited\n")
        assert compiled.key() not in where
        (tmp_path / edited_file).write_text(text)
    for driver in ("retarget/live.py", "plan/whole.py"):  # hold nothing that is compiled
        (tmp_path / driver).write_text("")
    assert compiled.key() in where
