"""How long a newcomer waits: `pip install`, the first motion, the next one, another robot.

    python benchmarks/first_motion.py [--clip FILE] [--urdf FILE] [--keep FOLDER] [--index-url URL]

A wheel is built and installed into an empty environment with an empty cache; then the commands
run there one after the other, each in a process of its own, from an empty folder. A second table
says where the seconds of the first motion go, in an environment whose cache is empty again.
Nothing is asserted; times are those of this machine, which should do nothing else meanwhile.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))
from handmade import bvh, write  # noqa: E402

# Run inside the environment: the same calls as `s3le retarget`, with a clock between them.
PARTS = """
import json, sys, time
clip, robot = sys.argv[1:]
begun, spent, seen = time.perf_counter(), {}, {}
def lap(name):
    spent[name] = time.perf_counter() - begun - sum(spent.values())
import s3le
from s3le.human.skeletons import read_frames
from s3le.retarget import clip as clips, outputs, stored
lap("import")
made = s3le.Robot.load(robot)
lap("robot file and URDF")
def watch(what, more, total):
    seen[what] = time.perf_counter() - begun
its = stored.retargeter_for(made, watch=watch)
lap("kernels and poses")
frames = read_frames(clip, made.neck)
lap("read the clip")
out = clips.convert(its, frames)
lap("follow and audit the clip")
print(json.dumps({"spent": spent, "seen": seen}))
"""


class Timed:
    """Runs commands and notes wall and processor seconds of each."""

    def __init__(self, where: Path, env: dict[str, str]) -> None:
        """Commands run in the folder where, with this environment."""
        self.where, self.env, self.rows = where, env, []

    def run(self, what: str, *words: object) -> str:
        """One command; what it printed."""
        before, begun = os.times(), time.perf_counter()
        done = subprocess.run(
            list(map(str, words)), cwd=self.where, env=self.env, capture_output=True, text=True
        )
        wall, after = time.perf_counter() - begun, os.times()
        if done.returncode:
            raise SystemExit(f"{what}: {done.stderr[-3000:]}")
        spent = (after.children_user + after.children_system) - (
            before.children_user + before.children_system
        )
        self.rows.append((what, wall, spent))
        typer.echo(f"{what}: {wall:.1f} s", err=True)
        return done.stdout


def main(
    clip: Annotated[
        Path | None, typer.Option(help="Motion file.", show_default="300 frames by hand")
    ] = None,
    urdf: Annotated[
        Path | None, typer.Option(help="Of the new robot.", show_default="COMAN's own")
    ] = None,
    keep: Annotated[
        Path | None, typer.Option(help="Environment to use, made if need be, and left there.")
    ] = None,
    index_url: Annotated[str | None, typer.Option(help="Where pip looks.")] = None,
) -> None:
    """Measure and print two tables."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        here = folder / "empty"
        here.mkdir()
        env = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        env.pop("NUMBA_CACHE_DIR", None)
        env["XDG_CACHE_HOME"] = str(folder / "cache")
        timed = Timed(here, env)
        motion = clip.resolve() if clip else write(here / "wave.bvh", _waving())
        place = keep.resolve() if keep else folder / "environment"
        _install(timed, place, folder, index_url)
        s3le, python = place / "bin" / "s3le", place / "bin" / "python"
        size = sum(p.stat().st_size for p in place.rglob("*") if p.is_file()) / 2**20
        timed.run("s3le --help", s3le, "--help")
        timed.run("first motion", s3le, "retarget", motion, "--out", "a")
        timed.run("second motion", s3le, "retarget", motion, "--out", "b")
        made = (here / "a" / Path(motion).name).with_suffix(".parquet")
        timed.run("first audit", s3le, "audit", made)
        timed.run("first motion of g1", s3le, "retarget", motion, "--robot", "g1", "--out", "c")
        timed.run("second motion of g1", s3le, "retarget", motion, "--robot", "g1", "--out", "d")
        robot = (urdf or ROOT / "s3le/robots/urdf/coman.urdf").resolve()
        timed.run("robot new", s3le, "robot", "new", robot, "--name", "my")
        timed.run("its first motion", s3le, "retarget", motion, "--robot", "my", "--out", "e")
        kept = {
            kind: sum(p.stat().st_size for p in found.rglob("*") if p.is_file()) / 2**20
            for kind, found in (
                ("kernels", next((folder / "cache" / "s3le").glob("kernels-*"))),
                ("poses of coman", next((folder / "cache" / "s3le" / "poses").glob("coman-*"))),
            )
        }
        parts = {}
        timed.env = env | {"XDG_CACHE_HOME": str(folder / "another")}
        for name in ("cold", "warm"):
            said = timed.run(f"parts, {name}", python, "-c", PARTS, motion, "coman")
            parts[name] = json.loads(said.splitlines()[-1])
    sizes = {"environment": size} | kept
    typer.echo(", ".join(f"{what}: {megabytes:.1f} MB" for what, megabytes in sizes.items()))
    typer.echo("\n| command | wall [s] | processor [s] |\n|---|---:|---:|")
    for what, wall, spent in timed.rows:
        typer.echo(f"| {what} | {wall:.1f} | {spent:.1f} |")
    typer.echo("\n| part of a motion | cold [s] | warm [s] |\n|---|---:|---:|")
    for part in parts["cold"]["spent"]:
        cold, warm = (parts[name]["spent"][part] for name in ("cold", "warm"))
        typer.echo(f"| {part} | {cold:.2f} | {warm:.2f} |")
    for what, at in parts["cold"]["seen"].items():
        typer.echo(f"last of the {what} came {at:.1f} s after the start")


def _waving() -> str:
    rows = [[0, 0, 0, 0, 0, 0, -40 * abs((k % 60) / 30 - 1), 0, 0, 0, 0, 0] for k in range(300)]
    return bvh(rows, order="ZXY", step="0.0333333")


def _install(timed: Timed, place: Path, folder: Path, index_url: str | None) -> None:
    """An environment with the wheel of this checkout and what it brings."""
    source = folder / "source"
    skip = shutil.ignore_patterns(".*", "data", "reports", "build", "*.egg-info")
    shutil.copytree(ROOT, source, ignore=skip)
    more = ["--index-url", index_url] if index_url else []
    pip = [place / "bin" / "python", "-m", "pip"]
    if not place.exists():
        timed.run("python -m venv", sys.executable, "-m", "venv", place)
    timed.run("pip install", *pip, "install", "-q", "-U", *more, source)


if __name__ == "__main__":
    typer.run(main)
