"""Which robots there are, and where: those that come with the package, and people's own."""

import json
from pathlib import Path

from s3le.errors import RobotError

MARGIN, NECK = 0.002, "midpoint"  # of a robot file, which says neither; see params.yaml
OWN = Path("data/robots")  # of a checkout, or of whoever has such a folder
READY = Path(__file__).parents[1] / "robots"  # what comes with the package
ORIGIN = "origin.json"


def named(name: str, folders: tuple[Path, ...] = (OWN,)) -> Path:
    """The robot file of a name: of the first folder that has it, else of the package.

    Raises:
        RobotError: there is none; lists those that are there.
    """
    places = (*folders, READY)
    for folder in places:
        file = folder / f"{name}.yaml"
        if Path(name).name == name and file.is_file():
            return file
    raise RobotError(
        f"there is no robot '{name}': give a folder with settings.json, a robot file (.yaml), or "
        f"one of: {', '.join(listed())}"
    )


def listed() -> dict[str, Path]:
    """Name -> robot file, of the package and of data/robots, which goes before."""
    files = [file for folder in (READY, OWN) for file in sorted(folder.glob("*.yaml"))]
    return dict(sorted((file.stem, file) for file in files))


def origin(file: Path) -> dict[str, str]:
    """Maker, source and licence of a robot that comes with the package; {} of any other."""
    if file.parent != READY:
        return {}
    return json.loads((READY / ORIGIN).read_text(encoding="utf-8")).get(file.stem, {})
