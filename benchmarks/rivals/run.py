"""`make rivals`: retargeters that run here on the same motions, judged between the frames too.

Protocol 1: the same targets, limits, rate and start for all, each rival with the settings that
sweep.py chose. Protocol 2: each tool as its documentation has it, from the anchor pose. Motions and
verdicts are kept in --work, so a run that was stopped goes on. Written are reports/rivals.html,
rivals.csv and rivals.json. Times are those of this machine; nothing is asserted.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import book
import entrants
import install
import kept
import meshes
import numpy as np
import sums
import tasks
import throughput
import typer
import verdict
from entrants import HERE, Entrant
from tasks import Task
from tqdm import tqdm

from s3le import Robot, retargeter_for
from s3le.store import documents

WORK, REPORTS = Path("data/rivals"), Path("reports")
FRAMES, QUICK_FRAMES = 240, 45  # of a clip
PATIENCE = 120.0  # [s] for one motion of one entrant, after which it counts as never made
COMPILES = 900.0  # [s] where kernels may have to be compiled
TRIES, STALLED = 12, "no motion within"  # processes for the motions of an entrant
SOONER = 4.0  # by so much is the patience less with one that has stalled
THIRD = "jvrc1"  # of --all


class Job(NamedTuple):
    """One motion to make."""

    entrant: Entrant
    settings: dict[str, Any]
    robot: str
    task: Task
    protocol: int
    turn: int
    out: Path


def main(
    quick: Annotated[bool, typer.Option("--quick", help="a few clips, minutes")] = False,
    everything: Annotated[bool, typer.Option("--all", help="whole clips, a third robot")] = False,
    only: Annotated[str, typer.Option(help="entrants by name, with commas")] = "all",
    robots: Annotated[str, typer.Option(help="robots by name, or robot files")] = "coman,g1",
    protocols: Annotated[str, typer.Option(help="1, 2 or 1,2")] = "",
    frames: Annotated[int, typer.Option(help="most frames of a clip; 0: as said above")] = 0,
    cmu: Annotated[Path, typer.Option(help="folder of CMU's originals")] = tasks.CMU,
    demo: Annotated[Path, typer.Option(help="folder of DeepMimic's clips")] = tasks.DEMO,
    clip: Annotated[list[Path] | None, typer.Option(help="these motion files alone")] = None,
    lafan: Annotated[Path | None, typer.Option(help="folder of LAFAN1's BVH files")] = None,
    clones: Annotated[Path | None, typer.Option(help="folder of clones: GMR and others")] = None,
    workers: Annotated[int, typer.Option(min=1, help="processes, each on a core")] = 2,
    data_set: Annotated[bool, typer.Option(help="the table of a data set too")] = True,
    work: Annotated[Path, typer.Option(help="where motions and verdicts are kept")] = WORK,
    reports: Annotated[Path, typer.Option(help="where the page is written")] = REPORTS,
) -> None:
    """Run, judge, repair, and write the page."""
    began = time.monotonic()
    who = [one for one in entrants.by_key(only) if missing(one, clones) is None]
    most = frames or (QUICK_FRAMES if quick else 0 if everything else FRAMES)
    which = [int(p) for p in protocols.split(",")] if protocols else [1] if quick else [1, 2]
    names = robots.split(",")[: 1 if quick else None]
    if everything and THIRD not in names:
        names.append(THIRD)
    found, shown = [], set()
    for name in names:
        every = {p: given(name, p, quick, most, cmu, demo, lafan, clip) for p in which}
        shown |= {task.name for listed in every.values() for task in listed}
        todo = jobs(who, name, every, work, clones)
        make(todo, name, work, workers, clones)
        found += judged(todo, name, work, workers)
    if not found:
        raise SystemExit("not one motion was made; see what is said above, and: make rivals")
    asked = [] if quick or clip else [*tasks.TEST, *(path.stem for path in recordings(lafan))]
    absent = [name for name in asked if name not in shown]
    told = about(who, clones, names, most, which, quick, absent)
    record = sums.record(found, told, sizes(who))
    if data_set and not quick and not clip:
        record["data_set"] = throughput.table(who, names[0], cmu, demo, work, workers)
    documents.write_json(record, reports / "rivals.json")
    documents.write_csv(book.rows(record), reports / "rivals.csv")
    documents.write_text(book.page(record), reports / "rivals.html")
    typer.echo(f"{len(found)} motions judged in {time.monotonic() - began:.0f} s")
    typer.echo(book.text(record))


def recordings(lafan: Path | None) -> list[Path]:
    """LAFAN1's files in a folder.

    Raises:
        SystemExit: there is none.
    """
    found = sorted(lafan.glob("*.bvh")) if lafan else []
    if lafan and not found:
        raise SystemExit(f"no .bvh is in {lafan}: --lafan FOLDER")
    return found


def given(
    name: str,
    protocol: int,
    quick: bool,
    most: int,
    cmu: Path,
    demo: Path,
    lafan: Path | None,
    own: list[Path] | None,
) -> list[Task]:
    """What a robot's entrants are to follow."""
    its = retargeter_for(Robot.load(name))
    if own:
        return tasks.clips(its, own, "own", most, protocol)
    shown = tasks.demo(demo)
    found = tasks.cmu(cmu, ("14_07",) if quick else tasks.TEST)
    if not found:
        typer.echo(f"no clip of CMU is in {cmu}, so they are left out: --cmu FOLDER")
    every = tasks.clips(its, found, "cmu", most, protocol)
    every += tasks.clips(its, shown[:1] if quick else shown, "deepmimic", most, protocol)
    if not quick:
        every += tasks.clips(its, recordings(lafan), "lafan", most, protocol)
    return every + tasks.adversarial(its, 1 if quick else tasks.STREAMS, protocol)


def missing(entrant: Entrant, clones: Path | None) -> str | None:
    """Why an entrant cannot run here; None: it can."""
    if entrant.module == "ours":
        return None
    for part in entrant.clone:
        if clones is None or not (clones / part).is_dir():
            return f"no clone of it: --clones FOLDER with {part} in it"
    if not install.python(entrant.environment).is_file():
        return f".venv-rivals/{entrant.environment} is not set up: make rivals"
    return None


def jobs(
    who: list[Entrant], name: str, every: dict[int, list[Task]], work: Path, clones: Path | None
) -> list[Job]:
    """All motions of a robot; of each entrant one is made a second time, to be compared."""
    robot, found = Robot.load(name).name, []
    for protocol, listed in every.items():
        for one in who:
            if protocol not in one.protocols or (one.robots and robot not in one.robots):
                continue
            settings = entrants.settings(one, protocol, robot)
            if one.clone and clones:
                settings["clone"] = kept.clone([clones / part for part in one.clone])
            mine = [task for task in listed if not one.kinds or task.kind in one.kinds]
            if not mine:
                continue
            again = protocol == min(p for p in every if p in one.protocols)
            turns = [(task, 0) for task in mine] + ([(mine[0], 1)] if again else [])
            for task, turn in turns:
                key = kept.motion(one, settings, robot, task, protocol, turn)
                out = work / robot / one.key / f"{task.name}_{key}.npz"
                found.append(Job(one, settings, name, task, protocol, turn, out))
    return found


def make(todo: list[Job], name: str, work: Path, workers: int, clones: Path | None) -> None:
    """Make the motions that are missing, an entrant and protocol in a process of its own."""
    robot = Robot.load(name)
    folder = work / robot.name / "given"
    files = tasks.write(folder, tasks.plain_of(robot), [job.task for job in todo])
    parts: dict[tuple, list[Job]] = {}
    for job in todo:
        if not job.out.is_file():
            parts.setdefault((job.entrant.key, job.protocol, job.turn), []).append(job)
    cores = sorted(os.sched_getaffinity(0))
    free = [cores[i % len(cores)] for i in range(workers)]

    def one(listed: list[Job]) -> None:
        core = free.pop()
        try:
            told = perform(listed, name, folder, files, core, clones)
        finally:
            free.append(core)
        if told:
            tqdm.write(f"{listed[0].entrant.label}, {robot.name}: {told}")
        shown.update(len(listed))

    with (
        ThreadPoolExecutor(workers) as pool,
        tqdm(
            total=sum(map(len, parts.values())), desc=f"{robot.name}, make", disable=None
        ) as shown,
    ):
        list(pool.map(one, parts.values()))


def perform(
    listed: list[Job],
    name: str,
    folder: Path,
    files: dict[str, Path],
    core: int | None,
    clones: Path | None,
    patience: float = PATIENCE,
) -> str:
    """Let a process make motions of one entrant; what went wrong, if anything did.

    A process that ends or is ended within a motion loses that one; another goes on with the rest,
    a few times.
    """
    told, left = "", listed
    for _ in range(TRIES):
        less = SOONER if told.startswith(STALLED) else 1.0
        told = _process(left, name, folder, files, core, clones, patience / less) or told
        waiting = [job for job in left if not job.out.is_file()]
        if not waiting or (len(waiting) == len(left) and told and not told.startswith(STALLED)):
            break  # all is made, or it does not even begin
        left = waiting[1:]  # they are made in their order: the first that is missing was too much
        if not left:
            break
    return told


def _process(
    listed: list[Job], name: str, folder: Path, files: dict[str, Path], core: int | None,
    clones: Path | None, patience: float,
) -> str:  # fmt: skip
    """One process; what went wrong, if anything did."""
    first = listed[0]
    ours = first.entrant.module == "ours"
    job = {
        "name": name, "robot": str(folder / "robot.json"), "settings": first.settings,
        "module": first.entrant.key if ours else first.entrant.module, "core": core,
        "protocol": first.protocol, "dt": 1.0 / tasks.RATE, "most": first.entrant.most,
        "clones": [str(clones / part) for part in first.entrant.clone] if clones else [],
        "asked": time.time(),
        "motions": [[str(files[job.task.digest]), str(job.out)] for job in listed],
    }  # fmt: skip
    where = folder / f"job_{first.entrant.key}_{first.protocol}_{first.turn}.json"
    documents.write_json(job, where)
    python = sys.executable if ours else install.python(first.entrant.environment)
    script = HERE / ("ours.py" if ours else "worker.py")
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    path = {"PYTHONPATH": str(HERE.parents[1])} if ours else {"PYTHONPATH": ""}
    patience = max(patience, COMPILES) if ours or first.entrant.compiles else patience
    with tempfile.TemporaryFile("w+") as words:
        process = subprocess.Popen(
            [str(python), str(script), str(where)], stdout=subprocess.DEVNULL, stderr=words,
            env=os.environ | single | path,
        )  # fmt: skip
        made, since = 0, time.monotonic()
        try:
            while process.poll() is None:
                time.sleep(0.2)
                if (now := sum(job.out.is_file() for job in listed)) > made:
                    made, since = now, time.monotonic()
                if time.monotonic() - since > patience:
                    return f"{STALLED} {patience:.0f} s"
        finally:
            process.kill()
            process.wait()
        words.seek(0)
        return "" if process.returncode == 0 else " ".join(words.read().split()[-40:])


_court: verdict.Court | None = None


def _sit(name: str, hulls: Path | None) -> None:
    global _court
    _court = verdict.Court(Robot.load(name), hulls)


def _judge(job: Job, work: Path) -> dict[str, Any] | None:
    """A verdict, kept or new; None: there is no motion."""
    assert _court is not None
    if not job.out.is_file():
        return None
    known = job.out.with_suffix(
        f".{kept.verdict(job.out, job.task, _court.robot.tag, _court.others)}.json"
    )
    if (seen := kept.read(known)) is None:
        with np.load(job.out) as held:
            made = {name: held[name] for name in held.files if name != "about"}
        seen = _court.judge(job.task, made)
        documents.write_json(seen, known)
    return seen


def judged(todo: list[Job], name: str, work: Path, workers: int) -> list[sums.Case]:
    """Verdicts on all motions of a robot, in the order of the jobs."""
    first = [job for job in todo if job.turn == 0]
    again = {(job.entrant.key, job.protocol): job for job in todo if job.turn == 1}
    robot, found = Robot.load(name), []
    hulls = meshes.hulls_of(robot, work / robot.name)
    with ProcessPoolExecutor(workers, get_context("spawn"), _sit, (name, hulls)) as pool:
        seen = pool.map(_judge, first, [work] * len(first))
        seen = list(tqdm(seen, f"{name}, judge", len(first), disable=None))
    for job, said in zip(first, seen, strict=True):
        other = again.get((job.entrant.key, job.protocol))
        same, told = None, {}
        if said is not None:
            with np.load(job.out) as held:
                told = json.loads(str(held["about"]))
                if other and other.task.digest == job.task.digest and other.out.is_file():
                    with np.load(other.out) as second:
                        same = bool(np.array_equal(held["q"], second["q"]))
        found.append(sums.Case(
            job.entrant.key, job.entrant.label, robot.name, job.protocol, job.task.name,
            job.task.kind, len(job.task.x), said, told, same,
        ))  # fmt: skip
    return found


def about(
    who: list[Entrant],
    clones: Path | None,
    names: list[str],
    most: int,
    which: list[int],
    quick: bool,
    absent: list[str],
) -> dict[str, Any]:
    """What was run, and what was not and why."""
    known = [Robot.load(name).name for name in names]
    reasons = {
        one.label: why for one in entrants.ENTRANTS if (why := missing(one, clones)) is not None
    }
    return {
        "quick": quick, "robots": known, "frames": most, "rate": tasks.RATE, "protocols": which,
        "entrants": {one.label: {"settings": {name: entrants.settings(one, 1, name)
                     for name in known} if 1 in one.protocols else {}, "documented": one.readme,
                     "says": one.readme_says} for one in who},
        "not_run": reasons | entrants.NOT_RUN,
        "absent": absent, "accelerations": entrants.accelerations(),
    }  # fmt: skip


def sizes(who: list[Entrant]) -> dict[str, float | None]:
    """MB that each takes installed, with all it requires; None: not known."""
    found: dict[str, float | None] = {}
    for one in who:
        names, more, python = list(one.packages), 0, str(install.python(one.environment))
        if one.module == "ours":  # what is installed here may be of an older state of the project
            (names, more), python = own(), sys.executable
        done = subprocess.run(
            [python, str(HERE / "size.py"), *names], capture_output=True, text=True, check=False
        )
        known = done.returncode == 0 and done.stdout.strip().isdigit()
        found[one.key] = (int(done.stdout) + more) / 1e6 if known and names else None
    return found


def own() -> tuple[list[str], int]:
    """What this project requires, and the bytes of its own files."""
    root = HERE.parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [re.split("[<>=!~ ;]", line)[0] for line in project["dependencies"]]
    files = [path for path in (root / "s3le").rglob("*") if path.is_file()]
    return names, sum(p.stat().st_size for p in files if "__pycache__" not in p.parts)


if __name__ == "__main__":
    app = typer.Typer(add_completion=False)
    app.command()(main)
    app(prog_name="make rivals" if "--help" in sys.argv else None)
