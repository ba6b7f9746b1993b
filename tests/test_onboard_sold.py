"""Robots as they are sold go from their URDF to an answer."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from figures import figure, write
from onboarded import through
from typer.testing import CliRunner
from worlds import MARGIN

from s3le.cli.main import app
from s3le.motion import whole
from s3le.onboard import propose, survey
from s3le.robot.robot import Robot

PACKAGES = {
    "jvrc": ("jvrc_description", "urdf/jvrc1.urdf"),
    "g1": ("example-robot-data", "g1_description/urdf/g1_29dof_rev_1_0.urdf"),
    "talos": ("example-robot-data", "talos_data/robots/talos_reduced.urdf"),
    "romeo": ("example-robot-data", "romeo_description/urdf/romeo.urdf"),
}
POINTS = {  # hip, shoulder, elbow, hand of the left side, and the waist
    "jvrc": ("PELVIS_S", "L_SHOULDER_R", "L_ELBOW_P", "L_WRIST_R", 3),
    "g1": ("pelvis", "left_shoulder_roll_joint", "left_elbow_joint", "left_wrist_pitch_joint", 3),
    "talos": ("base_link", "arm_left_3_joint", "arm_left_4_joint", "arm_left_6_joint", 2),
    "romeo": ("body", "LShoulderYaw", "LElbowYaw", "LWristYaw", 1),
}


def urdf_of(robot: str) -> Path:
    package, file = PACKAGES[robot]
    if package == "jvrc_description":
        home = Path(pytest.importorskip("jvrc_description").__file__).parent
    else:
        roots = [Path(p) / "cmeel.prefix/share/example-robot-data/robots" for p in sys.path]
        home = next((root for root in roots if root.is_dir()), None)
        if home is None:
            pytest.skip("example-robot-data is not installed (pip install .[robots])")
    return home / file


@pytest.fixture(scope="module")
def sold(tmp_path_factory):
    """Robots of packages, proposed once."""
    made = {}

    def get(robot: str) -> tuple[propose.Proposal, Robot]:
        if robot not in made:
            folder = tmp_path_factory.mktemp(robot)
            urdf = urdf_of(robot)
            found = propose.propose(urdf, robot, MARGIN, "midpoint", with_hulls=robot == "jvrc")
            propose.write(found, folder, force=False)
            made[robot] = found, Robot.from_file(folder / f"{robot}.yaml", MARGIN, "midpoint")
        return made[robot]

    return get


@pytest.mark.parametrize("robot", PACKAGES)
def test_a_robot_of_a_package_goes_from_its_urdf_to_an_answer(sold, robot):
    found, made = sold(robot)
    hip, shoulder, elbow, hand, waist = POINTS[robot]
    places = made.description.points
    named = [places[role].frame for role in ("hip", "l_shoulder", "l_elbow", "l_hand")]
    assert named == [hip, shoulder, elbow, hand]
    assert made.n_dof == waist + 8
    assert made.base_rotation == pytest.approx(np.eye(3), abs=1e-9)
    through(made, 20)


@pytest.mark.parametrize("robot", PACKAGES)
def test_a_whole_robots_file_has_the_joints_of_the_urdf_that_was_read(sold, robot):
    _, made = sold(robot)
    tree = ElementTree.parse(urdf_of(robot)).getroot()
    items = tree.findall("joint")
    moves = [item for item in items if item.get("type") != "fixed"]
    mimics = [item.get("name") for item in moves if item.find("mimic") is not None]
    found = whole.joints(made)
    names = [item.get("name") for item in moves if item.get("name") not in mimics]
    assert [joint.name for joint in found.joints] == names
    assert list(found.mimics) == mimics
    for part in tree.findall("link"):  # MuJoCo's numbers of the joints, without any mesh
        for shape in [*part.findall("visual"), *part.findall("collision")]:
            part.remove(shape)
    extra = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(extra, "compiler", boundmass="1", boundinertia="1")
    it = mujoco.MjModel.from_xml_string(ElementTree.tostring(tree, encoding="unicode"))
    numbered = [it.joint(i).name for i in range(it.njnt)]
    assert list(found.depth_first) == [name for name in numbered if name in names]
    still = sum(joint.moved < 0 for joint in found.joints)
    assert still == len(names) - made.n_dof > 10


@pytest.mark.parametrize("robot", ["jvrc"])
def test_every_vertex_of_every_mesh_lies_in_a_capsule_of_its_link(sold, robot):
    _, made = sold(robot)
    urdf = str(urdf_of(robot))
    model = pinocchio.buildModelFromUrdf(urdf)
    geometry = pinocchio.buildGeomFromUrdf(  # pinocchio's own reading of URDF and meshes
        model,
        urdf,
        pinocchio.GeometryType.COLLISION,
        package_dirs=[str(urdf_of(robot).parents[2])],
    )
    seen = 0
    full = pinocchio.buildModelFromUrdf(str(made.description.urdf))
    mine = pinocchio.buildGeomFromUrdf(
        full, str(made.description.urdf), pinocchio.GeometryType.COLLISION
    )
    for item in geometry.geometryObjects:
        link = model.frames[item.parentFrame].name
        at = model.frames[item.parentFrame].placement.actInv(item.placement)
        vertices = np.array(item.geometry.vertices()) @ at.rotation.T + at.translation
        outside = np.full(len(vertices), np.inf)
        for body in mine.geometryObjects:
            if full.frames[body.parentFrame].name == link:
                own = full.frames[body.parentFrame].placement.actInv(body.placement)
                along = own.rotation[:, 2] * getattr(body.geometry, "halfLength", 0.0)
                rel = vertices - (own.translation - along)
                t = np.clip(rel @ along / max(2 * along @ along, 1e-300), 0, 1)
                far = np.linalg.norm(rel - 2 * t[:, None] * along, axis=1) - body.geometry.radius
                outside = np.minimum(outside, far)
        assert outside.max() <= 1e-9, link  # [m]
        seen += len(vertices)
    assert seen > 4000


def test_the_survey_of_a_real_robot_says_what_its_capsules_add_and_its_hulls_find(sold):
    found, made = sold("jvrc")
    assert all(body.grown >= 1.0 and body.adds > 0.0 for body in found.made)
    told = "\n".join(survey.lines(made, survey.survey(made, 300), False))
    for words in ("11 joints", "7 of 7 are followed", "in collision", "by kernels", "by coal",
                  "hulls of the meshes at"):  # fmt: skip
        assert words in told


def test_the_command_line_proposes_draws_checks_and_refuses(tmp_path):
    urdf = write(tmp_path, figure())
    run = CliRunner().invoke
    words = ["robot", "new", str(urdf), "--name", "fig", "--out", str(tmp_path / "robots")]
    done = run(app, words)
    assert done.exit_code == 0, done.output
    assert "sure: waist:" in done.output and "--robot" in done.output
    assert (tmp_path / "robots" / "fig.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert sorted(p.name for p in (tmp_path / "robots").rglob("*.*")) == [
        "fig.png", "fig.urdf", "fig.yaml",
    ]  # fmt: skip
    again = run(app, words)
    assert again.exit_code == 2 and "fig.urdf exists; give another --name" in again.output
    file = tmp_path / "robots" / "fig.yaml"
    checked = run(app, ["robot", "check", str(file), "--poses", "50"])
    assert checked.exit_code == 0 and "left_elbow" in checked.output
    file.write_text(file.read_text().replace("urdf/fig.urdf", "urdf/no.urdf"))
    broken = run(app, ["robot", "check", str(file)])
    assert broken.exit_code == 2 and "does not exist below" in broken.output
