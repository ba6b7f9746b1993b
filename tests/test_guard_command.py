"""`s3le guard`: what it writes, what it says, what it keeps, and its exit status."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command import ROOT, run
from guarding import put, snapshot
from test_guard_clean import collides as stays
from test_guard_clean import colliding, joint, lying, swaying, too_hard
from worlds import coman

from s3le.cli import shell
from s3le.guard import folder
from s3le.guard.layouts.door import open_layout
from s3le.guard.layouts.text import TextLayout
from s3le.guard.table import guard as contract
from s3le.motion import files, trajectory
from s3le.store import tables
from s3le.tuples.engine import lock

ROBOT = ["--robot", "coman"]
ONE = [*ROBOT, "--jobs", "1"]


def gmr(path, q):
    """A motion as GMR's arrays lie in an NPZ, float32, with a root of its own."""
    rows = len(q)
    root = np.random.default_rng(1).normal(size=(rows, 3))
    np.savez(
        path, fps=np.array(30), root_pos=root, dof_pos=q.astype("f4"),
        joint_names=np.array(coman().joint_names), contacts=np.arange(rows) % 2,
    )  # fmt: skip
    return path


def side(out, name):
    return json.loads((out / f"{name}.guard.json").read_text())


def told(out):
    return tables.read_frame(contract(0.002), out / "guard.parquet", coman().tag)


def audited(*paths):
    return run("audit", *paths, *ROBOT, "--acceleration", 60)


@pytest.fixture
def bad(tmp_path):
    return put(tmp_path / "in" / "bad.csv", colliding())


@pytest.fixture
def good(tmp_path):
    return put(tmp_path / "in" / "good.parquet", swaying())


# --- one file


def test_a_colliding_file_comes_out_certified_under_its_own_name(bad, tmp_path):
    out = tmp_path / "out"
    said = run("guard", bad, *ONE, "--out", out)
    assert said.exit_code == shell.OK, said.output
    assert "poses: " in said.output and "overlap by" in said.output
    assert "now: poses keep" in said.output and said.output.strip().endswith("0 left broken")
    assert audited(bad).exit_code == shell.BROKEN
    assert audited(out / "bad.csv").exit_code == shell.OK
    held = side(out, "bad.csv")
    assert held["holds"] and held["certificate"]["holds"] and held["file"] == "bad.csv"
    assert held["certificate"]["robot_hash"] == coman().digest
    assert held["before"]["poses"]["broken"] and not held["after"]["poses"]["broken"]
    assert str(tmp_path) not in json.dumps(held)
    row = told(out).row(0, named=True)
    assert row["status"] == folder.MADE and row["left_broken"] == 0 and row["joint"] == "RShLat"
    assert row["broken_poses"] == held["before"]["poses"]["broken"]
    assert 0.0 < row["moved"] <= row["touched"] <= 1.0 and row["clearance"] >= 0.002


def test_what_holds_comes_back_to_the_bit_and_so_does_what_came_out(good, bad, tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    assert run("guard", good, bad, *ONE, "--out", one).exit_code == shell.OK
    was, now = files.read(good), files.read(one / "good.parquet")
    assert (was.q == now.q).all() and (was.time == now.time).all()
    # A file that tells no speeds gets them, so that every row has a way to rest.
    assert told(one)["status"].to_list() == [folder.MADE, folder.MADE]
    assert told(one)["touched"].to_list()[0] == 0.0 and now.v is not None and was.v is None
    said = run("guard", one / "good.parquet", one / "bad.csv", *ONE, "--out", two)
    assert said.exit_code == shell.OK and "0.0 % touched" in said.output
    for name in ("good.parquet", "bad.csv"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


def test_all_that_is_not_ours_stays_to_the_bit(tmp_path):
    source = gmr(tmp_path / "a.npz", colliding())
    assert run("guard", source, *ONE, "--out", tmp_path / "out").exit_code == shell.OK
    was, now = np.load(source), np.load(tmp_path / "out" / "a.npz")
    assert [*was.files, "v"] == now.files and now["dof_pos"].dtype == np.float32
    assert now["v"].shape == now["dof_pos"].shape and now["v"].any()
    for name in set(was.files) - {"dof_pos"}:
        assert (was[name] == now[name]).all() and was[name].dtype == now[name].dtype
    assert (was["dof_pos"] != now["dof_pos"]).any()
    assert audited(tmp_path / "out" / "a.npz").exit_code == shell.OK


def test_a_file_in_degrees_stays_in_degrees(tmp_path):
    source = put(tmp_path / "deg.csv", np.rad2deg(colliding()))
    said = run("guard", source, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "read them with --degrees" in said.output
    assert not (tmp_path / "out" / "deg.csv").exists()
    said = run("guard", source, *ONE, "--out", tmp_path / "out", "--degrees")
    assert said.exit_code == shell.OK, said.output
    assert run("audit", tmp_path / "out" / "deg.csv", *ROBOT, "--degrees").exit_code == shell.OK


# --- the verification has the word


@pytest.mark.parametrize("change", [stays, too_hard])
def test_what_the_audit_refuses_is_not_written(bad, good, tmp_path, monkeypatch, change):
    lying(monkeypatch, change)
    out = tmp_path / "out"
    said = run("guard", bad, good, *ONE, "--out", out)
    assert said.exit_code == shell.BROKEN and "what would be written does not hold" in said.output
    assert not (out / "bad.csv").exists() and not (out / "bad.csv.guard.json").exists()
    assert (out / "good.parquet").exists()  # one bad file does not stop the others
    assert told(out)["status"].to_list() == [folder.REFUSED, folder.MADE]
    assert "1 refused" in said.output


@pytest.mark.parametrize("off", [(1e-4, 0.0), (0.0, 1e-4)])
def test_a_file_that_does_not_hold_what_was_proven_is_taken_away(bad, tmp_path, monkeypatch, off):
    honest = TextLayout.write
    monkeypatch.setattr(
        TextLayout, "write",
        lambda self, to, q, about, v: honest(self, to, [q[0] + off[0]], about, [v[0] + off[1]]),
    )  # fmt: skip
    said = run("guard", bad, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.BROKEN and "did not hold the motion that was" in said.output
    assert {p.name for p in (tmp_path / "out").iterdir()} == {".guard.lock", "guard.parquet"}


# --- looking only


def test_a_check_writes_nothing_and_decides_the_exit_status(bad, good, tmp_path):
    before = snapshot(tmp_path)
    said = run("guard", good, *ONE, "--check")
    assert said.exit_code == shell.OK and "nothing" in said.output
    said = run("guard", good, bad, *ONE, "--check")
    assert said.exit_code == shell.BROKEN and "overlap by" in said.output
    assert "2 files, 120 frames, 1 broken or unreadable" in said.output
    assert run("guard", good, tmp_path / "in", *ONE, "--check").exit_code == shell.BROKEN
    assert snapshot(tmp_path) == before


def test_one_of_out_and_check_is_wanted(good, tmp_path):
    for words in ([], ["--check", "--out", tmp_path / "out"]):
        said = run("guard", good, *ONE, *words)
        assert said.exit_code == shell.UNREADABLE and "--check" in said.output


def test_a_tighter_limit_is_broken_by_what_held(good):
    assert run("guard", good, *ONE, "--check", "--acceleration", "LShSag=1").exit_code == 1
    assert run("guard", good, *ONE, "--check", "--acceleration", "1").exit_code == 1
    assert run("guard", good, *ONE, "--check", "--speed-factor", 0.1).exit_code == 1
    assert run("guard", good, *ONE, "--check", "--margin", 0.01).exit_code == 0
    said = run("guard", good, *ONE, "--check", "--acceleration", "elbow=1")
    assert said.exit_code == shell.UNREADABLE and "names 'elbow'" in said.output


def test_json_is_one_document(good, bad, tmp_path):
    said = run("guard", good, bad, *ONE, "--check", "--json")
    tree = json.loads(said.stdout)
    assert not tree["holds"] and [f["status"] for f in tree["files"]] == ["certified", "broken"]
    said = run("guard", good, bad, *ONE, "--out", tmp_path / "out", "--json")
    tree = json.loads(said.stdout)
    assert tree["holds"] and tree["moved"]["left_broken"] == 0
    assert tree["files"][1]["moved"]["moved"] == tree["moved"]["moved"] > 0


# --- bad input


def nan(path):
    q = swaying()
    q[7, 3] = np.nan
    lines = [",".join(["time", *coman().joint_names])]
    lines += [",".join(map(repr, [i / 30, *row.tolist()])) for i, row in enumerate(q)]
    path.write_text("\n".join(lines) + "\n")


def wild(path):
    q = swaying()
    q[7, 3] = 90.0
    put(path, q)


def misnamed(path):
    names = [name.replace("LElbj", "LElbow") for name in coman().joint_names]
    files.write(trajectory.make("m", names, np.arange(60) / 30, swaying()), path)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (nan, "nan"),
        (wild, "mend or cut that row"),
        (misnamed, "joint 'LElbj' of coman is missing; is it 'LElbow'"),
        (lambda path: path.write_bytes(b""), "odd.csv"),
        (lambda path: path.write_bytes(b"\x00\xff" * 50), "odd.csv"),
    ],
)
def test_bad_input_is_one_line_and_the_others_are_written(good, tmp_path, spoil, says):
    odd = tmp_path / "in" / "odd.csv"
    spoil(odd)
    said = run("guard", odd, good, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE
    lines = said.stderr.splitlines()
    assert len(lines) == 1 and says in lines[0] and "odd.csv" in lines[0]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        ".guard.lock", "guard.parquet", "good.parquet", "good.parquet.guard.json",
    }  # fmt: skip
    assert told(tmp_path / "out")["why"].to_list()[0] in said.stderr


def test_no_file_at_all_is_one_line(tmp_path):
    said = run("guard", tmp_path / "none.csv", *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "none.csv" in said.output


# --- folders


@pytest.fixture
def tree(tmp_path):
    put(tmp_path / "in" / "a" / "one.csv", colliding())
    put(tmp_path / "in" / "b" / "one.csv", swaying())
    put(tmp_path / "in" / "b" / "two.npz", colliding(90))
    return tmp_path / "in"


def test_a_folder_keeps_its_tree_and_gets_a_table_and_a_line(tree, tmp_path):
    said = run("guard", tree, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    rows = told(tmp_path / "out")
    assert rows["file"].to_list() == ["a/one.csv", "b/one.csv", "b/two.npz"]
    assert rows["frames"].sum() == 210 and rows["left_broken"].sum() == 0
    line = said.output.strip().splitlines()[-1]
    assert line.startswith("3 files, 210 frames, ") and line.endswith("0 left broken")
    again = run("guard", tmp_path / "out", *ONE, "--out", tmp_path / "twice")
    assert again.exit_code == shell.OK and "0.0 % touched" in again.output
    assert len(told(tmp_path / "twice")) == 3  # the table is no motion


def test_links_keep_the_names_that_they_have(tree, tmp_path):
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "far.csv").symlink_to(tree / "a" / "one.csv")
    (tmp_path / "near.csv").symlink_to(tree / "b" / "one.csv")
    given = [tmp_path / "links", tmp_path / "near.csv"]
    said = run("guard", *given, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK, said.output
    assert told(tmp_path / "out")["file"].to_list() == ["far.csv", "near.csv"]
    said = run("guard", tmp_path / "links", *ONE, "--out", tree / "a")
    assert said.exit_code == shell.OK  # far.csv there is another file than one.csv
    said = run("guard", tmp_path / "near.csv", *ONE, "--out", tmp_path)
    assert said.exit_code == shell.UNREADABLE and "would be replaced" in said.output


def test_no_result_replaces_an_input_or_another_result(tree, tmp_path):
    put(tmp_path / "in2" / "one.csv", swaying())
    before = snapshot(tmp_path)
    for words in (
        [tree / "a" / "one.csv", "--out", tree / "a"],
        [tree / "a" / "one.csv", tree / "b" / "one.csv", "--out", tmp_path / "out"],
        [tree, "--out", tree],
        [tree, "--out", tree / "out"],
        [tree / "a", tmp_path / "in2", "--out", tmp_path / "out"],
    ):
        said = run("guard", *words, *ONE)
        assert said.exit_code == shell.UNREADABLE, said.output
        assert "another folder" in said.output or "two folders" in said.output
    assert snapshot(tmp_path) == before


# --- resume


def test_what_is_finished_is_kept_and_what_changed_is_made_anew(tree, tmp_path):
    out = tmp_path / "out"

    def kept(*words):
        said = run("guard", tree, *ONE, "--out", out, *words)
        assert said.exit_code == shell.OK, said.output
        return [line.split()[0] for line in said.output.splitlines() if "(kept)" in line]

    everything = ["a/one.csv", "b/one.csv", "b/two.npz"]
    assert kept() == []
    first = snapshot(out)
    assert kept() == everything and snapshot(out) == first
    put(tree / "a" / "one.csv", colliding(61))  # another input
    assert kept() == ["b/one.csv", "b/two.npz"]
    (out / "b" / "two.npz").write_bytes(b"damaged")
    assert kept() == ["a/one.csv", "b/one.csv"]
    (out / "b" / "one.csv.guard.json").unlink()
    assert kept() == ["a/one.csv", "b/two.npz"]
    (out / "b" / "one.csv.guard.json").write_text('{"format": "guard 1"}')
    assert kept() == ["a/one.csv", "b/two.npz"]
    assert kept("--acceleration", "50") == []  # another claim
    assert kept("--acceleration", "50", "--jobs", "2") == everything


def test_a_result_of_other_numbers_does_not_stand_in_for_one_that_is_refused(
    bad, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    assert run("guard", bad, *ONE, "--out", out).exit_code == shell.OK
    lying(monkeypatch, stays)
    said = run("guard", bad, *ONE, "--out", out, "--acceleration", 50)
    assert said.exit_code == shell.BROKEN and "its earlier result" in said.output
    assert {p.name for p in out.iterdir()} == {".guard.lock", "guard.parquet"}


@pytest.mark.parametrize("earlier", [False, True])
def test_what_somebody_else_put_there_is_not_taken_away(bad, tmp_path, monkeypatch, earlier):
    out = tmp_path / "out"
    if earlier:
        assert run("guard", bad, *ONE, "--out", out).exit_code == shell.OK
    out.mkdir(exist_ok=True)
    (out / "bad.csv").write_text("mine")
    lying(monkeypatch, stays)
    said = run("guard", bad, *ONE, "--out", out, "--acceleration", 50)
    assert said.exit_code == shell.BROKEN
    assert (out / "bad.csv").read_text() == "mine"


def alone(*words):
    return subprocess.Popen(
        [sys.executable, "-m", "s3le.cli", *map(str, words)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip


@pytest.mark.parametrize("jobs", [pytest.param(1, marks=pytest.mark.wide), 2])
def test_a_kill_leaves_whole_files_and_the_next_run_goes_on(tmp_path, jobs):
    for number in range(12):
        put(tmp_path / "in" / f"{number:02}.csv", colliding(90 + number))
    out = tmp_path / "out"
    words = ["guard", tmp_path / "in", *ROBOT, "--jobs", jobs, "--out", out]
    process = alone(*words)
    until = time.monotonic() + 240
    while not list(out.glob("*.guard.json")) and process.poll() is None:
        assert time.monotonic() < until, "no file got done"
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = {p.name.removesuffix(".guard.json") for p in out.glob("*.guard.json")}
    for name in done:
        assert side(out, name)["output_sha256"] == folder.fingerprint(out / name)
    said = run(*words[:-4], "--jobs", 1, "--out", out)
    assert said.exit_code == shell.OK, said.output
    assert {line.split()[0] for line in said.output.splitlines() if "(kept)" in line} == done
    assert not list(out.rglob("*.part"))
    assert len(list(out.glob("*.csv"))) == 12


@pytest.mark.parametrize("jobs", [2])
def test_many_processes_write_what_one_writes(tree, tmp_path, jobs):
    (tree / "odd.csv").write_text("none")
    one = run("guard", tree, *ONE, "--out", tmp_path / "one")
    many = run("guard", tree, *ROBOT, "--jobs", jobs, "--out", tmp_path / "many")
    assert one.exit_code == many.exit_code == shell.UNREADABLE
    assert one.stdout == many.stdout
    first, second = snapshot(tmp_path / "one"), snapshot(tmp_path / "many")
    del first[Path(".guard.lock")], second[Path(".guard.lock")]
    assert first == second


def test_two_writers_of_one_folder_are_told(good, tmp_path, monkeypatch):
    with lock.held(tmp_path / "out" / ".guard.lock", "out"):
        monkeypatch.setattr(lock, "held", partial(lock.held, patience=0.0))
        said = run("guard", good, *ONE, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "is being written by process" in said.output


@pytest.mark.slow
@pytest.mark.wide
@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_a_cluster_writes_what_one_process_writes(tree, tmp_path):
    pytest.importorskip("ray")
    said = run("guard", tree, *ROBOT, "--ray-address", "local", "--out", tmp_path / "far")
    assert said.exit_code == shell.OK, said.output
    assert run("guard", tree, *ONE, "--out", tmp_path / "near").exit_code == shell.OK
    first, second = snapshot(tmp_path / "far"), snapshot(tmp_path / "near")
    del first[Path(".guard.lock")], second[Path(".guard.lock")]
    assert first == second


def test_rows_of_a_layout_of_ours_say_what_they_are_now(good, bad, tmp_path):
    """The certificate that lies in our own files is the guard's, and the audit agrees."""
    source = put(tmp_path / "in" / "ours.parquet", colliding(), about={"certificate": {"old": 1}})
    assert run("guard", source, *ONE, "--out", tmp_path / "out").exit_code == shell.OK
    held = open_layout(tmp_path / "out" / "ours.parquet", coman())
    about = files.read(tmp_path / "out" / "ours.parquet").about
    assert about["certificate"]["holds"] is True and "old" not in about["certificate"]
    assert about["robot_hash"] == coman().digest and joint("RShLat") == 8
    assert held.episodes[0].q.shape == (60, 11)
