"""Where this project keeps, for a user and between runs, what can be made again."""

import os
from pathlib import Path


def folder() -> Path:
    """`$XDG_CACHE_HOME/s3le`, or `~/.cache/s3le`; nobody says that it is there or can be written.

    What lies in it may be removed at any time, and is made again when it is wanted.
    """
    given = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(given) if os.path.isabs(given) else Path(os.path.expanduser("~")) / ".cache"
    return base / "s3le"
