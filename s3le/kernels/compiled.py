"""The one way a kernel is compiled, and where the machine code is kept between runs.

numba renews the stored code of a function when the function's own file changes, not when a file
it calls into does: after an edit of solver.py the old solver would go on running inside batch.py.
So the store is keyed by the text of every kernel.

numba also keys it by the folder that the code lies in, so that every copy of the project (a
worktree, a temporary experiment) would compile all kernels anew. The text says all that matters:
with NUMBA_CACHE_DIR set, copies with the same kernels share what one of them has compiled.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

from llvmlite import binding
from numba import config, njit
from numba.core.caching import UserProvidedCacheLocator

_HERE = Path(__file__).parent
_PLAN = _HERE.parent / "plan"  # holds kernels too, beside what drives them


def key() -> str:
    """Hash of the text of all kernels."""
    texts = [path.read_bytes() for path in sorted(_HERE.glob("*.py"))]
    texts += [t for path in sorted(_PLAN.glob("*.py")) if b"@compiled" in (t := path.read_bytes())]
    return hashlib.sha256(b"\0".join(texts)).hexdigest()[:16]


def processor() -> str:
    """The processor that kernels are compiled for: its name and a hash of its features."""
    name = config.CPU_NAME or binding.get_host_cpu_name()
    features = config.CPU_FEATURES or binding.get_host_cpu_features().flatten()
    # The mathematical functions of the C library choose their code by the real processor.
    real = binding.get_host_cpu_features().flatten()
    return f"{name} {hashlib.sha256(f'{features} {real}'.encode()).hexdigest()[:12]}"


_STORE = Path(config.CACHE_DIR or _HERE / "__pycache__") / f"kernels-{key()}"


def stored(kernel: str) -> bool:
    """Whether an earlier run has left the machine code of a kernel, e.g. 'guard.frame'."""
    return any(_STORE.rglob(f"{kernel}-*.nbc"))


class InOneFolder(UserProvidedCacheLocator):
    """The store itself, whatever folder the code lies in."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Where in the store the code of a file is kept; its files are named by module."""
        return ""

    def get_source_stamp(self) -> str:
        """What makes stored code old: the text, which names the store; never a file's time."""
        return _STORE.name


# numba takes the first of these that can be written to.
_LOCATORS = f"{__name__}.{InOneFolder.__name__},InTreeCacheLocator,UserWideCacheLocator"


def compiled(function: Callable) -> Callable:
    """Compile a function of arrays: at its first call, without the interpreter's lock, stored."""
    before = config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES
    config.CACHE_DIR = str(_STORE)  # both are read while the function is wrapped, not later
    config.CACHE_LOCATOR_CLASSES = _LOCATORS
    try:
        return njit(cache=True, nogil=True)(function)
    finally:
        config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = before
