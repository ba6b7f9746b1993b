"""`make judge`: up to a million steps before an independent judge.

Streams and whole motions of the exported retargeter, and joint motions through its robot's guard.

Work is cut into shards, each determined by the seed and its number. A shard that was judged with
the same code, retargeter, seed and clips (data/judge/<key>) is not judged again, so a run that was
stopped goes on, and a later commit begins anew. What was seen is one record,
reports/judge/steps.json; of the search, reports/judge/search.json.
"""

import hashlib
import json
import platform
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import hunt
import numpy as np
import shards
import typer
from tqdm import tqdm

from s3le.errors import S3leError
from s3le.store import documents
from s3le.tuples.engine.key import closure

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
WORK, REPORTS = Path("data/judge"), Path("reports/judge")
FOLDER, FRAMES = Path("data/retargeter"), Path("data/skeletons.parquet")
# What decides a shard.
JUDGED_BY = (
    "continuous.py", "engines.py", "joints.py", "judging.py", "plans.py", "shards.py", "streams.py",
)  # fmt: skip
DOORS = ("s3le.retarget.stream", "s3le.retarget.follow", "s3le.guard.guard", "s3le.guard.task")
EXAMPLES = """

Examples:

  make judge                                      a million steps; go on with the same words

  make judge ARGS="--steps 20000"                 a first look, in minutes

  make judge ARGS="--seconds 1500 --workers 8"    as many as there is time for

  make judge ARGS="--clips /a/folder/of/clips"    real motions from other files

  make judge ARGS="--search 10"                   look for a violation for ten minutes instead
"""


def main(
    steps: Annotated[int, typer.Option(min=1, help="steps to judge")] = 1_000_000,
    seconds: Annotated[float, typer.Option(help="stop after so long; 0: when done")] = 0.0,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    search: Annotated[float, typer.Option(help="minutes to search for a violation instead")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="root of all chance")] = 1,
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = FOLDER,
    clips: Annotated[
        Path | None, typer.Option(help="folder of clips; without it those of the pipeline")
    ] = None,
    reports: Annotated[Path, typer.Option(help="where the record is written")] = REPORTS,
    work: Annotated[Path, typer.Option(help="where shards are kept")] = WORK,
) -> None:
    """Judge what retargeter and guard do, step by step; exit status 1 if a promise is broken."""
    try:
        court = shards.Court(folder, clips or FRAMES)
    except S3leError as error:
        raise SystemExit(f"make judge: {error}") from None
    about = describe(court, seed)
    if search > 0.0:
        found = hunt.search(court, search * 60.0, seed, bar)
        documents.write_json(about | found, reports / "search.json")
        raise SystemExit(_say(found, reports / "search.json"))
    shelf = work / key(court, seed)
    count = -(-steps // shards.STEPS)
    done = {i: known for i in range(count) if (known := read(shelf / f"{i:06d}.json"))}
    stop = time.monotonic() + seconds if seconds > 0.0 else np.inf
    with bar(count * shards.STEPS, "steps", len(done) * shards.STEPS) as shown:
        try:
            todo = (i for i in range(count) if i not in done and time.monotonic() < stop)
            one = partial(court.shard if workers == 1 else shards.judged, seed)
            for i, made in perform(one, todo, workers, shards.begin, (court.folder, court.source)):
                documents.write_json(made, shelf / f"{i:06d}.json")
                done[i] = made
                shown.update(shards.STEPS)
        except KeyboardInterrupt:
            typer.echo("\nstopped; the same command goes on from here", err=True)
    if not done:
        raise SystemExit("make judge: not one shard was finished; nothing is recorded")
    found = total([done[i] for i in sorted(done)])
    found = {"complete": len(done) == count, "steps_planned": count * shards.STEPS} | found
    documents.write_json(about | found, reports / "steps.json")
    _pace(done.values())
    raise SystemExit(_say(found, reports / "steps.json"))


def perform(
    one: Callable[[int], dict[str, Any]],
    todo: Iterable[int],
    workers: int,
    begin: Callable[..., None] | None = None,
    given: tuple = (),
) -> Any:
    """Pairs (number, record) of the shards to do, in the order in which they are finished.

    Args:
        one: judges a shard; here if there is one worker, else in processes of their own.
        todo: numbers of the shards.
        workers: processes.
        begin, given: called once in each of these, and its arguments.
    """
    if workers == 1:
        for i in todo:
            yield i, one(i)
        return
    pool = ProcessPoolExecutor(workers, get_context("spawn"), begin, given)
    try:
        running, todo = {}, iter(todo)
        while True:
            while len(running) < 2 * workers and (i := next(todo, None)) is not None:
                running[pool.submit(one, i)] = i
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:  # also when it is stopped: what was not begun is for the next time
        pool.shutdown(cancel_futures=True)


def key(court: shards.Court, seed: int) -> str:
    """What decides the content of the shards: code, retargeter, clips, seed, engines.

    The code is what streams, files and guards run on, and the judge's own; the readers of clips
    speak through the frames that they gave.
    """
    digest = hashlib.sha256()
    code = set().union(*map(closure, DOORS))
    for path in sorted([*code, *(HERE / n for n in JUDGED_BY)]):
        digest.update(path.read_bytes())
    digest.update((court.folder / "retargeter.json").read_bytes())
    digest.update(json.dumps([court.digest, seed, shards.STEPS, court.versions]).encode())
    return digest.hexdigest()[:16]


def describe(court: shards.Court, seed: int) -> dict[str, Any]:
    """What was judged, by what, and where."""
    commit = _git("rev-parse", "HEAD")[:12]
    dirty = _git("status", "--porcelain", "--", "s3le", "benchmarks/judge")
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit + (" with changes" if dirty else ""),
        "machine": _processor(),
        "robot": court.plain.robot.tag,
        "settings": asdict(court.plain.settings),
        "engines": court.versions,
        "seed": seed,
        "clips": len(court.clips),
        "clip_frames": sum(len(x) for _, x in court.clips),
    }


def total(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The sums of shards, by kind of input and of all."""
    out: dict[str, Any] = {"violations": sum(part["violations"] for part in parts)}
    out["steps"] = sum(part["steps"] for part in parts)
    for kind in ("all", *dict.fromkeys(part["kind"] for part in parts)):
        mine = [part for part in parts if kind in ("all", part["kind"])]
        modes: Counter = sum((Counter(part["modes"]) for part in mine), Counter())
        count = sum(modes.values())
        row: dict[str, Any] = {"steps": count}
        for name in ("coal", "mujoco", "unguarded"):
            heard = [part[name] for part in mine if part.get(name)]
            if heard:
                row[name] = _sum(heard)
        for name in ("hpp", "hpp_unguarded"):
            said = [part[name] for part in mine if part.get(name)]
            if said:
                row[name] = {count: sum(one[count] for one in said) for count in said[0]}
        row["near_share"] = round(sum(part["near"] for part in mine) / count, 4)
        row["fastest_of_limit"] = max(part["fastest"] for part in mine)
        row["hardest_of_limit"] = max(part["hardest"] for part in mine)
        row["modes"] = {mode: round(n / count, 5) for mode, n in modes.most_common()}
        row["refused"] = sum(part["refused"] for part in mine)  # frames, rows, chunks, or files
        row["scripts"] = sum(part["scripts"] for part in mine)
        row["led_out"] = sum(part["led_out"] for part in mine)
        out[kind] = row
    out["first"] = [one for part in parts for one in part["first"]][:10]
    return out


def _sum(heard: list[dict[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {name: sum(one[name] for one in heard) for name in ("steps", "distances")}
    out["steps_broken"] = sum(one["steps_broken"] for one in heard)
    out["broken"] = dict(sum((Counter(one["broken"]) for one in heard), Counter()))
    for name in ("least_between_m", "least_end_m"):
        out[name] = min(one[name] for one in heard)
    return out


def _say(found: dict[str, Any], path: Path) -> int:
    """Print the outcome; the exit status."""
    typer.echo(f"{found['steps']} steps judged, {found['violations']} violations; read {path}")
    for one in found["first"][:3]:
        typer.echo(f"  {', '.join(one['broken'])}: {one['where']}")
    return 1 if found["violations"] else 0


def _pace(parts: Iterable[dict[str, Any]]) -> None:
    """Print how fast each kind of shard was judged, its making included, on one core."""
    steps, seconds = Counter(), Counter()
    for part in parts:
        steps[part["kind"]] += part["steps"]
        seconds[part["kind"]] += part["seconds"]
    for kind, count in steps.items():
        typer.echo(f"  {kind}: {count} steps, {count / seconds[kind]:.0f} a second and core")


def bar(total: float, unit: str, initial: float = 0) -> tqdm:
    """How far the work is; none where nobody looks."""
    return tqdm(total=total, unit=unit, initial=initial, unit_scale=True, disable=None)


def read(path: Path) -> dict[str, Any] | None:
    """A shard that was judged before; None: there is none that is whole."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() if not done.returncode else "unknown"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.robot()


if __name__ == "__main__":
    app = typer.Typer(add_completion=False)
    app.command(epilog=EXAMPLES.replace("\n\n  ", "\n\n"))(main)
    app(prog_name="make judge" if "--help" in sys.argv else None)
