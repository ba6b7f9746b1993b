"""What is drawn of a robot beyond its bodies: the record that `s3le robot new` leaves in its URDF.

A certificate speaks of bodies. How far each link's drawing reaches beyond them was measured when
the robot file was made, for the drawings do not travel with it. In the URDF, `<covered
allowance= bodies=>` says that it was measured, and for which bodies; in each link that is drawn,
`<covered reach= share=>` says what was found. For robots of the package whose URDF has no such
elements it stands in robots/covered.json.
"""

import hashlib
import json
import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from functools import lru_cache
from typing import Any, NamedTuple

from s3le.errors import RobotError
from s3le.robot.known import READY
from s3le.robot.model import Geometry
from s3le.robot.urdf import FINE

TAG = "covered"
ALLOWANCE = 0.02  # [m] that a drawing may reach beyond bodies before it is told
_READY = "covered.json"


class Drawn(NamedTuple):
    """What was found of one link that is drawn."""

    link: str
    reach: float  # [m] of its drawing beyond the bodies fixed to it; 0: within; NaN: not known
    share: float  # of the volume that is drawn, how much lies outside; NaN: not known


class Record(NamedTuple):
    """What was found of a robot's drawings."""

    allowance: float  # [m]
    links: tuple[Drawn, ...]  # those that are drawn

    @property
    def beyond(self) -> tuple[Drawn, ...]:
        """Links whose drawing reaches farther than is allowed, or whose reach is not known."""
        return tuple(item for item in self.links if not item.reach <= self.allowance)


def read(robot: Geometry) -> Record | None:
    """The record of a robot; None: there is none, or its bodies have been changed since.

    Raises:
        RobotError: a record is there and cannot be read; says where.
    """
    root, where = robot.tree, str(robot.description.urdf)
    bodies = fingerprint(root)
    head = root.find(TAG)
    if head is None:
        return _ready().get(bodies)
    if head.get("bodies") != bodies:
        return None
    links = []
    for link in root.findall("link"):
        item = link.find(TAG)
        if item is not None:
            name = link.get("name") or ""
            links.append(Drawn(name, *(_number(where, item, key) for key in ("reach", "share"))))
    return Record(_number(where, head, "allowance"), tuple(links))


def mark(root: ElementTree.Element, record: Record) -> None:
    """Put a record into a URDF's elements, once its bodies are as they will be."""
    for parent in [root, *root.findall("link")]:
        for old in parent.findall(TAG):
            parent.remove(old)
    links = {link.get("name"): link for link in root.findall("link")}
    for item in record.links:
        said = {"reach": _word(item.reach), "share": _word(item.share)}
        ElementTree.SubElement(links[item.link], TAG, said)
    said = {"allowance": repr(float(record.allowance)), "bodies": fingerprint(root)}
    root.insert(0, ElementTree.Element(TAG, said))


def fingerprint(root: ElementTree.Element) -> str:
    """Of all that a URDF says of bodies, 16 hexadecimal digits; a changed body changes it."""
    parts = []
    for link in root.findall("link"):
        for item in link.findall("collision"):
            parts.append(link.get("name") or "")
            parts += [FINE] if item.get("name") == FINE else []
            for element in item.iter():
                if element.tag != "collision":  # whose other names matter to nobody
                    parts += [str(element.tag), *(f"{k}={v}" for k, v in sorted(element.items()))]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def counts(robot: Geometry) -> Counter[str]:
    """Bodies of each link."""
    return Counter(body.link for body in robot.bodies)


def tree(robot: Geometry) -> list[dict[str, Any]] | None:
    """Links that are drawn beyond their bodies, as JSON can hold them; None: not measured."""
    record = read(robot)
    if record is None:
        return None
    return [
        {
            "link": item.link,
            "reach_m": None if math.isnan(item.reach) else item.reach,
            "share_outside": None if math.isnan(item.share) else item.share,
        }
        for item in record.beyond
    ]


def warning(robot: Geometry) -> str | None:
    """One line on what certificates of a robot leave out of its drawing; None: nothing."""
    record = read(robot)
    if record is None:
        return (
            f"robot {robot.name}: its bodies were never held against what is drawn of it, so a "
            "certificate may leave parts of it out; make its file anew with s3le robot new"
        )
    if not record.beyond:
        return None
    named = ", ".join(say(item) for item in record.beyond[:6])
    rest = len(record.beyond) - 6
    return (
        f"robot {robot.name}: drawn beyond its bodies, and not covered there: {named}"
        + (f" and {rest} more" if rest > 0 else "")
        + "; s3le robot new without --collision-only puts bodies around what is drawn"
    )


def say(item: Drawn) -> str:
    """A link and how far it reaches, in a few words."""
    if math.isnan(item.reach):
        return f"{item.link} (not measured)"
    return f"{item.link} ({item.reach * 1e3:.0f} mm, {item.share:.0%} outside)"


@lru_cache(maxsize=1)
def _ready() -> dict[str, Record]:
    """Records of the package's own robots, by the fingerprint of their bodies."""
    held = json.loads((READY / _READY).read_text(encoding="utf-8"))
    return {
        bodies: Record(
            float(entry["allowance"]),
            tuple(Drawn(link, *map(float, found)) for link, found in entry["links"].items()),
        )
        for bodies, entry in held.items()
    }


def _number(where: str, item: ElementTree.Element, key: str) -> float:
    word = item.get(key) or ""
    if word == "unknown" and key != "allowance":
        return math.nan
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:  # NaN compares False
        raise RobotError(
            f"{where}: {key} of a <{TAG}> is {word!r}, no number that it can be; make the robot "
            "file anew with s3le robot new"
        )
    return value


def _word(value: float) -> str:
    return "unknown" if math.isnan(value) else f"{value:.6f}"
