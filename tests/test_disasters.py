"""Kills, full disks, edited tables, foreign locks, two runs at once: one line, no half of a file.

Whatever happens to a run, each of its results is absent or whole, and the next run completes with
the bytes of a calm one.
"""

import os
import random
import resource
import shutil
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML
from stages import run, stale, stopped
from tiny import after_kills, environment, good, mend, set_params, shell

pytestmark = pytest.mark.slow
WIDE = pytest.mark.wide
STAGES = (  # each way of writing once
    "pair",  # files that are put in place one by one
    "sample",  # shards that outlive a run
    "train@s3le",  # a checkpoint that is gone on from
    "export",  # a folder that takes another's place
    pytest.param("robot", marks=WIDE),  # files again, into one folder
    pytest.param("report", marks=WIDE),  # files again, pictures and a page
)
FIRST = ("robot", "clips", "skeletons")  # what a run for the skeletons makes
OUT_OF_DISK = ("File too large", "No space left on device")


@cache  # for ruamel.yaml it is long
def parsed(lock: str) -> dict:
    return YAML(typ="safe").load(lock)["stages"]


def outs(folder: Path, stage: str) -> list[Path]:
    """The results of a stage, files and folders, as committed."""
    lock = parsed(good(folder, "git", "show", "HEAD:dvc.lock"))[stage]
    base = folder / "data" / "clips" if stage == "clips" else folder
    return [Path(os.path.normpath(base / out["path"])) for out in lock["outs"]]


def files(folder: Path, stages: tuple[str, ...] | list[str]) -> dict[str, bytes]:
    """Results of stages by path, as far as they are there, with parts that somebody left."""
    found: dict[str, bytes] = {}
    for out in (out for stage in stages for out in outs(folder, stage)):
        for path in [*out.parent.glob(f".{out.name}*"), out, *out.rglob("*")]:
            if path.is_file() and not path.name.endswith(".lock"):
                found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def forget(folder: Path, stages: tuple[str, ...] | list[str]) -> None:
    """Remove the results of stages, and all that a run could take instead of making them."""
    for name in ("data/shards", "data/checkpoints", ".dvc/cache"):
        shutil.rmtree(folder / name, ignore_errors=True)
    for out in (out for stage in stages for out in outs(folder, stage)):
        shutil.rmtree(out) if out.is_dir() else out.unlink(missing_ok=True)


def command(stage: str) -> list[str]:
    name, *argument = stage.split("@")
    return [sys.executable, "-m", f"pipeline.{name}", *argument]


def in_one_line(done: subprocess.CompletedProcess) -> str:
    """What a stage said when it stopped."""
    assert done.returncode == 2, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_is_out_of_disk_and_then_killed_leaves_nothing_half_written(
    here, stage, monkeypatch
):
    luck = random.Random(stage)
    calm = files(here, [stage])
    forget(here, [stage])
    most = luck.randrange(max(map(len, calm.values())))  # [bytes] that a file may have

    begin = time.monotonic()
    done = subprocess.run(
        command(stage), cwd=here, env=environment(here), capture_output=True, text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )  # fmt: skip
    lasted = time.monotonic() - begin
    line = in_one_line(done)
    assert line.startswith(f"stage '{stage}': ") and OUT_OF_DISK[0] in line
    assert line.endswith("nothing was half-written, run it again")
    assert files(here, [stage]).items() <= calm.items()

    victim = subprocess.Popen(
        command(stage), cwd=here, env=environment(here),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    time.sleep(luck.uniform(0.5, 1.05) * lasted)  # imports take the first half
    victim.kill()
    victim.wait()
    left = {name: data for name, data in files(here, [stage]).items() if ".part" not in name}
    assert left.items() <= calm.items()

    if stage == "train@s3le":  # it sets torch up for its process
        good(here, *command(stage))
    else:
        run(stage, here, monkeypatch)
    assert files(here, [stage]) == calm


@WIDE  # the same of one stage: test_pipeline
def test_dvc_killed_at_any_moment_goes_on_to_the_bytes_of_a_calm_run(here):
    luck, calm = random.Random(5), files(here, FIRST)
    forget(here, FIRST)
    killed = 0
    while killed < 5:
        top = subprocess.Popen(
            ["sh", "-c", "exec dvc repro skeletons > said 2>&1"], cwd=here, env=environment(here)
        )
        time.sleep(luck.uniform(0.5, 6.0))
        if top.poll() is None:
            top.kill()
            killed += 1
        if top.wait() > 0:  # it was killed while it wrote a file of its own, which it says
            mend(here, (here / "said").read_text())
        elif top.returncode == 0:
            forget(here, FIRST)  # all was done; over again
        left = {name: data for name, data in files(here, FIRST).items() if ".part" not in name}
        assert left.items() <= calm.items()
    good(here, "git", "checkout", "-q", "dvc.lock")
    after_kills(here, "dvc", "repro", "skeletons")
    assert files(here, FIRST) == calm
    assert not stale(here, "skeletons")


@pytest.fixture
def disk(here):
    """The project's data on a disk of its own, of 64 MiB."""
    folder = here / "data"
    how = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)]
    if not shutil.which("mount") or os.geteuid() or subprocess.run(how, check=False).returncode:
        pytest.skip("no right to mount a small disk here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("left_free", [pytest.param(0, marks=WIDE), 60_000])  # [bytes]
def test_dvc_on_a_full_disk_stops_with_a_line_and_goes_on_when_there_is_room(
    here, kept, disk, left_free
):
    shutil.copytree(kept / "data", disk, dirs_exist_ok=True)
    calm = files(here, FIRST)
    forget(here, FIRST)
    room = shutil.disk_usage(disk).free - left_free
    with (disk / "ballast").open("wb") as ballast:
        os.posix_fallocate(ballast.fileno(), 0, room)
    done = shell(here, "dvc", "repro", "skeletons")
    said = done.stdout + done.stderr
    assert done.returncode != 0 and "Traceback" not in said
    # Where the disk has room for the file and not for dvc's trial of a link to it, dvc says
    # the second.
    assert OUT_OF_DISK[1] in said or "No possible cache link types" in said, said
    assert files(here, FIRST).items() <= calm.items()
    (disk / "ballast").unlink()
    good(here, "git", "checkout", "-q", "dvc.lock")
    good(here, "dvc", "repro", "skeletons")
    assert files(here, FIRST) == calm


# --- what somebody did to the files


def lower_one_clearance(rows: pa.Table) -> pa.Table:
    values = rows["clearance"].to_pylist()
    values[3] = -0.01
    return rows.set_column(rows.schema.get_field_index("clearance"), "clearance", [values])


def another_row_order(rows: pa.Table) -> pa.Table:
    return rows.take(list(range(len(rows)))[::-1])


def without_metadata(rows: pa.Table) -> pa.Table:
    return rows.replace_schema_metadata(None)


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (lower_one_clearance, "rule 'collision_free' fails on 1 of"),
        (without_metadata, "is not a 'mocap_pairs' table"),
        (b"\0", "is not readable as Parquet"),
    ],
    ids=["an unsafe row", "saved by another program", "a byte"],
)
def test_a_table_edited_by_hand_is_refused(here, edit, why, monkeypatch, capfd):
    path = here / "data" / "mocap_pairs.parquet"
    if callable(edit):
        pq.write_table(edit(pq.read_table(path)), path)
    else:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(data)
    line = stopped("index@skeleton_pairs", here, monkeypatch, capfd)
    assert line.startswith("TableError: data/mocap_pairs.parquet") and why in line
    assert line.endswith("write it with: dvc repro pair")


def test_rows_in_another_order_are_seen_by_dvc_and_made_anew(here):
    path, calm = here / "data" / "mocap_pairs.parquet", files(here, ["pair"])
    pq.write_table(another_row_order(pq.read_table(path)), path)
    assert "data/mocap_pairs.parquet" in str(stale(here, "pair")["pair"])
    good(here, "dvc", "repro", "pair")
    assert files(here, ["pair"]) == calm


def test_a_lock_of_another_commit_gives_this_commit_s_bytes(here):
    calm = files(here, FIRST)
    set_params(here, {"skeletons": {"domain_rows": 200}})
    good(here, "dvc", "repro", "skeletons")
    other = files(here, FIRST)
    assert other != calm
    good(here, "git", "checkout", "-q", "params.yaml")  # dvc.lock and tables stay the other's
    assert "skeletons" in stale(here, "skeletons")
    good(here, "dvc", "repro", "skeletons")
    assert files(here, FIRST) == calm


def test_a_lock_whose_tables_nobody_has_or_with_a_merge_conflict_ends_in_a_line(here):
    calm = files(here, FIRST)
    forget(here, FIRST)
    done = shell(here, "dvc", "checkout", "data/skeletons.parquet")
    assert done.returncode != 0 and "Traceback" not in done.stderr
    assert "skeletons.parquet" in done.stderr
    lock = here / "dvc.lock"
    lock.write_text(
        lock.read_text().replace("  skeletons:", "<<<<<<< ours\n  skeletons:\n=======\n", 1)
    )
    done = shell(here, "dvc", "repro", "skeletons")
    assert done.returncode != 0 and "Traceback" not in done.stderr and "dvc.lock" in done.stderr
    good(here, "git", "checkout", "-q", "dvc.lock")
    good(here, "dvc", "repro", "skeletons")
    assert files(here, FIRST) == calm


# --- two at once


def both(folder: Path, *words: str) -> list[tuple[int, str]]:
    """Start a command twice; the status and the words of each."""
    twins = [
        subprocess.Popen(
            words, cwd=folder, env=environment(folder), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )
        for _ in range(2)
    ]  # fmt: skip
    said = [twin.communicate()[0] for twin in twins]
    return [(twin.returncode, words) for twin, words in zip(twins, said, strict=True)]


def test_of_two_runs_at_once_one_completes_and_the_other_says_who_is_in_its_way(here):
    calm = files(here, FIRST)
    forget(here, FIRST)
    for status, said in both(here, "dvc", "repro", "skeletons"):
        assert "Traceback" not in said
        assert status == 0 or "lock" in said or "busy" in said, said
    good(here, "dvc", "repro", "skeletons")
    assert files(here, FIRST) == calm


@pytest.mark.parametrize("stage", ["pair", "sample", pytest.param("train@s3le", marks=WIDE)])
def test_the_same_stage_twice_at_once_writes_the_same_bytes(here, stage):
    calm = files(here, [stage])
    forget(here, [stage])
    before = set(psutil.Process().children(recursive=True))  # multiprocessing's tracker
    for status, said in both(here, *command(stage)):
        assert status == 0, said
    assert files(here, [stage]) == calm
    assert set(psutil.Process().children(recursive=True)) <= before
