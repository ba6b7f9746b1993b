"""The command line as a person meets it: what it says, what it writes, and its exit status."""

import json
import os
import pickle
import socket
import subprocess
import sys
import threading
from pathlib import Path

import bodies
import numpy as np
import pytest
from follower import Plain, Reckless, led_by
from handmade import bvh, write
from test_gltf import packed, scene, several
from test_inert import frankmocap
from typer.testing import CliRunner
from worlds import coman, relaxed

from s3le.cli import shell
from s3le.cli.main import app
from s3le.errors import ParameterError, RobotError
from s3le.human.keypoints.how import AXES, recorded
from s3le.human.keypoints.layouts import LAYOUTS
from s3le.kernels import batch
from s3le.motion import files, trajectory, whole
from s3le.show import motions as scenes

ROOT = Path(__file__).parents[1]
ROBOT = ["--robot", str(ROOT / "s3le" / "robots" / "coman.yaml")]


def run(*words, given=None):
    return CliRunner().invoke(app, [str(word) for word in words], input=given)


def alone(*words, given=None):
    """The same in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "s3le.cli", *map(str, words)],
        input=given, capture_output=True, text=True, timeout=300,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def motion(rows=20, **more):
    robot = coman()
    q = np.repeat(robot.anchor[None], rows, 0)
    q[:, 3] += 0.3 * np.sin(np.arange(rows) / 10)
    return trajectory.make("m", robot.joint_names, np.arange(rows) / 30, q, **more)


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


@pytest.fixture
def retargeter(monkeypatch):
    """A retargeter in every folder."""
    return led_by(monkeypatch, Plain)


def waving(frames=12):
    angles = np.linspace(0, 40, frames)
    return bvh([[0, 0, 0, 0, 0, 0, -a, 0, 0, 0, 0, 0] for a in angles], order="ZXY", step=".033")


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
    with pytest.raises(RobotError, match="no robot 'nobody'.* coman, coman_authors, g1"):
        shell.robot("nobody")


def test_velocity_words():
    assert shell.by_joint(None, "--velocity", "RAD_S") is None
    assert shell.by_joint(["3"], "--velocity", "RAD_S") == 3.0
    assert shell.by_joint(["a=1", "b=2e0"], "--velocity", "RAD_S") == {"a": 1.0, "b": 2.0}
    with pytest.raises(ParameterError, match="RAD_S or JOINT=RAD_S"):
        shell.by_joint(["a="], "--velocity", "RAD_S")


# --- retarget

TABLE = {"retarget.parquet", ".retarget.lock"}


def test_each_clip_becomes_a_certified_file_and_a_summary(tmp_path, retargeter):
    for name in ("one", "two"):
        write(tmp_path / "clips" / f"{name}.bvh", waving())
    out = tmp_path / "out"
    said = run("retarget", tmp_path / "clips", "--robot", "coman", "--out", out, "--csv", "--npz")
    assert said.exit_code == shell.OK, said.output
    assert "one.bvh: 12 poses" in said.output and "certified" in said.output
    wanted = {
        f"{n}.{s}" for n in ("one", "two") for s in ("parquet", "csv", "csv.json", "npz", "json")
    }
    assert {p.name for p in out.iterdir()} == wanted | TABLE
    summary = json.loads((out / "one.json").read_text())
    assert summary["certificate"]["holds"] and summary["to_human"]["mean"] < 0.1
    assert said.stdout.splitlines()[0].startswith("robot coman (")
    assert "20,000 stored poses, found by the skeleton itself" in said.stdout.splitlines()[0]
    assert summary["model"] is None and summary["method"] == "skeleton"
    assert summary["poses"]["rows"] == 20_000 and len(summary["poses"]["key"]) == 16
    paths = [out / f"{n}.{s}" for n in ("one", "two") for s in ("parquet", "csv", "npz")]
    audited = run("audit", *paths, *ROBOT)
    assert audited.exit_code == shell.OK and "6 of 6 files hold" in audited.output
    back = files.read(out / "one.parquet")
    assert back.about["robot_hash"] == coman().digest
    assert back.about["certificate"]["paths"]["proven"] == 11


def test_a_clip_that_fails_is_named_and_the_others_are_written(tmp_path, retargeter):
    write(tmp_path / "good.bvh", waving())
    write(tmp_path / "bad.bvh", "HIERARCHY\nnonsense")
    out = tmp_path / "out"
    said = run(
        "retarget", tmp_path / "bad.bvh", tmp_path / "none.bvh", tmp_path / "good.bvh", "--out", out
    )
    assert said.exit_code == shell.BROKEN
    assert "bad.bvh" in said.output and "none.bvh" in said.output
    assert "2 of 3 clips failed" in said.output
    assert {p.name for p in out.iterdir()} == {"good.parquet", "good.json"} | TABLE


def test_nothing_is_written_of_a_motion_that_does_not_hold(tmp_path, monkeypatch):
    led_by(monkeypatch, Reckless)
    rows = [[0, 0, 0, 0, 0, 0, -80 * (i % 2), 0, 0, 0, 0, 0] for i in range(6)]
    write(tmp_path / "a.bvh", bvh(rows, order="ZXY", step=".033"))
    said = run("retarget", tmp_path / "a.bvh", "--out", tmp_path / "out")
    assert said.exit_code == shell.BROKEN and "refused" in said.output
    assert {p.name for p in (tmp_path / "out").iterdir()} == TABLE


def test_rate_and_lead_in_reach_the_file(tmp_path, retargeter):
    write(tmp_path / "a.bvh", waving())
    out = tmp_path / "out"
    said = run(
        "retarget", tmp_path / "a.bvh", "--out", out, "--rate", 200, "--lead-in", 0.5, "--npz"
    )
    assert said.exit_code == shell.OK, said.output
    back = files.read(out / "a.npz")
    assert back.rate == pytest.approx(200.0) or json.loads((out / "a.json").read_text())["rows"]
    assert back.mode[0] == "start" and "lead_in" in back.mode and "between" in back.mode


@pytest.mark.parametrize(
    ("options", "words", "status"),
    [
        (["--robot", "nao"], "no robot 'nao'", 2),
        (["--rate", "5"], "rate must be in [30, 1000] Hz", 1),
        (["--lead-in", "-1"], "lead-in must be in", 1),
        (["--fps", "-3"], "fps must be in", 1),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path, retargeter, options, words, status):
    write(tmp_path / "a.bvh", waving())
    said = run("retarget", tmp_path / "a.bvh", "--out", tmp_path / "out", *options)
    assert said.exit_code == status and words in said.output


def test_keypoints_are_read_as_said_and_what_is_assumed_is_said(tmp_path, retargeter):
    joints = bodies.listed("h36m17", bodies.body(20)) @ bodies.INTO["camera"].T
    np.save(tmp_path / "dance.npy", joints)
    said = run("retarget", tmp_path / "dance.npy", "--out", tmp_path / "out", "--pitch", "0")
    assert said.exit_code == 0, said.output
    assert "note: layout h36m17, by 17 joints" in said.output and "note: 30 Hz" in said.output
    summary = json.loads((tmp_path / "out" / "dance.json").read_text())
    assert summary["reading"]["layout"] == summary["clip_read_layout"] == "h36m17"
    assert summary["reading"]["axes"] == "camera" and len(summary["reading"]["assumed"]) == 3
    about = files.read(tmp_path / "out" / "dance.parquet").about
    assert about["clip_read_layout"] == "h36m17" and float(about["clip_read_pitch"]) == 0.0
    for words, why in (
        (["--layout", "coco17"], "by coco17 the joints are no body"),
        (["--layout", "cocoa"], "wanted one of smpl, mediapipe"),
        (["--axes", "up"], "wanted one of camera, y-up, z-up"),
        (["--pitch", "100"], "--pitch must be from -89 to 89"),
    ):
        said = run("retarget", tmp_path / "dance.npy", "--out", tmp_path / "no", *words)
        assert said.exit_code in (1, 2) and why in said.output
    assert not list((tmp_path / "no").glob("dance*"))
    said = run("retarget", "--help").output
    assert all(layout in said for layout in LAYOUTS) and all(axes in said for axes in AXES)


def test_one_of_a_scenes_animations_is_chosen_and_remembered(tmp_path, retargeter):
    tree, binary = scene()
    several(tree)
    (tmp_path / "a.glb").write_bytes(packed(tree, binary))
    said = run("retarget", tmp_path / "a.glb", "--out", tmp_path / "out")
    assert said.exit_code == 1 and "choose: --animation NAME or NUMBER" in said.output
    said = run("retarget", tmp_path / "a.glb", "--out", tmp_path / "out", "--animation", "dance")
    assert said.exit_code == 0, said.output
    assert files.read(tmp_path / "out" / "a.parquet").about["clip_read_animation"] == "dance"
    summary = json.loads((tmp_path / "out" / "a.json").read_text())
    assert summary["reading"]["animation"] == "dance"


def test_a_folder_of_amass_is_its_motions_without_its_shapes(tmp_path, retargeter):
    home = tmp_path / "subject"
    home.mkdir()
    np.savez(home / "walk_poses.npz", poses=bodies.pose(), mocap_framerate=60.0)
    for name in ("shape.npz", "male_stagei.npz"):
        np.savez(home / name, betas=np.zeros(10))
    said = run("retarget", home, "--out", tmp_path / "out")
    assert said.exit_code == 0, said.output
    assert {p.name for p in (tmp_path / "out").glob("w*.parquet")} == {"walk_poses.parquet"}


def test_axes_and_names_are_stated_of_a_bvh_and_remembered(tmp_path, retargeter):
    names = ["Sleeve" if name == "LeftForeArm" else name for name in bodies.named("LAFAN1")]
    joints = bodies.body(20) + (0.0, 0.0, 0.9)
    clip = write(tmp_path / "odd.bvh", bodies.bvh_of(joints, names, rest="y"))
    out = tmp_path / "out"
    said = run("retarget", clip, "--out", out)
    assert said.exit_code == shell.BROKEN and "no joint for l_elbow" in said.output
    write(tmp_path / "map.yaml", "l_elbow: Sleeve\n")
    given = ("--names", tmp_path / "map.yaml")
    said = run("retarget", clip, "--out", out, *given)
    assert said.exit_code == shell.BROKEN and "rest pose is y-up and trunks" in said.output
    said = run("retarget", clip, "--out", out, *given, "--axes", "z-up")
    assert said.exit_code == 0, said.output
    about = files.read(out / "odd.parquet").about
    known = recorded(about)
    assert (known.axes, known.names) == ("z-up", {"l_elbow": "Sleeve"})
    assert json.loads((out / "odd.json").read_text())["reading"]["axes"] == "z-up"
    shown = scenes.of(files.read(out / "odd.parquet"), out / "odd.parquet", retargeter.robot)
    assert len(scenes.human(clip, shown).x) == 20  # as a viewer reads it later
    said = run("retarget", clip, "--out", out, "--names", tmp_path / "none.yaml")
    assert said.exit_code == shell.UNREADABLE and "none.yaml: no such file" in said.output


@pytest.mark.parametrize("kind", ["bvh", "npz"])
def test_a_clip_of_which_most_frames_cannot_be_used_fails_unless_that_is_accepted(
    tmp_path, retargeter, kind
):
    joints = bodies.body(20) @ bodies.INTO["y-up"].T
    joints[:11] = joints[:11] @ bodies.INTO["y-up"]  # lies for 11 of 20
    clip = tmp_path / f"falls.{kind}"
    if kind == "bvh":
        write(clip, bodies.bvh_of(joints[::-1], bodies.named("LAFAN1"), rest="y"))
    else:
        np.savez(clip, joints=joints, fps=30.0)
    out = tmp_path / "out"
    said = run("retarget", clip, "--out", out, "--axes", "y-up")
    assert said.exit_code == shell.BROKEN
    assert "only 9 of 20 frames can be used (pelvis 2, tilt 9)" in said.output
    assert "--accept-minority" in said.output and not list(out.glob("falls*"))
    said = run("retarget", clip, "--out", out, "--axes", "y-up", "--accept-minority")
    assert said.exit_code == 0, said.output
    assert json.loads((out / "falls.json").read_text())["frames"]["followed"] == 9
    joints[10] = joints[11]  # ten of twenty are no minority
    np.savez(tmp_path / "half.npz", joints=joints, fps=30.0)
    said = run("retarget", tmp_path / "half.npz", "--out", out, "--axes", "y-up")
    assert said.exit_code == 0, said.output


def test_what_is_no_file_is_called_what_it_is(tmp_path, retargeter):
    (tmp_path / "dir.bvh").mkdir()
    os.mkfifo(tmp_path / "pipe.bvh")
    for name, what in (("dir.bvh", "is a folder"), ("pipe.bvh", "is a named pipe (FIFO)")):
        said = run("retarget", tmp_path / name, "--out", tmp_path / "out")
        assert said.exit_code in (1, 2) and what in said.output


def test_a_folder_of_frames_is_one_clip_and_not_mixed_with_others(tmp_path, retargeter):
    frames = frankmocap(tmp_path / "out" / "mocap", [3, 4, 5])
    said = run("retarget", tmp_path / "out", "--out", tmp_path / "a", "--fps", "25")
    assert said.exit_code == 0 and (tmp_path / "a" / "out.parquet").is_file(), said.output
    write(tmp_path / "out" / "walk.bvh", waving())
    said = run("retarget", tmp_path / "out", "--out", tmp_path / "b", "--fps", "25")
    found = {p.name for p in (tmp_path / "b").glob("*.parquet")}
    assert found == {"mocap.parquet", "walk.parquet", "retarget.parquet"}
    write(frames / "walk.bvh", waving())
    said = run("retarget", frames, "--out", tmp_path / "c")
    assert said.exit_code == 2 and "frames of one clip and other clips, as walk.bvh" in said.output


def test_two_clips_of_one_name_are_refused_before_anything_is_written(tmp_path, retargeter):
    for folder in "ab":
        write(tmp_path / folder / "walk.bvh", waving())
    said = run("retarget", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "2 clips are called 'walk'" in said.output
    assert not (tmp_path / "out").exists()
    (tmp_path / "empty").mkdir()
    said = run("retarget", tmp_path / "empty", "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "no motion files in it" in said.output


def test_without_a_model_it_says_what_is_missing(tmp_path):
    write(tmp_path / "a.bvh", waving())
    said = run("retarget", tmp_path / "a.bvh", "--out", tmp_path, "--model", tmp_path / "none")
    assert said.exit_code == shell.UNREADABLE and "ModelError" in said.output


# --- stream


def frame():
    x = batch.skeletons(coman().chain, coman().anchor[None])[0]
    return json.dumps({"x": x.tolist(), "dt": 0.05})


def test_a_stream_on_standard_input(retargeter):
    said = run("stream", given=f"{frame()}\nnonsense\n{frame()}\n")
    assert said.exit_code == shell.OK, said.output
    lines = [json.loads(line) for line in said.stdout.splitlines()]
    assert lines[0]["joints"] == coman().joint_names and lines[0]["model"] is None
    assert lines[0]["poses"]["seed"] == 7 and "20,000 stored poses" in said.stderr
    assert len(lines[1]["q"]) == 11 and lines[2]["line"] == 2 and "error" in lines[2]
    assert lines[3]["t"] == pytest.approx(0.1 + 1 / 30)


def test_a_stream_on_loopback_serves_one_client_after_another(retargeter, monkeypatch):
    from s3le.cli import stream

    port, opened = threading.Event(), {}
    create = socket.create_server

    def noted(address):
        server = create(address)
        opened["server"] = server
        port.set()
        return server

    monkeypatch.setattr(socket, "create_server", noted)

    def serve():
        from s3le.retarget import live

        with __import__("contextlib").suppress(OSError):
            stream._listen(0, lambda: live.Live(retargeter, 30.0, 1.0))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert port.wait(10)
    address = opened["server"].getsockname()
    for _ in range(2):
        with socket.create_connection(address, 30) as client, client.makefile("rw") as both:
            assert json.loads(both.readline())["robot"] == "coman"
            both.write(frame() + "\n")
            both.flush()
            assert json.loads(both.readline())["t"] == pytest.approx(0.05)
    opened["server"].shutdown(socket.SHUT_RDWR)
    thread.join(10)
    assert not thread.is_alive()
