"""Small files that people read: JSON, CSV and text, whole or not at all."""

import json
from collections.abc import Mapping
from pathlib import Path

import polars as pl

from s3le.errors import TableError
from s3le.store.atomic import replace


def write_json(tree: Mapping, path: Path) -> None:
    """Write a mapping as JSON with sorted keys, whole or not at all; NaN is refused.

    Raises:
        TableError: a value is not finite or not JSON.
    """
    try:
        text = encode_json(tree)
    except (ValueError, TypeError) as error:
        raise TableError(f"{path}: not writable as JSON ({error})") from None
    write_text(text, path)


def encode_json(tree: Mapping) -> str:
    """A mapping as JSON with sorted keys.

    Raises:
        ValueError, TypeError: a value is not finite or not JSON.
    """
    return json.dumps(tree, indent=2, sort_keys=True, allow_nan=False) + "\n"


def read_json(path: Path, stage: str) -> dict:
    """Read a mapping that a stage wrote.

    Raises:
        TableError: missing, not a JSON object, or with a key that is there twice.
    """

    def once(pairs: list[tuple[str, object]]) -> dict:
        if len(tree := dict(pairs)) < len(pairs):
            raise ValueError("a key is there twice")
        return tree

    try:
        tree = json.loads(Path(path).read_text(encoding="utf-8"), object_pairs_hook=once)
    except FileNotFoundError:
        raise TableError(f"{path} is missing; write it with: dvc repro {stage}") from None
    except (ValueError, OSError, RecursionError) as error:
        again = f"write it with: dvc repro {stage}"
        raise TableError(f"{path} is not JSON ({error}); {again}") from None
    if not isinstance(tree, dict):
        raise TableError(f"{path} holds no JSON object; write it with: dvc repro {stage}")
    return tree


def write_text(text: str, path: Path) -> None:
    """Write text, whole or not at all."""
    replace(path, lambda part: part.write_text(text, encoding="utf-8"))


def write_csv(rows: list[Mapping], path: Path) -> None:
    """Write rows with the same keys as CSV, whole or not at all.

    Raises:
        TableError: there is no row.
    """
    if not rows:
        raise TableError(f"{path}: no rows to write")
    replace(path, lambda part: pl.DataFrame(rows).write_csv(part))


def read_csv(path: Path, stage: str) -> list[dict]:
    """Read rows that a stage wrote.

    Raises:
        TableError: missing, or no CSV.
    """
    try:
        return pl.read_csv(path).to_dicts()
    except FileNotFoundError:
        raise TableError(f"{path} is missing; write it with: dvc repro {stage}") from None
    except pl.exceptions.PolarsError as error:
        raise TableError(f"{path} is not CSV ({error}); write it with: dvc repro {stage}") from None
