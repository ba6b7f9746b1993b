"""The command line: its help, and the audit of files."""

import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from command import ROBOT, ROOT, alone, motion, run
from worlds import coman, relaxed

from s3le.cli import shell
from s3le.errors import ParameterError, RobotError
from s3le.kernels import batch
from s3le.motion import files, trajectory, whole


@pytest.fixture
def good(tmp_path):
    files.write(motion(), tmp_path / "good.parquet")
    return tmp_path / "good.parquet"


@pytest.fixture
def bad(tmp_path):
    """Feasible poses, and paths between them that go through a body."""
    made = coman()
    q = batch.project(made.chain, made.anchor, relaxed(made, 20, 5), made.margin).q
    made = trajectory.make("m", made.joint_names, 5.0 * np.arange(20), q)
    files.write(made, tmp_path / "bad.csv")
    return tmp_path / "bad.csv"


# --- help


@pytest.mark.parametrize(
    "command", [None, "audit", "guard", "render", "retarget", "stream", "view"]
)
def test_help_teaches_by_example(command):
    said = run(*([command] if command else []), "--help")
    assert said.exit_code == 0
    assert "s3le audit" in said.output if command is None else f"s3le {command} " in said.output
    if command:
        assert "Exit status: 0" in said.output


def test_help_loads_nothing_heavy():
    code = "import sys, s3le.cli.main; print(*sys.modules)"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    heavy = {"numpy", "numba", "torch", "pinocchio", "coal", "polars", "pyarrow", "tqdm", "viser"}
    assert not heavy & set(said.stdout.split())


def test_the_entry_point_is_the_one_that_is_installed():
    assert 's3le = "s3le.cli.main:run"' in (ROOT / "pyproject.toml").read_text()


# --- audit


def test_a_good_file_is_certified(good):
    said = run("audit", good, *ROBOT)
    assert said.exit_code == shell.OK
    assert "  CERTIFIED" in said.output and "1 of 1 files hold" in said.output
    assert "not covered, 20 pairs" in said.output and "LShy_0 and LElb_0" in said.output


def test_a_counterexample_is_named_with_time_pair_and_depth(bad):
    said = run("audit", bad, *ROBOT, "--velocity", "inf")
    assert said.exit_code == shell.BROKEN and "NOT CERTIFIED; first: " in said.output
    first = said.output.split("first: ")[1].splitlines()[0]
    assert "s (row " in first and " and " in first and " mm" in first


def test_all_files_are_audited_and_the_worst_decides(good, bad, tmp_path):
    (tmp_path / "no.csv").write_text("time,LElbj\n0,x\n")
    said = run("audit", tmp_path / "no.csv", tmp_path / "none.npz", bad, good, *ROBOT)
    assert said.exit_code == shell.UNREADABLE
    assert "'x' is no number" in said.output and "none.npz: No such file" in said.output
    assert "  NOT CERTIFIED" in said.output and "  CERTIFIED" in said.output
    assert "1 of 4 files hold, 2 unreadable" in said.output


def test_json_says_it_all(good, bad, tmp_path):
    said = run("audit", good, bad, tmp_path / "none.csv", *ROBOT, "--json")
    told = json.loads(said.stdout)
    assert said.exit_code == shell.UNREADABLE and told["holds"] is False
    assert len(told["not_covered"]) == 20 and told["margin_m"] == 0.002
    first, second, third = told["files"]
    assert first["holds"] and first["checks"]["paths"]["total"] == 19
    assert not second["holds"] and second["first"]["what"]
    assert "No such file" in third["unreadable"]


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ([], 0),
        (["--margin", "0.02"], 1),
        (["--margin", "0.012", "--margin-between", "0.01"], 0),
        (["--velocity", "0.5"], 1),
        (["--velocity", "LShSag=0.5"], 1),
        (["--velocity", "RShSag=0.5"], 0),
        (["--fps", "3000"], 1),
        (["--velocity", "x"], 2),
        (["--velocity", "1", "--velocity", "2"], 2),
        (["--margin", "-1"], 2),
        (["--margin-between", "0.1"], 2),
        (["--robot", "nobody"], 2),
        (["--fps", "nan"], 2),
        (["--budget", "-1"], 2),
        (["--nonsense"], 2),
    ],
)
def test_options_change_what_is_asked(good, options, status):
    robot = [] if "--robot" in options else ROBOT
    said = run("audit", good, *robot, *options)
    assert said.exit_code == status, said.output
    assert "Traceback" not in said.output


def test_a_file_of_another_tool_in_degrees(tmp_path):
    one = motion()
    np.savez(
        tmp_path / "gmr.npz",
        dof_pos=np.hstack([np.zeros((20, 7)), np.rad2deg(one.q)]),
        joint_names=list(one.joints),
        fps=30,
    )
    said = run("audit", tmp_path / "gmr.npz", *ROBOT)
    assert said.exit_code == shell.BROKEN and "are these degrees? --degrees" in said.output
    assert run("audit", tmp_path / "gmr.npz", *ROBOT, "--degrees").exit_code == shell.OK


def test_columns_without_names_are_named_on_the_command_line_or_in_a_file(tmp_path):
    one = motion()
    np.savetxt(tmp_path / "a.csv", one.q, delimiter=",", fmt="%.17g")
    (tmp_path / "names.txt").write_text("\n".join(one.joints))
    for names in (",".join(one.joints), tmp_path / "names.txt"):
        said = run("audit", tmp_path / "a.csv", *ROBOT, "--fps", 30, "--joints", names)
        assert said.exit_code == shell.OK, said.output


def test_rows_between_frames_are_held_to_what_the_path_keeps_unless_told_otherwise(tmp_path):
    made = coman()
    found = batch.project(made.chain, made.anchor, relaxed(made, 60, 8), 0.0012).q
    clearance = made.certifier().check(found).clearance
    q = np.repeat(found[(clearance > 0.0011) & (clearance < 0.0019)][:1], 3, 0)
    mode = np.array(["between", "between", "between"])
    one = trajectory.make("m", made.joint_names, np.arange(3) / 30, q, mode=mode)
    files.write(one, tmp_path / "a.parquet")
    said = run("audit", tmp_path / "a.parquet", *ROBOT)
    assert said.exit_code == shell.OK and "3 rows lie between two frames" in said.output
    assert run("audit", tmp_path / "a.parquet", *ROBOT, "--margin", 0.002).exit_code == shell.BROKEN
    files.write(trajectory.make("m", made.joint_names, one.time, q), tmp_path / "b.parquet")
    assert run("audit", tmp_path / "b.parquet", *ROBOT).exit_code == shell.BROKEN


def test_layouts_of_other_tools_are_audited_motion_by_motion(tmp_path):
    q, names = motion().q, whole.joints(coman()).depth_first
    full = np.zeros((len(q), len(names)))
    for i, joint in enumerate(coman().joint_names):
        full[:, names.index(joint)] = q[:, i]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"dof_pos": full, "fps": 30}))
    said = run("audit", tmp_path / "a.pkl", *ROBOT)
    assert said.exit_code == shell.OK and "CERTIFIED" in said.output
    assert "note: dof_pos has no names" in said.output
    (tmp_path / "b.pkl").write_bytes(pickle.dumps({"dof_pos": full * 9.0, "fps": 30}))
    said = run("audit", tmp_path / "b.pkl", tmp_path, *ROBOT, "--json")
    assert said.exit_code == shell.UNREADABLE
    told = json.loads(said.stdout)["files"]
    assert not told[0]["holds"] and "no LeRobot data set" in told[1]["unreadable"]


def test_in_a_process_of_its_own(good, bad, tmp_path):
    said = alone("audit", good, bad, *ROBOT, "--velocity", "inf")
    assert said.returncode == shell.BROKEN and "NOT CERTIFIED" in said.stdout
    (tmp_path / "a.pkl").write_bytes(b"\x80\x04.")
    said = alone("audit", tmp_path / "a.pkl", *ROBOT)
    assert said.returncode == shell.UNREADABLE
    assert said.stderr.startswith("TrajectoryError: ") and said.stderr.count("\n") == 1
    assert "Traceback" not in said.stderr


# --- which robot


def test_a_robot_is_a_folder_a_file_or_a_name(tmp_path, monkeypatch):

    coman().write(tmp_path / "export" / "robot")
    for given in (tmp_path / "export", tmp_path / "export" / "robot", ROBOT[1], "coman"):
        assert shell.robot(str(given)).digest == coman().digest
    monkeypatch.chdir(tmp_path)
    assert shell.robot(None).name == "coman"
    with pytest.raises(RobotError, match="no robot 'nobody'.* coman, coman_authors, .*g1"):
        shell.robot("nobody")


def test_velocity_words():
    assert shell.by_joint(None, "--velocity", "RAD_S") is None
    assert shell.by_joint(["3"], "--velocity", "RAD_S") == 3.0
    assert shell.by_joint(["a=1", "b=2e0"], "--velocity", "RAD_S") == {"a": 1.0, "b": 2.0}
    with pytest.raises(ParameterError, match="RAD_S or JOINT=RAD_S"):
        shell.by_joint(["a="], "--velocity", "RAD_S")
