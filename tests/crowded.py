"""The two-armed robot with more joints, crowded onto a base that is turned."""

import numpy as np
import pinocchio
from worlds import ARMS_URDF, ARMS_YAML, edited

from s3le.motion import trajectory

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


def moving(robot, rows=6, fps=50.0, **more):
    """Some motion of a robot's own joints around its anchor, turning about z meanwhile."""
    heading = np.linspace(-0.4, 7.0, rows)
    time = 0.3 + np.arange(rows) / fps
    phase = np.random.default_rng(2).uniform(-3.0, 3.0, robot.n_dof)
    q = robot.anchor + 0.1 * np.sin(9.0 * time[:, None] + phase)
    q = np.clip(q, robot.lower, robot.upper)
    return trajectory.make("m", robot.joint_names, time, q, heading=heading, **more)
