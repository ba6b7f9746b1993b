"""One module an entrant: `about` says which versions run, `make` gives what solves a frame."""

import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def versions(*names: str) -> dict[str, str]:
    """Versions of packages that are installed here."""
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional part
            continue
    return found


def commits(folders: Iterable[str]) -> dict[str, str]:
    """Which commit a user's clones are at, by name; of folders in them, or themselves."""
    found = {}
    for folder in map(Path, folders):
        ask = ["git", "-C", str(folder), "rev-parse", "--show-toplevel", "--short", "HEAD"]
        try:
            done = subprocess.run(ask, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError):  # no git here, or no clone but a copy
            continue
        top, commit, *_ = done.stdout.split("\n")
        if Path(top) in (folder.resolve(), folder.resolve().parent):
            found[Path(top).name] = commit
    return found
