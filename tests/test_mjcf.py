"""MJCF in: MuJoCo itself says where every body stands, and what a broken file is told."""

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from figures import BOX, obj, stl
from worlds import MARGIN

from s3le.errors import RobotError
from s3le.motion import whole
from s3le.onboard import mjcf, propose, reading
from s3le.robot import pairs
from s3le.robot.robot import Robot
from s3le.safety import covered

# Every way to turn something, a joint off its body's origin, two joints in a body, a frame,
# a reference position, classes within classes, a mesh moved and scaled.
ODD = """
<mujoco model="odd">
  <compiler angle="degree" eulerseq="zYx" meshdir="parts"/>
  <include file="more/assets.xml"/>
  <default>
    <joint axis="0 1 0"/>
    <default class="bent"><joint axis="1 0 0" range="-40 60"/>
      <default class="far"><joint pos="0.01 -0.02 0.03"/><geom type="box" size="1 1 1"/></default>
    </default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <light pos="0 0 3"/>
    <body name="crate" pos="2 0 0"><freejoint/><geom size="0.1"/></body>
    <body name="base" pos="0 0 1" euler="10 20 30" childclass="bent">
      <freejoint name="root"/>
      <geom name="hull" type="mesh" mesh="brick" pos="0.1 0 0" quat="1 0.2 -0.3 0.1"/>
      <body name="a" pos="0.1 0.2 0.3" quat="0.5 0.1 -0.2 0.4">
        <joint name="a1"/><joint name="a2" class="far" ref="15"/>
        <joint name="a3" type="slide" axis="1 2 3" range="-0.1 0.2" ref="0.05"/>
        <geom type="capsule" fromto="0 0.1 0 0.2 0 -0.3" size="0.02"/>
        <frame pos="0 0.1 0" axisangle="0 1 1 33">
          <body name="b" pos="0.1 0 0" xyaxes="0 1 0.2 -1 0 0">
            <joint name="b1" class="far"/>
            <geom type="box" fromto="0.1 0.2 0 0.3 -0.1 0.1" size="0.03 0.05"/>
            <geom type="ellipsoid" size="0.1 0.05 0.02" zaxis="1 1 -1"/>
          </body>
        </frame>
      </body>
      <body name="c" zaxis="0 0 -1"><joint name="c1" range="-90 90"/>
        <geom type="cylinder" size="0.02 0.1"/>
        <body name="d" pos="0 0 0.1" euler="0 90 0">
          <joint name="d1" pos="0 0 -0.1"/><geom size="0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="d"/></contact>
  <equality><joint joint1="d1" joint2="c1" polycoef="0.1 -0.5"/></equality>
  <actuator><motor joint="c1"/><position joint="a1"/><motor joint="b1"/></actuator>
</mujoco>
"""
ASSETS = """<mujocoinclude><asset>
  <mesh name="brick" file="brick.stl" scale="0.1 0.2 0.3" refpos="0.1 0 0.2"
        refquat="0.9 0.1 0 0.2"/>
</asset></mujocoinclude>"""


def odd(folder, text=ODD, name="odd.xml"):
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    (folder / "more").mkdir(exist_ok=True)
    (folder / "parts" / "brick.stl").write_bytes(stl(BOX * [0.1, 0.2, 0.3]))
    (folder / "more" / "assets.xml").write_text(ASSETS)
    (folder / name).write_text(text)
    return folder / name


def test_every_body_stands_where_mujoco_has_it(tmp_path):
    path = odd(tmp_path)
    ours, theirs = reading.read(path).model, mujoco.MjModel.from_xml_path(str(path))
    state, data = mujoco.MjData(theirs), ours.createData()
    frames = {f.name: f for f in ours.frames if f.type == pin.FrameType.BODY}
    rng = np.random.default_rng(0)
    names = list(ours.names)[1:]
    assert sorted(names) == ["a1", "a2", "a3", "b1", "c1", "d1"]
    for _ in range(50):
        q = pin.neutral(ours)
        for name in names:
            joint = ours.joints[ours.getJointId(name)]
            angle = rng.uniform(-0.6, 1.0)
            state.qpos[theirs.joint(name).qposadr[0]] = angle
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            )
        mujoco.mj_kinematics(theirs, state)
        pin.framesForwardKinematics(ours, data, q)
        base = pin.SE3(state.body("base").xmat.reshape(3, 3), state.body("base").xpos)
        for name in ("a", "b", "c", "d"):
            want = base.actInv(pin.SE3(state.body(name).xmat.reshape(3, 3), state.body(name).xpos))
            got = data.oMi[frames[name].parentJoint] * frames[name].placement
            assert np.abs(got.homogeneous - want.homogeneous).max() < 1e-9, name


def test_every_geom_lies_where_mujoco_has_it(tmp_path):
    path = odd(tmp_path)
    found, model = reading.read(path), mujoco.MjModel.from_xml_path(str(path))
    state = mujoco.MjData(model)
    mujoco.mj_kinematics(model, state)
    at = 0
    for link in ("base", "a", "b", "c", "d"):
        body = pin.SE3(state.body(link).xmat.reshape(3, 3), state.body(link).xpos)
        for shape in found.shapes[link]:
            k = next(
                g for g in range(at, model.ngeom) if model.geom_bodyid[g] == model.body(link).id
            )
            at = k + 1
            geom = pin.SE3(state.geom_xmat[k].reshape(3, 3), state.geom_xpos[k])
            size, kind = model.geom_size[k], mujoco.mjtGeom(model.geom_type[k])
            inner = body.actInv(geom)
            if kind == mujoco.mjtGeom.mjGEOM_MESH:  # its own vertices, however MuJoCo moved them
                first = model.mesh_vertadr[model.geom_dataid[k]]
                many = model.mesh_vertnum[model.geom_dataid[k]]
                want = model.mesh_vert[first : first + many] @ inner.rotation.T + inner.translation
                got = np.unique(shape.triangles.reshape(-1, 3).round(5), axis=0)
                apart = np.linalg.norm(got[:, None] - want[None], axis=2)
                assert len(got) == 8 and apart.min(axis=1).max() < 2e-5 > apart.min(axis=0).max()
                continue
            assert np.allclose(shape.translation, inner.translation, atol=1e-9), shape
            if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
                corners = (
                    (shape.triangles.reshape(-1, 3) - inner.translation) @ inner.rotation / size
                )
                assert 1.0 <= np.linalg.norm(corners, axis=1).min() and np.abs(corners).max() < 1.1
                continue
            assert np.allclose(np.abs(shape.rotation[:, 2] @ inner.rotation[:, 2]), 1, atol=1e-9)
            twice = {"box": 2 * size, "sphere": size[:1]}.get(shape.kind, [size[0], 2 * size[1]])
            assert np.allclose(shape.sizes, twice, atol=1e-9)
            if shape.kind == "box":
                assert np.allclose(np.abs(shape.rotation.T @ inner.rotation), np.eye(3), atol=1e-9)


def test_limits_couplings_exclusions_and_order_are_the_file_s(tmp_path):
    found = reading.read(odd(tmp_path))
    limit = found.joint("a1").find("limit")
    assert float(limit.get("lower")) == pytest.approx(np.radians(-40))
    assert float(found.joint("a3").find("limit").get("upper")) == 0.2
    mimic = found.joint("d1").find("mimic")
    assert (mimic.get("joint"), float(mimic.get("multiplier"))) == ("c1", -0.5)
    assert float(mimic.get("offset")) == pytest.approx(0.1)
    assert found.order == ["a1", "b1", "c1"]  # that are driven, not as the actuators are listed
    assert found.apart == {frozenset(("base", "d")): "excluded by the MJCF"}
    assert "world" not in found.shapes and "crate" not in found.shapes
    assert any("crate" in note for note in found.notes)


# --- a whole robot

SIDE = """
<body name="{s}_upper0" pos="0 {y} 0.32">
 <joint name="{s}_shoulder_pitch" axis="0 1 0" range="-3 3"/>
 <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
 <body name="{s}_upper1"><joint name="{s}_shoulder_roll" axis="1 0 0" range="{r}"/>
  <geom class="hit" size="0.05"/>
  <body name="{s}_upper"><joint name="{s}_shoulder_yaw" axis="0 0 1" range="-1.5 1.5"/>
   <geom class="hit" type="capsule" fromto="0 0 -0.06 0 0 -0.22" size="0.04"/>
   <body name="{s}_fore" pos="0 0 -0.28"><joint name="{s}_elbow" axis="0 1 0" range="-2.3 0.1"/>
    <geom class="hit" type="capsule" fromto="0 0 -0.06 0 0 -0.2" size="0.035"/>
    <geom class="seen" type="box" size="0.02 0.02 0.02" pos="0 0 -0.13"/>
    <body name="{s}_hand" pos="0 0 -0.24">
     <joint name="{s}_wrist_pitch" axis="0 1 0" range="-1 1"/>
     <geom class="hit" size="0.05" pos="0 0 -0.05"/></body></body></body></body></body>"""
LEG = """<body name="{s}_leg" pos="0 {y} -0.1">
  <joint name="{s}_hip_pitch" range="-1 1" axis="0 1 0"/>
  <geom class="hit" type="capsule" fromto="0 0 -0.1 0 0 -0.4" size="0.05"/>
  <body name="{s}_shin" pos="0 0 -0.45"><joint name="{s}_knee" range="0 2" axis="0 1 0"/>
  <geom class="hit" type="capsule" fromto="0 0 -0.05 0 0 -0.4" size="0.04"/></body></body>"""


def human(
    torso='<geom class="hit" type="box" size="0.07 0.11 0.15" pos="0 0 0.15"/>', more=""
) -> str:
    arms = SIDE.format(s="right", y=-0.17, r="-3 0.2") + SIDE.format(s="left", y=0.17, r="-0.2 3")
    legs = LEG.format(s="right", y=-0.08) + LEG.format(s="left", y=0.08)
    driven = "".join(
        f'<motor joint="{side}_{part}"/>' for side in ("right", "left")
        for part in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
    )  # fmt: skip
    return f"""<mujoco model="human"><compiler angle="radian"/>
    <default><default class="hit"><geom group="3"/></default>
    <default class="seen"><geom contype="0" conaffinity="0" group="2"/></default></default>
    <worldbody><geom type="plane" size="3 3 1"/><body name="pelvis" pos="0 0 1"><freejoint/>
    <geom class="hit" type="box" size="0.07 0.1 0.06"/>{legs}
    <body name="torso" pos="0 0 0.1"><joint name="waist_yaw" axis="0 0 1" range="-1 1"/>{torso}
    {arms}</body></body></worldbody>
    <contact><exclude body1="left_hand" body2="left_leg"/></contact>
    <actuator><motor joint="waist_yaw"/>{driven}</actuator>{more}</mujoco>"""


def new(folder, text, **options) -> tuple[propose.Proposal, Robot]:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "human.xml").write_text(text)
    made = propose.propose(folder / "human.xml", "human", MARGIN, "midpoint", **options)
    propose.write(made, folder / "robots", force=True)
    return made, Robot.from_file(folder / "robots" / "human.yaml", MARGIN, "midpoint")


def test_an_mjcf_becomes_a_robot_whose_joints_stand_in_mujoco_s_order(tmp_path):
    made, robot = new(tmp_path, human())
    model = mujoco.MjModel.from_xml_string(human())
    theirs = [model.joint(k).name for k in range(model.njnt)]
    found = whole.joints(robot)
    assert [joint.name for joint in found.joints] == theirs[1:] == list(found.depth_first)
    assert list(robot.description.joints) == [j for j in theirs if j in robot.joint_names]
    assert len(robot.joint_names) == 9
    assert set(robot.description.points) == {
        "hip", "neck", "r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand"
    }  # fmt: skip
    reasons = {p.reason for p in robot.pairs if p.reason.startswith(pairs.DISABLED)}
    assert reasons == {f"{pairs.DISABLED} (excluded by the MJCF)"}
    assert any("MJCF's <exclude>: 1 pairs" in line for line in made.sure)
    record = covered.read(robot)
    assert sorted(item.link for item in record.links) == ["left_fore", "right_fore"]
    assert record.beyond == () and "world" not in {b.link for b in robot.bodies}


def test_what_is_drawn_beyond_the_colliding_geoms_gets_bodies(tmp_path):
    thin = '<geom class="hit" size="0.05" pos="0 0 0.15"/>'
    wide = '<geom class="seen" type="box" size="0.15 0.1 0.15" pos="0 0 0.15"/>'
    made, robot = new(tmp_path, human(thin + wide))
    assert any("'torso': drawn up to" in line for line in made.look)
    assert covered.read(robot).beyond == ()
    hidden = wide.replace("/>", ' group="4"/>')
    assert not any("'torso'" in line for line in new(tmp_path, human(thin + hidden))[0].look)


def test_a_joint_without_a_range_is_asked_about_and_one_that_nothing_drives_is_held(tmp_path):
    text = human().replace('axis="0 0 1" range="-1.5 1.5"', 'axis="0 0 1"')
    made, robot = new(tmp_path, text.replace('<motor joint="waist_yaw"/>', ""))
    assert any("'left_shoulder_yaw' is continuous" in line for line in made.look)
    assert any("no actuator drives them: waist_yaw" in line for line in made.look)
    assert "waist_yaw" not in robot.joint_names
    free = human().replace("<actuator>", "<extension>").replace("</actuator>", "</extension>")
    free = free.replace("<motor", "<plugin")
    (tmp_path / "free.xml").write_text(free)
    assert len(reading.read(tmp_path / "free.xml").order) == 15  # all, where none is driven


def test_meshes_of_a_class_s_scale_and_without_a_name_are_found(tmp_path):
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "trunk.obj").write_bytes(obj(BOX * [70.0, 110.0, 150.0] / 1e2))
    torso = '<geom class="hit" type="mesh" mesh="trunk" pos="0 0 0.15"/>'
    more = '<asset><mesh class="mm" file="trunk.obj"/></asset><compiler meshdir="m"/>'
    more += '<default><default class="mm"><mesh scale="0.1 0.1 0.1"/></default></default>'
    _, robot = new(tmp_path, human(torso, more))
    found = reading.read(tmp_path / "human.xml").shapes["torso"][0]
    assert np.ptp(found.triangles.reshape(-1, 3), axis=0) == pytest.approx([0.14, 0.22, 0.3])
    assert any(body.link == "torso" for body in robot.bodies)


REFUSED = {
    "not XML": ("<mujoco><worldbody>", "a.xml: not well-formed XML .*line 1"),
    "doctype": ("<mujoco><!DOCTYPE a></mujoco>", "DOCTYPE"),
    "no robot": ("<mujoco><worldbody><body/></worldbody></mujoco>", "no body .* has a joint"),
    "no world": ("<mujoco/>", "no body of the world has a joint"),
    "class": ("@<joint class='x'/>", "body 'b': a joint is of class 'x', which no"),
    "number": ("@<joint axis='0 0 up'/>", "joint 'b_joint': axis must be 3 numbers, got '0 0 up'"),
    "axis": ("@<joint axis='0 0 0'/>", "joint 'b_joint': axis has no direction"),
    "range": ("@<joint range='2 1'/>", "range must rise, got 2 and 1"),
    "no range": ("@<joint limited='true'/>", "joint 'b_joint' needs range"),
    "type": ("@<joint type='screw'/>", "body 'b': a joint of type 'screw'"),
    "name twice": ("@<joint name='j'/><joint name='j'/>", "two joints are called 'j'"),
    "size": ("@<joint/><geom type='box' size='1 1'/>", "geom '0': size must be 3 numbers"),
    "flat": ("@<joint/><geom size='-1'/>", "a sphere of size -1; sizes are in metres"),
    "geom": ("@<joint/><geom type='sdf' size='1'/>", "is of type 'sdf', which is not read"),
    "mesh": ("@<joint/><geom type='mesh' mesh='m'/>", "of the mesh 'm', which no <asset> names"),
    "replicate": ("@<joint/><replicate count='3'/>", "<replicate> is not read.*mj_saveLastXML"),
    "turned twice": ("<mujoco><worldbody><body quat='1 0 0 0' euler='0 0 0'><joint/></body>"
                     "</worldbody></mujoco>", "has both quat and euler"),
    "include": ("<mujoco><include file='no.xml'/></mujoco>", "no.xml does not exist"),
    "includes itself": ("<mujoco><include file='a.xml'/></mujoco>", "includes itself"),
    "angle": ("<mujoco><compiler angle='grad'/></mujoco>", "angle of <compiler> must be"),
    "order": ("<mujoco><compiler eulerseq='xy'/></mujoco>", "eulerseq of <compiler> must be"),
    "follows nothing": ("<mujoco><worldbody><body name='b'><joint name='j'/></body></worldbody>"
                        "<equality><joint joint1='j' joint2='k'/></equality></mujoco>",
                        "<equality> of 'j' names 'k'"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "want"), REFUSED.values(), ids=REFUSED)
def test_a_file_that_is_none_is_told_where_in_a_line(tmp_path, text, want):
    if text.startswith("@"):
        text = f"<mujoco><worldbody><body name='b'>{text[1:]}</body></worldbody></mujoco>"
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(RobotError, match=want) as refusal:
        reading.read(tmp_path / "a.xml")
    assert "\n" not in str(refusal.value) and "a.xml" in str(refusal.value)


def test_a_mesh_that_is_missing_is_named_with_its_place(tmp_path):
    path = odd(tmp_path)
    (tmp_path / "parts" / "brick.stl").unlink()
    with pytest.raises(RobotError, match="mesh 'brick' wants .*parts/brick.stl, which does not"):
        reading.read(path)


def test_what_a_file_is_written_in_is_seen_from_its_text_not_its_name(tmp_path):
    assert mjcf.is_mjcf(b'<?xml version="1.0"?>\n<!-- <robot> -->\n<mujoco model="a">')
    assert not mjcf.is_mjcf(b"<robot name='mujoco'><!-- <mujoco> --></robot>")
    text = ElementTree.tostring(ElementTree.fromstring(human())).decode()
    (tmp_path / "odd.urdf").write_text(text)
    assert reading.read(tmp_path / "odd.urdf").order is not None
