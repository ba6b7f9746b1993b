"""Files of a robot whose joints are of every kind: columns, base, and what MuJoCo plays."""

import mujoco
import numpy as np
import pinocchio
import pytest
from command import run
from crowded import ALGEBRA, BARE_YAML, CROWDED_URDF, CROWDED_YAML, INERTIA, ORDER, moving
from handmade import broken
from worlds import ARMS_URDF, MARGIN, coman, edited, write_arms

from s3le.errors import ParameterError, RobotError, S3leError, TrajectoryError
from s3le.human.rotation import about, from_quaternion
from s3le.motion import files, layouts, root, text, trajectory, whole
from s3le.motion.fit import fit
from s3le.robot import model
from s3le.robot.certificate import point_positions
from s3le.robot.robot import Robot


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """The robot with joints of every kind."""
    folder = tmp_path_factory.mktemp("crowded")
    return Robot.from_file(write_arms(folder, CROWDED_YAML, CROWDED_URDF), MARGIN, "midpoint")


# --- every joint


def test_joints_are_the_urdfs_in_its_order_with_their_units(crowded):
    robot = crowded
    found = whole.joints(robot)
    assert tuple(joint.name for joint in found.joints) == ORDER
    assert [joint.unit for joint in found.joints] == ["m"] + ["rad"] * 6
    assert found.mimics == {"thumb": {"of": "grip", "at": -0.3}}
    assert found.others == {"loose": "floating"}
    it = mujoco.MjModel.from_xml_string(CROWDED_URDF.replace("floating", "fixed"))
    numbered = [it.joint(i).name for i in range(it.njnt)]
    assert found.depth_first == tuple(name for name in numbered if name in ORDER) != ORDER
    one = moving(robot)
    made = whole.complete(one, robot, found)
    for column, name in enumerate(ORDER):
        if name in robot.joint_names:
            assert (made.q[:, column] == one.q[:, robot.joint_names.index(name)]).all()
        else:
            assert (made.q[:, column] == robot.description.hold[name]).all()
    said = made.about["whole"]
    assert said["moved"] == [name for name in ORDER if name in robot.joint_names]
    assert said["held"] == {"lift": 0.25, "spin": 7.0, "grip": 0.3}
    assert said["in_metres"] == ["lift"]


@pytest.mark.parametrize("suffix", files.WRITTEN)
def test_a_whole_robots_file_comes_back_and_fits(tmp_path, crowded, suffix):
    one = moving(crowded)
    files.write(whole.complete(one, crowded, whole.joints(crowded)),
                tmp_path / f"a{suffix}")  # fmt: skip
    back = files.read(tmp_path / f"a{suffix}")
    assert back.joints == ORDER and back.heading.tobytes() == one.heading.tobytes()
    assert trajectory.unit(back, "lift") == "m" and trajectory.unit(back, "spin") == "rad"
    fitted = fit(back, crowded)
    assert (fitted.trajectory.q == one.q).all() and fitted.notes == []
    degrees = trajectory.make("d", ORDER, back.time, np.where(
        np.array(ORDER) == "lift", back.q, np.rad2deg(back.q)))  # fmt: skip
    assert fit(degrees, crowded, True).trajectory.q == pytest.approx(one.q, abs=ALGEBRA)


def test_a_held_joint_that_has_moved_is_refused_in_its_unit(crowded):
    made = whole.complete(moving(crowded), crowded, whole.joints(crowded))
    q = np.array(made.q)
    q[3, 0] = 0.4
    moved = trajectory.make("m", made.joints, made.time, q)
    with pytest.raises(TrajectoryError, match=r"row 3: lift is 0.4 m, but .* holds it at 0.25"):
        fit(moved, crowded)


def test_a_joint_that_nobody_put_within_its_range_is_refused(tmp_path):
    yaml = edited(CROWDED_YAML, ("lift: 0.25, ", ""))
    robot = model.load(write_arms(tmp_path, yaml, CROWDED_URDF))
    with pytest.raises(RobotError, match=r"arms.yaml: joint 'lift' is held at 0 m, .*\[0.1, 0.5\]"):
        whole.joints(robot)


# --- the base


def about_z(angles):
    return about(2, np.asarray(angles, float))


def test_the_roots_quaternions_are_heading_times_base(crowded):
    base, heading = root.find(crowded), np.linspace(-9.0, 9.0, 400)
    turn = root.turned(base, heading)  # x y z w
    made = from_quaternion(turn[:, [3, 0, 1, 2]])
    assert made == pytest.approx(about_z(heading) @ crowded.base_rotation, abs=ALGEBRA)
    assert ((turn[1:] * turn[:-1]).sum(axis=1) > 0.9).all()  # no jumps in sign
    assert base.link == "base"


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="0.2 0.3 0.8"/>',
        '<cylinder radius="0.2" length="0.9"/>',
        '<sphere radius="0.5"/>',
        '<capsule radius="0.3" length="0.6"/>',
    ],
    ids=["box", "cylinder", "sphere", "capsule"],
)
def test_the_base_is_so_high_that_the_lowest_body_touches_the_ground(tmp_path, shape):
    """The surface of the body by hand, sampled; everything else is higher."""
    urdf = edited(
        ARMS_URDF, ('<capsule radius="0.1" length="0.3"/>', shape),
        ('xyz="0 0 0.25"', 'xyz="0 0 0.25" rpy="0.5 0.9 -0.2"'),
    )  # fmt: skip
    robot = model.load(write_arms(tmp_path, BARE_YAML, urdf))
    kind = shape[1:].split()[0]
    sizes = [float(v) for v in " ".join(shape.split('"')[1::2]).split()]
    way = np.random.default_rng(0).normal(size=(200_000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    if kind == "box":
        surface = np.sign(way) * sizes / 2
    elif kind == "sphere":
        surface = sizes[0] * way
    else:
        end = np.sign(way[:, 2:]) * [0, 0, sizes[1] / 2]
        flat = way * [1, 1, 0] / np.linalg.norm(way[:, :2], axis=1, keepdims=True)
        surface = end + sizes[0] * (way if kind == "capsule" else flat)
    surface = surface @ pinocchio.rpy.rpyToMatrix(0.5, 0.9, -0.2).T + [0, 0, 0.25]
    below = (surface @ robot.base_rotation.T)[:, 2].min()
    base = root.find(robot)
    assert base.height == pytest.approx(-below, abs=2e-5) and base.height >= -below - ALGEBRA
    assert base.because == root.STANDING


def test_comans_soles_are_on_the_ground():
    """By MuJoCo's reading of the URDF: corners of boxes, ends of capsules, all joints at zero."""
    it = mujoco.MjModel.from_xml_string(coman().description.urdf.read_text())
    data = mujoco.MjData(it)
    mujoco.mj_kinematics(it, data)
    is_box, is_capsule = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    assert set(it.geom_type.tolist()) == {is_box, is_capsule}
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8)
    low = []
    for geom, kind in enumerate(it.geom_type):
        up, size = data.geom_xmat[geom].reshape(3, 3)[2], it.geom_size[geom]
        reach = (up * size) @ corners if kind == is_box else up[2] * size[1] * corners[2] - size[0]
        low.append(data.geom_xpos[geom, 2] + reach.min())
    base = root.find(coman())
    assert base.link == "base_link" and base.height == pytest.approx(-min(low), abs=1e-6)
    assert root.find(coman(), 0.6).height == 0.6
    for wrong in (float("nan"), 11.0):
        with pytest.raises(ParameterError, match="root height must be within 10 m"):
            root.find(coman(), wrong)


def played(robot, rows, free):
    """Where MuJoCo has a robot's joints, by its own reading of the URDF [m], (n, joints, 3).

    Args:
        robot: its URDF is what is played.
        rows: numbers as a file has them: root position, quaternion x y z w, joints if free.
        free: whether there is a free base.
    """
    said = robot.description.urdf.read_text()
    if free:
        link = root.find(robot).link
        world = '<link name="w"/><joint name="free" type="floating"><parent link="w"/>'
        world += f'<child link="{link}"/></joint>'
        said = said.replace("</robot>", world + "</robot>")
        for name, kind in (("loose", "floating"), ("thumb", "revolute")):  # files leave these out
            said = said.replace(f'"{name}" type="{kind}"', f'"{name}" type="fixed"')
        said = said.replace(f'<link name="{link}"/>', f'<link name="{link}">{INERTIA}</link>')
        said = said.replace(f'<link name="{link}"><coll', f'<link name="{link}">{INERTIA}<coll')
    it = mujoco.MjModel.from_xml_string(said)
    data = mujoco.MjData(it)
    places = []
    for row in rows:
        data.qpos[:] = row[[0, 1, 2, 6, 3, 4, 5, *range(7, len(row))]] if free else row
        for name, held in robot.description.hold.items():
            assert name == "thumb" or data.joint(name).qpos[0] == held
        mujoco.mj_kinematics(it, data)
        places.append([data.joint(name).xanchor.copy() for name in robot.joint_names])
    return np.array(places)


def ours(robot, q):
    """The same for points that are joints, by pinocchio, in the upright frame."""
    at = {role: point.frame for role, point in robot.description.points.items()}
    kept = [r for r, role in enumerate(robot.points) if at[role] in robot.joint_names]
    names = [at[role] for role in robot.points if at[role] in robot.joint_names]
    places = np.array([point_positions(robot, row)[kept] for row in q])
    return names, places


def test_mujoco_plays_comans_files_by_the_order_of_their_columns(tmp_path):
    robot = coman()
    one = moving(robot)
    made = whole.complete(one, robot, whole.joints(robot))
    assert len(made.joints) == 29
    files.write(made, tmp_path / "a.parquet")
    layouts.write(made, root.find(robot), 50.0, "mjlab", tmp_path / "a.mjlab.csv")
    names, want = ours(robot, one.q)
    at = [robot.joint_names.index(name) for name in names]
    assert len(names) == 4
    found = played(robot, files.read(tmp_path / "a.parquet").q, free=False)[:, at]
    assert found == pytest.approx(want, abs=1e-6)
    rows = np.loadtxt(tmp_path / "a.mjlab.csv", delimiter=",")
    found = played(robot, rows, free=True)[:, at]
    turned = np.einsum("nij,nkj->nki", about_z(one.heading), want)
    assert found == pytest.approx(turned + [0, 0, root.find(robot).height], abs=1e-6)


def test_mujoco_plays_joints_of_every_kind_on_a_turned_base(tmp_path, crowded):
    robot, found = crowded, whole.joints(crowded)
    one = moving(robot)
    made = whole.numbered(whole.complete(one, robot, found), found)
    layouts.write(made, root.find(robot, 1.5), 50.0, "mjlab", tmp_path / "a.mjlab.csv")
    rows = np.loadtxt(tmp_path / "a.mjlab.csv", delimiter=",")
    names, want = ours(robot, one.q)
    found = played(robot, rows, free=True)[:, [robot.joint_names.index(name) for name in names]]
    turned = np.einsum("nij,nkj->nki", about_z(one.heading), want)
    assert found == pytest.approx(turned + [0, 0, 1.5], abs=1e-6) and len(names) == 4


def test_the_audit_certifies_every_file_of_such_a_robot(tmp_path, crowded):
    robot, found = crowded, whole.joints(crowded)
    made = whole.complete(moving(robot), robot, found)
    paths = [tmp_path / f"a{suffix}" for suffix in files.WRITTEN]
    for path in paths:
        files.write(made, path)
    for layout, suffix in layouts.SUFFIX.items():
        paths.append(tmp_path / f"a{suffix}")
        layouts.write(whole.numbered(made, found), root.find(robot), 50.0, layout, paths[-1])
    said = run("audit", *paths, "--robot", robot.description.source)
    assert said.exit_code == 0 and "5 of 5 files hold" in said.output, said.output


# --- layouts


def test_rows_that_are_not_at_the_rate_are_in_no_layout(tmp_path, crowded):
    made = whole.complete(moving(crowded), crowded, whole.joints(crowded))
    base = root.find(crowded)
    for layout, fps, words in (("gmr", 49.0, "1 / 49 s apart"), ("bvh", 50.0, "no layout 'bvh'")):
        with pytest.raises(TrajectoryError, match=words):
            layouts.write(made, base, fps, layout, tmp_path / "a")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("layout", layouts.SUFFIX)
def test_a_layouts_file_of_any_robot_is_read_by_itself(tmp_path, crowded, layout):
    mode = np.array(["start", "reached", "reached", "between", "reached", "held"])
    found = whole.joints(crowded)
    made = whole.numbered(whole.complete(moving(crowded, mode=mode), crowded, found),
                          found)  # fmt: skip
    path = tmp_path / f"a{layouts.SUFFIX[layout]}"
    layouts.write(made, root.find(crowded), 50.0, layout, path)
    back = files.read(path)
    assert back.joints == found.depth_first and back.mode.tolist() == mode.tolist()
    assert back.q.tobytes() == made.q.tobytes() and back.rate == pytest.approx(50.0)
    assert (fit(back, crowded).trajectory.q == moving(crowded).q).all()


@pytest.mark.parametrize("name", ["a.gmr.npz", "a.mjlab.csv", "a.mjlab.csv.json"])
def test_a_damaged_file_of_a_layout_is_read_or_refused_and_nothing_else(tmp_path, crowded, name):
    mode = np.array(["reached", "between"])[np.arange(20) % 2]
    found = whole.joints(crowded)
    made = whole.complete(moving(crowded, 20, mode=mode), crowded, found)
    for layout, suffix in layouts.SUFFIX.items():
        layouts.write(made, root.find(crowded), 50.0, layout, tmp_path / f"a{suffix}")
    for copy in broken((tmp_path / name).read_bytes(), 100, 5):
        (tmp_path / name).write_bytes(copy)
        try:
            back = files.read(tmp_path / name.removesuffix(".json"))
            fit(back, crowded)
        except S3leError as refusal:
            assert "\n" not in str(refusal)
        else:
            assert np.isfinite(back.q).all() and (np.diff(back.time) > 0).all()


@pytest.mark.parametrize(
    "pairs",
    [None, [], {}, [[0]], [[0, "a"], [0, "b"]], [[1, "a"]], [[0, "a"], [9, "b"]], [[0, 5]],
     [[True, "a"]], [[0, "a" * 300]], [[0, "a"], ["1", "b"]], [[-1, "a"]]],
)  # fmt: skip
def test_runs_of_modes_that_are_none_are_no_modes(pairs):
    assert trajectory.unrolled(pairs, 3) is None
    assert trajectory.unrolled([[0, "a"], [2, "b"]], 3).tolist() == ["a", "a", "b"]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"fps": 30}, "name the 8 columns"),
        ({"fps": 30, "joint_names": "a"}, "name the 8 columns"),
        ({"fps": 30, "joint_names": ["a", 1]}, "name the 8 columns"),
        ({"fps": 30, "joint_names": ["a", "b", "c"]}, "8 columns for 3 joints"),
        ({"fps": "30", "joint_names": ["a"]}, "neither time nor rate"),
        ({"fps": True, "joint_names": ["a"]}, "neither time nor rate"),
        ({"fps": -1, "joint_names": ["a"]}, "one positive number"),
    ],
)
def test_what_lies_beside_a_nameless_csv_is_held_to_it(tmp_path, said, words):
    lines = "0,0,0,0,0,0,1,0.5\n"
    (tmp_path / "a.csv").write_text(lines)
    (tmp_path / "a.csv.json").write_text(text.side(said, lines))
    with pytest.raises(TrajectoryError, match=words):
        files.read(tmp_path / "a.csv")
