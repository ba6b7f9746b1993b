"""The front door: what `import s3le` hands out, robots by name, poses without a training."""

import json
import os
import re
import shutil
import subprocess
import sys
import threading
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from command import ROOT, run, waving
from fresh import python
from handmade import write
from ruamel.yaml import YAML
from worlds import ARMS_URDF, ARMS_YAML, MARGIN, coman

import s3le
from s3le.cli import shell
from s3le.errors import BundleError, CertificateError, RobotError
from s3le.kernels import batch, compiled
from s3le.kernels.batch import Projection
from s3le.retarget import exported, stored
from s3le.retarget.settings import Settings
from s3le.robot import known
from s3le.robot.robot import Robot
from s3le.store import cache

PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")
HEAVY = {"numpy", "numba", "torch", "pinocchio", "coal", "polars", "pyarrow", "scipy"}


# --- import s3le


def test_the_package_loads_nothing_heavy_and_hands_out_what_people_use():
    code = f"import sys, s3le; assert not {HEAVY!r} & set(sys.modules), sys.modules; " \
           "print(*(getattr(s3le, name).__name__ for name in s3le._HOME))"  # fmt: skip
    said = python(code)
    assert said.returncode == 0, said.stderr
    assert said.stdout.split() == list(s3le._HOME)


def test_what_is_handed_out_is_what_the_modules_define_and_nothing_else():
    from s3le.safety.audit import audit

    assert s3le.Robot is Robot and s3le.audit is audit
    assert set(s3le.__all__) == set(s3le._HOME) | {"__version__"} <= set(dir(s3le))
    with pytest.raises(AttributeError, match="no attribute 'Retargetter'"):
        _ = s3le.Retargetter


def test_the_version_stands_in_one_place():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in project["project"] and project["project"]["dynamic"] == ["version"]
    dynamic = project["tool"]["setuptools"]["dynamic"]
    assert dynamic == {"version": {"attr": "s3le.__version__"}}
    assert s3le.__version__ == "0.2.0"


def test_threads_are_told_not_to_spin_before_anything_can_start_them():
    names = ("OMP_WAIT_POLICY", "KMP_BLOCKTIME", "GOMP_SPINCOUNT")
    code = f"import {{}}, os; print(*(os.environ[name] for name in {names}))"
    bare = {key: value for key, value in os.environ.items() if key not in names}
    for module in ("s3le", "s3le.cli.main", "pipeline.stage"):
        said = subprocess.run(
            [sys.executable, "-c", code.format(module)], capture_output=True, text=True,
            cwd=ROOT, env=bare | {"PYTHONPATH": str(ROOT)}, check=True,
        )  # fmt: skip
        assert said.stdout.split() == ["passive", "0", "0"]
    said = python(code.format("s3le"), OMP_WAIT_POLICY="active")  # whoever says so, decides
    assert said.stdout.split()[0] == "active"


def test_a_motion_needs_neither_torch_nor_dvc_nor_a_viewer():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    base = {line.split(">")[0].split("=")[0] for line in project["dependencies"]}
    assert not base & {"torch", "dvc", "psutil", "ray", "viser", "av", "mujoco", "pytest"}
    extra = {line.split(">")[0] for line in project["optional-dependencies"]["pipeline"]}
    assert {"torch", "dvc", "psutil"} <= extra


# --- settings


def test_a_robot_without_a_training_is_retargeted_with_the_settings_of_params_yaml():
    """The package has no params.yaml; its defaults are those that the pipeline comes with."""
    given = {name: value for name, value in PARAMS["export"].items() if name != "method"}
    chosen = {f.name: getattr(Settings(), f.name) for f in fields(Settings) if f.metadata}
    assert chosen == given
    assert (stored.SAMPLER, stored.ALPHA, stored.SEED) == (
        PARAMS["sample"]["sampler"], PARAMS["alpha"], PARAMS["seed"],
    )  # fmt: skip
    assert (known.MARGIN, known.NECK) == (PARAMS["margin"], PARAMS["neck"])


# --- robots


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of its own with an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def arms(folder, name="arms"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.yaml").write_text(ARMS_YAML.replace("name: arms", f"name: {name}"))
    (folder / "arms.urdf").write_text(ARMS_URDF)


def test_every_robot_that_comes_along_says_who_made_it_and_has_bodies_but_no_mesh():
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    files = sorted(known.READY.glob("*.yaml"))
    assert {"coman", "coman_authors", "g1", "g1_23", "h1", "t1", "talos"} <= {f.stem for f in files}
    for file in files:
        made = known.origin(file)
        assert made["maker"] and made["licence"] in ("BSD-3-Clause", "Apache-2.0", "CC-BY-SA-4.0")
        assert re.search(rf"\b{file.stem}\.urdf", notice)
        urdf = (known.READY / "urdf" / f"{file.stem}.urdf").read_text(encoding="utf-8")
        assert "<mesh" not in urdf and len(Robot.load(file.stem).bodies) > 10


def test_a_name_is_looked_for_here_in_data_robots_and_in_the_package(place):
    assert Robot.load("coman").digest == coman().digest
    arms(place / "data" / "robots", "mine")
    assert Robot.load("mine").name == "mine" and "mine" in known.listed()
    arms(place / "data" / "robots", "coman")
    assert Robot.load("coman").n_dof == 4  # people's own goes before
    assert known.origin(known.listed()["coman"]) == {}
    arms(place, "other")
    for given in ("other", "other.yaml", Path("other.yaml")):
        assert Robot.load(given).name == "other"
    with pytest.raises(RobotError, match="'nobody'.*one of: coman, coman_authors, .*g1, .*mine, "):
        Robot.load("nobody")
    with pytest.raises(RobotError, match="no robot '../here/other'"):
        Robot.load("../here/other")


def test_the_list_of_robots_says_what_is_not_covered(place):
    arms(place / "data" / "robots", "mine")
    said = run("robot", "list")
    assert said.exit_code == shell.OK, said.output
    heads, *rows = said.output.splitlines()
    assert heads.split()[:5] == ["robot", "joints", "bones", "bodies", "watched"]
    told = {row.split()[0]: row.split() for row in rows if row and row[0] != " "}
    assert told["coman"][1:6] == ["11", "7", "32", "378", "20"]
    assert (
        "Unitree Robotics" in said.output and told["mine"][1] == "4" and told["mine"][-1] == "you"
    )
    told = {row["name"]: row for row in json.loads(run("robot", "list", "--json").output)}
    assert any("LShy_0 and LElb_0" in pair for pair in told["coman"]["not_covered"])
    assert len(told["coman"]["not_covered"]) == 20
    assert len(told["coman_covered"]["not_covered"]) == 13
    (place / "data" / "robots" / "broken.yaml").write_text("name: broken\n")
    said = run("robot", "list")
    assert said.exit_code == shell.BROKEN and "broken: cannot be used: " in said.output
    assert any(row.startswith("mine ") for row in said.output.splitlines())


def test_a_new_robot_is_written_where_robots_are_kept_or_here(place):
    urdf = known.READY / "urdf" / "coman.urdf"
    assert run("robot", "new", urdf, "--name", "my").exit_code == shell.OK
    assert (place / "my.yaml").is_file() and (place / "urdf" / "my.urdf").is_file()
    (place / "data" / "robots").mkdir(parents=True)
    assert run("robot", "new", urdf, "--name", "my").exit_code == shell.OK
    assert (place / "data" / "robots" / "my.yaml").is_file()


# --- poses without a training


@pytest.fixture
def few(monkeypatch, place):
    """Few poses, so that they are made in a moment."""
    monkeypatch.setattr(stored, "ROWS", 400)
    monkeypatch.setattr(compiled, "stored", lambda kernel: True)  # so that nobody helps
    return place


def test_poses_are_made_once_certified_and_kept(few, monkeypatch):
    told = []
    made = stored.retargeter_for("coman", watch=lambda what, more, _: told.append((what, more)))
    assert sum(more for what, more in told if what == "poses") == 800
    folder = stored.folder(coman())
    assert folder.is_dir() and folder.parent == cache.folder() / "poses"
    q = exported.load(folder).proposer._poses
    assert q.shape == (400, 11)
    report = coman().certifier().check(q)
    assert (report.clearance >= MARGIN).all() and (report.limit_margin >= 0.0).all()
    monkeypatch.setattr(stored, "make", None)  # not made again
    again = stored.retargeter_for(coman(), k=3)
    assert (made.settings.k, again.settings.k) == (PARAMS["export"]["k"], 3)
    x = batch.skeletons(coman().chain, q[:1])[0]
    assert (again.propose(x)[0] == q[0]).all() and len(again.propose(x)) == 3


def test_the_same_poses_whatever_the_number_of_threads(few, monkeypatch):
    one = stored.ensure(coman())
    before = {file.name: file.read_bytes() for file in one.rglob("*") if file.is_file()}
    shutil.rmtree(one)
    monkeypatch.setattr("s3le.kernels.threads._threads", 3)
    again = stored.ensure(coman())
    assert before == {file.name: file.read_bytes() for file in again.rglob("*") if file.is_file()}


def test_a_pose_that_is_not_feasible_is_never_stored(few, monkeypatch):
    """Without the projection some poses collide; the independent check sees it."""
    monkeypatch.setattr(
        batch, "project", lambda chain, anchor, q, margin, progress: Projection(q, None)
    )
    with pytest.raises(CertificateError):
        stored.ensure(coman())
    assert not stored.folder(coman()).exists()


def test_the_key_holds_all_that_can_change_a_pose(monkeypatch):
    before = stored.key(coman())
    assert stored.key(coman()) == before
    keys = {before, stored.key(coman(0.003)), stored.key(coman(name="coman_authors"))}
    for name, value in (("SEED", 8), ("ROWS", 5), ("ALPHA", 0.1), ("SAMPLER", "uniform")):
        with monkeypatch.context() as changed:
            changed.setattr(stored, name, value)
            keys.add(stored.key(coman()))
    with monkeypatch.context() as changed:
        changed.setattr(stored, "_code", lambda: "edited")
        keys.add(stored.key(coman()))
    assert len(keys) == 8


@pytest.mark.parametrize("damage", ["poses.parquet", "neighbours", "retargeter.json", "robot"])
def test_damaged_poses_are_made_again(few, damage):
    folder = stored.ensure(coman())
    hurt = folder / damage
    if hurt.is_dir():
        shutil.rmtree(hurt)
    else:
        hurt.write_bytes(hurt.read_bytes()[:-7])
    assert stored.retargeter_for("coman").robot.tag == coman().tag
    exported.load(folder)


def test_half_made_poses_are_no_poses(few, monkeypatch):
    """Whoever is stopped while it writes leaves nothing that another takes for whole."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as changed:
        changed.setattr("s3le.retarget.exported.neighbours.build", stopped)
        with pytest.raises(KeyboardInterrupt):
            stored.ensure(coman())
    assert not stored.folder(coman()).exists()
    assert stored.retargeter_for("coman").robot.tag == coman().tag


def test_of_two_at_once_one_makes_the_poses_and_both_have_them(few, monkeypatch):
    made, real = [], stored.make

    def counted(robot, target, progress=None):
        made.append(target)
        real(robot, target, progress)

    monkeypatch.setattr(stored, "make", counted)
    both = [threading.Thread(target=stored.ensure, args=(coman(),)) for _ in range(2)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert len(made) == 1
    exported.load(stored.folder(coman()))


def test_a_cache_that_cannot_be_written_is_said_with_the_way_round(few, monkeypatch):
    (few / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(few / "file"))
    with pytest.raises(BundleError, match="cannot be kept in .*XDG_CACHE_HOME="):
        stored.ensure(coman())


def test_a_helper_that_fails_costs_nothing_but_time(few, monkeypatch):
    monkeypatch.setattr(compiled, "stored", lambda kernel: False)  # as in a fresh installation
    monkeypatch.setattr(stored.threads, "processors", lambda: 2)
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    assert stored.retargeter_for("coman").robot.tag == coman().tag


def test_a_helper_makes_the_poses_that_its_caller_would(few, monkeypatch, capsys):
    import io

    monkeypatch.setattr(sys, "stdin", io.StringIO(stored._packed(coman()).decode()))
    stored.help_out()
    assert sum(map(int, capsys.readouterr().out.split())) == 800
    monkeypatch.setattr(stored, "make", None)
    assert stored.ensure(coman()) == stored.folder(coman())


# --- the command


def test_the_first_motion_takes_neither_model_nor_checkout(few):
    write(few / "a.bvh", waving())
    said = run("retarget", "a.bvh", "--out", "motions", "--robot", "g1")
    assert said.exit_code == shell.OK, said.output
    first = said.stdout.splitlines()[0]
    robot = Robot.load("g1")
    assert first == (
        f"robot g1 ({known.READY / 'g1.yaml'}), 400 stored poses, found by the skeleton itself: "
        f"{stored.folder(robot)}"
    )
    summary = json.loads((few / "motions" / "a.json").read_text())
    assert summary["certificate"]["holds"] and summary["robot"] == "g1"
    assert summary["poses"]["key"] == stored.key(robot)
    assert run("audit", "motions/a.parquet", "--robot", "g1").exit_code == shell.OK


def test_a_model_is_taken_only_where_it_is_named(few):
    """A folder data/retargeter is none of the command's business until --model says so."""
    write(few / "a.bvh", waving())
    stored.make(coman(), few / "data" / "retargeter")
    said = run("retarget", "a.bvh", "--out", "one", "--robot", "coman")
    assert "400 stored poses" in said.stdout.splitlines()[0]
    said = run("retarget", "a.bvh", "--out", "two", "--model", "data/retargeter")
    assert said.stdout.splitlines()[0] == (
        "robot coman, model data/retargeter, poses found by skeleton"
    )
    assert json.loads((few / "two" / "a.json").read_text())["model"] == "data/retargeter"
    said = run("retarget", "a.bvh", "--out", "no", "--model", "data/retargeter", "--robot", "g1")
    assert said.exit_code == shell.UNREADABLE
    assert "data/retargeter is for robot 'coman', not 'g1'" in said.output
    said = run("retarget", "a.bvh", "--out", "no", "--method", "s3le")
    assert said.exit_code == shell.UNREADABLE and "--model FOLDER" in said.output
    assert not (few / "no").exists()


def test_a_new_robot_moves_without_a_pipeline(few):
    write(few / "a.bvh", waving())
    said = run("robot", "new", known.READY / "urdf" / "coman.urdf", "--name", "my")
    assert "s3le retarget CLIP --robot my.yaml --out motions" in said.output
    for given in ("my.yaml", "my"):
        said = run("retarget", "a.bvh", "--out", "motions", "--robot", given)
        assert said.exit_code == shell.OK, said.output
        assert "robot my (my.yaml)" in said.output
