"""All parameters of a run with their sentences, as params.yaml has them."""

import re
from pathlib import Path
from typing import NamedTuple

from s3le.errors import ParameterError
from s3le.store import yaml

_LINE = re.compile(r"( *)([A-Za-z_]\w*):((?:'[^']*'|\"[^\"]*\"|[^#'\"])*)(?:#\s*(.*))?")
_MORE = re.compile(r" +#\s*(.*)")


class Parameter(NamedTuple):
    """One of them."""

    key: str  # with its section: sample.rows
    value: str
    sentence: str  # what stands beside it


def read(path: Path) -> list[Parameter]:
    """Every key of params.yaml, top to bottom.

    Raises:
        ParameterError: missing, too long, not YAML, or no mapping.
    """
    try:
        tree, text = yaml.mapping(path, "parameters", ParameterError)
    except FileNotFoundError:
        raise ParameterError(f"{path} is missing here; run from the project's folder") from None
    beside = _sentences(text)
    found = []
    for name, value in tree.items():
        own = value.items() if isinstance(value, dict) else [(None, value)]
        for key, single in own:
            full = str(name) if key is None else f"{name}.{key}"
            found.append(Parameter(full, _written(single), beside.get(full, "")))
    return found


def _written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _sentences(text: str) -> dict[str, str]:
    """Comments by key; a line that is all comment goes on with the one above it."""
    found, section, last = {}, "", None
    for line in text.splitlines():
        if (more := _MORE.fullmatch(line)) and last:
            found[last] = f"{found[last]} {more[1]}"
        elif own := _LINE.fullmatch(line):
            if not own[1]:
                section = own[2]
            if own[3].strip() or not own[4]:
                last = f"{section}.{own[2]}" if own[1] else own[2]
                found[last] = own[4] or ""
            else:
                last = None  # the sentence of a section
        else:
            last = None
    return found
