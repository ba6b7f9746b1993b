"""`make study`: the trainings behind reports/study/study.md, one after the other, resumable.

    python benchmarks/study/run.py [--only cmu] [--set clips_mirror=/folder] [--foreground]

Each training is `dvc repro` with other parameters, in a clone of this project's last commit under
data/study, with a cache of its own: what is in the clone's cache is not made again, and a killed
training goes on where it was. What came out is one row for each split, motion and method in
reports/study/runs.csv, with the commit, the seed and the machine. A row that is there is
not made again, unless `--again` is given.

Without a GPU this takes hours, so it goes on in the background; calling it again says how far
it is.
"""

import fcntl
import itertools
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import polars as pl
import tables  # beside this file
import torch
import typer
from ruamel.yaml import YAML

from s3le.store import documents

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PLAN = HERE / "plan.yaml"
WORK = ROOT / "data/study"
RUNS = ROOT / "reports/study/runs.csv"
KEYS = ("experiment", "row", "seed")
FIGURES = ("frames", "to_truth", "to_human", "collision_rate", "below_margin_rate", "limit_rate")


class Run(NamedTuple):
    """One training and what is evaluated after it."""

    experiment: str
    row: str
    seed: int
    entries: list[str]
    changed: dict[str, Any]  # parameter, dotted -> value


def planned(only: list[str], extra: dict[str, Any]) -> Iterator[Run]:
    """All runs of the plan: the first seed of every row, then the second, and so on."""
    plan = YAML(typ="safe").load(PLAN)
    for name in set(only) - set(plan):
        raise SystemExit(f"no experiment '{name}'; there are: {', '.join(plan)}")
    for name, what in plan.items():
        if only and name not in only:
            continue
        for seed, (row, own) in itertools.product(what["seeds"], what["tries"].items()):
            changed = {"clips": what["clips"], "clips_missing": "skip"} | extra
            changed |= what.get("all", {}) | own | {"train.seed": seed}
            yield Run(name, row, seed, what["evaluate"], changed)


def recorded() -> pl.DataFrame | None:
    """The rows that are there."""
    return pl.read_csv(RUNS) if RUNS.is_file() else None


def is_there(run: Run) -> bool:
    """Whether all of a run's methods have been recorded."""
    rows = recorded()
    if rows is None:
        return False
    mine = rows.filter(experiment=run.experiment, row=run.row, seed=run.seed)
    return set(run.entries) <= set(mine["method"])


def record(run: Run, found: list[dict[str, Any]]) -> None:
    """Add a run's rows, in place of those of the same run; the file is the old or the new one."""
    WORK.mkdir(parents=True, exist_ok=True)
    with (WORK / "runs.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another study may write too
        new, old = pl.DataFrame(found), recorded()
        if old is not None:
            same = pl.all_horizontal(pl.col(key) == getattr(run, key) for key in KEYS)
            new = pl.concat([old.filter(~same), new], how="vertical_relaxed")
        documents.write_csv(new.to_dicts(), RUNS)


def prepare(clone: Path, update: bool) -> str:
    """A clone of the last commit, or with `update` one brought to it; returns its commit.

    A study that was begun goes on with the code it began with: another commit would train anew.
    """
    if (clone / ".git").is_dir() and not update:
        return _git(clone, "rev-parse", "HEAD")
    commit = _git(ROOT, "rev-parse", "HEAD")
    if _git(ROOT, "status", "--porcelain", "--", "s3le", "pipeline", "dvc.yaml", "params.yaml"):
        raise SystemExit("the pipeline has changes that are not committed; commit them, then study")
    if not (clone / ".git").is_dir():
        clone.mkdir(parents=True, exist_ok=True)
        _git(ROOT, "clone", "-q", "--no-checkout", str(ROOT), str(clone))
        for shared in ("downloads", "shards"):  # fetched clips and tuples that were made before
            (ROOT / "data" / shared).mkdir(exist_ok=True)
            (clone / "data").mkdir(exist_ok=True)
            (clone / "data" / shared).symlink_to(ROOT / "data" / shared)
    _git(clone, "fetch", "-q", "origin", commit)
    _git(clone, "checkout", "-q", "--force", "--detach", commit)
    return commit


def perform(run: Run, clone: Path, commit: str) -> list[dict[str, Any]]:
    """Train and evaluate one run in the clone; its rows."""
    _git(clone, "checkout", "-q", "--force", "--", "params.yaml")
    yaml = YAML()
    params = yaml.load(clone / "params.yaml")
    for key, value in run.changed.items():
        *section, name = key.split(".")
        home = params[section[0]] if section else params
        if name not in home:
            raise SystemExit(f"{PLAN.name}: '{run.row}': params.yaml has no {key}")
        home[name] = value
    yaml.dump(params, clone / "params.yaml")
    began = time.perf_counter()
    stages = [f"evaluate@{entry}" for entry in run.entries]
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, "-m", "dvc", "repro", "-q", *stages],
        cwd=clone,
        env=os.environ | {"PYTHONPATH": str(clone), "PATH": path},
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"'{run.experiment}: {run.row}', seed {run.seed} failed; see above")
    about = {
        "seconds": round(time.perf_counter() - began),
        "commit": commit[:12],
        "date": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "changed": json.dumps({k: v for k, v in run.changed.items() if k != "clips_mirror"}),
    }
    rows = []
    for entry in run.entries:
        figures = json.loads((clone / f"data/counts/evaluate-{entry}.json").read_text())
        for split, part in figures.items():
            for motion, found in [("all", part["all"]), *part["motions"].items()]:
                rows.append(
                    {key: getattr(run, key) for key in KEYS}
                    | {"method": entry, "split": split, "motion": motion}
                    | {key: round(found[key], 6) for key in FIGURES}
                    | {"pool": part["all"]["pool"]}
                    | about
                )
    return rows


def machine() -> str:
    """What the trainings ran on."""
    if torch.cuda.is_available():
        return torch.cuda.get_device_name()
    models = [
        line.split(":", 1)[1].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    ]
    return f"{models[0] if models else platform.processor()}, {torch.get_num_threads()} threads"


def main(
    only: Annotated[list[str] | None, typer.Option(help="experiments; all if none")] = None,
    assign: Annotated[list[str] | None, typer.Option("--set", help="parameter=value")] = None,
    again: Annotated[bool, typer.Option(help="make rows anew that are there")] = False,
    update: Annotated[bool, typer.Option(help="go on with the last commit's code")] = False,
    foreground: Annotated[bool, typer.Option(help="stay, also without a GPU")] = False,
    folder: Annotated[
        Path, typer.Option(help="where it works; one for each study at a time")
    ] = WORK,
) -> None:
    """Train what is not recorded yet, then write the tables."""
    yaml = YAML(typ="safe")
    extra = {key: yaml.load(value) for key, value in (text.split("=", 1) for text in assign or [])}
    runs = list(planned(only or [], extra))
    todo = [run for run in runs if again or not is_there(run)]
    typer.echo(f"{len(runs) - len(todo)} of {len(runs)} trainings are recorded in {RUNS}")
    if not todo:
        return
    folder.mkdir(parents=True, exist_ok=True)
    lock, log = (folder / "lock").open("w"), folder / "log"
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        typer.echo(f"the rest is being made; follow it with: tail -f {log}")
        return
    if not foreground and not torch.cuda.is_available():
        lock.close()
        with log.open("ab") as told:
            subprocess.Popen(
                ["nice", "-n", "19", sys.executable, __file__, *sys.argv[1:], "--foreground"],
                stdin=subprocess.DEVNULL,
                stdout=told,
                stderr=told,
                start_new_session=True,
            )
        typer.echo(
            "no GPU: going on in the background, 5 to 15 minutes a training on 2 cores;\n"
            f"follow it with: tail -f {log}; call make study again to see how far it is"
        )
        return
    commit = prepare(folder / "clone", update)
    for number, run in enumerate(todo, 1):
        typer.echo(f"{number} of {len(todo)}: {run.experiment}: {run.row}, seed {run.seed}")
        record(run, perform(run, folder / "clone", commit))
        tables.main()
    typer.echo(f"read {RUNS.with_name('study.md')}")


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"git {words[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


if __name__ == "__main__":
    typer.run(main)
