"""Which settings each rival is run with in protocol 1: a sweep, recorded in chosen.json.

    python benchmarks/rivals/sweep.py [--only mink,pink] [--frames 90] [--accelerations]

Every combination of what entrants.py lists under `sweep` follows training clips that the benchmark
does not hold, and adversarial streams of another seed. It is weighed by what its motions are worth
to a user of the benchmark: the mean angle of a bone to the human on clips [deg], and PRICE degrees
for each percent of poses or paths that collide, and of frames without a solution or with a joint
over its speed. Times do not count: a rival may be as slow as it likes. One setting is chosen for
each robot; all numbers are recorded beside it. With --accelerations the chosen settings are tried
without and with limits of accelerations, by those who can be asked for them; the better is chosen.
"""

import itertools
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import entrants
import numpy as np
import run
import tasks
import typer
from entrants import CHOSEN, Entrant
from tasks import Task
from tqdm import tqdm

from s3le import Robot, retargeter_for
from s3le.kernels import batch
from s3le.plan.limits import accelerations as bends
from s3le.plan.limits import limits, speeds
from s3le.safety import paths
from s3le.store import documents

PRICE = 1.0  # [deg] for a percent
HARD = 3  # adversarial streams
TOUCH = 1e-9  # [m]
PATIENCE = 20.0  # [s] for a motion, after which it counts as lost


def main(
    only: Annotated[str, typer.Option(help="entrants by name, with commas")] = "all",
    robots: Annotated[str, typer.Option(help="robots by name")] = "coman,g1",
    frames: Annotated[int, typer.Option(help="most frames of a clip")] = 90,
    cmu: Annotated[Path, typer.Option(help="folder of CMU's originals")] = tasks.CMU,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    work: Annotated[Path, typer.Option(help="where motions are kept")] = run.WORK / "sweep",
    accelerations: Annotated[bool, typer.Option("--accelerations", help="what they cost")] = False,
) -> None:
    """Sweep, and record what is chosen."""
    known = json.loads(CHOSEN.read_text(encoding="utf-8")) if CHOSEN.is_file() else {}
    chosen, tried = known.get("chosen", {}), known.get("tried", {})
    costs = known.get("accelerations", {})
    for one in entrants.by_key(only):
        if not one.sweep or (accelerations and not one.accelerations):
            continue
        if (why := run.missing(one, None)) is not None:
            typer.echo(f"{one.label}: {why}")
            continue
        for name in robots.split(","):
            robot = Robot.load(name).name
            if accelerations:
                own = entrants.settings(one, 1, robot)
                own.pop("accelerations", None)
                given = [own, own | {"accelerations": True}]
                rows = told = swept(one, name, given, frames, cmu, workers, work)
                costs.setdefault(one.key, {})[robot] = rows
            else:
                names, values = list(one.sweep), itertools.product(*one.sweep.values())
                given = [dict(zip(names, each, strict=True)) for each in values]
                rows = swept(one, name, given, frames, cmu, workers, work)
                told = [min(rows, key=lambda row: row["worth"])]
                tried.setdefault(one.key, {})[robot] = rows
            best = min(rows, key=lambda row: row["worth"])
            chosen.setdefault(one.key, {})[robot] = best["settings"]
            documents.write_json(
                {
                    "clips": list(tasks.TRAINING), "frames": frames, "adversarial": HARD,
                    "price": PRICE, "chosen": chosen, "tried": tried, "accelerations": costs,
                },
                CHOSEN,
            )  # fmt: skip
            for row in told:
                typer.echo(f"{one.label}, {robot}: {row}")


def swept(
    one: Entrant, name: str, given: list[dict[str, Any]], frames: int, cmu: Path, workers: int,
    work: Path,
) -> list[dict[str, Any]]:  # fmt: skip
    """Settings on one robot, each with its numbers."""
    its = retargeter_for(Robot.load(name))
    listed = tasks.clips(its, tasks.cmu(cmu, tasks.TRAINING), "training", frames, 1)
    hard = tasks.adversarial(its, tasks.STREAMS + HARD, 1)[tasks.STREAMS :]
    every = listed + hard
    folder = work / its.robot.name / "given"
    tasks.write(folder, tasks.plain_of(its.robot), every)
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        parts = [(one, name, settings, every, work, i) for i, settings in enumerate(given)]
        found = pool.map(tried_one, *zip(*parts, strict=True))
        rows = list(tqdm(found, f"{one.label}, {its.robot.name}", len(given), disable=None))
    return [row for row in rows if row is not None]


def tried_one(
    one: Entrant, name: str, settings: dict[str, Any], every: list[Task], work: Path, number: int
) -> dict[str, Any] | None:
    """One combination: make its motions and weigh them."""
    robot = Robot.load(name)
    todo = []
    for task in every:
        key = run.kept.motion(one, settings, robot.name, task, 1)
        out = work / robot.name / one.key / f"{task.name}_{key}.npz"
        todo.append(run.Job(one, settings, name, task, 1, number, out))
    missing = [job for job in todo if not job.out.is_file()]
    if missing:
        folder = work / robot.name / "given"
        files = {t.digest: folder / "tasks" / f"{t.name}_{t.digest}.npz" for t in every}
        run.perform(missing, name, folder, files, None, None, PATIENCE)
    sums = {"frames": 0, "broken": 0, "lost": 0, "hard": 0}
    angles, weights = [], []
    most = limits(robot)
    for job in todo:
        m = len(job.task.x)
        sums["frames"] += m
        if not job.out.is_file():
            sums["lost"] += m
            if job.task.kind == "training":
                angles.append(180.0)
                weights.append(m)
            continue
        with np.load(job.out) as held:
            q, failed = held["q"], held["failed"]
        if job.task.kind == "training":
            cosine = (batch.skeletons(robot.chain, q) * job.task.x).reshape(-1, 7, 3).sum(axis=2)
            angles.append(float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean()))
            weights.append(m)
        bad = batch.clearances(robot.chain, q) < -TOUCH
        collides = paths.certify(robot, q, robot.margin / 4.0)
        bad[1:] |= (collides.status == paths.COLLIDES) & (collides.clearance < -TOUCH)
        time = np.arange(m) / tasks.RATE
        fast = (np.abs(speeds(time, q)) > most.speed * (1.0 + 1e-6)).any(axis=1)
        bad[1:] |= fast
        bent = np.abs(bends(time, q)) > most.acceleration * (1.0 + 1e-3)
        sums["hard"] += int(bent.any(axis=1).sum())
        sums["broken"] += int(bad.sum())
        sums["lost"] += int((failed & ~bad).sum())
    angle = float(np.average(angles, weights=weights))
    percent = 100.0 * (sums["broken"] + sums["lost"]) / sums["frames"]
    return {
        "settings": settings, "angle": round(angle, 3),
        "broken": round(100.0 * sums["broken"] / sums["frames"], 3),
        "unsolved": round(100.0 * sums["lost"] / sums["frames"], 3),
        "worth": round(angle + PRICE * percent, 3),
        "hard": round(100.0 * sums["hard"] / sums["frames"], 3),
    }  # fmt: skip


if __name__ == "__main__":
    app = typer.Typer(add_completion=False)
    app.command()(main)
    app(prog_name="sweep.py" if "--help" in sys.argv else None)
