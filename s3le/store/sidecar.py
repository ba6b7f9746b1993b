"""What is said of a result in a file beside it: of which input and question, each by a hash.

A result counts once its sidecar lies there; so it is written last, and taken away first.
"""

import hashlib
import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

INPUT = "input_sha256"  # of what was read
OUTPUT = "output_sha256"  # of what was written
TAG = "asked_and_made_with"  # of what was asked, and of the code that answered
FORMAT = "format"


def read(path: Path, form: str, keys: Collection[str]) -> dict[str, Any] | None:
    """What a sidecar says, if it is one of ours.

    Args:
        path: the sidecar.
        form: the format that it must name.
        keys: what it must say beside.

    Returns:
        None where there is none, or a damaged one, or somebody else's file.
    """
    try:
        tree = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse)
    except (OSError, ValueError, RecursionError):
        return None
    wanted = {FORMAT, INPUT, OUTPUT, TAG, *keys}
    ours = isinstance(tree, dict) and tree.get(FORMAT) == form and tree.keys() >= wanted
    return tree if ours else None


def answers(said: dict[str, Any], held: str, tag: str) -> bool:
    """Whether a sidecar speaks of an input that holds `held`, and of what `tag` asks."""
    return said.get(INPUT) == held and said.get(TAG) == tag


def digest(path: Path) -> str:
    """SHA-256 of a file.

    Raises:
        OSError: it cannot be read.
    """
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _refuse(word: str) -> None:
    raise ValueError(f"{word} is no number of a sidecar")
