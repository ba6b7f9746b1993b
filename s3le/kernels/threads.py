"""How many threads the kernels may use in this process."""

import os

_threads = 0  # 0: one for every processor


def use_threads(count: int) -> None:
    """Let this process use so many threads from now on; 0: one for every processor."""
    global _threads
    _threads = count


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


def workers() -> int:
    """Threads that share the rows."""
    return _threads or processors()
