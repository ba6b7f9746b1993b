"""The robot model: its joints, points and bodies are those of its source."""

import numpy as np
import pytest
from worlds import (
    ARMS_URDF,
    ARMS_YAML,
    MARGIN,
    ROBOTS,
    arms_points,
    coman,
    edited,
    write_arms,
)

from s3le.robot import certificate, model
from s3le.robot.robot import Robot

FACT = 1e-4  # [m] or [rad], the facts are typed with four decimals
ALGEBRA = 1e-12  # [m], float64
LIMITS = {  # [rad], iit-coman-ros-pkg
    "WaistLat": (-0.5236, 0.5235), "WaistSag": (-0.3491, 0.8727), "WaistYaw": (-1.3963, 1.3962),
    "RShSag": (-3.4034, 1.6581), "RShLat": (-2.094, 0.31415), "RShYaw": (-1.5708, 1.5708),
    "RElbj": (-2.3562, 0.0), "LShSag": (-3.4034, 1.6581), "LShLat": (-0.31415, 2.094),
    "LShYaw": (-1.5708, 1.5708), "LElbj": (-2.3562, 0.0),
}  # fmt: skip
AUTHORS = LIMITS | {
    "WaistLat": (-0.2618, 0.26175), "WaistYaw": (-0.69815, 0.6981),
    "RShLat": (-3.1416, -0.1745), "LShLat": (0.1745, 3.1416),
}  # fmt: skip
ZERO_POSE = {  # [m], arms hanging down
    "hip": (0, 0, 0), "neck": (0.00531, 0, 0.32433),
    "r_shoulder": (0.00531, -0.1558, 0.32433), "l_shoulder": (0.00531, 0.1558, 0.32433),
    "r_elbow": (0.0203, -0.1558, 0.14433), "l_elbow": (0.0203, 0.1558, 0.14433),
    "r_hand": (0.00531, -0.1558, -0.05035), "l_hand": (0.00531, 0.1558, -0.05035),
}  # fmt: skip


def points_at(robot: model.Geometry, q: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(robot.points, certificate.point_positions(robot, q), strict=True))


# --- COMAN


@pytest.mark.parametrize(
    ("name", "limits"), [("coman", LIMITS), ("coman_authors", AUTHORS)], ids=["official", "authors"]
)
def test_coman_has_eleven_joints_with_the_ranges_of_its_source(name, limits):
    robot = coman(name=name)
    assert robot.n_dof == 11
    found = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    assert found.keys() == limits.keys()
    for joint, bounds in limits.items():
        assert found[joint] == pytest.approx(bounds, abs=FACT / 2), joint


def test_coman_stands_where_its_source_says_at_zero():
    at = points_at(coman(), np.zeros(11))
    for role, where in ZERO_POSE.items():
        assert at[role] == pytest.approx(where, abs=FACT), role


@pytest.mark.parametrize("side", ["r", "l"])
def test_coman_s_link_lengths_are_the_measured_ones_in_every_pose(side):
    robot = coman()
    for q in np.random.default_rng(1).uniform(robot.lower, robot.upper, (20, 11)):
        at = points_at(robot, q)
        neck = (at["r_shoulder"] + at["l_shoulder"]) / 2
        lengths = [
            np.linalg.norm(at[f"{side}_elbow"] - at[f"{side}_shoulder"]),
            np.linalg.norm(at[f"{side}_hand"] - at[f"{side}_elbow"]),
            np.linalg.norm(at[f"{side}_shoulder"] - neck),
        ]
        assert lengths == pytest.approx([0.1806, 0.1953, 0.1558], abs=FACT)  # [m]


def test_coman_s_anchor_is_the_t_pose():
    at = points_at(coman(), coman().anchor)
    assert at["l_hand"] - at["l_shoulder"] == pytest.approx([0, 0.3747, 0], abs=0.016)
    assert at["r_hand"] - at["r_shoulder"] == pytest.approx([0, -0.3747, 0], abs=0.016)


def test_coman_s_arms_mirror_each_other():
    robot = coman()
    flipped = {"Lat", "Yaw"}  # joints whose axis is not across the body change their sign
    for q in np.random.default_rng(2).uniform(robot.lower, robot.upper, (10, 11)):
        by_name = dict(zip(robot.joint_names, q, strict=True))
        other = []
        for name in robot.joint_names:
            twin = {"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:]
            other.append(by_name[twin] * (-1 if name[-3:] in flipped else 1))
        here, there = points_at(robot, q), points_at(robot, np.array(other))
        for a, b in (("r_hand", "l_hand"), ("l_elbow", "r_elbow")):
            assert here[a] * [1, -1, 1] == pytest.approx(there[b], abs=1e-9)


def test_the_two_coman_files_differ_only_in_their_ranges_and_so_in_their_digest():
    ours, theirs = coman(), coman(name="coman_authors")
    assert ours.digest != theirs.digest
    assert ours.joint_names == theirs.joint_names
    for a, b in zip(ours.bodies, theirs.bodies, strict=True):
        assert (a.name, a.joint, a.radius) == (b.name, b.joint, b.radius)
        assert np.array_equal(a.a, b.a) and np.array_equal(a.b, b.b)
    assert {a.name for a, b in zip(ours.joints, theirs.joints, strict=True) if a[5:] != b[5:]} == {
        "WaistLat", "WaistYaw", "RShLat", "LShLat",
    }  # fmt: skip


@pytest.mark.parametrize("file", sorted(ROBOTS.glob("*.yaml")), ids=lambda f: f.stem)
def test_every_robot_of_the_project_loads_and_its_anchor_is_feasible(file):
    made = Robot.from_file(file, MARGIN, "midpoint")
    report = made.certifier().require(made.anchor[None], MARGIN)
    assert report.clearance[0] >= MARGIN and report.limit_margin[0] >= 0.0


def test_a_machine_that_was_written_is_read_back_the_same(tmp_path):
    coman().write(tmp_path / "robot")
    again = Robot.read(tmp_path / "robot")
    assert again.tag == coman().tag
    assert again.pairs == coman().pairs


# --- a robot whose kinematics are known by hand


def test_points_of_two_planar_arms_are_where_algebra_puts_them(tmp_path):
    robot = model.load(write_arms(tmp_path))
    for q in np.random.default_rng(3).uniform(robot.lower, robot.upper, (20, 4)):
        want = arms_points(dict(zip(robot.joint_names, q, strict=True)))
        for role, where in points_at(robot, q).items():
            assert where == pytest.approx(want[role], abs=ALGEBRA), role


def test_a_base_that_lies_on_its_back_is_turned_upright(tmp_path):
    robot = model.load(
        write_arms(
            tmp_path, edited(ARMS_YAML, ("[0.0, 0.0, 0.0]", "[0.0, 0.0, 3.141592653589793]"))
        )
    )
    want = arms_points(dict(zip(robot.joint_names, np.full(4, 0.3), strict=True)))
    found = points_at(robot, np.full(4, 0.3))
    assert found["l_hand"] == pytest.approx(want["l_hand"] * [-1, -1, 1], abs=ALGEBRA)


@pytest.mark.parametrize(
    ("kind", "held"), [("revolute", 0.7), ("continuous", 0.7), ("continuous", 7.0)],
    ids=["revolute", "continuous", "continuous beyond a turn"],
)  # fmt: skip
def test_a_held_joint_stands_at_its_angle(tmp_path, kind, held):
    yaml = edited(
        ARMS_YAML,
        ("[r_shoulder, r_elbow", "[r_elbow"),
        ("hold: {}", f"hold: {{r_shoulder: {held}}}"),
        ("r_shoulder: -1.5, ", ""),
    )
    urdf = edited(ARMS_URDF, ('r_shoulder" type="revolute"', f'r_shoulder" type="{kind}"'))
    robot = model.load(write_arms(tmp_path, yaml, urdf))
    assert robot.n_dof == 3
    q = np.array([0.1, -0.2, 0.4])
    want = arms_points(dict(zip(robot.joint_names, q, strict=True)) | {"r_shoulder": held})
    assert points_at(robot, q)["r_hand"] == pytest.approx(want["r_hand"], abs=ALGEBRA)


def test_the_digest_sees_every_number_that_can_change_a_result(tmp_path):
    plain = model.load(write_arms(tmp_path)).digest
    changes = {
        "limit": (ARMS_YAML, edited(ARMS_URDF, ('upper="3"', 'upper="3.01"'))),
        "radius": (ARMS_YAML, edited(ARMS_URDF, ('radius="0.03"', 'radius="0.031"'))),
        "link": (ARMS_YAML, edited(ARMS_URDF, ('xyz="0 0 -0.3"', 'xyz="0 0 -0.31"'))),
        "anchor": (edited(ARMS_YAML, ("r_shoulder: -1.5", "r_shoulder: -1.4")), ARMS_URDF),
        "inflation": (edited(ARMS_YAML, ("1.1", "1.2")), ARMS_URDF),
        "base": (edited(ARMS_YAML, ("[0.0,", "[0.1,")), ARMS_URDF),
        "point": (edited(ARMS_YAML, ("r_hand: r_hand", "r_hand: r_lower")), ARMS_URDF),
    }
    digests = [model.load(write_arms(tmp_path, *files)).digest for files in changes.values()]
    assert len({plain, *digests}) == len(changes) + 1
    assert model.load(write_arms(tmp_path / "elsewhere")).digest == plain


# --- bodies


def inside(body: model.Body, vertices: np.ndarray) -> np.ndarray:
    """By how much each vertex lies inside the capsule [m]; negative: outside."""
    along = body.b - body.a
    share = np.clip((vertices - body.a) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    return body.radius - np.linalg.norm(vertices - body.a - share[:, None] * along, axis=1)


@pytest.mark.parametrize(
    "sides", [(0.2, 0.1, 0.04), (0.04, 0.2, 0.1), (0.1, 0.1, 0.1), (0.001, 0.5, 0.001)],
    ids=["foot", "along y", "cube", "stick"],
)  # fmt: skip
def test_a_box_lies_within_its_capsule(tmp_path, sides):
    box = f'<box size="{sides[0]} {sides[1]} {sides[2]}"/>'
    turned = edited(
        ARMS_URDF,
        ('<capsule radius="0.04" length="0.2"/>', box),
        ('xyz="0 0 -0.15"', 'xyz="0.01 0.02 -0.15" rpy="0.3 -0.7 1.1"'),
    )
    robot = model.load(write_arms(tmp_path, urdf=turned))
    body = next(body for body in robot.bodies if body.name.startswith("r_upper"))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2 * sides
    turn = model.pin.rpy.rpyToMatrix(0.3, -0.7, 1.1)
    depth = inside(body, corners @ turn.T + [0.01, 0.02, -0.15])
    assert body.shape == "box"
    assert depth.min() >= -ALGEBRA
    assert depth.min() <= 1e-6 * body.radius + ALGEBRA  # and touches its corners, so no larger


@pytest.mark.parametrize(
    ("radius", "length"), [(0.05, 0.3), (0.1, 0.02), (0.04, 0.08)], ids=["rod", "disk", "even"]
)
def test_a_cylinder_lies_within_its_capsule(tmp_path, radius, length):
    cylinder = f'<cylinder radius="{radius}" length="{length}"/>'
    urdf = edited(ARMS_URDF, ('<capsule radius="0.04" length="0.2"/>', cylinder))
    body = next(
        body
        for body in model.load(write_arms(tmp_path, urdf=urdf)).bodies
        if body.shape == "cylinder"
    )
    turn = np.linspace(0, 2 * np.pi, 60)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], axis=1)
    for end in (-length / 2, length / 2):
        depth = inside(body, rim + [0, 0, -0.15 + end])
        assert depth.min() >= -ALGEBRA and depth.max() <= 1e-6


def test_a_sphere_is_a_capsule_without_length(tmp_path):
    sphere = '<sphere radius="0.07"/>'
    urdf = edited(ARMS_URDF, ('<capsule radius="0.04" length="0.2"/>', sphere))
    body = next(
        b for b in model.load(write_arms(tmp_path, urdf=urdf)).bodies if b.shape == "sphere"
    )
    assert np.array_equal(body.a, body.b)
    assert body.radius == 0.07


def test_coman_s_feet_are_boxes_within_their_capsules():
    feet = [body for body in coman().bodies if body.shape == "box"]
    assert len(feet) == 2
    assert all(body.joint == -1 for body in feet)
