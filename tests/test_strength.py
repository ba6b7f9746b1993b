"""What `robot new` proposes as limits of acceleration, and why it does not where it does not."""

import re

import numpy as np
import pytest
from command import run
from figures import figure
from onboarded import new
from test_mjcf import human
from test_mjcf import new as new_of_mjcf

from s3le.onboard import strength
from s3le.plan.limits import ACCELERATION, limits
from s3le.robot import sense

MASS = 1.5  # [kg], of every link
INERTIAL = (
    '<inertial><origin xyz="0 0 -0.1"/><mass value="{mass}"/>'
    '<inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def heavy(text, effort="{name} 40", mass=MASS):
    """A URDF whose links weigh something and whose joints all have an effort [N m]."""
    text = re.sub(r'(<link name="\w+"\s*)/>', r"\1></link>", text)
    text = re.sub(r'(<link name="\w+"\s*>)', rf"\1{INERTIAL.format(mass=mass)}", text)
    return text.replace('effort="1"', f'effort="{effort}"')


def test_an_elbow_gets_what_its_motor_and_its_forearm_say(tmp_path):
    made = new(tmp_path, heavy(figure(wrist=False, hand_frame=False), effort="2"))
    # Forearm: 1.5 kg 0.1 m from the elbow.
    about, gravity = 0.004 + MASS * 0.1**2, MASS * 9.81 * 0.1
    limit = made.robot.description.acceleration["left_elbow"]
    assert limit == pytest.approx((2.0 - gravity) / about, rel=0.02)
    by_joint = dict(zip(made.robot.joint_names, limits(made.robot).acceleration, strict=True))
    assert by_joint["left_elbow"] == limit
    assert "left_shoulder_pitch" not in made.robot.description.acceleration  # 2 N m hold no arm
    assert by_joint["left_shoulder_pitch"] == ACCELERATION
    (line,) = [line for line in made.proposal.look if "does not hold what it carries" in line]
    assert "left_shoulder_pitch" in line and "60 rad/s^2 is their limit" in line
    text = (tmp_path / "robots" / "figure.yaml").read_text()
    assert "# Limits [rad/s^2]: effort less the torque of gravity" in text
    said = run("robot", "check", tmp_path / "robots" / "figure.yaml", "--poses", 10)
    assert f"{limit:g} rad/s^2 by the robot file (" in said.output
    assert "60 rad/s^2 by default (" in said.output


def test_a_strong_motor_is_given_no_more_than_the_default(tmp_path):
    made = new(tmp_path, heavy(figure(), effort="400"))
    limit = made.robot.description.acceleration
    assert limit["left_elbow"] == ACCELERATION and max(limit.values()) == ACCELERATION
    assert any(line.startswith("acceleration: of ") for line in made.proposal.sure)


@pytest.mark.parametrize("effort", ["0", "10000", "inf", "nan"])
def test_an_effort_that_is_none_gives_nothing(tmp_path, effort):
    try:
        made = new(tmp_path, heavy(figure(), effort=effort))
    except Exception as refusal:  # urdfdom itself may refuse what is no number
        assert effort in ("inf", "nan") and "refuse it" in str(refusal)
        return
    assert made.robot.description.acceleration == {}
    (line,) = [line for line in made.proposal.look if line.startswith("acceleration")]
    assert "no effort that can be one" in line
    assert (
        "acceleration:" not in (tmp_path / "robots" / "figure.yaml").read_text().split("\n\n", 1)[1]
    )


def test_without_inertias_the_default_is_said_in_a_line(tmp_path):
    made = new(tmp_path, figure())
    assert made.robot.description.acceleration == {}
    assert [line for line in made.proposal.look if line.startswith("acceleration")] == [
        "acceleration: the file has no inertias; 60 rad/s^2 is their limit; give the robot's own"
    ]
    made = new(tmp_path, heavy(figure(), effort="30", mass="1e6"))
    assert made.robot.description.acceleration == {}
    assert any("the mass of link 'base' is none" in line for line in made.proposal.look)


def test_joints_that_ask_too_much_of_each_other_are_told(tmp_path):
    made = new(tmp_path, heavy(figure(), effort="30"))
    (line,) = [line for line in made.proposal.look if "all joints at once" in line]
    assert float(re.search(r"up to ([\d.]+) times the effort of", line)[1]) > 1.0


@pytest.mark.parametrize("effort", ["joint", "motor"])
def test_an_mjcf_gives_what_mujoco_itself_computes(tmp_path, effort):
    mujoco = pytest.importorskip("mujoco")
    how = {
        "joint": 'fullinertia="0.02 0.015 0.01 0.001 0.002 -0.001"',
        "motor": 'diaginertia="0.02 0.015 0.01" quat="0.9 0.1 0.2 0.1"',
    }
    full = f'<inertial pos="0.01 0 -0.08" mass="1.2" {how[effort]}/>'
    text = re.sub(r"<inertial [^>]*/>", "", human())
    text = re.sub(r"(<body [^>]*>)", rf"\1{full}", text)
    text = text.replace(
        'axis="0 1 0" range="-2.3 0.1"', 'axis="0 1 0" range="-2.3 0.1" armature="0.05"'
    )
    if effort == "joint":
        text = text.replace('range="', 'actuatorfrcrange="-45 45" range="')
    else:
        text = text.replace("<motor ", '<motor forcerange="-45 45" ')
    _, robot = new_of_mjcf(tmp_path, text)
    found = robot.description.acceleration
    model = mujoco.MjModel.from_xml_string(text)
    data, moved = mujoco.MjData(model), np.zeros(model.nv)
    at = [model.joint(name).qposadr[0] for name in robot.joint_names]
    column = [model.joint(name).dofadr[0] for name in robot.joint_names]
    about, weight = np.zeros(robot.n_dof), np.zeros(robot.n_dof)
    for pose in sense.poses(robot, strength.POSES):
        data.qpos[at] = pose
        mujoco.mj_forward(model, data)
        for i, at_joint in enumerate(column):
            unit = np.zeros(model.nv)
            unit[at_joint] = 1.0
            mujoco.mj_mulM(model, data, moved, unit)
            about[i] = max(about[i], moved[at_joint])
        weight = np.maximum(weight, np.abs(data.qfrc_bias[column]))
    theirs = np.minimum((45.0 - weight) / about, ACCELERATION)
    assert set(found) == set(robot.joint_names)
    ours = np.array([found[name] for name in robot.joint_names])
    assert (ours <= theirs * (1 + 1e-9)).all() and ours == pytest.approx(theirs, rel=0.01)
    assert 1.0 < ours.min() < ours.max() <= ACCELERATION


def test_an_mjcf_whose_bodies_are_weighed_by_their_geoms_has_no_inertias(tmp_path):
    made, robot = new_of_mjcf(tmp_path, human())
    assert robot.description.acceleration == {}
    assert any("the file has no inertias" in line for line in made.look)


def test_limits_are_rounded_down():
    assert [strength._down(x) for x in (12.349, 60.0, 1.2399, 0.99999)] == [12.3, 60.0, 1.23, 0.999]
