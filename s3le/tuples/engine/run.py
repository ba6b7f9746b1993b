"""Make a table: find what is there, make what is missing, put it in place."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from s3le.errors import EngineError
from s3le.tuples.engine import key, local, lock
from s3le.tuples.engine.task import Counts, Job, Made, Progress, Task, jobs, total
from s3le.tuples.engine.vault import Vault, home

EXECUTORS = ("local", "ray")


@dataclass(frozen=True, kw_only=True)
class Where:
    """Who makes the shards; changes no row."""

    executor: str = "local"  # EXECUTORS
    workers: int = 0  # local processes; 0: one for every processor
    ray_address: str = "auto"  # of a running cluster, or "local" for one of this run's own


def produce(
    task: Task,
    rows: int,
    out: Path,
    where: Where,
    progress: Progress,
    warn: Callable[[str], object],
    shelf: Path | None = None,
) -> Counts:
    """Make a table's folder of shards, taking those that are finished already.

    However this process ends, finished shards stay, the table's folder is either the old one or
    the complete new one, and the next call goes on from there.

    Args:
        task: what the rows are.
        rows: how many.
        out: the table's folder.
        where: who makes them.
        progress: called with rows done since the last call and all counts so far.
        warn: called with sentences for the person who is watching.
        shelf: where shards are kept; None: vault.home of the current folder.

    Returns:
        The tasks' counts, summed over all shards.

    Raises:
        EngineError: another process writes the same table or key, or workers were lost.
        S3leError: what the task raises.
    """
    own = key.fingerprint(task)
    shelf = shelf or home(Path.cwd())
    vault = Vault(shelf, task, key.key(task, own))
    # A table has one writer, whatever its key: an older run that still lives would otherwise
    # put its rows where the new ones belong.
    with lock.held(out.with_name(f".{out.name}.lock"), str(out), kept=lock.SHARDS), vault.lock():
        vault.open({"task": dict(task.about()), "made with": own})
        all_jobs = jobs(rows, task.shard_rows)
        have = {}
        for job in all_jobs:
            if shard := vault.find(job, warn):
                have[job] = shard
        if have:
            done = sum(job.rows for job in have)
            progress(done, total(shard.counts for shard in have.values()))
        counts = total(shard.counts for shard in have.values())
        for made in spread(task, [job for job in all_jobs if job not in have], where, own):
            have[made.job] = vault.put(made)
            counts = total([counts, made.counts])
            progress(made.job.rows, counts)
        # Summed anew in order: a sum of floats depends on the order in which shards got done.
        shards = [have[job] for job in all_jobs]
        vault.publish(shards, task.note(), out)
        vault.close()
        vault.prune()
    return total(shard.counts for shard in shards)


def spread(task: Task, todo: list[Job], where: Where, own: dict[str, str]) -> Iterator[Made]:
    """Make shards, in whatever order they get done; nothing is written.

    Args:
        task: what they are made of.
        todo: which ones.
        where: who makes them.
        own: fingerprint of this process (key.fingerprint), which every worker must share.

    Raises:
        EngineError: no such executor, or workers were lost.
        S3leError: what the task raises.
    """
    if where.executor == "local":
        return local.make(task, todo, where.workers, own)
    if where.executor == "ray":
        from s3le.tuples.engine import cluster  # ray is an extra, and slow to import

        return cluster.make(task, todo, where.ray_address, own)
    raise EngineError(f"executor must be one of {', '.join(EXECUTORS)}, got {where.executor!r}")
