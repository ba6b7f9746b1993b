"""Pairs of links that an SRDF (MoveIt's file of meaning beside a URDF) takes off checks."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from s3le.errors import RobotError

LARGEST = 4 * 2**20  # [bytes]; large ones have two hundred thousand


def disabled(path: Path) -> dict[frozenset[str], str]:
    """Pairs of links that are not to be watched, with the reason that the file gives.

    Raises:
        RobotError: the file is missing, too long, no SRDF, or an entry lacks a link.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except OSError as error:
        raise RobotError(f"{path}: not readable ({error.strerror}); give another SRDF") from None
    if len(data) > LARGEST:
        raise RobotError(f"{path}: longer than the {LARGEST / 2**20:g} MiB of an SRDF")
    if b"<!DOCTYPE" in data:
        raise RobotError(f"{path}: a DOCTYPE is not read; write its entities out")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotError(f"{path}: not well-formed XML ({error})") from None
    if root.tag != "robot":
        raise RobotError(f"{path}: its root is <{root.tag}>, wanted the <robot> of an SRDF")
    pairs = {}
    for item in root.findall("disable_collisions"):
        one, two = item.get("link1"), item.get("link2")
        if not one or not two:
            raise RobotError(f"{path}: a <disable_collisions> needs link1 and link2")
        pairs[frozenset((one, two))] = item.get("reason") or "no reason given"
    return pairs


def text(name: str, pairs: dict[frozenset[str], str]) -> str:
    """An SRDF with these pairs and nothing else."""
    root = ElementTree.Element("robot", {"name": name})
    for pair, reason in pairs.items():
        one, two = sorted(pair) if len(pair) == 2 else (*pair, *pair)
        entry = {"link1": one, "link2": two, "reason": reason}
        ElementTree.SubElement(root, "disable_collisions", entry)
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
