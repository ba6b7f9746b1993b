"""Files for a simulator by the command line: heading, even rows, layouts, each certified."""

import json
import pickle

import numpy as np
import pytest
from command import ROBOT, TABLE, run
from crowded import ALGEBRA
from follower import Plain, led_by
from handmade import bvh, deepmimic, write
from worlds import coman

from s3le.cli.options import Tool
from s3le.errors import TrajectoryError
from s3le.human.skeletons import read_frames
from s3le.motion import files, layouts, trajectory, whole
from s3le.retarget import clip

# --- heading


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A figure that lowers its left arm and turns by 400 degrees; three frames are of no use."""
    yaw, arm = np.linspace(0, 400, 40), 60 * np.sin(np.linspace(0, 1.3, 40)) ** 2
    rows = [[0, 0, 0, 0, 0, a, -b, 0, 0, 0, 0, 0] for a, b in zip(yaw, arm, strict=True)]
    for row in (20, 21, 22):
        rows[row][4] = 90
    folder = tmp_path_factory.mktemp("turning")
    return write(folder / "turn.bvh", bvh(rows, order="ZXY", step=".04"))


def test_the_heading_is_the_clips_unwrapped_and_at_the_rows_own_times(turning):
    frames = read_frames(turning, "midpoint")
    yaw = np.deg2rad(np.linspace(0, 400, 40))
    made = clip.convert(Plain(), frames).motion
    assert made.heading - made.heading[0] == pytest.approx(yaw, abs=1e-6)
    assert made.about["heading"] == "from the clip"
    lead = clip.convert(Plain(), frames, lead_in=0.4, rate=100.0).motion
    offset = lead.about["clip_time_offset_s"]
    assert (lead.heading[lead.time <= offset] == made.heading[0]).all()
    by_hand = np.interp(lead.time - offset, made.time, made.heading)
    assert lead.heading == pytest.approx(by_hand, abs=1e-9)


def test_a_clip_without_a_heading_is_the_identity_and_says_so(turning):
    frames = read_frames(turning, "midpoint")._replace(heading=None)
    made = clip.convert(Plain(), frames)
    assert (made.motion.heading == 0.0).all() and made.summary["heading"] == "identity"


def test_a_heading_that_is_not_finite_is_refused_with_its_row():
    with pytest.raises(TrajectoryError, match="row 1: heading is nan"):
        trajectory.make("m", ["a"], [0, 1], [[0], [0]], heading=[0, np.nan])


# --- even rows


@pytest.mark.parametrize("even", [False, True])
def test_rows_fill_gaps_at_the_clips_own_rate(turning, even):
    made = clip.convert(Plain(), read_frames(turning, "midpoint"), even=even).motion
    assert made.rate == pytest.approx(25.0) and len(made.time) == 40
    assert made.about["rate"] == (25.0 if even else None)
    assert np.flatnonzero(made.mode == "dropped").tolist() == [20, 21, 22]


# --- layouts


def test_the_command_line_knows_every_layout():
    assert {tool.value for tool in Tool} == set(layouts.SUFFIX)


def test_every_file_that_is_written_is_certified_by_the_audit(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    out = tmp_path / "out"
    said = run("retarget", turning, "--out", out, "--full", "--csv", "--npz", "--for", "gmr",
               "--for", "mjlab", "--rate", 50)  # fmt: skip
    assert said.exit_code == 0, said.output
    names = ["turn.parquet", "turn.csv", "turn.npz", "turn.gmr.npz", "turn.mjlab.csv"]
    sides = ["turn.csv.json", "turn.mjlab.csv.json", "turn.json"]
    assert {p.name for p in out.iterdir()} == {*names, *sides} | TABLE
    said = run("audit", *(out / name for name in names), *ROBOT, "--straight")
    assert said.exit_code == 0 and "5 of 5 files hold" in said.output
    assert said.output.count("rows lie between two frames by their mode") == 5
    summary = json.loads((out / "turn.json").read_text())
    assert len(summary["whole"]["moved"]) == 11 and len(summary["whole"]["held"]) == 18
    # mjlab's: by names and rate from the command line where the side file is gone
    (out / "turn.mjlab.csv.json").unlink()
    path = out / "turn.mjlab.csv"
    assert run("audit", path, *ROBOT).exit_code == 2
    order = [joint.name for joint in whole.joints(coman()).joints]
    said = run("audit", path, *ROBOT, "--fps", 50, "--joints", ",".join(order))
    assert said.exit_code == 0 and "1 of 1 files hold" in said.output
    rows = np.loadtxt(path, delimiter=",")
    whole_file = files.read(out / "turn.parquet")
    assert rows.shape == (len(whole_file.time), 36) and (rows[:, 7:] == whole_file.q).all()
    # GMR's: what its loader takes from the pickle that docs/files.md makes of it
    with np.load(out / "turn.gmr.npz") as it:
        motion = {k: it[k] for k in ("root_pos", "root_rot", "dof_pos")}
        motion |= {"fps": it["fps"].item(), "local_body_pos": None, "link_body_list": None}
        layout = json.loads(str(it["about"]))["layout"]
    motion = pickle.loads(pickle.dumps(motion))
    assert motion["fps"] == 50 and isinstance(motion["fps"], int)
    assert (motion["root_pos"] == rows[:, :3]).all() and (motion["root_rot"] == rows[:, 3:7]).all()
    half = whole_file.heading / 2
    by_hand = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    assert motion["root_rot"] == pytest.approx(by_hand, abs=ALGEBRA)
    assert layout["root_quaternion"].startswith("x y z w") and len(layout["joints"]) == 29


def test_without_full_the_usual_files_keep_the_robots_own_joints(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    said = run("retarget", turning, "--out", tmp_path, "--for", "gmr", "--root-height", 0.7)
    assert said.exit_code == 0, said.output
    assert len(files.read(tmp_path / "turn.parquet").joints) == 11
    assert files.read(tmp_path / "turn.gmr.npz").joints[7] == "RForearmPlate"
    with np.load(tmp_path / "turn.gmr.npz") as it:
        assert it["root_pos"].tolist() == [[0.0, 0.0, 0.7]] * 40
        assert json.loads(str(it["about"]))["layout"]["root_height"] == "as asked for"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--for", "isaac"], "isaac"),
        (["--root-height", "0.5"], "give --for too"),
        (["--for", "gmr", "--root-height", "99"], "root height must be within 10 m"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path, turning, monkeypatch, options, words):
    led_by(monkeypatch, Plain)
    said = run("retarget", turning, "--out", tmp_path / "out", *options)
    assert said.exit_code == 2 and words in said.output and not (tmp_path / "out").exists()


def test_clips_whose_files_would_be_one_anothers_are_refused(tmp_path, turning, monkeypatch):
    led_by(monkeypatch, Plain)
    for name in ("a.bvh", "a.gmr.bvh"):
        (tmp_path / name).write_bytes(turning.read_bytes())
    said = run("retarget", tmp_path / "a.bvh", tmp_path / "a.gmr.bvh", "--out", tmp_path / "out",
               "--npz", "--for", "gmr")  # fmt: skip
    assert said.exit_code == 2 and "would both become a.gmr.npz" in said.output


def test_a_clip_is_never_replaced_by_what_became_of_it(tmp_path, monkeypatch):
    """A motion takes its clip's name, and .json and .parquet are suffixes of both."""
    led_by(monkeypatch, Plain)
    monkeypatch.chdir(tmp_path)
    clip = write(tmp_path / "wave.json", deepmimic(*({} for _ in range(5))))
    before = clip.read_bytes()
    for out in (".", "sub/..", str(tmp_path)):
        said = run("retarget", "wave.json", "--out", out)
        assert said.exit_code == 2 and "wave.json is a clip" in said.output
    assert clip.read_bytes() == before and list(tmp_path.iterdir()) == [clip]
