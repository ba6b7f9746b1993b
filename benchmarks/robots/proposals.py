"""What `s3le robot new` is sure of, held against a person's reading of each robot's file.

    python benchmarks/robots/proposals.py SOURCES [--only talos,romeo]

proposals.yaml says of each robot where hip, shoulder, elbow, hand and waist are and how its base is
turned, as somebody read them from the file and its picture, and what `robot new` has to ask about.
Printed is what it found instead: right; asked, where it differs and says so (`look`); WRONG, where
it differs and is sure. SOURCES has a folder for each repository or package, called as it is. Robots
that are not there are passed over. Exit status: 1 if anything is WRONG.
"""

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from s3le.errors import RobotError
from s3le.onboard import limbs, reading
from s3le.store import yaml

READ = Path(__file__).with_name("proposals.yaml")
RIGHT, ASKED, WRONG = "right", "asked", "WRONG"
PARTS = ("hip", "shoulder", "elbow", "hand", "waist", "base")


def main(
    folder: Annotated[Path, typer.Argument(metavar="SOURCES", help="folder of sources")],
    only: Annotated[str, typer.Option(help="these robots alone, with commas")] = "",
) -> None:
    """Print the table."""
    tree = readings()
    print("| robot | " + " | ".join(PARTS) + " | asks about |\n|---|" + "---|" * (len(PARTS) + 1))
    wrong = []
    for name, read in tree.items():
        if (only and name not in only.split(",")) or not (folder / read["file"]).is_file():
            continue
        found, asks = verdicts(folder / read["file"], read, folder)
        print(f"| {name} | {' | '.join(found)} | {asks} |", flush=True)
        if WRONG in " ".join(found):
            wrong.append(name)
    if wrong:
        sys.exit(f"sure and wrong: {', '.join(wrong)}")


def readings() -> dict[str, Any]:
    """What a person read, by robot."""
    return yaml.mapping(READ, "robots", RobotError, yaml.LARGEST, None)[0]


def verdicts(file: Path, read: dict[str, Any], folder: Path) -> tuple[list[str], str]:
    """Of each part whether it is right, and what is asked about; packages may lie in the folder."""
    packages = [folder, file.parent, *file.resolve().parents[:6]]
    try:
        try:
            origin = reading.read(file, packages)
        except RobotError:
            origin = reading.read(file, packages, collision_only=True)
        found = limbs.find(origin)
    except RobotError as refusal:
        said = str(refusal).partition(": ")[2][:80]
        good = "refused" in read
        return [RIGHT if good else f"refused: {said}"] + [""] * (len(PARTS) - 1), ""
    if "refused" in read:
        return [f"{WRONG}: taken, though {read['refused']}"] + [""] * (len(PARTS) - 1), ""
    names = origin.model.names
    side = "l" if "l_hand" in found.points else "r"
    at = {part: found.points.get(f"{side}_{part}") for part in ("shoulder", "elbow", "hand")}
    at["hip"] = found.points["hip"]
    turn = np.degrees(np.arctan2(found.base[0, 1], found.base[0, 0]))
    here = {part: _word(value) for part, value in at.items()} | {
        "waist": [names[j] for j in found.waist],
        "base": round(float(turn)) % 360 if abs(found.base[2, 2] - 1) < 1e-6 else "tilted",
    }
    asked = sorted({line.partition(":")[0].removeprefix("l_").removeprefix("r_")
                    for line in found.look if ":" in line} & {*PARTS, "arms"})  # fmt: skip
    out = []
    for part in PARTS:
        same = here[part] == read.get(part, 0 if part == "base" else None)
        told = part in asked or ("arms" in asked and part in ("shoulder", "elbow", "hand"))
        out.append(RIGHT if same else f"{ASKED if told else WRONG}: {here[part]}")
    if lost := set(read.get("asks", ())) - set(asked):
        out[0] += f"; {WRONG}: does not ask about {', '.join(sorted(lost))}"
    return out, ", ".join(asked)


def _word(point: Any) -> str:
    """A point as it is written down: a name; with a star where an offset is added."""
    return point if isinstance(point, str) else f"{point['frame']}*"


if __name__ == "__main__":
    typer.run(main)
