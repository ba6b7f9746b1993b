"""`make search`: the same budget of settings for each method, judged on a validation set.

    python benchmarks/study/search.py [--count 24] [--steps 1500] [--set clips_mirror=/folder]
    python benchmarks/study/search.py --status     # only say where it stands

The validation set is some of the *training* clips, which then train nothing; test and held-out
clips are not read at all. Each method gets the same number of settings, its default first and the
rest drawn from SPACE by a seed, and the same number of steps. S3LE, LWL2 and ALE take turns, so
that their budgets are equal whenever it is stopped. One row a setting and look-up goes into
reports/study/search.csv; a setting that is there for this commit is not tried again. It works as
`make study` does: in a clone, without a GPU in the background, and on where it was killed.
"""

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import polars as pl
import run  # beside this file
import tables
import torch
import typer
from ruamel.yaml import YAML

from s3le.search.metrics import LATENT_METRICS
from s3le.store import documents

WORK = run.ROOT / "data/study/search"
FOUND = run.RUNS.with_name("search.csv")
VALIDATION = {  # training clips that validate; of CMU's, all of two of the five people
    "cmu": ("49_09", "49_10", "135_06"),
    "demo": ("dance_a", "spin", "walk"),
}
ENTRIES = {  # every look-up of a method; the best of them counts
    "s3le": ["s3le"],
    "lwl2": ["lwl2_pairs", "lwl2", "lwl2_all"],
    "ale": ["ale"],
}
FIGURES = ("to_truth", "to_human", "collision_rate", "frames")


class Between(NamedTuple):
    """Log-uniform between two numbers."""

    low: float
    high: float


RATE, LATENT = Between(3e-4, 5e-3), (14, 32, 64)
CONSENSUS = ("plain", "normalised")
SPACE: dict[str, dict[str, Any]] = {  # as many keys for each method
    "s3le": {
        "s3le.weight_recon_x": Between(1, 200),
        "s3le.weight_recon_q": Between(0.02, 5),
        "s3le.weight_consensus": Between(0.3, 100),
        "s3le.weight_nt_xent": Between(1, 200),
        "s3le.consensus_kind": CONSENSUS,
        "s3le.prior_rows": ("tuples", "all"),
        "tau": Between(0.05, 2),
        "train.learning_rate": RATE,
        "train.latent": LATENT,
        "index.metric_s3le": LATENT_METRICS,
    },
    "lwl2": {
        "lwl2.weight_recon_x": Between(1, 200),
        "lwl2.weight_recon_q": Between(0.02, 5),
        "lwl2.weight_consensus": Between(0.3, 100),
        "lwl2.consensus_kind": CONSENSUS,
        "lwl2.prior_rows": ("tuples", "all"),
        "lwl2.prior_fit": ("adversarial", "mmd", "none"),
        "beta": Between(0.01, 100),
        "train.learning_rate": RATE,
        "train.latent": LATENT,
        "index.metric_lwl2": LATENT_METRICS,
    },
    "ale": {
        "ale.weight_recon_x": Between(1, 1000),
        "ale.weight_recon_q": Between(1, 1000),
        "ale.weight_consensus": Between(1, 1000),
        "ale.consensus_kind": CONSENSUS,
        "ale.batch_pairs": (32, 64, 128, 256),
        "ale.batch_domain": (32, 64, 128, 256),
        "beta": Between(0.01, 10),
        "train.second_moment": (0.95, 0.99, 0.999),
        "train.learning_rate": RATE,
        "train.latent": LATENT,
    },
}


def settings(method: str, count: int, seed: int) -> list[dict[str, Any]]:
    """A method's settings: its default, then random ones; fewer are the first of more."""
    rng = np.random.default_rng([seed, list(SPACE).index(method)])
    return [{}] + [_draw(SPACE[method], rng) for _ in range(count - 1)]


def _draw(space: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    drawn: dict[str, Any] = {}
    for key, among in space.items():
        if isinstance(among, Between):
            value = np.exp(rng.uniform(np.log(among.low), np.log(among.high)))
            drawn[key] = float(f"{value:.3g}")
        else:
            drawn[key] = among[int(rng.integers(len(among)))]
    return drawn


def split_off(manifest: str, clips: tuple[str, ...]) -> str:
    """A list of clips whose training clips only are left, some of them as its test clips.

    Raises:
        SystemExit: the list does not train with one of these clips, or with no other.
    """
    reader = csv.DictReader(io.StringIO(manifest))
    name = reader.fieldnames[0]
    rows = [row for row in reader if row["split"] == "train"]
    if lost := set(clips) - {row[name] for row in rows}:
        raise SystemExit(f"no training clip {', '.join(sorted(lost))}: search.py's VALIDATION")
    for row in rows:
        row["split"] = "test" if row[name] in clips else "train"
    if len(rows) == len(clips):
        raise SystemExit("search.py's VALIDATION leaves no clip to train with")
    out = io.StringIO()
    writer = csv.DictWriter(out, reader.fieldnames, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def planned(
    count: int, steps: int, seed: int, clips: str, extra: dict[str, Any]
) -> Iterator[run.Run]:
    """All runs: every method's default, then every method's first random setting, and so on."""
    drawn = {method: settings(method, count, seed) for method in SPACE}
    for number in range(count):
        for method in SPACE:
            changed = {"clips": clips, "clips_missing": "skip"} | extra
            changed |= {f"{method}.steps": steps} | drawn[method][number]
            yield run.Run(method, str(number), seed, ENTRIES[method], changed)


def rows_of(one: run.Run, found: list[dict[str, Any]], own: dict[str, Any]) -> list[dict]:
    """A run's rows of search.csv: the validation set's mean by each of its look-ups."""
    about = {"method": one.experiment, "number": int(one.row), "seed": one.seed}
    return [
        about
        | {"entry": row["method"]}
        | {key: row[key] for key in FIGURES}
        | {"steps": one.changed[f"{one.experiment}.steps"], "clips": one.changed["clips"]}
        | {"setting": json.dumps(own), "changed": row["changed"]}
        | {key: row[key] for key in ("seconds", "commit", "date", "machine")}
        for row in found
        if row["motion"] == "all" and row["split"] == "test"
    ]


def is_there(one: run.Run, commit: str) -> bool:
    """Whether a setting has been tried with this code."""
    if not FOUND.is_file():
        return False
    mine = pl.read_csv(FOUND).filter(
        method=one.experiment, number=int(one.row), commit=commit[:12], changed=one.told()
    )
    return set(one.entries) <= set(mine["entry"])


def record(new: list[dict[str, Any]]) -> None:
    """Add a setting's rows, in place of those of the same setting; whole or not at all."""
    one, old = new[0], []
    if FOUND.is_file():
        old = [
            row
            for row in pl.read_csv(FOUND).to_dicts()
            if (row["method"], row["number"]) != (one["method"], one["number"])
        ]
    documents.write_csv(old + new, FOUND)


def standing(runs: list[run.Run], commit: str) -> list[str]:
    """Where the search stands, a line a method."""
    lines = []
    found = tables.searched(FOUND)
    best = {one.method: one for one in tables.best(found)}
    for method in SPACE:
        own = [one for one in runs if one.experiment == method]
        done = sum(is_there(one, commit) for one in own)
        line = f"{method:5s} {done:3d} of {len(own)} settings tried"
        if method in best:
            one = best[method]
            line += f"; best of {one.among}: {one.to_truth:.4f} ({one.entry}, no. {one.number})"
            line += f", its default {one.default:.4f}"
        lines.append(line)
    return lines


def main(
    count: Annotated[int, typer.Option(min=1, help="settings of each method")] = 24,
    steps: Annotated[int, typer.Option(min=1, help="of each training")] = 1500,
    seed: Annotated[int, typer.Option(min=0, help="that settings are drawn by")] = 1,
    clips: Annotated[str, typer.Option(help=" or ".join(VALIDATION))] = "cmu",
    assign: Annotated[list[str] | None, typer.Option("--set", help="parameter=value")] = None,
    status: Annotated[bool, typer.Option(help="say where it stands, and stop")] = False,
    update: Annotated[bool, typer.Option(help="go on with the last commit's code")] = False,
    foreground: Annotated[bool, typer.Option(help="stay, also without a GPU")] = False,
    folder: Annotated[Path, typer.Option(help="where it works")] = WORK,
) -> None:
    """Try what has not been tried, then write the tables."""
    if clips not in VALIDATION:
        raise SystemExit(f"clips must be one of {', '.join(VALIDATION)}, got '{clips}'")
    yaml = YAML(typ="safe")
    extra = {key: yaml.load(value) for key, value in (text.split("=", 1) for text in assign or [])}
    runs = list(planned(count, steps, seed, clips, extra))
    clone = folder / "clone"
    commit = run.commit_of(clone, update)
    for line in standing(runs, commit):
        typer.echo(line)
    todo = [one for one in runs if not is_there(one, commit)]
    if status or not todo:
        return
    lock, log = run.alone(folder), folder / "log"
    if lock is None:
        typer.echo(f"the rest is being tried; follow it with: tail -f {log}")
        return
    if not foreground and not torch.cuda.is_available():
        lock.close()
        run.leave_to_the_background(__file__, log)
        typer.echo(
            f"no GPU: {len(todo)} settings go on in the background, minutes each on 2 cores;\n"
            f"follow it with: tail -f {log}; where it stands: add --status"
        )
        return
    commit = run.prepare(clone, update)
    manifest = clone / "data/clips" / clips / "manifest.csv"
    listed = run.git(clone, "show", f"HEAD:data/clips/{clips}/manifest.csv")
    documents.write_text(split_off(listed + "\n", VALIDATION[clips]), manifest)
    for number, one in enumerate(todo, 1):
        typer.echo(f"{number} of {len(todo)}: {one.experiment}, setting {one.row}")
        own = settings(one.experiment, count, seed)[int(one.row)]
        record(rows_of(one, run.perform(one, clone, commit), own))
        for line in standing(runs, commit):
            typer.echo("  " + line)
        tables.main()


if __name__ == "__main__":
    typer.run(main)
