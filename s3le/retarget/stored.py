"""A retargeter for a robot without a training: certified poses, found by the skeleton itself.

The poses are drawn as people move (the sampler `human`), projected and certified by coal as those
of the pipeline are, made searchable, and kept in the user's cache folder as a retargeter folder
(s3le/retarget/exported.py). They are made once for a robot, in seconds; its key holds all that
can change a row. Where kernels have to be compiled too, a process of its own makes the poses
meanwhile, for numba compiles one function at a time in a process.
"""

import hashlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import cache as once
from pathlib import Path
from typing import IO, Any

import numpy as np

from s3le import __version__
from s3le.errors import BundleError, EngineError, ModelError, S3leError
from s3le.kernels import batch, compiled, threads
from s3le.plan import steps, whole
from s3le.retarget import exported
from s3le.retarget.settings import Settings
from s3le.retarget.stream import Retargeter
from s3le.rng import stream
from s3le.robot.robot import Robot
from s3le.safety.paths import certify
from s3le.store import cache
from s3le.tuples import certified, samplers, sampling
from s3le.tuples.engine import lock
from s3le.types import Progress

ROWS = 20_000  # stored poses
SAMPLER, ALPHA, SEED = "human", 0.2, 7  # as params.yaml has them: sample.sampler, alpha, seed
METHOD, METRIC = "skeleton", "l2"
PATIENCE = 600.0  # [s] for another process that makes the same poses
_MADE_BY = ("kernels", "robot", "search", "store", "tuples", "retarget", "rng.py", "skeleton.py")
_HERE = Path(__file__).parents[1]
Watch = Callable[[str, int, int], object]  # what is done, how many are new, of how many


def retargeter_for(
    robot: Robot | Path | str,
    *,
    watch: Watch | None = None,
    streams: bool = False,
    **changed: Any,
) -> Retargeter:
    """The retargeter of a robot that nothing was trained for, ready for its first motion.

    The first time on a machine this compiles the kernels, about a minute, and the first time for
    a robot it makes the robot's stored poses, some seconds.

    Args:
        robot: the robot, or what Robot.load takes.
        watch: called with "kernels" or "poses", how many more are done, and of how many.
        streams: compile what a stream needs; False: what a file needs.
        **changed: settings to change, by name (s3le.retarget.settings).

    Raises:
        RobotError: there is no such robot, or its files are unusable.
        CertificateError: a stored pose is not feasible by the independent check.
        ParameterError: a changed setting is unknown or out of range.
        BundleError: the user's cache folder cannot be written.
    """
    if not isinstance(robot, Robot):
        robot = Robot.load(robot)
    watch = watch or (lambda what, more, total: None)
    if compiled.stored(steps.SLOWEST if streams else whole.SLOWEST):
        return _loaded(robot, changed, watch)
    with _compiling(watch), _helper(robot, watch):
        standing = Retargeter(robot, _Standing(robot), Settings())
        if streams:
            standing.warm_up()
        else:
            standing.warm_up_plan()
    return _loaded(robot, changed, watch)


def about(robot: Robot) -> dict[str, Any]:
    """What the poses are, for a motion's metadata."""
    poses = {"rows": ROWS, "sampler": SAMPLER, "alpha": ALPHA, "seed": SEED, "key": key(robot)}
    return {"method": METHOD, "poses": poses}


def folder(robot: Robot) -> Path:
    """Where a robot's poses are kept, or will be."""
    return cache.folder() / "poses" / f"{robot.name}-{key(robot)}"


def key(robot: Robot) -> str:
    """Hash of everything that can change the poses or what is done with them."""
    whole = {
        "robot": robot.tag, "rows": ROWS, "sampler": SAMPLER, "alpha": ALPHA, "seed": SEED,
        "settings": asdict(Settings()), "version": __version__, "code": _code(),
        "processor": compiled.processor(),
    }  # fmt: skip
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:16]


@once
def _code() -> str:
    """Hash of the text of the rooms that make the poses: rather too much than too little."""
    found = hashlib.sha256()
    for name in _MADE_BY:
        path = _HERE / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            found.update(f"{file.relative_to(_HERE)}\0".encode() + file.read_bytes() + b"\0")
    return found.hexdigest()


def make(robot: Robot, target: Path, progress: Progress | None = None) -> None:
    """Draw a robot's poses, project and certify them, and write them as a retargeter folder.

    Args:
        robot: the robot.
        target: the folder; what lay there is replaced.
        progress: called with numbers of poses done; each counts twice, made and made searchable.

    Raises:
        CertificateError: a projected pose is not feasible by the independent check.
    """
    low, high = sampling.relaxed_limits(robot.lower, robot.upper, ALPHA)
    q = samplers.draw(SAMPLER, robot, low, high, 0, ROWS, stream(SEED, "stored"), SEED)
    q = batch.project(robot.chain, robot.anchor, q, robot.margin, progress).q
    x = batch.skeletons(robot.chain, q)
    index = {
        "row": np.arange(ROWS, dtype=np.int32),
        "z": np.asarray(x, np.float32),
        "x": x,
        "q": q,
    } | certified.certificate(robot, q)
    exported.save(target, robot, METHOD, METRIC, Settings(), index, None, progress)


def ensure(robot: Robot, progress: Progress | None = None, again: bool = False) -> Path:
    """The folder of a robot's poses, made if need be; of several processes one makes it.

    Args:
        robot: the robot.
        progress: see make.
        again: what is there could not be read; make it again, unless somebody has meanwhile.

    Raises:
        BundleError: the cache folder cannot be written, or another process does not come to an
            end with it.
    """
    target = folder(robot)
    if target.is_dir() and not again:
        return target
    try:
        with lock.held(target.with_name(f".{target.name}.lock"), str(target), PATIENCE):
            if not (_whole(target) if again else target.is_dir()):
                make(robot, target, progress)
    except EngineError as refusal:
        raise BundleError(str(refusal)) from None
    except OSError as refusal:
        raise BundleError(
            f"the poses of {robot.name} cannot be kept in {target.parent} "
            f"({refusal.strerror or refusal}); name a folder that can be written: "
            "XDG_CACHE_HOME=/a/folder"
        ) from None
    return target


def _whole(target: Path) -> bool:
    try:
        exported.load(target)
    except (BundleError, ModelError):
        return False
    return True


def _loaded(robot: Robot, changed: dict[str, Any], watch: Watch) -> Retargeter:
    """The retargeter of the cache folder; one that is damaged is made again."""

    def more(rows: int) -> None:
        watch("poses", rows, 2 * ROWS)

    try:
        return Retargeter.load(ensure(robot, more), changed)
    except (BundleError, ModelError):
        return Retargeter.load(ensure(robot, more, again=True), changed)


class _Standing:
    """Proposes the anchor: enough for the kernels of a frame to be compiled."""

    def __init__(self, robot: Robot) -> None:
        self._q = robot.anchor[None]

    def propose(self, x: np.ndarray) -> np.ndarray:
        """See propose.Proposer."""
        return self._q


@contextmanager
def _compiling(watch: Watch) -> Iterator[None]:
    with compiled.told(lambda more: watch("kernels", more, compiled.count())):
        yield


@contextmanager
def _helper(robot: Robot, watch: Watch) -> Iterator[None]:
    """Make the poses in another process meanwhile, and wait for it at the end.

    It is a help only: what it could not do is done afterwards in this process, which says why.
    """
    if folder(robot).is_dir() or threads.processors() < 2 or not compiled.kept():
        yield
        return
    code = "import sys, json; sys.path[:] = json.loads(sys.argv[1]); " \
           "from s3le.retarget import stored; stored.help_out()"  # fmt: skip
    words = [sys.executable, "-c", code, json.dumps([p for p in sys.path if p])]
    process = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdin is not None and process.stdout is not None  # both are piped
    reader = threading.Thread(target=_tell, args=(process.stdout, watch), daemon=True)
    try:
        reader.start()
        with suppress(BrokenPipeError), process.stdin as pipe:
            pipe.write(_packed(robot))
        yield
        process.wait()
    finally:
        process.kill()  # nothing, once it has ended
        process.wait()
        reader.join()
        process.stdout.close()


def _packed(robot: Robot) -> bytes:
    return json.dumps([[name, data.hex()] for name, data in robot.to_bytes()]).encode()


def _tell(told: IO[bytes], watch: Watch) -> None:
    for line in told:
        watch("poses", int(line), 2 * ROWS)


def help_out() -> None:
    """What the helping process does: read a robot, make its poses, say how many are done.

    First of all it proves a path, so that the process that compiles a frame finds the kernels of
    the proof in the store when it comes to them, as the audit does later.
    """

    def more(rows: int) -> None:
        print(rows, flush=True)

    robot = Robot.from_bytes((name, bytes.fromhex(data)) for name, data in json.load(sys.stdin))
    try:
        certify(robot, np.stack([robot.anchor, robot.anchor]), Settings().between)
        made = exported.load(ensure(robot, more))
        x = batch.skeletons(robot.chain, robot.anchor[None])[0]
        made.proposer.propose(x)  # compiles the look-up too
    except S3leError as refusal:
        raise SystemExit(str(refusal)) from None
