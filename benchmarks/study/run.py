"""`make study`: the trainings behind reports/study/study.md, one after the other, resumable.

    python benchmarks/study/run.py [--only cmu] [--set clips_mirror=/folder] [--foreground]

Each training is `dvc repro` with other parameters, in a clone of this project's last commit under
data/study, with a cache of its own: what is in the clone's cache is not made again, and a killed
training goes on where it was. What came out is one row for each split, motion and method in
reports/study/runs.csv, with the commit, the seed and the machine. A training counts as made when
its rows are of the clone's commit and of the same parameters; rows of another commit are made anew
and replaced, and so are all with `--again`. A seed moves `seed`, which all data are drawn by, and
`train.seed`, which the trainings start from.

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
from typing import Annotated, Any, NamedTuple, TextIO

import by_profile  # beside this file
import polars as pl
import tables
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
    grid: bool = False  # stage `grid` too: its cells are methods named model/pool/metric

    def told(self) -> str:
        """What differs from params.yaml, but for where clips come from."""
        return json.dumps({k: v for k, v in self.changed.items() if k != "clips_mirror"})


def planned(only: list[str], extra: dict[str, Any]) -> Iterator[Run]:
    """All runs of the plan: the first seed of every row, then the second, and so on."""
    plan = YAML(typ="safe").load(PLAN)
    for name in set(only) - set(plan):
        raise SystemExit(f"no experiment '{name}'; there are: {', '.join(plan)}")
    for name, what in plan.items():
        if only and name not in only:
            continue
        shared = by_profile.changes(what["profile"]) if "profile" in what else {}
        for seed, (row, own, entries) in itertools.product(what["seeds"], tries(what)):
            changed = {"clips": what["clips"], "clips_missing": "skip"} | shared | extra
            changed |= what.get("all", {}) | own | {"seed": seed, "train.seed": seed}
            yield Run(name, row, seed, entries, changed, what.get("grid", False))


def tries(what: dict[str, Any]) -> list[tuple[str, dict[str, Any], list[str]]]:
    """Rows of an experiment: name, what differs, entries that are evaluated.

    Those of one that is `searched` are each method's best settings of reports/study/search.csv.
    """
    if not what.get("searched"):
        return [(row, own, what["evaluate"]) for row, own in what["tries"].items()]
    found = tables.best(tables.searched(RUNS.with_name("search.csv")))
    return [(f"{one.method} {one.number}", one.changed, one.entries) for one in found]


def recorded() -> pl.DataFrame | None:
    """The rows that are there."""
    return pl.read_csv(RUNS) if RUNS.is_file() else None


def is_there(run: Run, commit: str) -> bool:
    """Whether all of a run's methods have been recorded with this code and these parameters."""
    rows = recorded()
    if rows is None:
        return False
    mine = rows.filter(experiment=run.experiment, row=run.row, seed=run.seed)
    mine = mine.filter(commit=commit[:12], changed=run.told())
    cells = mine["method"].str.contains("/", literal=True).any()
    return set(run.entries) <= set(mine["method"]) and (cells or not run.grid)


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


def commit_of(clone: Path, update: bool) -> str:
    """The commit that `prepare` will give."""
    there = (clone / ".git").is_dir() and not update
    return git(clone if there else ROOT, "rev-parse", "HEAD")


def prepare(clone: Path, update: bool) -> str:
    """A clone of the last commit, or with `update` one brought to it; returns its commit.

    A study that was begun goes on with the code it began with: another commit would train anew.
    """
    commit = commit_of(clone, update)
    if (clone / ".git").is_dir() and not update:
        return commit
    if git(ROOT, "status", "--porcelain", "--", "s3le", "pipeline", "dvc.yaml", "params.yaml"):
        raise SystemExit("the pipeline has changes that are not committed; commit them, then study")
    if not (clone / ".git").is_dir():
        clone.mkdir(parents=True, exist_ok=True)
        git(ROOT, "clone", "-q", "--no-checkout", str(ROOT), str(clone))
        for shared in ("downloads", "shards"):  # fetched clips and tuples that were made before
            (ROOT / "data" / shared).mkdir(exist_ok=True)
            (clone / "data").mkdir(exist_ok=True)
            (clone / "data" / shared).symlink_to(ROOT / "data" / shared)
    git(clone, "fetch", "-q", "origin", commit)
    git(clone, "checkout", "-q", "--force", "--detach", commit)
    return commit


def perform(run: Run, clone: Path, commit: str) -> list[dict[str, Any]]:
    """Train and evaluate one run in the clone; its rows.

    A row is a split, a motion ("all" among them) and a method; a cell of the grid has no rates,
    for its poses were checked when they were stored.
    """
    git(clone, "checkout", "-q", "--force", "--", "params.yaml")
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
    stages = [f"evaluate@{entry}" for entry in run.entries] + (["grid"] if run.grid else [])
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
        "changed": run.told(),
    }
    rows = []
    cells = documents.read_csv(clone / "reports/grid.csv", "grid") if run.grid else []
    for cell in cells:
        name = "/".join(cell[key] for key in ("model", "pool", "metric"))
        rows.append(
            {key: getattr(run, key) for key in KEYS}
            | {"method": name, "split": cell["split"], "motion": "all"}
            | {key: cell.get(key) for key in FIGURES}
            | {"pool": cell["stored"]}
            | about
        )
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


def alone(folder: Path) -> TextIO | None:
    """A lock that one process at a time has, to be kept open; None where another has it."""
    folder.mkdir(parents=True, exist_ok=True)
    lock = (folder / "lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        return None
    return lock


def leave_to_the_background(script: str, log: Path) -> None:
    """Call a script anew, with the arguments of this one, so that it outlives this process."""
    with log.open("ab") as told:
        subprocess.Popen(
            ["nice", "-n", "19", sys.executable, script, *sys.argv[1:], "--foreground"],
            stdin=subprocess.DEVNULL,
            stdout=told,
            stderr=told,
            start_new_session=True,
        )


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
    runs, commit = list(planned(only or [], extra)), commit_of(folder / "clone", update)
    todo = [run for run in runs if again or not is_there(run, commit)]
    typer.echo(
        f"{len(runs) - len(todo)} of {len(runs)} trainings are recorded in {RUNS} for "
        f"commit {commit[:12]}; those of other commits are made anew"
    )
    if not todo:
        return
    lock, log = alone(folder), folder / "log"
    if lock is None:
        typer.echo(f"the rest is being made; follow it with: tail -f {log}")
        return
    if not foreground and not torch.cuda.is_available():
        lock.close()
        leave_to_the_background(__file__, log)
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


def git(folder: Path, *words: str) -> str:
    """What git says."""
    done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"git {words[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


if __name__ == "__main__":
    typer.run(main)
