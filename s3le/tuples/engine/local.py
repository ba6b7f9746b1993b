"""Shards made by processes of this machine, one thread each.

A worker only computes; the calling process alone writes. A worker that dies is replaced and its
shard made again; a worker whose caller dies ends by itself.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for

from s3le.errors import EngineError
from s3le.kernels.threads import processors, use_threads
from s3le.tuples.engine.key import require_same
from s3le.tuples.engine.task import Job, Made, Task

AHEAD = 2  # shards in flight for each worker: one at work, one waiting
DEATHS = 3  # of workers in a row without a shard between them, after which we give up
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "POLARS_MAX_THREADS": "1",
}


def make(task: Task, todo: list[Job], workers: int, own: Mapping[str, str]) -> Iterator[Made]:
    """Make shards, in whatever order they get done.

    Args:
        task: what they are made of.
        todo: which ones.
        workers: processes; 0: one for every processor.
        own: fingerprint of this process, which every worker must share.

    Raises:
        EngineError: workers keep dying.
        S3leError: what the task raises.
    """
    workers = min(workers or processors(), len(todo))
    if workers <= 1:
        for job in todo:
            yield task.make(job)
        return
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)  # the workers' own; this process has read its settings already
    try:
        yield from _in_pools(task, list(reversed(todo)), workers, own)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _in_pools(task: Task, todo: list[Job], workers: int, own: Mapping[str, str]) -> Iterator[Made]:
    deaths = 0
    while todo:
        flying: dict[Future[Made], Job] = {}
        pool = ProcessPoolExecutor(
            workers, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(task, own)
        )
        try:
            while todo or flying:
                while todo and len(flying) < AHEAD * workers:
                    flying[pool.submit(_work, todo[-1])] = todo[-1]
                    todo.pop()  # only now: a pool that broke meanwhile takes nothing
                done, _ = wait(flying, return_when=FIRST_COMPLETED)
                for future in done:
                    made = future.result()  # raises BrokenProcessPool where a worker died
                    del flying[future]
                    deaths = 0
                    yield made
            pool.shutdown()  # idle workers leave, and are waited for
        except BrokenProcessPool:
            deaths += 1
            if deaths == DEATHS:
                raise EngineError(
                    f"{task.table}: a worker died {deaths} times before it had made a shard "
                    "(killed, or out of memory?); finished shards are kept: run again, perhaps "
                    "with fewer workers or smaller shards"
                ) from None
            todo += sorted(flying.values(), reverse=True)
        finally:
            left = list((pool._processes or {}).values())  # which shutdown forgets
            pool.shutdown(wait=False, cancel_futures=True)
            for process in left:
                process.kill()  # at work on a shard that nobody waits for any more
            for process in left:
                process.join()


_task: Task
_caller: Mapping[str, str]


def _begin(task: Task, caller: Mapping[str, str]) -> None:
    """Make a fresh process a worker."""
    global _task, _caller
    _task, _caller = task, caller
    use_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller hears it and stops us
    parent = multiprocessing.parent_process()
    assert parent is not None  # workers are started by it
    ended = parent.sentinel

    def end_with_caller() -> None:
        wait_for([ended])
        os._exit(1)  # in mid-computation too; a worker holds nothing that could be half-written

    threading.Thread(target=end_with_caller, daemon=True).start()


def _work(job: Job) -> Made:
    require_same(_task, _caller)  # a worker reads the code anew, which may have changed
    return _task.make(job)
