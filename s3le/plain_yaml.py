"""YAML as far as people write parameters and robots in it: no aliases, no bottomless nesting."""

from ruamel.yaml import YAML
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

DEEPEST = 32  # levels; params.yaml has two, a robot file four


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
