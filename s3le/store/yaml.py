"""YAML as far as people write parameters and robots in it: no aliases, no bottomless nesting."""

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

from s3le.errors import S3leError

DEEPEST = 32  # levels; params.yaml has two, a robot file four
LARGEST = 32 * 2**10  # [bytes] of a file that people write


def mapping(
    path: Path,
    wanted: str,
    wrong: type[S3leError],
    largest: int = LARGEST,
    data: bytes | None = None,
) -> tuple[dict[Any, Any], str]:
    """Read a file that holds one mapping, as YAML 1.2, which is how DVC reads: 1e-3 is a number.

    Args:
        path: the file.
        wanted: what the mapping holds, for a refusal.
        wrong: what a refusal is raised as.
        largest: longest file that is read [bytes].
        data: the file's bytes, where it was read already.

    Returns:
        Pair (mapping, text of the file).

    Raises:
        FileNotFoundError: there is no such file.
        S3leError, as `wrong`: it is too long, not YAML, has what objection names, or is no mapping.
    """
    try:
        if data is None:
            with Path(path).open("rb") as stream:
                data = stream.read(largest + 1)
        if len(data) > largest:
            raise wrong(f"{path}: longer than the {largest / 1024:g} KiB that are read")
        text = data.decode("utf-8")
        if found := objection(text):
            raise wrong(f"{path}: {found}")
        tree = YAML(typ="safe").load(text)
    except FileNotFoundError:
        raise
    except (YAMLError, ValueError, OSError, RecursionError) as error:
        raise wrong(f"{path}: not readable as YAML ({str(error).splitlines()[0]})") from None
    if not isinstance(tree, dict):
        raise wrong(f"{path}: expected a mapping with {wanted}")
    return tree, text


def objection(text: str) -> str | None:
    """What a text has that is not read, found before anything is built from it; None: nothing.

    A few lines of aliases unfold to more than memory holds, and the time that brackets within
    brackets take grows with the square of their number. Neither has any use here.

    Raises:
        YAMLError: the text is not YAML.
    """
    depth = 0
    for event in YAML(typ="safe").parse(text):
        if isinstance(event, AliasEvent):
            return "YAML aliases (*name) are not read; write the value out"
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > DEEPEST:
            return f"nested deeper than {DEEPEST} levels in line {event.start_mark.line + 1}"
    return None
