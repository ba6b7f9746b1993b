"""The key of a shard store: one hash of everything that can change a row.

Parameters, robot and seed come from the task; added here are the bytes of the code that makes the
rows, the versions of the numeric libraries and the processor. It covers too much
rather than too little: the price of that is making rows again, the price of less is stale rows.
"""

import hashlib
import json
import platform
import re
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

from s3le.errors import EngineError
from s3le.kernels.compiled import processor
from s3le.tuples.engine.task import Task

ROOT = Path(__file__).parents[3]
LIBRARIES = (
    "numpy", "scipy", "numba", "llvmlite", "pin", "coal", "libpinocchio", "libcoal", "eigenpy",
    "polars", "pyarrow",
)  # fmt: skip
OWN = ("s3le", "pipeline")


def file_of(module: str, root: Path = ROOT) -> Path | None:
    """The file of one of this project's modules; None for any other."""
    base = root.joinpath(*module.split("."))
    return next((p for p in (base.with_suffix(".py"), base / "__init__.py") if p.is_file()), None)


# A statement that imports: from A import B, (C as D); or import A, B. Thirty times as fast as
# parsing, which every start of a command would wait for; what a text quotes is taken in too.
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n;]+)|import[ \t]+([^\n;]+))",
    re.MULTILINE,
)
_NAME = re.compile(r"([\w.]+)(?:[ \t]+as[ \t]+\w+)?")
_REMARK = re.compile(r"#[^\n]*")


@cache
def imported(path: Path) -> frozenset[str]:
    """Every module that a file may import, anywhere in it."""
    names: set[str] = set()
    for origin, parts, plain in _IMPORT.findall(path.read_text(encoding="utf-8")):
        found = _NAME.findall(_REMARK.sub("", parts or plain))
        names |= {origin} | {f"{origin}.{name}" for name in found} if origin else set(found)
    return frozenset(names)


def closure(module: str, root: Path = ROOT) -> set[Path]:
    """This project's files that importing a module may execute."""
    seen: set[Path] = set()
    todo = [module]
    while todo:
        parts = todo.pop().split(".")
        if parts[0] not in OWN:
            continue
        for depth in range(1, len(parts) + 1):
            path = file_of(".".join(parts[:depth]), root)
            if path and path not in seen:
                seen.add(path)
                todo += imported(path)
    return seen


def fingerprint(task: Task) -> dict[str, str]:
    """What this process makes a task's rows with: code, libraries, processor.

    Two processes with the same fingerprint give the same bytes for the same task.
    """
    code = hashlib.sha256()
    for path in sorted(closure(task.module)):
        code.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    versions = {name: version for name in LIBRARIES if (version := _version(name))}
    return {
        "code": code.hexdigest()[:16],
        "python": platform.python_version(),
        "libc": "-".join(platform.libc_ver()),
        "processor": processor(),
        "precision": "float64",
    } | versions


_own = cache(fingerprint)  # a worker reads its code once


def require_same(task: Task, caller: Mapping[str, str]) -> None:
    """On a worker: refuse to make other bytes than the caller would.

    Raises:
        EngineError: this process computes with something else; names it and this machine.
    """
    own = _own(task)
    for name in caller:
        if own.get(name) != caller[name]:
            raise EngineError(
                f"a worker on {platform.node()} would make other bytes: its {name} is "
                f"{own.get(name, '')!r}, the caller's is {caller[name]!r}; all workers need the "
                "same code, lock file and type of processor"
            )


def key(task: Task, own: Mapping[str, str]) -> str:
    """Hash of a task and of what it is computed with (fingerprint)."""
    whole = {"task": dict(task.about()), "made with": dict(own)}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:24]


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
