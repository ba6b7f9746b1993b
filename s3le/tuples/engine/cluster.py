"""Shards made through Ray: the only door to it. Workers compute, this process alone writes.

A shard travels back as bytes, so the machines need no common file system. Ray makes a shard anew
when a worker or a whole machine is lost.
"""

import os
import socket
from collections.abc import Iterator

from s3le.errors import EngineError
from s3le.kernels.threads import use_threads
from s3le.tuples.engine.key import require_same
from s3le.tuples.engine.local import AHEAD, ONE_THREAD
from s3le.tuples.engine.task import Job, Made, Task

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
try:
    import ray
    from ray.exceptions import RayError, RayTaskError
except ImportError:
    raise EngineError("executor 'ray' needs Ray; install it with: pip install .[cluster]") from None

RETRIES = 5  # times that a shard is made anew after its worker or machine was lost


def make(task: Task, todo: list[Job], address: str, own: dict[str, str]) -> Iterator[Made]:
    """Make shards on a cluster, in whatever order they get done.

    Args:
        task: what they are made of.
        todo: which ones.
        address: of the cluster: "host:port", "auto" for the one this machine belongs to, or
            "local" for one of this process's own.
        own: fingerprint of this process, which every worker must share.

    Raises:
        EngineError: no cluster there, a worker that would compute other bytes, machines lost.
        S3leError: what the task raises.
    """
    if not todo:
        return
    try:
        _knock(address)
        ray.init(
            address=address,
            log_to_driver=False,
            logging_level="ERROR",
            runtime_env={"env_vars": ONE_THREAD},
            **({"include_dashboard": False} if address == "local" else {}),
        )
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0][:160]
        raise EngineError(
            f"no Ray cluster at ray_address {address!r} ({reason}); "
            "start one with: ray start --head"
        ) from None
    try:
        yield from _spread(task, list(reversed(todo)), own)
    except RayTaskError as error:
        raise error.cause from None  # what the task raised, as if it had been raised here
    except RayError as error:
        reason = str(error).splitlines()[0][:160]
        raise EngineError(
            f"{task.table}: the cluster was lost ({reason}); finished shards are kept: run again"
        ) from None
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """See whether anybody is there; Ray itself would try for minutes."""
    host, colon, port = address.rpartition(":")
    if colon and "/" not in host:
        socket.create_connection((host, int(port)), timeout=10).close()


def _spread(task: Task, todo: list[Job], own: dict[str, str]) -> Iterator[Made]:
    work = ray.remote(num_cpus=1, max_retries=RETRIES)(_work)
    what = ray.put(task)
    flying: list = []
    while todo or flying:
        # Asked again each time: machines may join or leave while we run.
        most = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while todo and len(flying) < most:
            flying.append(work.remote(what, todo.pop(), own))
        done, flying = ray.wait(flying, num_returns=1)
        yield ray.get(done[0])


def _work(task: Task, job: Job, caller: dict[str, str]) -> Made:
    """On a worker."""
    use_threads(1)
    require_same(task, caller)
    return task.make(job)
