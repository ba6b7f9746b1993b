"""Files that a simulator or a controller plays as they are: every joint, the heading, a base."""

import json
import pickle

import mujoco
import numpy as np
import pinocchio
import pytest
from follower import Plain, led_by
from handmade import broken, bvh, deepmimic, write
from test_cli import TABLE
from typer.testing import CliRunner
from worlds import ARMS_URDF, ARMS_YAML, MARGIN, ROBOTS, coman, edited, write_arms

from s3le.cli.main import app
from s3le.cli.options import Tool
from s3le.errors import ParameterError, RobotError, S3leError, TrajectoryError
from s3le.human.rotation import about, from_quaternion
from s3le.human.skeletons import read_frames
from s3le.motion import files, layouts, rates, root, text, trajectory, whole
from s3le.motion.fit import fit
from s3le.retarget import clip
from s3le.robot import model
from s3le.robot.certificate import point_positions
from s3le.robot.robot import Robot

ROBOT = ["--robot", str(ROBOTS / "coman.yaml")]
ALGEBRA = 1e-12
# The two-armed robot with a lift, a wheel and a gripper that do not move, on a base that is turned.
TURN = (0.3, -0.4, 2.0)  # [rad], base link -> x forward, y left, z up
BACK = pinocchio.rpy.matrixToRpy(pinocchio.rpy.rpyToMatrix(*TURN).T).tolist()
BASE = f"""\
  <link name="base">{{inertia}}</link>
  <joint name="stand" type="fixed"><parent link="base"/><child link="body"/>
    <origin xyz="0 0 0" rpy="{BACK[0]} {BACK[1]} {BACK[2]}"/></joint>
"""
INERTIA = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LINKS = ("head", "wheel", "finger", "thumb", "tag")
LIFT = (
    "".join(f'  <link name="{name}">{INERTIA}</link>\n' for name in LINKS)
    + """\
  <joint name="lift" type="prismatic"><parent link="chest"/><child link="head"/>
    <axis xyz="0 0 1"/><limit lower="0.1" upper="0.5" velocity="1" effort="1"/></joint>
"""
)
MORE = """\
  <joint name="spin" type="continuous"><parent link="body"/><child link="wheel"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="thumb" type="revolute"><parent link="r_hand"/><child link="thumb"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>
    <mimic joint="grip" multiplier="-1"/></joint>
  <joint name="grip" type="revolute"><parent link="r_hand"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="loose" type="floating"><parent link="head"/><child link="tag"/></joint>
</robot>
"""
CROWDED_URDF = edited(
    ARMS_URDF,
    ('  <link name="r_upper">', BASE.format(inertia=INERTIA) + LIFT + '  <link name="r_upper">'),
    ("</robot>\n", MORE),
)
CROWDED_YAML = edited(
    ARMS_YAML,
    ("hold: {}", "hold: {lift: 0.25, spin: 7.0, grip: 0.3, thumb: -0.3}"),
    ("[0.0, 0.0, 0.0]", str(list(TURN))),
    ("[r_shoulder, r_elbow, l_shoulder, l_elbow]", "[l_elbow, r_shoulder, r_elbow, l_shoulder]"),
)
BARE_YAML = edited(CROWDED_YAML, ("hold: {lift", "hold: {}  # {lift"))
ORDER = ("lift", "r_shoulder", "r_elbow", "l_shoulder", "l_elbow", "spin", "grip")


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """The robot with joints of every kind."""
    folder = tmp_path_factory.mktemp("crowded")
    return Robot.from_file(write_arms(folder, CROWDED_YAML, CROWDED_URDF), MARGIN, "midpoint")


def moving(robot, rows=6, fps=50.0, **more):
    """Some motion of a robot's own joints around its anchor, turning about z meanwhile."""
    heading = np.linspace(-0.4, 7.0, rows)
    time = 0.3 + np.arange(rows) / fps
    phase = np.random.default_rng(2).uniform(-3.0, 3.0, robot.n_dof)
    q = robot.anchor + 0.1 * np.sin(9.0 * time[:, None] + phase)
    q = np.clip(q, robot.lower, robot.upper)
    return trajectory.make("m", robot.joint_names, time, q, heading=heading, **more)


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


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


# --- heading


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A figure that lowers its left arm and turns by 400 degrees; three frames are of no use."""
    yaw, arm = np.linspace(0, 400, 40), 60 * np.sin(np.linspace(0, 1.3, 40)) ** 2
    rows = [[0, 0, 0, 0, 0, a, -b, 0, 0, 0, 0, 0] for a, b in zip(yaw, arm, strict=True)]
    for row in (20, 21, 22):
        rows[row][4] = 90
    folder = tmp_path_factory.mktemp("turning")
    return write(folder / "turn.bvh", bvh(rows, order="ZXY", step=".04"))


def test_the_heading_is_the_clips_unwrapped_and_at_the_rows_own_times(turning):
    frames = read_frames(turning, "midpoint")
    yaw = np.deg2rad(np.delete(np.linspace(0, 400, 40), [20, 21, 22]))
    made = clip.convert(Plain(), frames).motion
    assert made.heading - made.heading[0] == pytest.approx(yaw, abs=1e-6)
    assert made.about["heading"] == "from the clip"
    lead = clip.convert(Plain(), frames, lead_in=0.4, rate=100.0).motion
    offset = lead.about["clip_time_offset_s"]
    assert (lead.heading[lead.time <= offset] == made.heading[0]).all()
    by_hand = np.interp(lead.time - offset, frames.time, made.heading)
    assert lead.heading == pytest.approx(by_hand, abs=1e-9)


def test_a_clip_without_a_heading_is_the_identity_and_says_so(turning):
    frames = read_frames(turning, "midpoint")._replace(heading=None)
    made = clip.convert(Plain(), frames)
    assert (made.motion.heading == 0.0).all() and made.summary["heading"] == "identity"


def test_a_heading_that_is_not_finite_is_refused_with_its_row():
    with pytest.raises(TrajectoryError, match="row 1: heading is nan"):
        trajectory.make("m", ["a"], [0, 1], [[0], [0]], heading=[0, np.nan])


# --- even rows


def test_even_rows_fill_gaps_and_cut_no_corner_at_the_clips_own_rate(turning):
    frames = read_frames(turning, "midpoint")
    plain = clip.convert(Plain(), frames).motion
    made = clip.convert(Plain(), frames, even=True).motion
    assert made.rate == pytest.approx(25.0) and len(made.time) == 40
    assert made.about["rate"] == 25.0 and (made.mode == "between").sum() == 3
    assert (made.q[made.mode != "between"] == plain.q).all()


def test_where_a_corner_cannot_be_cut_even_rows_are_refused_with_the_place(monkeypatch):
    it, time = coman(), np.arange(3) / 40
    q = np.repeat(it.anchor[None], 3, 0)
    unproven = type("Unproven", (), {"status": np.full(1, -1)})
    monkeypatch.setattr("s3le.motion.rates.paths.certify", lambda *_: unproven)
    with pytest.raises(ParameterError, match=r"at an even 30 Hz 1 of .*, one at 0.0250 s; give a"):
        rates.evenly(it, time, q, 30.0, 0.0005)
    unproven.status = np.full(4, -1)
    assert len(rates.evenly(it, time, q, 80.0, 0.0005).time) == 5


# --- layouts


def test_the_command_line_knows_every_layout():
    assert {tool.value for tool in Tool} == set(layouts.SUFFIX)


def test_every_file_that_is_written_is_certified_by_the_audit(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    out = tmp_path / "out"
    said = run("retarget", turning, "--out", out, "--full", "--csv", "--npz", "--for", "gmr",
               "--for", "mjlab", "--rate", 50)  # fmt: skip
    assert said.exit_code == 0, said.output
    names = ["turn.parquet", "turn.csv", "turn.npz", "turn.gmr.npz", "turn.mjlab.csv"]
    sides = ["turn.csv.json", "turn.mjlab.csv.json", "turn.json"]
    assert {p.name for p in out.iterdir()} == {*names, *sides} | TABLE
    said = run("audit", *(out / name for name in names), *ROBOT)
    assert said.exit_code == 0 and "5 of 5 files hold" in said.output
    assert said.output.count("rows lie between two frames by their mode") == 5
    summary = json.loads((out / "turn.json").read_text())
    assert len(summary["whole"]["moved"]) == 11 and len(summary["whole"]["held"]) == 18
    # mjlab's: by names and rate from the command line where the side file is gone
    (out / "turn.mjlab.csv.json").unlink()
    path = out / "turn.mjlab.csv"
    assert run("audit", path, *ROBOT).exit_code == 2
    order = [joint.name for joint in whole.joints(coman()).joints]
    said = run("audit", path, *ROBOT, "--fps", 50, "--joints", ",".join(order))
    assert said.exit_code == 0 and "1 of 1 files hold" in said.output
    rows = np.loadtxt(path, delimiter=",")
    whole_file = files.read(out / "turn.parquet")
    assert rows.shape == (len(whole_file.time), 36) and (rows[:, 7:] == whole_file.q).all()
    # GMR's: what its loader takes from the pickle that docs/files.md makes of it
    with np.load(out / "turn.gmr.npz") as it:
        motion = {k: it[k] for k in ("root_pos", "root_rot", "dof_pos")}
        motion |= {"fps": it["fps"].item(), "local_body_pos": None, "link_body_list": None}
        layout = json.loads(str(it["about"]))["layout"]
    motion = pickle.loads(pickle.dumps(motion))
    assert motion["fps"] == 50 and isinstance(motion["fps"], int)
    assert (motion["root_pos"] == rows[:, :3]).all() and (motion["root_rot"] == rows[:, 3:7]).all()
    half = whole_file.heading / 2
    by_hand = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    assert motion["root_rot"] == pytest.approx(by_hand, abs=ALGEBRA)
    assert layout["root_quaternion"].startswith("x y z w") and len(layout["joints"]) == 29


def test_without_full_the_usual_files_keep_the_robots_own_joints(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    said = run("retarget", turning, "--out", tmp_path, "--for", "gmr", "--root-height", 0.7)
    assert said.exit_code == 0, said.output
    assert len(files.read(tmp_path / "turn.parquet").joints) == 11
    assert files.read(tmp_path / "turn.gmr.npz").joints[7] == "RForearmPlate"
    with np.load(tmp_path / "turn.gmr.npz") as it:
        assert it["root_pos"].tolist() == [[0.0, 0.0, 0.7]] * 40
        assert json.loads(str(it["about"]))["layout"]["root_height"] == "as asked for"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--for", "isaac"], "isaac"),
        (["--root-height", "0.5"], "give --for too"),
        (["--for", "gmr", "--root-height", "99"], "root height must be within 10 m"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path, turning, monkeypatch, options, words):
    led_by(monkeypatch, Plain)
    said = run("retarget", turning, "--out", tmp_path / "out", *options)
    assert said.exit_code == 2 and words in said.output and not (tmp_path / "out").exists()


def test_clips_whose_files_would_be_one_anothers_are_refused(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    for name in ("a.bvh", "a.gmr.bvh"):
        (tmp_path / name).write_bytes(turning.read_bytes())
    said = run("retarget", tmp_path / "a.bvh", tmp_path / "a.gmr.bvh", "--out", tmp_path / "out",
               "--npz", "--for", "gmr")  # fmt: skip
    assert said.exit_code == 2 and "would both become a.gmr.npz" in said.output


def test_a_clip_is_never_replaced_by_what_became_of_it(tmp_path, monkeypatch):
    """A motion takes its clip's name, and .json and .parquet are suffixes of both."""
    led_by(monkeypatch, Plain)
    monkeypatch.chdir(tmp_path)
    clip = write(tmp_path / "wave.json", deepmimic(*({} for _ in range(5))))
    before = clip.read_bytes()
    for out in (".", "sub/..", str(tmp_path)):
        said = run("retarget", "wave.json", "--out", out)
        assert said.exit_code == 2 and "wave.json is a clip" in said.output
    assert clip.read_bytes() == before and list(tmp_path.iterdir()) == [clip]


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
