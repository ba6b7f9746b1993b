"""Where motions and verdicts are kept, so that a run that was stopped goes on.

A motion's key holds all that decides it: entrant, settings, robot, task, protocol, what is
installed for it, and the code it runs on. A verdict's key holds the motion's bytes and the judges'
code. What has a file is not made again; a later commit that changes that code begins anew.
"""

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import install
from entrants import HERE, Entrant
from tasks import Task

from s3le.tuples.engine.key import closure

JUDGES = ("judging.py", "engines.py", "continuous.py")
OWN = ("s3le.retarget.stream", "s3le.retarget.follow", "s3le.retarget.stored")
JUDGED = ("s3le.safety.paths", "s3le.guard.clean", "s3le.robot.hulls", "s3le.kernels.batch")
MORE = {  # what else a module in solvers/ reads
    "by_hands": ("solvers/by_pink.py",), "by_holosoma": ("person.py",), "by_gmr": ("person.py",),
    "by_soma": ("person.py",),
}  # fmt: skip
READ = (".py", ".json", ".xml")  # of a clone


def motion(
    entrant: Entrant, settings: dict[str, Any], robot: str, task: Task, protocol: int, turn: int = 0
) -> str:
    """Key of a motion; turn: 1 for the second time the same is made, which is compared."""
    given = [entrant.key, settings, robot, task.digest, protocol, turn]
    code = _code(entrant.module, entrant.environment)
    return _hash([json.dumps(given, sort_keys=True).encode(), code.encode()])


def verdict(made: Path, task: Task, robot: str, who: list[str]) -> str:
    """Key of a verdict on a motion's file.

    Args:
        made: the file.
        task: what it follows.
        robot: its tag.
        who: further judges that are there, and of which versions.
    """
    given = json.dumps([task.digest, robot, who]).encode()
    return _hash([made.read_bytes(), given, _judges().encode()])


@cache
def _code(module: str, environment: str) -> str:
    """Of an entrant, and what is installed in its environment."""
    if module == "ours":
        own = set().union(*map(closure, OWN))
        return _hash(
            path.read_bytes() for path in sorted([*own, HERE / "ours.py", HERE / "motions.py"])
        )
    names = ["plain.py", "worker.py", "motions.py", f"solvers/{module}.py", *MORE.get(module, ())]
    installed = install.sections(install.LOCK.read_text(encoding="utf-8")).get(environment, "")
    return _hash([*((HERE / name).read_bytes() for name in names), installed.encode()])


@cache
def _judges() -> str:
    own = set().union(*map(closure, JUDGED))
    judge = [HERE.parent / "judge" / name for name in JUDGES]
    return _hash(
        path.read_bytes()
        for path in sorted([*own, *judge, HERE / "verdict.py", HERE / "meshes.py"])
    )


def clone(folders: Iterable[Path]) -> str:
    """What a user's clones hold of code, settings and models."""
    every = [path for folder in folders for path in sorted(folder.rglob("*"))]
    files = [path for path in every if path.suffix in READ and path.is_file()]
    return _hash(path.read_bytes() for path in files)


def _hash(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()[:20]


def read(path: Path) -> dict[str, Any] | None:
    """A verdict that was reached before; None: there is none that is whole."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
