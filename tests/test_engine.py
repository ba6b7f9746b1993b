"""The engine: rows are the same however they were made, and nothing of a stopped run is lost."""

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from toys import Toy

from s3le.errors import EngineError, RobotError
from s3le.kernels import batch, threads
from s3le.tuples.engine import key, local, lock, run
from s3le.tuples.engine.task import Job, jobs, total
from s3le.tuples.engine.vault import COMPLETE, Vault, home
from s3le.tuples.shards import PoseShards

TESTS = Path(__file__).parent
SHARDS = PoseShards(files=(), seed=1, shard_rows=1)  # stands for the code that makes real rows


def make(folder, rows=95, toy=None, workers=1, said=None):
    """Make a table in folder/out with its shards beside it."""
    told = []
    run.produce(
        toy or Toy(), rows, folder / "out", run.Where(workers=workers),
        lambda *args: told.append(args), (said if said is not None else []).append,
        folder / "shelf",
    )  # fmt: skip
    return told


def contents(folder):
    return {path.name: path.read_bytes() for path in (folder / "out").iterdir()}


def shards(folder):
    """The files of all finished shards."""
    return sorted((folder / "shelf").rglob("0*.parquet"))


def started(folder, toy, rows=95, workers=2):
    """A process of its own that makes a toy table."""
    words = [sys.executable, str(TESTS / "toys.py"), str(folder / "out"), str(rows), str(workers)]
    process = subprocess.Popen(
        words + toy.words(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": f"{TESTS}:{TESTS.parent}"},
    )  # fmt: skip
    wait_until(lambda: (folder / "shelf").exists())
    return process


def wait_until(true, seconds=20.0):
    until = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.02)


# --- shards


@pytest.mark.parametrize(("rows", "size"), [(1, 10), (10, 10), (95, 10), (100, 10), (7, 1)])
def test_all_shards_are_equal_but_the_last(rows, size):
    todo = jobs(rows, size)
    assert [job.number for job in todo] == list(range(len(todo)))
    assert {job.rows for job in todo[:-1]} <= {size} and 0 < todo[-1].rows <= size
    assert sum(job.rows for job in todo) == rows


@pytest.mark.parametrize(("rows", "size"), [(0, 10), (-1, 10), (10, 0)])
def test_no_rows_and_no_shard_size_are_refused(rows, size):
    with pytest.raises(EngineError, match="cannot make"):
        jobs(rows, size)


def test_the_folder_holds_every_shard_and_a_manifest_that_names_them(tmp_path):
    make(tmp_path)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["rows"] == 95 and len(manifest["shards"]) == 10
    assert contents(tmp_path).keys() == {s["file"] for s in manifest["shards"]} | {"manifest.json"}
    toy = Toy()
    for job in jobs(95, 10):
        assert contents(tmp_path)[f"part-{job.number:06d}.parquet"] == toy.make(job).data


@pytest.mark.parametrize("workers", [2, 3], ids=str)
def test_the_number_of_workers_changes_no_byte(tmp_path, workers):
    make(tmp_path / "one")
    make(tmp_path / "many", workers=workers)
    assert contents(tmp_path / "one") == contents(tmp_path / "many")


def test_progress_tells_rows_and_counts(tmp_path):
    told = make(tmp_path)
    assert sum(rows for rows, _ in told) == 95
    assert told[-1][1] == {"rows": 95, "tenths": pytest.approx(9.5)}
    assert make(tmp_path)[0][0] == 95  # all found at once


def test_counts_add_up_by_name():
    assert total([{"a": 1}, {"a": 2, "b": 0.5}]) == {"a": 3, "b": 0.5}


# --- what is finished is kept


def test_a_second_run_makes_nothing_and_gives_the_same(tmp_path):
    make(tmp_path)
    before, stamps = contents(tmp_path), [path.stat().st_mtime_ns for path in shards(tmp_path)]
    make(tmp_path)
    assert contents(tmp_path) == before
    assert [path.stat().st_mtime_ns for path in shards(tmp_path)] == stamps


def test_more_rows_keep_the_shards_that_are_there(tmp_path):
    make(tmp_path, rows=40)
    first = (tmp_path / "out" / "part-000000.parquet").stat().st_ino
    make(tmp_path, rows=95)
    assert (tmp_path / "out" / "part-000000.parquet").stat().st_ino == first
    make(tmp_path / "fresh", rows=95)
    assert contents(tmp_path) == contents(tmp_path / "fresh")


def test_fewer_rows_leave_no_shard_too_many(tmp_path):
    make(tmp_path, rows=95)
    make(tmp_path, rows=33)
    make(tmp_path / "fresh", rows=33)
    assert contents(tmp_path) == contents(tmp_path / "fresh")


def test_a_changed_parameter_leaves_no_old_row(tmp_path):
    make(tmp_path, toy=Toy(seed=1))
    make(tmp_path, toy=Toy(seed=2))
    make(tmp_path / "fresh", toy=Toy(seed=2))
    assert contents(tmp_path) == contents(tmp_path / "fresh")
    assert len(list((tmp_path / "shelf").iterdir())) == 1  # the complete store of seed 1 is gone


def test_an_unfinished_store_of_another_key_stays(tmp_path):
    make(tmp_path, toy=Toy(seed=1))
    (other,) = (tmp_path / "shelf").iterdir()
    (other / COMPLETE).unlink()
    make(tmp_path, toy=Toy(seed=2))
    assert other.is_dir()


def test_a_store_that_somebody_writes_is_not_cleared(tmp_path):
    make(tmp_path, toy=Toy(seed=1))
    (other,) = (tmp_path / "shelf").iterdir()
    with lock.held(other / "lock", "it"):
        make(tmp_path, toy=Toy(seed=2))
    assert other.is_dir()


@pytest.mark.parametrize(
    "harm",
    [
        lambda shard: shard.write_bytes(shard.read_bytes()[:-1] + b"?"),
        lambda shard: shard.write_bytes(b""),
        lambda shard: shard.with_suffix(".json").write_text("{"),
        lambda shard: shard.with_suffix(".json").write_text('{"rows": 10}'),
        lambda shard: shard.with_suffix(".json").write_text(
            '{"rows": 9, "sha256": "", "counts": {}}'
        ),
    ],
    ids=["edited", "emptied", "cut record", "partial record", "lying record"],
)
def test_a_shard_that_was_tampered_with_is_told_and_made_anew(tmp_path, harm):
    make(tmp_path)
    before = contents(tmp_path)
    harm(shards(tmp_path)[3])
    said = []
    make(tmp_path, said=said)
    assert contents(tmp_path) == before
    assert len(said) == 1 and said[0].endswith(
        "000003.parquet is not what its record says (edited or damaged); making it anew"
    )


def test_a_file_without_its_record_is_no_shard(tmp_path):
    make(tmp_path)
    before = contents(tmp_path)
    shards(tmp_path)[0].with_suffix(".json").unlink()
    shards(tmp_path)[0].write_bytes(b"half of i")
    make(tmp_path)
    assert contents(tmp_path) == before


def test_what_a_killed_run_left_is_cleared(tmp_path):
    make(tmp_path)
    (tmp_path / ".out.123.part").mkdir()
    (tmp_path / ".out.123.part" / "x").touch()
    (store,) = (tmp_path / "shelf").iterdir()
    (store / ".000001.parquet.123.part").touch()
    make(tmp_path)
    assert not list(tmp_path.rglob("*.part"))


# --- the key


def test_the_key_covers_parameters_and_all_that_rows_are_computed_with(monkeypatch):
    own = key.fingerprint(SHARDS)
    base = key.key(Toy(), own)
    assert key.key(Toy(), own) == base
    others = [key.key(Toy(seed=2), own), key.key(Toy(shard_rows=11), own)]
    others += [key.key(Toy(), own | {name: "another"}) for name in own]
    assert len({base, *others}) == 1 + len(others)
    assert {"code", "processor", "precision", "libc", "numba", "coal"} <= own.keys()


def test_one_edited_line_of_projection_code_is_another_key(tmp_path, monkeypatch):
    shutil.copytree(key.ROOT / "s3le", tmp_path / "s3le", ignore=shutil.ignore_patterns("__pyc*"))
    before = key.fingerprint(SHARDS)["code"]
    monkeypatch.setattr(key, "ROOT", tmp_path)
    monkeypatch.setattr(key.closure, "__defaults__", (tmp_path,))
    monkeypatch.setattr(key.file_of, "__defaults__", (tmp_path,))
    assert key.fingerprint(SHARDS)["code"] == before
    solver = tmp_path / "s3le" / "kernels" / "solver.py"
    solver.write_text(solver.read_text().replace("_SLACK = 1e-6", "_SLACK = 2e-6"))
    assert key.fingerprint(SHARDS)["code"] != before


def test_code_that_makes_no_row_is_not_in_the_key():
    files = {path.relative_to(key.ROOT).as_posix() for path in key.closure("s3le.tuples.shards")}
    assert {"s3le/kernels/solver.py", "s3le/robot/certificate.py", "s3le/rng.py"} <= files
    assert not files & {"s3le/learn/training.py", "s3le/report/document.py", "s3le/human/bvh.py"}


def test_a_worker_that_computes_with_something_else_is_named():
    own = key.fingerprint(Toy())
    key.require_same(Toy(), own)
    with pytest.raises(EngineError, match="its processor is .*, the caller's is 'znver9 abc'"):
        key.require_same(Toy(), own | {"processor": "znver9 abc"})


# --- one writer


def test_a_second_writer_is_told_who_the_first_is(tmp_path, monkeypatch):
    monkeypatch.setattr(lock, "PATIENCE", 0.2)
    monkeypatch.setattr(lock.held.__wrapped__, "__defaults__", (0.2, ""))
    process = started(tmp_path, Toy(seconds=0.5))
    try:
        wait_until(lambda: shards(tmp_path))
        with pytest.raises(EngineError, match=f"out is being written by process {process.pid} on"):
            make(tmp_path, toy=Toy(seed=3))  # another key, but the same table
    finally:
        process.kill()
        process.wait()
    make(tmp_path, toy=Toy(seed=3))  # the lock died with its holder


def test_a_waiting_writer_goes_on_when_the_first_is_done(tmp_path):
    process = started(tmp_path, Toy(seconds=0.01))
    make(tmp_path, toy=Toy())
    assert process.wait(timeout=20) == 0
    make(tmp_path / "fresh")
    assert contents(tmp_path) == contents(tmp_path / "fresh")


# --- deaths


def test_a_worker_that_dies_is_replaced_and_its_shard_made(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    for number in range(2, 10):  # only shards 0 and 1 kill their worker
        (marks / str(number)).touch()
    make(tmp_path, toy=Toy(dies_in=str(marks)), workers=2)
    make(tmp_path / "fresh")
    assert contents(tmp_path) == contents(tmp_path / "fresh")


def test_workers_that_only_die_end_the_run_in_one_line(tmp_path):
    with pytest.raises(EngineError, match="toy: a worker died 3 times before it had made a shard"):
        make(tmp_path, toy=Toy(always_dies=True), workers=2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("workers", [1, 2], ids=str)
def test_a_refusal_of_the_task_arrives_as_it_was_raised(tmp_path, workers):
    with pytest.raises(RobotError, match="shard 4 is refused"):
        make(tmp_path, toy=Toy(refuses=4), workers=workers)
    assert not (tmp_path / "out").exists() and shards(tmp_path)
    make(tmp_path, workers=workers)  # same key: what was finished is taken
    make(tmp_path / "fresh")
    assert contents(tmp_path) == contents(tmp_path / "fresh")


def test_workers_end_with_the_process_that_called_them(tmp_path):
    process = started(tmp_path, Toy(seconds=0.3))
    wait_until(lambda: shards(tmp_path))
    children = psutil.Process(process.pid).children(recursive=True)
    assert children
    process.kill()
    process.wait()
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive


def spawned():
    """Workers of this process: multiprocessing's own tracker stays as long as we do."""
    below = psutil.Process().children(recursive=True)
    return [child for child in below if "spawn_main" in " ".join(child.cmdline())]


@pytest.mark.parametrize("refuses", [-1, 0], ids=["done", "refused"])
def test_no_worker_is_left_when_a_table_is_done_or_refused(tmp_path, refuses):
    with suppress(RobotError):
        make(tmp_path, toy=Toy(refuses=refuses), workers=2)
    assert not spawned()


def test_a_caller_who_turns_away_does_not_wait_for_shards_at_work(tmp_path):
    """A quick shard arrives; the other worker would be at work on its own for a minute."""
    quick = Toy(seconds=60.0, quick=0)
    made = local.make(quick, jobs(20, 10), 2, key.fingerprint(quick))
    assert next(made).job.number == 0 and spawned()
    began = time.monotonic()
    made.close()
    assert not spawned()
    assert time.monotonic() - began < 30.0


def test_killed_at_random_moments_it_ends_with_the_bytes_of_an_undisturbed_run(tmp_path):
    """Twelve kills of a worker or of the caller; the pipeline's own are in test_pipeline."""
    luck, kills, toy = random.Random(5), 0, Toy(seconds=0.02)
    make(tmp_path / "calm", rows=600)
    process = started(tmp_path, toy, rows=600)
    while kills < 12:
        time.sleep(luck.uniform(0.05, 0.8))
        if process.poll() is None:
            victims = [psutil.Process(process.pid)]
            try:
                victims += victims[0].children(recursive=True)
            except psutil.NoSuchProcess:
                pass
            victim = luck.choice(victims)
            try:
                victim.send_signal(signal.SIGKILL)
                kills += 1
            except psutil.NoSuchProcess:
                continue
        else:
            process = started(tmp_path, toy, rows=600, workers=luck.choice([1, 2, 3]))
    process.kill()
    process.wait()
    make(tmp_path, rows=600)
    assert contents(tmp_path) == contents(tmp_path / "calm")


# --- disks


def test_a_full_disk_ends_in_one_line_and_can_be_gone_on_from(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = shutil.which("mount") and os.geteuid() == 0
    if mounted:
        mounted = not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)],
            capture_output=True, check=False,
        ).returncode  # fmt: skip
    if not mounted:
        pytest.skip("no right to mount a small disk here")
    try:
        with pytest.raises(OSError, match="No space left on device"):
            make(disk, rows=2000, toy=Toy(shard_rows=50))
        assert not (disk / "out").exists() and not list(disk.rglob("*.part"))
        kept = shards(disk)
        assert kept
        subprocess.run(["mount", "-o", "remount,size=4m", str(disk)], check=True)
        told = make(disk, rows=2000, toy=Toy(shard_rows=50))
        assert told[0][0] >= 50 * (len(kept) - 1)
        make(tmp_path / "fresh", rows=2000, toy=Toy(shard_rows=50))
        assert contents(disk) == contents(tmp_path / "fresh")
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_file_that_may_not_grow_is_an_error_and_leaves_nothing(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            make(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (tmp_path / "out").exists() and not list(tmp_path.rglob("*.part"))


def test_another_file_system_gets_copies(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError("cross-device link")

    monkeypatch.setattr(os, "link", refuse)
    make(tmp_path)
    make(tmp_path / "fresh")
    assert contents(tmp_path) == contents(tmp_path / "fresh")


# --- where


def test_temporary_experiments_share_the_project_s_shards(tmp_path):
    assert home(tmp_path) == tmp_path / "data" / "shards"
    inside = tmp_path / ".dvc" / "tmp" / "exps" / "standalone" / "xyz"
    inside.mkdir(parents=True)
    assert home(inside) == tmp_path / "data" / "shards"


def test_an_unknown_executor_is_refused(tmp_path):
    where = run.Where(executor="slurm")
    with pytest.raises(EngineError, match="executor must be one of local, ray, got 'slurm'"):
        run.produce(Toy(), 5, tmp_path / "out", where, print, print, tmp_path / "shelf")


def test_a_worker_uses_one_thread():
    threads.use_threads(1)
    try:
        assert batch.workers() == 1
    finally:
        threads.use_threads(0)
    assert batch.workers() == threads.processors()


def test_a_vault_keeps_a_cut_shard_beside_the_whole_one(tmp_path):
    toy = Toy()
    vault = Vault(tmp_path, toy, "k")
    vault.open({})
    for job in (Job(0, 10), Job(0, 4)):
        vault.put(toy.make(job))
        assert vault.find(job, print).path.read_bytes() == toy.make(job).data
