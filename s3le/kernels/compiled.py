"""The one way a kernel is compiled, and where the machine code is kept between runs.

numba renews the stored code of a function when the function's own file changes, not when a file
it calls into does: after an edit of solver.py the old solver would go on running inside batch.py.
So the store is keyed by the text of every kernel.

numba also keys it by the folder that the code lies in, so that every copy of the project (a
worktree, an environment, a temporary experiment) would compile all kernels anew. The text says
all that matters: copies with the same kernels share what one of them has compiled. The store lies
in NUMBA_CACHE_DIR if that is set, else in the user's cache folder, else beside the code; where
none of them can be written, every process compiles for itself.

Processes that compile at the same time take turns in writing: numba numbers the files of one
function, and two of them that take the same number at once would call code of another signature.
"""

import fcntl
import hashlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding
from numba import config, njit, types
from numba.core.caching import UserProvidedCacheLocator

from s3le.store import cache

_HERE = Path(__file__).parent
_ROOMS = ("kernels", "safety", "search", "retarget", "plan", "show")  # where functions are compiled
_LOCK = ".lock"


def key() -> str:
    """Hash of numba's version and of the text of every file that holds compiled functions."""
    files = sorted(path for room in _ROOMS for path in (_HERE.parent / room).glob("*.py"))
    texts = [text for text in (path.read_bytes() for path in files) if b"@compiled" in text]
    return hashlib.sha256(b"\0".join([numba.__version__.encode(), *texts])).hexdigest()[:16]


def processor() -> str:
    """The processor that kernels are compiled for: its name and a hash of its features."""
    name = config.CPU_NAME or binding.get_host_cpu_name()
    features = config.CPU_FEATURES or binding.get_host_cpu_features().flatten()
    # The mathematical functions of the C library choose their code by the real processor.
    real = binding.get_host_cpu_features().flatten()
    return f"{name} {hashlib.sha256(f'{features} {real}'.encode()).hexdigest()[:12]}"


def place() -> Path | None:
    """The folder that holds the store, the first that can be written; None: there is none."""
    candidates: tuple[Path, ...]
    if config.CACHE_DIR:
        candidates = (Path(config.CACHE_DIR),)
    else:
        candidates = (cache.folder(), _HERE / "__pycache__")
    return next((folder for folder in candidates if _writable(folder)), None)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


_PLACE = place()
_STORE = _PLACE and _PLACE / f"kernels-{key()}"


def stored(kernel: str) -> bool:
    """Whether an earlier run has left the machine code of a kernel, e.g. 'guard.frame'."""
    return _STORE is not None and any(_STORE.rglob(f"{kernel}-*.nbc"))


def kept() -> bool:
    """Whether what is compiled is kept for the next run."""
    return _STORE is not None


class InOneFolder(UserProvidedCacheLocator):
    """The store itself, whatever folder the code lies in."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Where in the store the code of a file is kept; its files are named by module."""
        return ""

    def get_source_stamp(self) -> str:
        """What makes stored code old: the text, which names the store; never a file's time."""
        assert _STORE is not None  # whoever has no store has no locator
        return _STORE.name


_LOCATOR = f"{__name__}.{InOneFolder.__name__}"
_functions = 0  # that this process has wrapped
_listeners: list[Callable[[int], object]] = []


@contextmanager
def told(listener: Callable[[int], object]):
    """Call listener(1) whenever a kernel of this process has been compiled and stored."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def count() -> int:
    """Kernels that this process may have to compile, as far as their modules are imported."""
    return _functions


def compiled(function: Callable) -> Callable:
    """Compile a function of arrays: at its first call, without the interpreter's lock, stored."""
    global _functions
    _functions += 1
    if _STORE is None:
        return _once(njit(nogil=True)(function))
    before = config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES
    config.CACHE_DIR = str(_STORE)  # both are read while the function is wrapped, not later
    config.CACHE_LOCATOR_CLASSES = _LOCATOR
    try:
        made = njit(cache=True, nogil=True)(function)
    finally:
        config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = before
    files = made._cache._cache_file  # numba has no other place to take turns at
    files.save = _in_turn(files.save)
    return _once(made)


def _once(made: Any) -> Callable:
    """Compile a function once for a type, not once more for each constant that it is called with.

    numba tells 0 from 1 and True from False where a kernel passes them to another. LLVM sees the
    constants anyway where it inlines the call; elsewhere they are not worth a second of compiling.
    """
    call = made.get_call_template

    def template(args: Sequence[types.Type], kws: Mapping[str, types.Type]) -> object:
        return call(
            [types.unliteral(one) for one in args],
            {name: types.unliteral(one) for name, one in kws.items()},
        )

    made.get_call_template = template
    return made


def _in_turn(save: Callable[..., None]) -> Callable[..., None]:
    """What numba stores one function with, for one process at a time."""

    def saved(*args: object) -> None:
        assert _STORE is not None  # whoever has no store saves nothing
        with (_STORE / _LOCK).open("a") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)  # freed with the handle
            save(*args)
        for listener in _listeners:
            listener(1)

    return saved
