"""One writer at a time: an exclusive lock that names its holder and dies with it."""

import contextlib
import fcntl
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

from s3le.errors import EngineError

SHARDS = "its finished shards are kept"
PATIENCE = 10.0  # [s]; a process that was just told to stop needs a moment to go


@contextlib.contextmanager
def held(path: Path, what: str, patience: float = PATIENCE, kept: str = "") -> Iterator[None]:
    """Hold the lock at path while the block runs; the kernel frees it however the process ends.

    Args:
        path: lock file; made if need be, never removed.
        what: what is locked, for the message.
        patience: how long to wait for another holder [s].
        kept: what of the other's work is not lost if it is stopped, for the message.

    Raises:
        EngineError: another process holds it; names that process.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as handle:
        until = time.monotonic() + patience
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() < until:
                    time.sleep(0.1)
                    continue
                handle.seek(0)
                holder = handle.read().strip() or "another process"
                raise EngineError(
                    f"{what} is being written by {holder}; wait for it to end or stop it"
                    f"{f' ({kept})' if kept else ''}, then run again"
                ) from None
        handle.truncate(0)
        handle.write(f"process {os.getpid()} on {socket.gethostname()}")
        handle.flush()
        yield


def free(path: Path) -> bool:
    """Whether nobody holds the lock at path just now."""
    try:
        with held(path, "", patience=0.0):
            return True
    except EngineError:
        return False
