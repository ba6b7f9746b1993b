"""What is drawn of a robot is held by its bodies, or said to be missing wherever it matters."""

import json
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from figures import BOX, drawn, figure, joint, stripped, write
from typer.testing import CliRunner
from worlds import MARGIN

from s3le.cli import shell
from s3le.cli.main import app
from s3le.errors import RobotError
from s3le.onboard import covering, propose, source, survey
from s3le.robot.robot import Robot
from s3le.safety import covered
from s3le.safety.audit import audit, certificate, demands

CASES = Path(__file__).parents[2] / "shared" / "cases"
TORSO, SIDES = "waist_pitch_link", np.array([0.3, 0.36, 0.3])
WIDE = '<box size="0.3 0.36 0.3"/>'
THIN = drawn(figure(torso='<sphere radius="0.05"/>'), TORSO, WIDE, "0 0 0.15")
CORNERS = BOX * SIDES / 2 + [0, 0, 0.15]
REACH = np.linalg.norm(SIDES / 2) - 0.05  # [m], of a corner beyond the sphere
SHARE = 1.0 - 4.0 / 3.0 * np.pi * 0.05**3 / SIDES.prod()


def made(folder, text, **options) -> tuple[propose.Proposal, Robot]:
    found = propose.propose(write(folder, text), "figure", MARGIN, "midpoint", **options)
    propose.write(found, folder / "robots", force=True)
    return found, Robot.from_file(folder / "robots" / "figure.yaml", MARGIN, "midpoint")


def of(robot: Robot, link: str) -> covered.Drawn:
    record = covered.read(robot)
    assert record is not None
    return next(item for item in record.links if item.link == link)


def beyond(points, robot, link) -> np.ndarray:
    """How far points of a link lie outside its bodies [m]; written anew, it judges."""
    far = []
    for body in (b for b in robot.bodies if b.link == link):
        d = body.b - body.a
        t = np.clip((points - body.a) @ d / max(d @ d, 1e-300), 0, 1)
        far.append(np.linalg.norm(points - body.a - t[:, None] * d, axis=1) - body.radius)
    return np.min(far, axis=0)


def still(robot: Robot):
    """Ten rows at the anchor, audited."""
    q = np.repeat(robot.anchor[None], 10, axis=0)
    wanted = demands(robot)
    return certificate(robot, wanted, audit(robot, np.arange(10) / 10, q, wanted))


# --- what `robot new` makes of it


def test_a_torso_that_its_bodies_barely_cover_gets_bodies_around_what_is_drawn(tmp_path):
    proposal, robot = made(tmp_path, THIN)
    assert beyond(CORNERS, robot, TORSO).max() <= 1e-9
    assert of(robot, TORSO) == (TORSO, 0.0, 0.0)
    told = [line for line in proposal.look if line.startswith(f"link '{TORSO}'")]
    assert len(told) == 1 and f"drawn up to {REACH * 1e3:.0f} mm beyond the bodies" in told[0]
    assert re.search(r"\(9[89]% outside\)", told[0]) and "\n" not in told[0]
    assert covered.warning(robot) is None and still(robot)["not_covered_links"] == []


def test_with_collision_only_the_bodies_stay_and_every_certificate_names_the_link(tmp_path):
    proposal, robot = made(tmp_path, THIN, collision_only=True)
    body = [b for b in robot.bodies if b.link == TORSO]
    assert [b.radius for b in body] == [0.05]
    found = of(robot, TORSO)
    assert found.reach == pytest.approx(REACH, abs=1e-6)
    assert found.share == pytest.approx(SHARE, abs=0.01)
    assert sum(TORSO in line for line in proposal.look) == 1
    assert f"{TORSO} ({REACH * 1e3:.0f} mm" in covered.warning(robot)
    said = still(robot)
    assert said["holds"]
    assert [item["link"] for item in said["not_covered_links"]] == [TORSO]
    assert said["not_covered_links"][0]["reach_m"] == pytest.approx(REACH, abs=1e-6)


def test_what_reaches_no_farther_than_is_allowed_is_left(tmp_path):
    proposal, robot = made(tmp_path, THIN, allowance=REACH + 1e-3)
    assert [b.radius for b in robot.bodies if b.link == TORSO] == [0.05]
    assert of(robot, TORSO).reach == pytest.approx(REACH, abs=1e-6)
    assert covered.warning(robot) is None
    assert not any("drawn up to" in line for line in proposal.look)


def test_a_flat_face_between_covered_corners_is_seen(tmp_path):
    """A ball at each corner covers every vertex of a box and hardly any of the box."""
    text = stripped(THIN, TORSO)
    spheres = tmp_path / "spheres.yaml"
    rows = ", ".join(f"{{center: {list(map(float, c))}, radius: 0.02}}" for c in CORNERS)
    spheres.write_text(f"{TORSO}: [{rows}]")
    _, robot = made(tmp_path, text, spheres=spheres)
    found = of(robot, TORSO)
    middle = np.linalg.norm([0.15, 0.18, 0.0]) - 0.02  # [m], of the largest face's middle
    assert found.reach == pytest.approx(middle, abs=0.01) and found.share > 0.99


def test_pieces_of_its_own_that_reach_beyond_what_is_drawn_stay(tmp_path):
    text = drawn(figure(torso='<sphere radius="0.05"/>'), TORSO, WIDE, "0 0 0.15")
    mast = (
        '<collision><origin xyz="0 0 0.6"/><geometry><sphere radius="0.02"/></geometry></collision>'
    )
    _, robot = made(
        tmp_path, text.replace(f'<link name="{TORSO}">', f'<link name="{TORSO}">{mast}')
    )
    own = [b for b in robot.bodies if b.link == TORSO]
    assert any(b.radius == 0.02 for b in own) and not any(b.radius == 0.05 for b in own)


def test_what_a_link_fixed_to_another_covers_of_it_counts(tmp_path):
    badge = (
        '<link name="badge"><visual><geometry><sphere radius="0.01"/></geometry></visual></link>'
    )
    spot = joint("b", TORSO, "badge", "0 0 0.15", kind="fixed")
    _, robot = made(tmp_path, figure(extra=badge + spot))
    assert of(robot, "badge").reach == 0.0


def test_links_that_are_only_drawn_get_bodies_and_with_collision_only_are_refused(tmp_path):
    links = [f"left_{part}" for part in ("sr", "upper", "fore", "palm")]
    text = stripped(figure(), *links)
    for link in links:
        text = drawn(text, link, '<box size="0.06 0.06 0.1"/>')
    proposal, robot = made(tmp_path, text)
    for link in links[:3]:  # the palm hangs on a joint that is held, in whose frame it is not
        assert beyond(BOX * [0.03, 0.03, 0.05], robot, link).max() <= 1e-9
        assert any(f"'{link}': its visual shapes" in line for line in proposal.look)
    with pytest.raises(RobotError, match="4 links are drawn but have no collision.*left_sr") as no:
        made(tmp_path, text, collision_only=True)
    assert "\n" not in str(no.value)


@pytest.mark.parametrize(
    ("links", "part"),
    [
        (("right_sr", "right_upper"), "right upper arm"),
        (("left_fore", "left_palm"), "left forearm"),
    ],
)
def test_a_part_of_an_arm_without_bodies_and_drawing_is_refused(tmp_path, links, part):
    with pytest.raises(RobotError, match=f"the {part} has neither") as no:
        made(tmp_path, stripped(figure(), *links))
    assert "\n" not in str(no.value)


def test_a_drawing_that_cannot_be_read_is_refused_or_said_to_be_unknown(tmp_path):
    text = drawn(figure(), TORSO, '<mesh filename="package://no/torso.stl"/>')
    with pytest.raises(RobotError, match="--package-path.*--collision-only does without") as no:
        made(tmp_path, text)
    assert "\n" not in str(no.value)
    _, robot = made(tmp_path, text, collision_only=True)
    assert np.isnan(of(robot, TORSO).reach)
    assert f"{TORSO} (not measured)" in covered.warning(robot)
    assert still(robot)["not_covered_links"] == [
        {"link": TORSO, "reach_m": None, "share_outside": None}
    ]


# --- the record


def test_the_record_goes_where_the_robot_goes(tmp_path):
    _, robot = made(tmp_path, THIN, collision_only=True)
    robot.write(tmp_path / "robot")
    for other in (Robot.read(tmp_path / "robot"), Robot.from_bytes(robot.to_bytes())):
        assert covered.read(other) == covered.read(robot)
    again, _ = made(tmp_path / "again", (tmp_path / "robot" / "figure.urdf").read_text())
    assert again.files["urdf/figure.urdf"].count(b"<covered") == len(covered.read(robot).links) + 1


def test_a_record_of_other_bodies_or_none_is_no_record(tmp_path):
    _, robot = made(tmp_path, THIN, collision_only=True)
    file = tmp_path / "robots" / "urdf" / "figure.urdf"
    text = file.read_text()
    for other in (text.replace('radius="0.05"', 'radius="0.049"'), re.sub("<covered .*", "", text)):
        assert other != text
        file.write_text(other)
        it = Robot.from_file(tmp_path / "robots" / "figure.yaml", MARGIN, "midpoint")
        assert covered.read(it) is None and "never held against" in covered.warning(it)
        assert still(it)["not_covered_links"] is None
        assert "not measured" in "\n".join(survey.lines(it, survey.survey(it, 20), False))


@pytest.mark.parametrize("word", ["nan", "-1", "x", ""])
def test_a_damaged_record_is_refused_in_a_line(tmp_path, word):
    made(tmp_path, THIN, collision_only=True)
    file = tmp_path / "robots" / "urdf" / "figure.urdf"
    file.write_text(re.sub('reach="[^"]*"', f'reach="{word}"', file.read_text(), count=1))
    it = Robot.from_file(tmp_path / "robots" / "figure.yaml", MARGIN, "midpoint")
    with pytest.raises(RobotError, match="figure.urdf: reach of a <covered>"):
        covered.read(it)


def test_the_record_changes_nothing_that_a_robot_computes(tmp_path):
    _, robot = made(tmp_path, THIN)
    file = tmp_path / "robots" / "urdf" / "figure.urdf"
    file.write_text(re.sub("<covered .*", "", file.read_text()))
    assert Robot.from_file(tmp_path / "robots" / "figure.yaml", MARGIN, "midpoint").tag == robot.tag


@pytest.mark.parametrize("name", ["coman", "coman_authors"])
def test_robots_of_the_package_are_measured(name):
    record = covered.read(Robot.load(name))
    assert record is not None and record.beyond == () and len(record.links) >= 32
    assert covered.warning(Robot.load(name)) is None


def test_check_prints_the_table(tmp_path):
    _, robot = made(tmp_path, THIN, collision_only=True)
    told = "\n".join(survey.lines(robot, survey.survey(robot, 20), False))
    assert re.search(rf"{TORSO} +1 +{REACH * 1e3:.1f} +98\.\d%", told)
    assert re.search(r"left_fore +1 not drawn", told)


# --- commands


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_audit_warns_in_a_line_on_stderr_and_names_the_links_in_json(tmp_path):
    _, robot = made(tmp_path, THIN, collision_only=True)
    rows = np.column_stack([np.arange(5) / 10, np.repeat(robot.anchor[None], 5, axis=0)])
    names = ",".join(["time", *robot.joint_names])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=names, comments="")
    file = tmp_path / "robots" / "figure.yaml"
    said = run("audit", tmp_path / "a.csv", "--robot", file, "--json")
    assert said.exit_code == shell.OK, said.output
    assert said.stderr.count("\n") == 1 and said.stderr.startswith("warning: robot figure: drawn")
    told = json.loads(said.stdout)["not_covered_links"]
    assert [item["link"] for item in told] == [TORSO]
    text = tmp_path / "robots" / "urdf" / "figure.urdf"
    text.write_text(re.sub("<covered .*", "", text.read_text()))
    said = run("audit", tmp_path / "a.csv", "--robot", file, "--json")
    assert "never held against" in said.stderr and said.stderr.count("\n") == 1
    assert json.loads(said.stdout)["not_covered_links"] is None


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not here")
def test_the_shared_cases_come_out_right(tmp_path):
    thin = CASES / "robot_torso_barely_covered"
    assert run("robot", "new", thin / "thin.urdf", "--out", tmp_path).exit_code == shell.OK
    said = run("audit", thin / "hand_in_chest.csv", "--robot", tmp_path / "thin.yaml")
    assert said.exit_code == shell.BROKEN and "torso_link" in said.output
    options = ("--collision-only", "--out", tmp_path / "old")
    assert run("robot", "new", thin / "thin.urdf", *options).exit_code == shell.OK
    said = run("audit", thin / "hand_in_chest.csv", "--robot", tmp_path / "old" / "thin.yaml")
    assert re.search(r"warning: .*torso_link \(4\d\d mm", said.stderr)
    bare = CASES / "robot_arms_without_bodies" / "bare.urdf"
    said = run("robot", "new", bare, "--out", tmp_path)
    assert said.exit_code == shell.OK and "'trunk': its visual shapes" in said.output
    robot = Robot.load(tmp_path / "bare.yaml")
    trunk = BOX * [0.1, 0.15, 0.3]
    assert beyond(trunk, robot, "trunk").max() <= 1e-9
    assert survey.survey(robot, 400).colliding > 0.05
    said = run("robot", "new", bare, "--collision-only", "--out", tmp_path / "no")
    assert said.exit_code == shell.UNREADABLE and not (tmp_path / "no").exists()
    assert "15 links are drawn" in said.stderr and said.stderr.count("\n") == 1


# --- geometry


def test_reach_and_share_of_shapes_whose_answer_is_known():
    """A ball in a ball, a rod beside a ball, a plate without volume."""
    ball = source.Shape("sphere", np.eye(3), np.zeros(3), (0.1,), np.empty((0, 3, 3)))
    inner = [(np.zeros(3), np.zeros(3), 0.06)]
    points = covering.surface(ball)
    assert covering.outside(points, inner).max() == pytest.approx(0.04, abs=1e-12)
    assert covering.outside(points, [(np.zeros(3), np.zeros(3), 0.1)]).max() == 0.0
    found = covering._one("a", [ball], source.pin.SE3.Identity(), inner)
    assert found.share == pytest.approx(1.0 - 0.6**3, abs=0.03)
    rod = source.Shape(
        "capsule", np.eye(3), np.array([0, 0, 0.5]), (0.02, 1.0), np.empty((0, 3, 3))
    )
    assert covering.outside(covering.surface(rod), inner).max() == pytest.approx(0.96, abs=1e-3)
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)
    plate = source.Shape("mesh", np.eye(3), np.zeros(3), (), flat)
    found = covering._one("a", [plate], source.pin.SE3.Identity(), inner)
    assert found.reach == pytest.approx(0.94) and 0.9 < found.share < 1.0


# --- xacro

XACRO = (
    figure()
    .replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    .replace('<box size="0.14 0.2 0.12"/>', '<box size="${2 * 0.07} 0.2 0.12"/>')
)


def test_xacro_is_expanded_where_the_package_is_installed(tmp_path):
    pytest.importorskip("xacro")
    (tmp_path / "a.urdf.xacro").write_text(XACRO)
    plain = source.read(write(tmp_path, figure()))
    assert source.read(tmp_path / "a.urdf.xacro").shapes["pelvis"][0].sizes == (0.14, 0.2, 0.12)
    assert set(source.read(tmp_path / "a.urdf.xacro").shapes) == set(plain.shapes)


def test_what_xacro_gives_is_read_and_what_it_refuses_is_told(tmp_path, monkeypatch):
    file = tmp_path / "a.urdf.xacro"
    file.write_text("whatever")
    given = types.SimpleNamespace(toprettyxml=lambda indent: figure())
    stub = types.SimpleNamespace(process_file=lambda path: given)
    monkeypatch.setitem(sys.modules, "xacro", stub)
    assert "pelvis" in source.read(file).shapes

    def refuse(path):
        raise ValueError("undefined\nname")

    stub.process_file = refuse
    with pytest.raises(
        RobotError, match=r"a.urdf.xacro: xacro cannot .*ValueError: undefined name"
    ):
        source.read(file)


def test_without_the_package_xacro_is_refused_with_a_way_out(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    (tmp_path / "a.xacro").write_text(XACRO)
    arm = '<xacro:arm xmlns:xacro="http://www.ros.org/wiki/xacro"/>'
    for file in (tmp_path / "a.xacro", write(tmp_path, figure(extra=arm))):
        with pytest.raises(RobotError, match="pip install xacro.*xacro .* > my.urdf") as no:
            source.read(file)
        assert "\n" not in str(no.value)
