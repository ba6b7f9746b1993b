"""Robots that come with the package: their records hold, and their makers' own drawings agree."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_onboard_sold import urdf_of
from typer.testing import CliRunner

from s3le.cli import listed, shell
from s3le.cli.main import app
from s3le.errors import RobotError
from s3le.guard.guard import Guard
from s3le.robot import known
from s3le.robot.robot import Robot

ROOT = Path(__file__).parents[1]
NAMES = ("hulls", "sources", "table", "proposals")
FREE = {"BSD-3-Clause", "Apache-2.0", "CC-BY-SA-4.0"}  # NC and ND are not: docs/robots.md
DRAWN = {"jvrc1": "jvrc", "g1": "g1", "talos": "talos"}  # robot of the package -> of a package
STEPS = 40


@pytest.fixture(scope="module")
def rooms():
    """The modules of benchmarks/robots."""
    pytest.importorskip("mujoco")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks/robots"))
        yield SimpleNamespace(**{name: __import__(name) for name in NAMES})
    for name in NAMES:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def record():
    return json.loads((known.READY / listed.RECORD).read_text(encoding="utf-8"))


def ready():
    return sorted(file.stem for file in known.READY.glob("*.yaml"))


def test_the_list_has_a_record_of_every_robot_and_of_no_other(record):
    assert sorted(record) == ready() and len(ready()) >= 12


@pytest.mark.parametrize("name", ready())
def test_what_the_list_says_of_a_robot_is_what_its_files_say(record, name):
    file = known.READY / f"{name}.yaml"
    robot = Robot.load(name)
    assert record[name] == {"files": listed.fingerprint(file)} | listed.about(robot)
    assert robot.name == name and "/" not in robot.description.urdf_name.removeprefix("urdf/")
    made = known.origin(file)
    assert made["licence"] in FREE and made["maker"] and made["source"]


def test_the_list_is_read_and_not_worked_out_and_a_changed_file_is(monkeypatch, tmp_path, record):
    asked = []
    monkeypatch.setattr(shell, "robot", lambda given: asked.append(given) or Robot.load(given))
    told = listed.rows()
    assert asked == [] and [row["name"] for row in told] == ready()
    for name in ("urdf", "g1.yaml"):
        (tmp_path / name).symlink_to(known.READY / name)
    for name in (known.ORIGIN, listed.RECORD):
        (tmp_path / name).write_bytes((known.READY / name).read_bytes())
    monkeypatch.setattr(known, "READY", tmp_path)
    (tmp_path / "g1.yaml").unlink()
    text = (ROOT / "s3le/robots/g1.yaml").read_text(encoding="utf-8")
    for of in ("joints: [", "acceleration: {"):
        text = re.sub(f"^{re.escape(of)}waist_yaw_joint[^,]*, ", of, text, flags=re.M)
    (tmp_path / "g1.yaml").write_text(text)
    (row,) = listed.rows()
    assert asked == [str(tmp_path / "g1.yaml")]
    assert len(row["joints"]) == len(record["g1"]["joints"]) - 1


def test_the_table_names_makers_licences_and_what_no_certificate_speaks_of(record):
    short, said = (CliRunner().invoke(app, ["robot", "list", *more]) for more in ([], ["--pairs"]))
    assert short.exit_code == said.exit_code == shell.OK, said.output
    assert len(short.output.splitlines()) == len(ready()) + 5 and "LShy" not in short.output
    lines = said.output.splitlines()
    for name in ready():
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        its = record[name]
        assert row.split()[1:6] == [
            str(n) for n in (len(its["joints"]), len(its["bones"]), its["bodies"],
                             its["pairs_watched"], len(its["not_covered"]))
        ]  # fmt: skip
        assert known.origin(known.READY / f"{name}.yaml")["licence"] in row
        assert any(line.startswith(f"  {name}: ") for line in lines)
    assert "LShy and LElb" in said.output and max(map(len, lines)) <= 130


def test_recipes_name_every_robot_of_the_package_and_what_it_is_from(rooms):
    made = {recipe.name: recipe for recipe in rooms.sources.recipes()}
    assert set(made) == set(ready()) - {"coman_authors", "coman_covered"}
    for name, recipe in made.items():
        origin = known.origin(known.READY / f"{name}.yaml")
        assert origin["licence"] == recipe.licence and origin["maker"] == recipe.maker
        if recipe.made and name != "g1":
            assert recipe.file.partition("/")[2] in origin["source"] and len(origin["sha256"]) == 64


def test_a_source_that_is_missing_is_named_with_what_gets_it(rooms, tmp_path):
    (recipe,) = rooms.sources.recipes(["t1"])
    with pytest.raises(RobotError, match="git clone .*booster_assets, checkout 486da0f"):
        rooms.sources.located(recipe, tmp_path)


# --- the makers' own drawings


@pytest.fixture(scope="module", params=DRAWN)
def drawn(request, rooms):
    """A robot of the package, and the hulls of what its maker drew."""
    urdf = urdf_of(DRAWN[request.param])
    above = tuple(map(str, urdf.parents[:5]))
    recipe = rooms.sources.Recipe(request.param, urdf.name, packages=above)
    return rooms.hulls.Hulls(Robot.load(request.param), rooms.sources.drawn(recipe, urdf.parent))


def wild(robot, seed=0):
    """A guarded motion towards anything, the impossible included: rows and their speeds."""
    guard = Guard(robot)
    guard.start(robot.anchor)
    rng, q, v = np.random.default_rng(seed), [robot.anchor], [np.zeros(robot.n_dof)]
    for i in range(STEPS):
        if i % 10 == 0:
            wanted = rng.uniform(robot.lower, robot.upper)
        step = guard.step(wanted, 1.0 / 30.0)
        assert step.certified
        q, v = [*q, step.q], [*v, step.v]
    return np.array(q), np.array(v)


def test_no_hull_meets_another_in_a_certified_motion_by_coal_and_by_mujoco(rooms, drawn):
    q, v = wild(drawn.robot)
    poses = rooms.hulls.between(q, v, np.full(STEPS, 1.0 / 30.0), 3)
    assert len(poses) == 4 * STEPS + 1 and np.abs(np.diff(poses, axis=0)).max() < 0.3
    least = []
    for engine in (rooms.hulls.Coal(drawn), rooms.hulls.Mujoco(drawn)):
        verdict = rooms.hulls.judge(engine, poses)
        assert rooms.hulls.claimed(drawn, np.flatnonzero(verdict.deeper)) == []
        least.append(verdict.least)
    clear = np.minimum(*least) > -rooms.hulls.AGREE
    assert np.abs(least[0] - least[1])[clear].max() < rooms.hulls.AGREE


def test_both_engines_see_an_arm_that_is_put_into_the_body(rooms, drawn):
    robot = drawn.robot
    rng = np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, (40, robot.n_dof))
    found = [rooms.hulls.judge(engine, q).deeper > 0
             for engine in (rooms.hulls.Coal(drawn), rooms.hulls.Mujoco(drawn))]  # fmt: skip
    assert found[0].any()
    assert rooms.hulls.claimed(drawn, np.flatnonzero(found[0]))
    assert (found[0] == found[1]).all()


def test_poses_between_rows_lie_on_the_parabola(rooms):
    q = np.array([[0.0], [0.5], [2.0]])
    v = np.array([[0.0], [1.0], [2.0]])  # half a unit of acceleration and time each way
    at = rooms.hulls.between(q, v, np.array([1.0, 1.0]), 1)
    assert at[:, 0] == pytest.approx([0.0, 0.125, 0.5, 1.125, 2.0])


@pytest.mark.parametrize("name", DRAWN)
def test_what_robot_new_is_sure_of_is_what_a_person_read(rooms, name):
    urdf = urdf_of(DRAWN[name])
    read = rooms.proposals.readings()[name]
    assert urdf.name == Path(read["file"]).name
    found, _ = rooms.proposals.verdicts(urdf, read, urdf.parent)
    assert found == [rooms.proposals.RIGHT] * len(rooms.proposals.PARTS)
    other = read | {"waist": [], "asks": ["hip"]}
    wrong, _ = rooms.proposals.verdicts(urdf, other, urdf.parent)
    assert rooms.proposals.WRONG in wrong[0] and rooms.proposals.WRONG in wrong[4]
