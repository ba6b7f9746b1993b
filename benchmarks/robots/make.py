"""Make the robots of the package anew, each from its maker's file by `s3le robot new`.

    python benchmarks/robots/make.py SOURCES [--only g1,h1] [--pictures FOLDER] [--list]

SOURCES has a folder for each source of recipes.yaml; what is missing is named with the command
that gets it. Into s3le/robots go NAME.yaml, urdf/NAME.urdf, and in origin.json maker, source,
licence and SHA-256 of what was read. Then listed.json is written, which `s3le robot list` reads.
Robots that were written by hand (COMAN) are left as they are. Look at the pictures before you
commit.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from sources import Recipe, checksum, described, located, recipes

from s3le.cli import listed
from s3le.errors import S3leError
from s3le.robot.known import ORIGIN, READY
from s3le.robot.robot import Robot
from s3le.store import documents

PARTS = ("{}.yaml", "urdf/{}.urdf", "urdf/{}.srdf")


def main(
    folder: Annotated[Path, typer.Argument(metavar="SOURCES", help="folder of sources")] = Path(),
    only: Annotated[str, typer.Option(help="these robots alone, with commas")] = "",
    pictures: Annotated[Path | None, typer.Option(help="keep the pictures here")] = None,
    list_only: Annotated[bool, typer.Option("--list", help="write listed.json alone")] = False,
) -> None:
    """Make them, say what each took, and refuse nothing silently."""
    failed = []
    for recipe in [] if list_only else recipes([word for word in only.split(",") if word]):
        if not recipe.made:
            continue
        try:
            print(f"{recipe.name}: {make(recipe, folder.resolve(), pictures)}", flush=True)
        except S3leError as refusal:
            failed.append(recipe.name)
            print(f"{recipe.name}: {refusal}", file=sys.stderr, flush=True)
    write_list()
    if failed:
        raise SystemExit(f"not made: {', '.join(failed)}")


def make(recipe: Recipe, folder: Path, pictures: Path | None) -> str:
    """One robot: propose, put in place, note where it is from; says what `robot new` asked about.

    Raises:
        S3leError: a source is missing, or `robot new` refuses.
    """
    file, name = located(recipe, folder), recipe.name
    words = [word for at in recipe.packages for word in ("--package-path", str(folder / at))]
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch)
        done = subprocess.run(
            [sys.executable, "-m", "s3le.cli", "robot", "new", str(file), "--name", name,
             "--out", str(out), *words, *recipe.options],
            capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise S3leError(" ".join(done.stderr.split()))
        for part in map(str.format, PARTS, [name] * len(PARTS)):
            if (out / part).is_file():
                text = (out / part).read_text(encoding="utf-8")
                if part.endswith(".yaml"):
                    text = f"{_heading(recipe)}{text}"
                documents.write_text(text, READY / part)
            else:
                (READY / part).unlink(missing_ok=True)
        if pictures:
            pictures.mkdir(parents=True, exist_ok=True)
            (pictures / f"{name}.png").write_bytes((out / f"{name}.png").read_bytes())
    origins = json.loads((READY / ORIGIN).read_text(encoding="utf-8"))
    origins = {old: row for old, row in origins.items() if (READY / f"{old}.yaml").is_file()}
    origins[name] = {
        "maker": recipe.maker, "source": f"{described(recipe.source)}, {_below(recipe)}",
        "licence": recipe.licence, "sha256": checksum(recipe, folder),
    } | ({"options": " ".join(recipe.options)} if recipe.options else {})  # fmt: skip
    documents.write_json(origins, READY / ORIGIN)
    looks = [line for line in done.stdout.splitlines() if line.startswith("look: ")]
    return f"made, {len(looks)} to look at" + "".join(f"\n  {line}" for line in looks)


def write_list() -> None:
    """What `s3le robot list` says of the robots of the package, held against their files."""
    documents.write_json(
        {file.stem: {"files": listed.fingerprint(file)} | listed.about(Robot.load(file))
         for file in sorted(READY.glob("*.yaml"))},
        READY / listed.RECORD,
    )  # fmt: skip


def _below(recipe: Recipe) -> str:
    return recipe.file.partition("/")[2]


def _heading(recipe: Recipe) -> str:
    """What a robot file says of where it is from."""
    return (
        f"# {recipe.maker}: {_below(recipe)} of {described(recipe.source)} ({recipe.licence}),\n"
        "# as `s3le robot new` proposes it; benchmarks/robots/make.py makes it anew. Kinematics\n"
        "# are the maker's, bodies are made around its geometry.\n"
    )


if __name__ == "__main__":
    typer.run(main)
