"""Any joint motion in, the nearest certified motion out."""

from importlib import import_module

_HOME = {"Guard": "s3le.guard.guard"}  # name -> the module that defines it
__all__ = ["Guard"]


def __getattr__(name: str) -> object:
    """What is asked for, from the module that defines it; so that importing a part costs that."""
    if name not in _HOME:
        raise AttributeError(f"module 's3le.guard' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
