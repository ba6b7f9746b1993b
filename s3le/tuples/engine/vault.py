"""Finished shards on disk, kept under their key, and their way into a table's folder.

    <root>/<table>-<key>/about.json       what the key stands for, to read
                        /000042.parquet   a shard, written under another name, synced, renamed
                        /000042.json      its record: rows, hash, counts; written after it
                        /lock, /complete

A shard without a record, or unlike its record, does not exist: it is made again. The table's own
folder holds hard links to the shards and a manifest; it is put in place when they are all there.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from s3le.store import documents, tables
from s3le.store.atomic import replace
from s3le.tuples.engine import lock
from s3le.tuples.engine.task import Counts, Job, Made, Task

COMPLETE = "complete"


class Shard(NamedTuple):
    """A finished shard."""

    job: Job
    path: Path
    sha256: str
    counts: Counts


def home(workspace: Path) -> Path:
    """Where shards are kept: beside the project's data, outside of any temporary experiment.

    `dvc exp run --temp` and `--queue` work in a copy below .dvc/tmp/exps of the project, which is
    removed afterwards; shards kept in the project itself outlive it, so that such runs resume too.
    """
    workspace = workspace.resolve()
    for folder in workspace.parents:
        if folder.parts[-3:] == (".dvc", "tmp", "exps"):
            workspace = folder.parents[2]
            break
    return workspace / "data" / "shards"


class Vault:
    """The finished shards of one key."""

    def __init__(self, root: Path, task: Task, key: str) -> None:
        """Name the folder; nothing is read or written yet."""
        self.root, self.table = root, task.table
        self.folder = root / f"{task.table}-{key}"
        self._full = task.shard_rows

    def open(self, about: Mapping[str, Any]) -> None:
        """Make the folder and write what its key stands for; call it under the lock."""
        self._complete.unlink(missing_ok=True)
        for left in self.folder.glob(".*.part"):
            left.unlink()  # by a run that was killed here
        documents.write_json(about, self.folder / "about.json")

    def close(self) -> None:
        """Note that the table is complete, so that a later run with another key may clear it."""
        documents.write_text("", self._complete)

    def lock(self, patience: float = lock.PATIENCE):
        """Context manager: be the only writer. Raises EngineError where another one is."""
        what = f"{self.table} ({self.folder.name})"
        return lock.held(self.folder / "lock", what, patience, lock.SHARDS)

    def find(self, job: Job, warn: Callable[[str], object]) -> Shard | None:
        """A finished shard, checked byte by byte against its record; None: to be made.

        Args:
            job: which shard.
            warn: called with a sentence where a shard was edited or damaged since; it is dropped.
        """
        path, record = self._paths(job)
        if not record.is_file() or not path.is_file():
            return None
        try:
            noted = json.loads(record.read_text(encoding="utf-8"))
            rows, digest, counts = noted["rows"], noted["sha256"], dict(noted["counts"])
            if rows == job.rows and _digest(path) == digest:
                return Shard(job, path, digest, counts)
        except (ValueError, KeyError, TypeError):
            pass  # a record that is none describes no shard
        warn(f"{path} is not what its record says (edited or damaged); making it anew")
        record.unlink()
        path.unlink()
        return None

    def put(self, made: Made) -> Shard:
        """Store a shard: the file first, then its record, each whole or not at all."""
        path, record = self._paths(made.job)
        digest = hashlib.sha256(made.data).hexdigest()
        replace(path, lambda part: part.write_bytes(made.data))
        noted = {"rows": made.job.rows, "sha256": digest, "counts": made.counts}
        documents.write_json(noted, record)
        return Shard(made.job, path, digest, made.counts)

    def publish(self, shards: list[Shard], note: Mapping[str, Any], out: Path) -> None:
        """Put a folder of links to the shards, with a manifest, in the place of out.

        Args:
            shards: all of the table's, in order.
            note: what the manifest says beside them.
            out: the table's folder.
        """
        out.parent.mkdir(parents=True, exist_ok=True)
        for left in out.parent.glob(f".{out.name}.*.part"):
            shutil.rmtree(left)  # by a run that was killed here; the caller holds out's lock
        part = out.with_name(f".{out.name}.{os.getpid()}.part")
        part.mkdir()
        try:
            listed = []
            for shard in shards:
                name = f"part-{shard.job.number:06d}.parquet"
                _link(shard.path, part / name)
                listed.append({"file": name, "rows": shard.job.rows, "sha256": shard.sha256})
            rows = sum(shard.job.rows for shard in shards)
            manifest = {"rows": rows, "shards": listed} | dict(note)
            documents.write_json(manifest, part / tables.MANIFEST)
            if out.is_dir() and not out.is_symlink():
                old = out.with_name(f".{out.name}.{os.getpid()}.old.part")
                os.replace(out, old)
                os.replace(part, out)
                shutil.rmtree(old)
            else:
                out.unlink(missing_ok=True)
                os.replace(part, out)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def prune(self) -> list[Path]:
        """Remove complete stores of this table under other keys: DVC's cache has their tables.

        Unfinished ones stay, so that a run that was stopped can go on.
        """
        gone = []
        for mark in sorted(self.root.glob(f"{self.table}-*/{COMPLETE}")):
            other = mark.parent
            if other != self.folder and lock.free(other / "lock"):
                shutil.rmtree(other)
                gone.append(other)
        return gone

    @property
    def _complete(self) -> Path:
        return self.folder / COMPLETE

    def _paths(self, job: Job) -> tuple[Path, Path]:
        # A shard that is cut short is another file than the whole one: both can be kept.
        name = f"{job.number:06d}" + ("" if job.rows == self._full else f"-{job.rows}")
        return self.folder / f"{name}.parquet", self.folder / f"{name}.json"


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without hard links
        shutil.copyfile(source, target)


def _digest(path: Path) -> str:
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
