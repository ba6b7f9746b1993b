"""Pairs of links that an SRDF (MoveIt's file of meaning beside a URDF) takes off checks."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from s3le.errors import RobotError
from s3le.robot import markup

LARGEST = 4 * 2**20  # [bytes]; large ones have two hundred thousand


def disabled(path: Path, data: bytes | None = None) -> dict[frozenset[str], str]:
    """Pairs of links that are not to be watched, with the reason that the file gives.

    Args:
        path: the file.
        data: its text, where it was read already.

    Raises:
        RobotError: the file is missing, too long, no SRDF, or an entry lacks a link.
    """
    path = Path(path)
    if data is None:
        try:
            with path.open("rb") as stream:
                data = stream.read(LARGEST + 1)
        except OSError as error:
            raise RobotError(
                f"{path}: not readable ({error.strerror}); give another SRDF"
            ) from None
    root = markup.parse(data, path, LARGEST, "an SRDF")
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
