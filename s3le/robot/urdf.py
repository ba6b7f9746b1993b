"""What pinocchio's URDF reader does in silence, refused: elements it skips, geometry it drops.

A misspelt `<origin>` or `lower` is no error to it, only another robot, so names that are nearly
one that matters here are refused; unknown names that resemble none are extensions and pass.
"""

import contextlib
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path

from s3le.errors import RobotError
from s3le.robot import markup
from s3le.robot.description import Description

LARGEST = 4 * 2**20  # [bytes] of a URDF; large ones have half a million
FINE = "fine"  # name of a <collision> that stands for its link in some pairs only
ALIKE = 0.7  # of two names, above which one is taken for a slip of the other
# Element -> those in it that matter here, and further ones that may be there.
_ELEMENTS = {
    "robot": ("link joint", "material transmission gazebo"),
    "link": ("collision", "inertial visual"),
    "joint": ("parent child origin axis limit", "dynamics mimic safety_controller calibration"),
    "collision": ("origin geometry", "material name"),
    "geometry": ("capsule sphere box cylinder", "mesh"),
}
_ATTRIBUTES = {
    "parent": "link",
    "child": "link",
    "origin": "xyz rpy",
    "axis": "xyz",
    "limit": "lower upper velocity effort",
    "joint": "name type",
    "link": "name",
}
_ONCE = ("joint", "collision", "geometry")  # of whose children each may be there only once


def elements(path: Path, data: bytes | None = None) -> ElementTree.Element:
    """The elements of a URDF, once no name in it is a slip of one that matters.

    Args:
        path: the file.
        data: its text, where it was read already.

    Raises:
        RobotError: not well-formed, too long, with a DOCTYPE, of another root, a misspelt name,
            or an element twice where one is read.
    """
    if data is None:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    root = markup.parse(data, path, LARGEST, "a URDF")
    links, joints = root.findall("link"), root.findall("joint")
    bodies = root.findall("link/collision")
    for item in [root, *links, *joints, *bodies, *root.iterfind("link/collision/geometry")]:
        wanted, others = (words.split() for words in _ELEMENTS[item.tag])
        for tag in dict.fromkeys(child.tag for child in item):
            if tag not in wanted + others:
                _refuse_slip(path, f"<{tag}> in {_named(item)}", tag, wanted)
        counts = Counter(child.tag for child in item)
        for tag in wanted if item.tag in _ONCE else []:
            if counts[tag] > 1:
                raise RobotError(f"{path}: {counts[tag]} <{tag}> in {_named(item)}, one is read")
    for parent in [*links, *joints, *bodies]:
        for item in [parent, *parent]:
            wanted = _ATTRIBUTES.get(item.tag, "").split()
            for name in item.keys():
                if wanted and name not in wanted:
                    _refuse_slip(path, f"{name} of <{item.tag}> in {_named(parent)}", name, wanted)
    return root


def finer(text: Description, tree: ElementTree.Element) -> set[str]:
    """Names of the bodies that are finer: those whose <collision> is called `fine`.

    Raises:
        RobotError: a link has finer bodies alone, or the robot file asks for some that are not.
    """
    found, links, every = set(), set(), set()
    for link in tree.findall("link"):
        name = link.get("name", "")
        every.add(name)
        marked = [item.get("name") == FINE for item in link.findall("collision")]
        if any(marked) and all(marked):
            raise RobotError(
                f"{text.urdf}: link '{name}' has bodies that are `{FINE}` and no other"
            )
        found |= {f"{name}_{k}" for k, fine in enumerate(marked) if fine}
        links |= {name} if any(marked) else set()
    for pair in text.finer:
        for name in sorted(pair - every):
            raise RobotError(
                f"{text.source}: finer names '{name}', which is no link of {text.urdf.name}"
            )
        if not pair & links:
            raise RobotError(
                f"{text.source}: finer names {' and '.join(sorted(pair))}, of which neither has a "
                f'<collision name="{FINE}">'
            )
    return found


def _named(item: ElementTree.Element) -> str:
    return f"<{item.tag}> '{item.get('name')}'" if item.get("name") else f"a <{item.tag}>"


def _refuse_slip(path: Path, what: str, name: str, wanted: list[str]) -> None:
    if near := get_close_matches(name.lower()[:100], wanted, n=1, cutoff=ALIKE):
        raise RobotError(f"{path}: {what} is not read; did you mean {near[0]}?")


def refuse_mimicry(text: Description, root: ElementTree.Element) -> None:
    """Refuse a joint that would move although the model has it standing still.

    Raises:
        RobotError: a moving joint mimics another, one that is held mimics a moving one, one of the
            two has a range, or it is held at another angle than it has when its master is held
            where it is.
    """
    for item in root.findall("joint"):
        mimic, name = item.find("mimic"), item.get("name", "")
        if mimic is None:
            continue
        master = mimic.get("joint", "")
        if ranged := next((one for one in (name, master) if one in text.ranges), ""):
            raise RobotError(
                f"{text.source}: given.{ranged}: joint '{name}' mimics '{master}', which is not "
                "modelled for ranges; leave the range out, or remove <mimic>"
            )
        if name in text.joints:
            raise RobotError(
                f"{text.urdf}: joint '{name}' mimics '{master}' and cannot move by itself; take it "
                "off joints, and points beyond it, or remove <mimic>"
            )
        if master in text.joints:
            raise RobotError(
                f"{text.urdf}: joint '{name}' mimics '{master}' and would move with it, which is "
                f"not modelled; take '{master}' off joints, or remove <mimic>"
            )
        try:
            factor, offset = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
        except ValueError:
            raise RobotError(
                f"{text.urdf}: <mimic> of joint '{name}' needs numbers for multiplier and offset"
            ) from None
        angle = factor * text.hold.get(master, 0.0) + offset
        if not abs(text.hold.get(name, 0.0) - angle) <= 1e-6:
            raise RobotError(
                f"{text.source}: joint '{name}' mimics '{master}', so hold it at {angle:.6g}"
            )


def refuse_lost_geometry(where: str, root: ElementTree.Element, names: list[str]) -> None:
    """Refuse a link whose collision geometry the URDF reader dropped, which it does in silence.

    Args:
        where: the file, for the refusal.
        root: its elements.
        names: of the geometry that was read: the link's, and its number on the link.

    Raises:
        RobotError: a link has lost some.
    """
    read = Counter(name.rpartition("_")[0] for name in names)
    for link in root.findall("link"):
        written = len(link.findall("collision"))
        name = link.get("name")
        there = 0 if name is None else read[name]
        if there < written:
            raise RobotError(
                f"{where}: link '{name}' has {written} collision elements, only "
                f"{there} could be read; write finite sizes, and "
                '<robot version="1.1"> where there is a <capsule>'
            )


@contextlib.contextmanager
def quiet(printed: list[str]) -> Iterator[None]:
    """Collect the lines that C++ prints to standard error while the block runs, here of urdfdom.

    What other threads print meanwhile is collected too, so keep the block short.
    """
    with tempfile.TemporaryFile() as file:
        try:
            kept = os.dup(2)
        except OSError:  # there is no standard error, so nothing to keep quiet
            yield
            return
        try:
            os.dup2(file.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            text = file.read(LARGEST).decode("utf-8", "replace")
            lines = (" ".join(line.split()) for line in text.splitlines())
            printed += [line for line in lines if line and not line.startswith("at line")]
