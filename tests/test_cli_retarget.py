"""The command line: clips to motions, one by one or as a stream."""

import json
import os
import socket
import threading

import bodies
import numpy as np
import pytest
from command import ROBOT, TABLE, run, waving
from follower import Plain, Reckless, led_by
from frankmocaps import frankmocap
from handmade import bvh, write
from test_gltf import packed, scene, several
from worlds import coman

from s3le.cli import shell
from s3le.human.keypoints.how import AXES, recorded
from s3le.human.keypoints.layouts import LAYOUTS
from s3le.kernels import batch
from s3le.motion import files
from s3le.show import motions as scenes


@pytest.fixture
def retargeter(monkeypatch):
    """A retargeter in every folder."""
    return led_by(monkeypatch, Plain)


# --- retarget


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
    audited = run("audit", *paths, *ROBOT, "--straight")  # it comes to rest at every row
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
