"""Run a function of tensors as it is written, or fused into few kernels by torch.compile.

Eager torch writes every intermediate result to memory; a distance has about sixty of them. Fusing
keeps them in registers, which is what a GPU needs, at the price of a compilation at first use.
Both answer alike to rounding, not to the bit. The compiler is only imported when it is asked for.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module

import torch

_ON: ContextVar[bool] = ContextVar("fused", default=False)


@contextmanager
def fusing(on: bool) -> Iterator[None]:
    """Within it, functions marked `fused` are compiled, if on."""
    before = _ON.set(on)
    try:
        if not on:
            yield
            return
        # One compilation for each robot and for one, some and any number of rows.
        with import_module("torch._dynamo.config").patch(recompile_limit=64):
            yield
    finally:
        _ON.reset(before)


def fused(function: Callable) -> Callable:
    """Mark a function of tensors, without words to the host in it, as worth fusing."""
    compiled = functools.cache(lambda: torch.compile(function, fullgraph=True))

    @functools.wraps(function)
    def call(*args):
        return compiled()(*args) if _ON.get() else function(*args)

    return call
