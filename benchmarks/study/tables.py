"""The study's tables and pictures from reports/study/runs.csv and search.csv.

    python benchmarks/study/tables.py

Writes reports/study/study.md and a bar chart per experiment that has more than one method.
Standard deviations are over trainings, of which n are in a row; every frame of a split counts
once, in the share of motions every motion does. All rows of a table are of one commit, which
stands above it; a row of another is marked. A try that is not finished with all its seeds is
left out.
"""

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
from ruamel.yaml import YAML

from s3le.learn.methods import ENTRIES
from s3le.report import bars
from s3le.store import documents

HERE = Path(__file__).resolve().parent
REPORTS = HERE.parents[1] / "reports/study"
COMPARED = ("s3le", "lwl2_all", "lwl2", "lwl2_pairs", "ale")
MARK = " †"  # of a row that has a training of another commit
CELL = pl.col("method").str.contains("/", literal=True)  # of the grid, not a method
NAMES = {"s3le": "S3LE", "lwl2": "LWL2", "ale": "ALE", "skeleton": "nearest skeleton"}


class Best(NamedTuple):
    """The best setting that the search found for a method."""

    method: str
    number: int  # of the setting; 0: the default
    entry: str  # the look-up that was best with it
    to_truth: float  # on the validation set
    default: float  # the same with the default's best look-up
    among: int  # settings, as many for each method
    changed: dict[str, Any]  # parameter, dotted -> value
    entries: list[str]  # all its look-ups


def searched(path: Path) -> pl.DataFrame | None:
    """Rows of the search that are of the last one's commit and budget; None: there are none."""
    if not path.is_file():
        return None
    found = pl.read_csv(path)
    last = found.tail(1)
    return found.join(last.select("commit", "steps", "clips", "seed"), list(last.select(
        "commit", "steps", "clips", "seed").columns))  # fmt: skip


def best(found: pl.DataFrame | None) -> list[Best]:
    """Each method's best setting among the first ones that all three have tried."""
    if found is None:
        return []
    tried = {name: set(found.filter(method=name)["number"]) for name in ("s3le", "lwl2", "ale")}
    among = 0
    while all(among in numbers for numbers in tried.values()):
        among += 1
    if not among:
        return []
    chosen = []
    for name in tried:
        own = found.filter(pl.col("number") < among, method=name).sort("to_truth", "number")
        first = own.row(0, named=True)
        chosen.append(
            Best(
                name,
                first["number"],
                first["entry"],
                first["to_truth"],
                own.filter(number=0)["to_truth"].min(),
                among,
                json.loads(first["setting"]),
                sorted(set(own["entry"])),
            )
        )
    return chosen


def spread(values: pl.Series) -> str:
    """Mean and standard deviation, or the one value there is."""
    if len(values) < 2:
        return f"{values.mean():.4f}"
    return f"{values.mean():.4f} ± {values.std():.4f}"


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, first column left, the others right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main_commit(runs: pl.DataFrame) -> str:
    """The commit that most trainings are of; of equally many the one recorded last."""
    own = runs.filter(pl.col("motion") == "all", ~CELL)
    counts = own.with_row_index("at").group_by("commit").agg(pl.len(), pl.col("at").max())
    return counts.sort("len", "at")["commit"][-1]


def marked(words: str, rows: pl.DataFrame, commit: str) -> str:
    """The name of a row, with a mark if a training of it is of another commit."""
    return words + (MARK if (rows["commit"] != commit).any() else "")


def legend(runs: pl.DataFrame, commit: str) -> list[str]:
    """What the mark stands for; nothing where no row has it."""
    other = runs.filter(pl.col("motion") == "all", pl.col("commit") != commit, ~CELL)
    told = [
        f"{row}, seed {seed}: {made} ({', '.join(own['method'].unique(maintain_order=True))})"
        for (row, seed, made), own in other.group_by("row", "seed", "commit", maintain_order=True)
    ]
    return [f"{MARK.strip()} has trainings of another commit: {'; '.join(told)}."] if told else []


def spread_over(runs: pl.DataFrame) -> str:
    """What differs between the trainings of a row."""
    data = sum('"seed"' in changed for changed in runs["changed"].unique())
    if data == 0:
        return "± is the standard deviation over `train.seed` alone, all on the same data"
    if data == runs["changed"].n_unique():
        return (
            "± is the standard deviation over n trainings, each with a `seed` (data) and a "
            "`train.seed` (start) of its own"
        )
    return "± is the standard deviation over n trainings, of which some share their data"


def people(names: list[str]) -> str:
    """How many subjects motions named SUBJECT_TRIAL are of, where they are named so."""
    if not all(re.fullmatch(r"\d+_\d+", name) for name in names):
        return ""
    subjects = sorted({name.split("_")[0] for name in names}, key=int)
    return f" of {len(subjects)} people (CMU's subjects {', '.join(subjects)})"


def methods(runs: pl.DataFrame, commit: str) -> str:
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
                marked(entry.label, mine, commit),
                spread(mine["to_truth"]),
                spread(mine["to_human"]),
                f"{mine['collision_rate'].max():.2%}",
                f"{mine['limit_rate'].max():.2%}",
                f"{mine['pool'][0]:,}",
                ratio,
                str(len(mine)),
            ]
        )
    head = ["method", "to the ground truth", "to the human", "collisions, worst seed",
            "limits broken, worst seed", "stored", "over brute force", "n"]  # fmt: skip
    return table(head, rows)


def motions(runs: pl.DataFrame) -> str:
    """Each motion, mean over seeds; the best of the compared methods in bold."""
    compared = [name for name in COMPARED if name in set(runs["method"])]
    mean = (
        runs.filter(pl.col("motion") != "all", pl.col("method").is_in([*compared, "skeleton_all"]))
        .group_by("motion", "method", maintain_order=True)
        .agg(pl.col("to_truth").mean(), pl.col("frames").first(), pl.len())
    )
    names = mean["motion"].unique(maintain_order=True)
    rows = []
    for name in names:
        own = {row["method"]: row for row in mean.filter(motion=name).to_dicts()}
        best = min(own[m]["to_truth"] for m in compared if m in own)
        cells = [
            "-" if m not in own
            else f"**{own[m]['to_truth']:.3f}**" if own[m]["to_truth"] == best
            else f"{own[m]['to_truth']:.3f}"
            for m in compared
        ]  # fmt: skip
        brute = f"{own['skeleton_all']['to_truth']:.3f}" if "skeleton_all" in own else "-"
        first = own[compared[0]]
        rows.append([name, f"{first['frames']:,}", *cells, brute, str(first["len"])])
    head = ["motion", "frames", *(ENTRIES[m].label for m in compared), "brute force, all poses",
            "n"]  # fmt: skip
    return table(head, rows)


def wins(runs: pl.DataFrame) -> str:
    """In how many motions S3LE lies below each baseline and below all of them, seed by seed."""
    wide = runs.filter(pl.col("motion") != "all").pivot(
        on="method", index=["seed", "motion"], values="to_truth"
    )
    others = [name for name in COMPARED[1:] if name in wide.columns]
    rows = []
    for label, against in [
        *((ENTRIES[name].label, [name]) for name in others),
        ("all of them", others),
    ]:
        sets = wide.drop_nulls(["s3le", *against])
        below = sets.with_columns(won=pl.col("s3le") < pl.min_horizontal(against))
        counts = below.group_by("seed", maintain_order=True).agg(pl.col("won").sum(), pl.len())
        told = ", ".join(f"{won} of {n}" for _, won, n in counts.iter_rows())
        rows.append([label, told, f"{below['won'].mean():.0%}", str(len(counts))])
    return table(["motions in which S3LE is below", "by seed", "share", "n"], rows)


def in_words(runs: pl.DataFrame) -> str:
    """Who is nearer in the mean, which counts of motions alone do not say."""
    mean = {
        name: runs.filter(motion="all", method=name)["to_truth"].mean()
        for name in (*COMPARED, *(e.twin for e in ENTRIES.values() if e.twin))
    }
    own, parts = mean["s3le"], []
    if own and mean["ale"]:
        how = "below" if own < mean["ale"] else "behind"
        parts.append(
            f"In the mean over all frames S3LE ({own:.4f}) is {how} ALE ({mean['ale']:.4f}), which "
            "may answer with poses that collide."
        )
    pairs = [(name, ENTRIES[name].twin) for name in COMPARED if ENTRIES[name].twin]
    pairs = [(name, twin) for name, twin in pairs if mean[name] and mean[twin]]
    if pairs and all(mean[twin] < mean[name] for name, twin in pairs):
        parts.append(
            "Brute force, which compares skeletons and learns nothing, is nearer on the same poses "
            "than every latent look-up."
        )
    return " ".join(parts)


def grid(runs: pl.DataFrame, commit: str) -> list[str]:
    """Every model in every pool by every metric; nothing where none was looked up so."""
    cells = runs.filter(CELL)
    if cells.is_empty():
        return []
    parts = cells.with_columns(
        pl.col("method").str.split_exact("/", 2).struct.rename_fields(["model", "stored", "metric"])
        .alias("cell")
    ).unnest("cell")  # fmt: skip
    metrics = list(parts["metric"].unique(maintain_order=True))
    rows = []
    for (model, stored), own in parts.group_by("model", "stored", maintain_order=True):
        by = [own.filter(metric=metric)["to_truth"] for metric in metrics]
        rows.append(
            [
                marked(f"{NAMES[model]}, {stored}", own, commit),
                f"{own['pool'][0]:,}",
                *(spread(values) if len(values) else "-" for values in by),
                str(own["seed"].n_unique()),
            ]
        )
    return [
        "Which pool and which distance, the same trainings (to the ground truth):",
        table(["model, pool", "stored", *metrics, "n"], rows),
    ]


def tries(runs: pl.DataFrame, what: dict[str, Any], commit: str) -> list[str]:
    """One line a try: S3LE and what brute force finds on its pool; unfinished ones are left out."""
    rows, left, base = [], [], None
    for row in what["tries"]:
        own = runs.filter(row=row, motion="all").sort("seed")
        mine = own.filter(method="s3le")
        if not set(what["seeds"]) <= set(mine["seed"]):
            left.append(row)
            continue
        brute = own.filter(method="skeleton_all")["to_truth"].mean()
        base = mine if base is None else base
        both = mine.join(base, on="seed", suffix="_base")
        change = both["to_truth"] - both["to_truth_base"]
        told = "-"
        if row != base["row"][0]:
            told = f"{change.mean():+.4f}"
            if len(change) > 1:
                told += f" ± {change.std() / math.sqrt(len(change)):.4f}"
        rows.append(
            [
                marked(row, own, commit),
                spread(mine["to_truth"]),
                told,
                f"{brute:.4f}",
                f"{mine['to_truth'].mean() / brute:.2f}",
                str(len(mine)),
            ]
        )
    parts = []
    if base is not None:
        first = base["row"][0]
        head = ["S3LE with", "to the ground truth", f"against '{first}' (± standard error)",
                "brute force, same poses", "ratio", "n"]  # fmt: skip
        parts.append(table(head, rows))
    if left:
        parts.append(
            f"Not finished with all {len(what['seeds'])} seeds, and therefore left out: "
            f"{'; '.join(left)}."
        )
    return parts


def search(found: pl.DataFrame | None) -> list[str]:
    """What the search of settings has given so far."""
    chosen = best(found)
    about = "As many settings for each method, judged on training clips that were split off"
    if not chosen:
        return ["## search", f"{about} (`make search`). No setting of all three is tried yet."]
    last = found.row(-1, named=True)
    rows = [
        [
            NAMES[one.method],
            f"{one.default:.4f}",
            f"{one.to_truth:.4f}",
            ENTRIES[one.entry].label,
            "its default" if not one.number
            else ", ".join(f"{key} {value}" for key, value in one.changed.items()),
            str(one.among),
        ]
        for one in chosen
    ]  # fmt: skip
    head = ["method", "default", "best", "by", "with", "n"]
    return [
        "## search",
        f"{about} (`make search`): {last['clips']}, {last['frames']:,} frames, {last['steps']:,} "
        f"steps a setting, n settings of each; commit {last['commit']}; {last['machine']}.",
        table(head, rows),
    ]


def main() -> None:
    """Write the page and its pictures."""
    plan = YAML(typ="safe").load(HERE / "plan.yaml")
    runs = pl.read_csv(REPORTS / "runs.csv")
    found = searched(REPORTS / "search.csv")
    parts = [
        "# The study",
        "Written by `python benchmarks/study/tables.py` from `runs.csv` and `search.csv`; the "
        "trainings are those of `make study` (benchmarks/study/plan.yaml) and `make search`. What "
        "it amounts to, in words: [docs/study.md](../../docs/study.md). n is the number of "
        "trainings that a row is the mean of.",
    ]
    for name, what in plan.items():
        own = runs.filter(experiment=name)
        planned = len(what["seeds"]) * len(what.get("tries", best(found)))
        if own.is_empty():
            parts += [f"## {name}", f"{what['about']}. None of {planned} trainings is made yet."]
            continue
        seeds = own.select("row", "seed").n_unique()
        commit = main_commit(own)
        where = "; ".join(own["machine"].unique(maintain_order=True))
        parts += [
            f"## {name}",
            f"{what['about']}. {seeds} of {planned} trainings; commit {commit}; {where}. "
            f"{spread_over(own)}.",
            *legend(own, commit),
        ]
        for split in own["split"].unique(maintain_order=True):
            part = own.filter(split=split)
            names = list(part.filter(pl.col("motion") != "all")["motion"].unique())
            frames = part.filter(motion="all")["frames"][0]
            head = f"{len(names)} motions{people(names)}, {frames:,} frames"
            parts += [f"### Split *{split}*: {head}"]
            if what.get("ablation"):
                parts += tries(part, what, commit)
                continue
            plain = part.filter(~CELL)
            parts += [methods(plain, commit), in_words(plain), wins(plain), motions(plain)]
            parts += grid(part, commit)
        if not what.get("ablation"):
            draw(own.filter(~CELL), name)
            parts += [f"![{name}: each motion]({name}.png)"]
    text = "\n\n".join([part for part in [*parts, *search(found)] if part]) + "\n"
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
