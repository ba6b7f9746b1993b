"""The study's tables and pictures from reports/study/runs.csv.

    python benchmarks/study/tables.py

Writes reports/study/study.md and a bar chart per experiment that has more than one method.
Standard deviations are over training seeds; every frame of a split counts once, in the share of
motions every motion does.
"""

import math
from pathlib import Path

import polars as pl
from ruamel.yaml import YAML

from s3le.learn.methods import ENTRIES
from s3le.report import bars
from s3le.store import documents

HERE = Path(__file__).resolve().parent
REPORTS = HERE.parents[1] / "reports/study"
COMPARED = ("s3le", "lwl2", "lwl2_pairs", "ale")


def spread(values: pl.Series) -> str:
    """Mean and standard deviation, or the one value there is."""
    if len(values) < 2:
        return f"{values.mean():.4f}"
    return f"{values.mean():.4f} ± {values.std():.4f}"


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, first column left, the others right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def methods(runs: pl.DataFrame) -> str:
    """Each method over all frames of a split."""
    rows = []
    for name, entry in ENTRIES.items():
        mine = runs.filter(motion="all", method=name)
        if mine.is_empty():
            continue
        twin = runs.filter(motion="all", method=entry.twin or "")
        brute = twin["to_truth"].mean()
        ratio = f"{mine['to_truth'].mean() / brute:.2f}" if brute else "-"
        rows.append(
            [
                entry.label,
                spread(mine["to_truth"]),
                spread(mine["to_human"]),
                f"{mine['collision_rate'].max():.2%}",
                f"{mine['limit_rate'].max():.2%}",
                f"{mine['pool'][0]:,}",
                ratio,
            ]
        )
    head = ["method", "to the ground truth", "to the human", "collisions, worst seed",
            "limits broken, worst seed", "stored", "over brute force"]  # fmt: skip
    return table(head, rows)


def motions(runs: pl.DataFrame) -> str:
    """Each motion, mean over seeds; the best of the compared methods in bold."""
    mean = (
        runs.filter(pl.col("motion") != "all", pl.col("method").is_in([*COMPARED, "skeleton_all"]))
        .group_by("motion", "method", maintain_order=True)
        .agg(pl.col("to_truth").mean(), pl.col("frames").first())
    )
    names = mean["motion"].unique(maintain_order=True)
    rows = []
    for name in names:
        own = {row["method"]: row for row in mean.filter(motion=name).to_dicts()}
        best = min(own[m]["to_truth"] for m in COMPARED if m in own)
        cells = [
            f"**{own[m]['to_truth']:.3f}**"
            if own[m]["to_truth"] == best
            else f"{own[m]['to_truth']:.3f}"
            for m in COMPARED
        ]
        brute = f"{own['skeleton_all']['to_truth']:.3f}"
        rows.append([name, f"{own['s3le']['frames']:,}", *cells, brute])
    head = ["motion", "frames", *(ENTRIES[m].label for m in COMPARED), "brute force, all poses"]
    return table(head, rows)


def wins(runs: pl.DataFrame) -> str:
    """In how many motions S3LE lies below each baseline and below all of them, seed by seed."""
    wide = runs.filter(pl.col("motion") != "all").pivot(
        on="method", index=["seed", "motion"], values="to_truth"
    )
    rows = []
    for label, others in [
        *((ENTRIES[name].label, [name]) for name in COMPARED[1:]),
        ("all of them", list(COMPARED[1:])),
    ]:
        below = wide.with_columns(won=pl.col("s3le") < pl.min_horizontal(others))
        counts = below.group_by("seed", maintain_order=True).agg(pl.col("won").sum(), pl.len())
        told = ", ".join(f"{won} of {n}" for _, won, n in counts.iter_rows())
        rows.append([label, told, f"{below['won'].mean():.0%}"])
    return table(["motions in which S3LE is below", "by seed", "share"], rows)


def tries(runs: pl.DataFrame, order: list[str]) -> str:
    """One line a try: S3LE and what brute force finds on its pool."""
    rows, base = [], None
    for row in order:
        own = runs.filter(row=row, motion="all").sort("seed")
        mine = own.filter(method="s3le")
        if mine.is_empty():
            continue
        brute = own.filter(method="skeleton_all")["to_truth"].mean()
        base = mine if base is None else base
        both = mine.join(base, on="seed", suffix="_base")
        change = both["to_truth"] - both["to_truth_base"]
        told = "-" if row == base["row"][0] or not len(change) else f"{change.mean():+.4f}"
        if len(change) > 1 and told != "-":
            told += f" ± {change.std() / math.sqrt(len(change)):.4f}"
        rows.append(
            [
                row,
                spread(mine["to_truth"]),
                told,
                f"{brute:.4f}",
                f"{mine['to_truth'].mean() / brute:.2f}",
                str(len(mine)),
            ]
        )
    if base is None:
        return "Not trained yet."
    first = base["row"][0]
    head = ["S3LE with", "to the ground truth", f"against '{first}' (± standard error)",
            "brute force, same poses", "ratio", "seeds"]  # fmt: skip
    return table(head, rows)


def main() -> None:
    """Write the page and its pictures."""
    plan = YAML(typ="safe").load(HERE / "plan.yaml")
    runs = pl.read_csv(REPORTS / "runs.csv")
    parts = ["# The study", "Written by `python benchmarks/study/tables.py` from `runs.csv`; the "
             "trainings are those of `make study` (benchmarks/study/plan.yaml)."]  # fmt: skip
    for name, what in plan.items():
        own = runs.filter(experiment=name)
        planned = len(what["seeds"]) * len(what["tries"])
        if own.is_empty():
            parts += [f"## {name}", f"{what['about']}. None of {planned} trainings is made yet."]
            continue
        seeds = own.select("row", "seed").n_unique()
        made = ", ".join(own["commit"].unique(maintain_order=True))
        where = "; ".join(own["machine"].unique(maintain_order=True))
        parts += [
            f"## {name}",
            f"{what['about']}. {seeds} of {planned} trainings; commit {made}; {where}.",
        ]
        if len(what["evaluate"]) == 2:
            for split in own["split"].unique(maintain_order=True):
                parts += [f"Split *{split}*:", tries(own.filter(split=split), list(what["tries"]))]
            continue
        for split in own["split"].unique(maintain_order=True):
            part = own.filter(split=split)
            count = part.filter(pl.col("motion") != "all")["motion"].n_unique()
            frames = part.filter(motion="all")["frames"][0]
            parts += [f"### Split *{split}*: {count} motions, {frames:,} frames", methods(part)]
            parts += [wins(part), motions(part)]
        draw(own, name)
        parts += [f"![{name}: each motion]({name}.png)"]
    text = "\n\n".join(parts) + "\n"
    documents.write_text(text, REPORTS / "study.md")


def draw(runs: pl.DataFrame, name: str) -> None:
    """Bars per motion and method, mean over seeds."""
    mean = (
        runs.filter(pl.col("motion") != "all")
        .group_by("split", "motion", "method", maintain_order=True)
        .agg(pl.col("to_truth").mean(), pl.col("frames").first())
        .rename({"motion": "clip"})
    )
    made = set(mean["method"])
    labels = [(key, entry.label) for key, entry in ENTRIES.items() if key in made]
    title = f"{name}: distance to the ground truth per motion, mean of {runs['seed'].n_unique()}"
    bars.draw(REPORTS / f"{name}.png", mean.to_dicts(), labels, f"{title} seeds")


if __name__ == "__main__":
    main()
