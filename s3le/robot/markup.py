"""XML of robots as elements: bounded, without entities that could grow, refused in one line."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from s3le.errors import RobotError


def parse(data: bytes, path: Path, longest: int, what: str) -> ElementTree.Element:
    """The root of a text, which must be <robot>.

    Args:
        data: the text.
        path: the file that it is of, for the refusal.
        longest: most bytes that are taken.
        what: what it is meant to be, for the refusal, e.g. "a URDF".

    Raises:
        RobotError: not well-formed, too long, with a DOCTYPE, or of another root.
    """
    if len(data) > longest:
        raise RobotError(f"{path}: longer than the {longest / 2**20:g} MiB of {what}")
    if b"<!DOCTYPE" in data:
        raise RobotError(f"{path}: a DOCTYPE is not read; write its entities out")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotError(f"{path}: not well-formed XML ({error})") from None
    if root.tag != "robot":
        raise RobotError(
            f"{path}: its root is <{root.tag}>, wanted the <robot> of {what} (and no xmlns)"
        )
    return root
