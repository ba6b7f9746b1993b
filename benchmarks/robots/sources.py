"""Where the package's robots come from: recipes.yaml, and the files that it names.

A folder of sources has one folder for each source, named as in recipes.yaml: a checkout at the
commit there, or what the package there installs. `described` says how to get each.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import RobotError
from s3le.onboard import reading
from s3le.onboard.hulls import corners
from s3le.onboard.source import Source
from s3le.store import yaml

RECIPES = Path(__file__).with_name("recipes.yaml")
_FILE = re.compile(r"""\bfile(?:name)?\s*=\s*["']([^"']+)["']""")


class Recipe(NamedTuple):
    """What one robot of the package is made from, and how."""

    name: str
    file: str  # the maker's URDF or MJCF, below the folder of sources
    packages: tuple[str, ...] = ()  # folders below it in which packages are looked for
    options: tuple[str, ...] = ()  # of s3le robot new
    add: tuple[tuple[str, str], ...] = ()  # files below the sources, and where copies belong
    maker: str = ""
    source: str = ""  # its key in `sources`
    licence: str = ""  # SPDX
    made: bool = True  # False: its files are written by hand, and only judged


def recipes(only: list[str] | None = None) -> list[Recipe]:
    """All recipes, or those of these names, in the file's order.

    Raises:
        RobotError: a name has none, or the file is damaged.
    """
    tree = _tree()
    names = list(tree["robots"])
    if unknown := [name for name in only or () if name not in names]:
        raise RobotError(f"{RECIPES}: no robot '{unknown[0]}'; there are {', '.join(names)}")
    found = []
    for name, row in tree["robots"].items():
        if only and name not in only:
            continue
        made = tree["sources"][row["source"]]
        found.append(
            Recipe(
                name, row["file"], tuple(row.get("packages", ())),
                tuple(map(str, row.get("options", ()))), tuple(row.get("add", {}).items()),
                row["maker"], row["source"], row.get("licence", made["licence"]),
                bool(row.get("made", True)),
            )
        )  # fmt: skip
    return found


def described(source: str) -> str:
    """A source in words, for people who read where a robot is from."""
    made = _tree()["sources"][source]
    if "package" in made:
        return f"the package {made['package']}"
    return f"{made['repository']}, commit {made['commit'][:7]}"


def how(source: str) -> str:
    """What to do to get a source into the folder of sources."""
    made = _tree()["sources"][source]
    if "package" in made:
        return f"pip download --no-deps {made['package']}, unpack, and put {made['folder']} there"
    then = f", there {made['then']}" if "then" in made else ""
    return f"git clone https://github.com/{made['repository']}, checkout {made['commit']}{then}"


def located(recipe: Recipe, folder: Path) -> Path:
    """The robot's file, once what it wants from other sources has been put beside it.

    Raises:
        RobotError: it or one of them is not there; says how to get it.
    """
    for wanted in (recipe.file, *(origin for origin, _ in recipe.add)):
        if not (folder / wanted).is_file():
            source = wanted.split("/")[0]
            raise RobotError(f"{folder / wanted} is not there; {how(source)} as {folder / source}")
    for origin, target in recipe.add:
        if not (folder / target).is_file():
            (folder / target).write_bytes((folder / origin).read_bytes())
    return folder / recipe.file


def read(recipe: Recipe, folder: Path) -> Source:
    """The robot as its maker wrote it, with all that is drawn.

    Raises:
        RobotError: a file is missing or cannot be read.
    """
    return reading.read(located(recipe, folder), [folder / at for at in recipe.packages])


def drawn(recipe: Recipe, folder: Path) -> dict[str, Any]:
    """Corners of the convex hull of every drawn piece, LINK/K -> (n, 3) [m] in the link's frame.

    What a link has as collision geometry stands where nothing is drawn of it. Spheres and capsules
    have no corners: judged are meshes, boxes and cylinders.
    """
    origin = read(recipe, folder)
    found = {}
    for link in dict.fromkeys([*origin.drawn, *origin.shapes]):
        for k, shape in enumerate(origin.drawn.get(link) or origin.shapes[link]):
            hull = corners(shape.triangles.reshape(-1, 3))
            if len(hull):
                found[f"{link}/{k}"] = hull
    return found


def checksum(recipe: Recipe, folder: Path) -> str:
    """SHA-256 over the robot's file and over every file that it names, in the names' order."""
    file = located(recipe, folder)
    text = file.read_text(encoding="utf-8", errors="replace")
    whole = hashlib.sha256(file.read_bytes())
    for name in sorted(set(_FILE.findall(text))):
        path = _resolved(name, file, [folder / at for at in recipe.packages])
        if path is not None:
            whole.update(f"\0{name}\0".encode() + path.read_bytes())
    return whole.hexdigest()


def _resolved(name: str, file: Path, packages: list[Path]) -> Path | None:
    inside = re.sub(r"^(package|model|file)://", "", name)
    tail = inside.partition("/")[2]
    roots = [file.parent, *packages, *file.resolve().parents, file.parent / "meshes"]
    for root in roots:
        for path in (root / inside, root / tail if tail else root / inside):
            if path.is_file():
                return path
    return None


def _tree() -> Mapping[str, Any]:
    return yaml.mapping(RECIPES, "the keys sources, robots", RobotError, yaml.LARGEST, None)[0]
