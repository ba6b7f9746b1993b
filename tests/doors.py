"""Every reader of files from outside, with what it owes; a program that sends mutants through one.

A door says which good files there are, how they are read, and what must hold of a file that was
read although it is broken: its own grammar, looked up again in the bytes by simpler means than
the reader's, and numbers within the ranges that the reader promises. What is written with
checksums (tables, shards, models) must read as a good file to the last bit, or not at all.

As a program it runs each reader in a process of its own, so that a reader may crash, hang or eat
memory without taking the tests along.
"""

import json
import logging
import os
import resource
import signal
import struct
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from doors_keypoints import KEYPOINTS
from doors_motion import CLIPS, REAL
from doors_product import PRODUCT
from doorway import Door, Reading
from mutants import mutant

from s3le.errors import S3leError

SECONDS = 2.0  # of processor time, for one file
MEMORY = 512 * 2**20  # [bytes] of address space beyond what reading the good file takes
LONGEST = 5000  # characters of a refusal
DOORS = CLIPS | KEYPOINTS | PRODUCT

_told: list[str] = []  # what was said while a file was read


class TooLongError(BaseException):
    """A file took more than its time; no reader catches this."""


def _stop(*_: object) -> None:
    raise TooLongError


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray):
        equal = a.shape == b.shape and a.dtype == b.dtype
        return equal and (a.tolist() == b.tolist() if a.dtype == object else
                          a.tobytes() == b.tobytes())  # fmt: skip
    return a == b


def _listing(folder: Path) -> list[tuple[str, int, int]]:
    return sorted(
        (entry.name, entry.stat().st_size, entry.stat().st_mtime_ns) for entry in os.scandir(folder)
    )


def judge(at: Door, folder: Path, files: dict[str, bytes], goods: list) -> tuple[str, str]:
    """Read a folder and judge what came of it.

    Returns:
        Pair (verdict, why): "read", "refused", or what is wrong: "crash", "slow", "accepted",
        "words" (of a refusal) or "written".
    """
    before = _listing(folder)
    _told.clear()
    result, refused = None, ""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        result = at.read(folder)
    except TooLongError:
        return "slow", f"more than {SECONDS:g} s of processor time"
    except S3leError as error:
        refused = str(error) or "(no words)"
    except BaseException as error:  # noqa: B036  a panic of a library is no Exception
        last = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {str(error)[:200]!r}"
        return "crash", f"{what} at {Path(last.filename).name}:{last.lineno}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    if _listing(folder) != before:
        return "written", "the folder is not what it was"
    if refused:
        if len(refused.splitlines()) != 1 or not refused.isprintable():
            return "words", f"not one line: {refused!r:.300}"
        if len(refused) > LONGEST:
            return "words", f"{len(refused)} characters: {refused[:200]}"
        if not any(str(folder / name) in refused for name in [*files, ""]):
            return "words", f"names no file: {refused[:300]}"
        return "refused", refused
    if any(len(line) > LONGEST or not line.isprintable() for line in _told):
        return "words", f"said: {_told!r:.300}"
    try:
        at.owed(Reading(files, result, folder, _told))
        assert not at.exact or any(_same(result, one) for one in goods), "reads as no good file"
    except Exception as error:  # the check itself may stumble over what should not have been read
        return "accepted", f"{type(error).__name__}: {str(error)[:300]}"
    return "read", ""


def main(name: str, first: int, count: int, folder: Path) -> None:
    """Send mutants through a door; one JSON line for each that is not as it must be."""
    at = (DOORS | REAL)[name]()
    goods = []
    for number, files in enumerate(at.goods):
        home = folder / f"good{number}"
        home.mkdir(parents=True)
        for file, data in files.items():
            (home / file).write_bytes(data)
        goods.append(at.read(home))
        at.owed(Reading(files, goods[-1], home, _told))
    signal.signal(signal.SIGPROF, _stop)
    pages = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (pages + MEMORY, pages + MEMORY))
    warnings.simplefilter("error")
    ear = logging.Handler()
    ear.emit = lambda record: _told.append(record.getMessage())
    logging.getLogger("s3le").addHandler(ear)
    counts: dict[str, int] = {}
    mark = os.open(folder / "number", os.O_CREAT | os.O_WRONLY)
    for number in range(first, first + count):
        os.pwrite(mark, struct.pack("<q", number), 0)
        turn = number % len(at.goods)
        files = at.goods[turn]
        target = at.broken[number // len(at.goods) % len(at.broken)]
        others = [data for other in at.goods for data in other.values()]
        data, done = mutant(files[target], others, f"{name} {number}")
        home = folder / f"good{turn}"
        (home / target).write_bytes(data)
        verdict, why = judge(at, home, files | {target: data}, goods)
        if verdict == "slow":  # for its own sake, or because the machine was busy
            verdict, why = judge(at, home, files | {target: data}, goods)
        (home / target).write_bytes(files[target])
        counts[verdict] = counts.get(verdict, 0) + 1
        if verdict not in ("read", "refused"):
            print(json.dumps({"number": number, "how": done, "verdict": verdict, "why": why}))
            sys.stdout.flush()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # [bytes]
    print(json.dumps({"counts": counts, "most": peak}))


def serve() -> None:
    """Do what each line of standard input says in a process of its own, forked from this one.

    A line is JSON, the arguments of main; what is said goes to out and err in the folder, and the
    status in which the process ended is the answer. What readers import is imported once.
    """
    for line in sys.stdin:
        name, first, count, folder = json.loads(line)
        child = os.fork()
        if not child:
            for stream, file in ((1, "out"), (2, "err")):
                os.dup2(os.open(Path(folder) / file, os.O_CREAT | os.O_WRONLY), stream)
            status = 1
            try:
                main(name, first, count, Path(folder))
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush(), sys.stderr.flush()
                os._exit(status)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    serve()
