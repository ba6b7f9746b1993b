"""`s3le retarget` over many clips: what it keeps, what processes share, and what it says of all."""

import base64
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from command import run
from follower import Plain, led_by
from handmade import amc, asf, bvh, write
from worlds import coman

from s3le.cli import shell, shown
from s3le.errors import BundleError, CertificateError, EngineError, TableError
from s3le.human.origin import about_clip
from s3le.human.read import digest, fingerprint
from s3le.human.skeletons import read_frames
from s3le.motion import files
from s3le.retarget import stored, task
from s3le.retarget.clip import convert
from s3le.retarget.clips import LIMITED, retarget
from s3le.store import sidecar, tables
from s3le.tuples.engine import key, lock, parcel
from s3le.tuples.engine.task import Job

ROOT = Path(__file__).parents[1]
ROBOT = ["--robot", "coman"]


@pytest.fixture
def plain(monkeypatch):
    return led_by(monkeypatch, Plain)


@pytest.fixture
def clips(tmp_path):
    for number in range(3):
        put(tmp_path / "clips", number)
    return tmp_path / "clips"


def put(folder, number, frames=12):
    """A figure that lowers an arm, each a little farther; 30 Hz."""
    angles = np.linspace(0, 30 + 5 * number, frames + number)
    rows = [[0, 0, 0, 0, 0, 0, -a, 0, 0, 0, a / 2, 0] for a in angles]
    return write(folder / f"{number}.bvh", bvh(rows, order="ZXY", step=".0333333"))


class Choosy(Plain):
    def plan(self, x, dt, start=None, progress=None):
        if len(x) == 6:
            raise CertificateError("row 3 does not hold")
        return super().plan(x, dt, start, progress)


def motions(place):
    """The bytes of all motions in a folder."""
    return {p.name: p.read_bytes() for p in place.glob("[0-9]*") if p.suffix != ".json"}


def said_of(place):
    """All summaries in a folder, but for how long it took."""
    found = {p.name: json.loads(p.read_text()) for p in place.glob("*.json")}
    return {name: {k: v for k, v in tree.items() if k != "milliseconds_per_frame"}
            for name, tree in found.items()}  # fmt: skip


def told(place):
    return tables.read_frame(retarget(0.0005), place / "retarget.parquet", coman().tag)


def kept(said):
    assert said.exit_code == shell.OK, said.output
    return [line.split(".")[0] for line in said.stdout.splitlines() if line.endswith("(kept)")]


# --- the table and the line


def test_all_clips_get_a_table_and_a_line(clips, tmp_path, plain):
    out = tmp_path / "out"
    (clips / "lost.bvh").write_text("HIERARCHY\nnonsense")
    said = run("retarget", clips, *ROBOT, "--out", out)
    assert said.exit_code == shell.BROKEN
    rows = told(out)
    assert rows["file"].to_list() == [f"../clips/{n}.bvh" for n in ("0", "1", "2", "lost")]
    assert rows["status"].to_list() == ["certified"] * 3 + ["unreadable"]
    assert rows["frames"].to_list() == [12, 13, 14, None] and rows["rows"].sum() == 39
    assert rows["why"].to_list()[:3] == [""] * 3 and "lost.bvh" in rows["why"][3]
    assert (rows["clearance"].drop_nulls() >= 0.002).all()
    one, summary = rows.row(1, named=True), json.loads((out / "1.json").read_text())
    assert [one[k] for k in ("mean", "p95", "largest")] == [
        summary["to_human"][k] for k in ("mean", "p95", "largest")
    ]
    assert one["bound"] == summary["certified"]["proven_bound_m"] >= 0.0005
    assert one["limited"] == sum(summary["modes"].get(mode, 0) for mode in LIMITED)
    assert one["input_sha256"] == digest(clips / "1.bvh")
    assert one["output_sha256"] == sidecar.digest(out / "1.parquet")
    assert one["milliseconds"] == summary["milliseconds_per_frame"]["mean"] > 0.0
    line = said.stdout.splitlines()[-1]
    assert line.startswith("4 clips, 39 frames, 39 poses certified, 1.2 s, to the human 0.0")
    assert line.endswith("1 unreadable")
    assert "1 of 4 clips failed" in said.stderr


def test_a_clip_alone_has_a_table_and_is_its_own_line(tmp_path, plain):
    said = run("retarget", put(tmp_path, 1), *ROBOT, "--out", tmp_path / "out")
    assert said.exit_code == shell.OK and len(said.stdout.splitlines()) == 2
    assert told(tmp_path / "out")["frames"].to_list() == [13]


def test_lines_come_in_the_order_of_the_clips_whatever_is_kept(clips, tmp_path, plain):
    out = tmp_path / "out"
    assert kept(run("retarget", clips / "2.bvh", *ROBOT, "--out", out)) == []
    said = run("retarget", clips, *ROBOT, "--out", out)
    assert kept(said) == ["2"]
    assert [line.split(".bvh")[0] for line in said.stdout.splitlines()[1:4]] == ["0", "1", "2"]
    assert ", 1 kept" in said.stdout.splitlines()[-1]


def test_one_bad_clip_does_not_stop_the_others(clips, tmp_path, monkeypatch):
    led_by(monkeypatch, Choosy)
    put(clips, 0, frames=6)
    said = run("retarget", clips, tmp_path / "none.bvh", *ROBOT, "--out", tmp_path / "out")
    assert said.exit_code == shell.BROKEN
    rows = told(tmp_path / "out")
    assert rows["status"].to_list() == ["refused", "certified", "certified", "unreadable"]
    assert rows["why"][0] == f"{clips}/0.bvh: row 3 does not hold"
    assert rows["why"][-1] == f"{tmp_path}/none.bvh: No such file or directory"
    assert not list((tmp_path / "out").glob("0.*"))
    assert said.stdout.splitlines()[-1].endswith(", 1 refused, 1 unreadable")


@pytest.mark.parametrize(
    ("column", "value"),
    [("clearance", 0.0004), ("clearance", np.nan), ("bound", 0.0004), ("bound", None),
     ("status", "refused")],
)  # fmt: skip
def test_the_table_refuses_what_breaks_its_promise(clips, tmp_path, plain, column, value):
    run("retarget", clips / "0.bvh", *ROBOT, "--out", tmp_path / "out")
    good = told(tmp_path / "out")
    odd = good.with_columns(pl.lit(value, good[column].dtype).alias(column))
    with pytest.raises(TableError, match="rule"):
        retarget(0.0005).check(odd)


@pytest.mark.parametrize("command", ["audit", "guard"])
def test_the_table_beside_motions_is_no_motion(clips, tmp_path, plain, command):
    out = tmp_path / "out"
    assert run("retarget", clips, *ROBOT, "--out", out).exit_code == shell.OK
    given = sorted(out.glob("*.parquet"))
    more = ["--straight"]  # they come to rest at every row, harder than COMAN brakes
    if command == "guard":
        more = ["--acceleration", "inf", "--check", "--jobs", 1]
    said = run(command, *given, *ROBOT, *more)
    assert said.exit_code == shell.OK, said.output
    assert "retarget.parquet: note: is no motion but the table" in said.stderr
    assert run(command, given[-1], *ROBOT, *more).exit_code == shell.UNREADABLE
    loaded = shown.load(given, "none", "coman", None, None, False)
    assert [motion.path.name for motion in loaded.motions] == [
        "0.parquet",
        "1.parquet",
        "2.parquet",
    ]


# --- resume


def test_what_is_finished_is_kept_and_what_changed_is_made_anew(clips, tmp_path, plain):
    out = tmp_path / "out"

    def names(*words):
        return kept(run("retarget", clips, *ROBOT, "--out", out, *words))

    assert names() == []
    first, summaries = motions(out), said_of(out)
    assert names() == ["0", "1", "2"]
    assert names("--again") == [] and motions(out) == first and said_of(out) == summaries
    put(clips, 1, frames=15)  # another clip
    assert names() == ["0", "2"]
    (out / "0.parquet").write_bytes(b"damaged")
    assert names() == ["1", "2"]
    (out / "2.parquet").unlink()
    assert names() == ["0", "1"]
    (out / "2.json").unlink()
    assert names() == ["0", "1"]
    for words in ("{}", "[]", '{"format": "retarget 1"}', "{", "[" * 100_000):
        (out / "2.json").write_text(words)
        assert names() == ["0", "1"]
    tree = json.loads((out / "2.json").read_text())
    for part in ("rows", "modes", "to_human", "output_sha256", "certificate", "frames"):
        (out / "2.json").write_text(json.dumps(tree | {part: 1}))
        assert names() == ["0", "1"]
    (out / "2.json").write_text(json.dumps(tree | {"rows": tree["rows"] | {"seconds": np.nan}}))
    assert names() == ["0", "1"]
    assert names("--rate", 60) == [] and names("--rate", 60) == ["0", "1", "2"]  # other options
    assert names("--csv") == [] and names("--tilt-max", 50, "--csv") == []
    assert names("--tilt-max", 50, "--csv") == ["0", "1", "2"]
    (out / "1.csv.json").unlink()
    assert names("--tilt-max", 50, "--csv") == ["0", "2"]


def test_other_code_makes_all_anew(clips, tmp_path, plain, monkeypatch):
    out = tmp_path / "out"
    assert kept(run("retarget", clips, *ROBOT, "--out", out)) == []
    covered = {path.relative_to(ROOT).as_posix() for path in key.closure(task.Retargeting.module)}
    for file in ("human/bvh", "plan/whole", "retarget/stored", "retarget/outputs", "motion/text"):
        assert f"s3le/{file}.py" in covered
    own = key.fingerprint
    monkeypatch.setattr(key, "fingerprint", lambda task: own(task) | {"code": "another"})
    assert kept(run("retarget", clips, *ROBOT, "--out", out)) == []
    assert kept(run("retarget", clips, *ROBOT, "--out", out)) == ["0", "1", "2"]


def test_a_motion_that_leads_to_where_its_clip_lay_is_made_anew(clips, tmp_path, plain):
    out = tmp_path / "out"
    assert kept(run("retarget", clips, *ROBOT, "--out", out)) == []
    shutil.move(clips, tmp_path / "moved")
    assert kept(run("retarget", tmp_path / "moved", *ROBOT, "--out", out)) == []
    about = files.read(out / "0.parquet").about
    assert about["clip_file"] == "../moved/0.bvh"


def test_the_skeleton_of_an_amc_and_the_buffers_of_a_scene_are_part_of_the_clip(tmp_path):
    clip = write(tmp_path / "01_01.amc", amc({}, {}))
    assert fingerprint(clip) == digest(clip)  # nothing to lean on: its reader says so
    write(tmp_path / "01.asf", asf())
    one = fingerprint(clip)
    write(tmp_path / "01.asf", asf().replace("0.5", "0.6"))
    assert digest(clip) != one != fingerprint(clip)
    inside = "data:application/octet-stream;base64," + base64.b64encode(b"abc").decode()
    tree = {"asset": {}, "buffers": [{"uri": "a.bin"}, {"uri": inside}, {"uri": "../b"}, {}]}
    scene = write(tmp_path / "a.gltf", json.dumps(tree))
    assert fingerprint(scene) == digest(scene)
    write(tmp_path / "a.bin", b"1")
    one = fingerprint(scene)
    write(tmp_path / "a.bin", b"2")
    assert digest(scene) != one != fingerprint(scene)
    for odd in (b"", b"{", b'{"buffers": 3}', b'{"buffers": [3]}', b"[]", b"glTF\0"):
        assert fingerprint(write(tmp_path / "a.gltf", odd)) == digest(tmp_path / "a.gltf")


def test_a_clip_that_changes_while_it_is_read_is_not_written(clips, tmp_path, plain, monkeypatch):
    honest = task.read_frames

    def slow(path, *args, **more):
        frames = honest(path, *args, **more)
        if path.name == "1.bvh":
            path.write_bytes(path.read_bytes() + b"\n")
        return frames

    monkeypatch.setattr(task, "read_frames", slow)
    said = run("retarget", clips, *ROBOT, "--out", tmp_path / "out")
    assert said.exit_code == shell.BROKEN and "changed while it was read" in said.stderr
    assert not (tmp_path / "out" / "1.parquet").exists()
    assert told(tmp_path / "out")["status"].to_list() == ["certified", "unreadable", "certified"]


def test_an_earlier_result_of_a_clip_that_is_refused_stays_and_is_named(
    tmp_path, plain, monkeypatch
):
    clip, out = put(tmp_path, 0), tmp_path / "out"
    assert run("retarget", clip, *ROBOT, "--out", out).exit_code == shell.OK
    before = motions(out)
    said = run("retarget", clip, *ROBOT, "--out", out, "--rate", 5)
    assert said.exit_code == shell.BROKEN and motions(out) == before
    assert "its earlier result" in said.stderr and "its earlier result" in told(out)["why"][0]
    assert kept(run("retarget", clip, *ROBOT, "--out", out)) == ["0"]


def test_a_disk_that_refuses_one_result_leaves_the_others(clips, tmp_path, plain):
    out = tmp_path / "out"
    (out / "1.parquet" / "in the way").mkdir(parents=True)
    said = run("retarget", clips, *ROBOT, "--out", out)
    assert said.exit_code == shell.BROKEN
    assert told(out)["status"].to_list() == ["certified", "unreadable", "certified"]
    assert not (out / "1.json").exists() and not list(out.glob(".*.part"))


def test_no_result_takes_the_place_of_the_table_and_no_table_that_of_a_clip(tmp_path, plain):
    clip = put(tmp_path, 0)
    clip.rename(tmp_path / "retarget.bvh")
    said = run("retarget", tmp_path / "retarget.bvh", *ROBOT, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "is the name of the table" in said.stderr
    odd = tmp_path / "retarget.parquet"
    odd.write_bytes(b"PAR1")
    said = run("retarget", odd, *ROBOT, "--out", tmp_path)
    assert said.exit_code == shell.UNREADABLE and "would be replaced by the table" in said.stderr
    assert odd.read_bytes() == b"PAR1" and not (tmp_path / "out").exists()


def test_two_writers_of_one_folder_are_told(clips, tmp_path, plain, monkeypatch):
    with lock.held(tmp_path / "out" / ".retarget.lock", "out"):
        monkeypatch.setattr(lock, "held", partial(lock.held, patience=0.0))
        said = run("retarget", clips, *ROBOT, "--out", tmp_path / "out")
    assert said.exit_code == shell.UNREADABLE and "is being written by process" in said.stderr
    assert [p.name for p in (tmp_path / "out").iterdir()] == [".retarget.lock"]


# --- what goes to workers and comes back


def retargeting(clip, out, its, **changed):
    return task.Retargeting(
        robot=its.robot.tag, lead=task.Lead.of(its.robot, None, None),
        asked=task.Asked(**changed), words={"model": None}, written={},
        sources=(str(clip),), hashes=(fingerprint(clip),), origins=(about_clip(clip, out),),
    )  # fmt: skip


def test_what_comes_back_is_what_was_found_to_the_bit(tmp_path):
    clip, its = put(tmp_path, 1), Plain()
    asked = retargeting(clip, tmp_path, its, rate=60.0)
    found = task.decode(asked.answer(its, 0)).found
    about = {"model": None, **asked.origins[0]}
    frames = read_frames(clip, its.robot.neck)
    direct = convert(its, frames, rate=60.0, about=about)
    for name in ("time", "q", "clearance", "mode", "heading"):
        here, there = getattr(direct.motion, name), getattr(found.motion, name)
        assert here.tobytes() == there.tobytes() and here.dtype == there.dtype
    assert found.motion.about == direct.motion.about and found.motion.name == "1"
    files.write(found.motion, tmp_path / "a.parquet")
    files.write(direct.motion, tmp_path / "b.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_a_refusal_and_its_notes_come_back(tmp_path):
    its = Plain()
    asked = retargeting(put(tmp_path, 0), tmp_path, its, rate=5.0)
    answer = task.decode(asked.answer(its, 0))
    assert not answer.found.unreadable and answer.found.why.startswith(f"{tmp_path}/0.bvh: rate")
    assert task.decode(task.encode(answer._replace(notes=("a", "b")))).notes == ("a", "b")
    with pytest.raises(EngineError, match="cannot be sent as JSON"):
        parcel.pack({"a": float("nan")}, {})


def test_a_model_that_changes_meanwhile_is_refused_by_workers(tmp_path):
    held = tmp_path / "model"
    shutil.copytree(stored.ensure(coman()), held)
    lead = task.Lead.of(coman(), held, None)
    assert task.opened(lead).robot.tag == coman().tag and lead.files == ()
    with pytest.raises(BundleError, match="changed while clips were retargeted"):
        task.opened(lead._replace(digest="another"))


def test_every_option_that_can_change_a_result_is_in_the_key(tmp_path):
    clip, its = put(tmp_path, 0), Plain()
    plain = dict(retargeting(clip, tmp_path, its).about())
    changed = dict(
        fps=25.0, tilt_max=50.0, how=task.How(axes="z-up"), minority=True, rate=60.0, even=True,
        lead_in=1.0, others=task.Other("legs.npz", "../legs.npz", "hash"), jerk=900.0,
    )  # fmt: skip
    assert changed.keys() == set(task.Asked._fields)
    for name, value in changed.items():
        other = dict(retargeting(clip, tmp_path, its, **{name: value}).about())
        assert json.dumps(other) != json.dumps(plain), name
    legs, seen = changed["others"], set()
    for name in set(legs._fields) - {"path"}:
        other = retargeting(clip, tmp_path, its, others=legs._replace(**{name: ["another"]}))
        seen.add(json.dumps(dict(other.about())))
    assert len(seen) == len(legs) - 1


# --- the real retargeter, in processes


def alone(*words):
    return subprocess.Popen(
        [sys.executable, "-m", "s3le.cli", *map(str, words)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip


@pytest.mark.parametrize(
    "model", [pytest.param(False, marks=pytest.mark.wide), True], ids=["poses", "model"]
)
def test_many_processes_write_what_one_writes(clips, tmp_path, model):
    (clips / "lost.bvh").write_text("HIERARCHY\nnonsense")
    more = ["--model", stored.ensure(coman())] if model else []
    said = {}
    for jobs in (1, 2):
        out = tmp_path / str(jobs)
        said[jobs] = run("retarget", clips, *ROBOT, *more, "--jobs", jobs, "--csv", "--out", out)
        assert said[jobs].exit_code == shell.BROKEN, said[jobs].output
        assert len(list(out.glob("*.parquet"))) == 4
    assert said[1].stderr == said[2].stderr
    assert motions(tmp_path / "1") == motions(tmp_path / "2") != {}
    assert said_of(tmp_path / "1") == said_of(tmp_path / "2") != {}
    one, two = (told(tmp_path / name).drop("milliseconds") for name in ("1", "2"))
    assert one.equals(two)
    audited = run("audit", *sorted((tmp_path / "2").glob("[0-9].parquet")), *ROBOT)
    assert audited.exit_code == shell.OK and "3 of 3 files hold" in audited.output


@pytest.mark.parametrize("jobs", [pytest.param(1, marks=pytest.mark.wide), 2])
def test_a_kill_leaves_whole_files_and_the_next_run_goes_on(tmp_path, jobs):
    for number in range(10):
        put(tmp_path / "clips", number, frames=150)
    out, words = tmp_path / "out", ["retarget", tmp_path / "clips", *ROBOT, "--npz", "--jobs"]
    process = alone(*words, jobs, "--out", out)
    until = time.monotonic() + 240
    while len(list(out.glob("*.json"))) < 2 and process.poll() is None:
        assert time.monotonic() < until, "no clip got done"
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = {p.stem for p in out.glob("*.json")}
    assert 2 <= len(done) < 10, "killed too late to see anything"
    assert not (out / "retarget.parquet").exists()
    for name in done:
        held = json.loads((out / f"{name}.json").read_text())["output_sha256"]
        assert held == {f: sidecar.digest(out / f) for f in (f"{name}.parquet", f"{name}.npz")}
    said = run(*words, 1, "--out", out)
    assert set(kept(said)) == done
    assert not list(out.rglob("*.part"))
    assert run(*words, 1, "--out", tmp_path / "calm").exit_code == shell.OK
    assert motions(out) == motions(tmp_path / "calm") and len(motions(out)) == 20
    assert said_of(out) == said_of(tmp_path / "calm")
    same = [told(place).drop("milliseconds") for place in (out, tmp_path / "calm")]
    assert same[0].equals(same[1])


def test_a_worker_makes_what_this_process_makes(tmp_path):
    clip = put(tmp_path, 0)
    its = stored.retargeter_for(coman())
    asked = retargeting(clip, tmp_path, its)
    here = task.decode(asked.answer(its, 0)).found
    there = task.decode(asked.make(Job(0, 1)).data).found
    assert here.motion.q.tobytes() == there.motion.q.tobytes()
