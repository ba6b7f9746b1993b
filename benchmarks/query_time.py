"""Query time against the number of stored poses, the question of the paper's Conclusion.

    python benchmarks/query_time.py [--sizes 10000,...,1000000] [--clips FOLDER] [--draw-only]

Looking at all rows, and the walk over a graph beside it (s3le/search), one query a call,
eight rows wanted, on one thread. Queries are people. Writes reports/study/query_time.csv and
draws reports/study/query_time.png; times are processor time of the asking thread.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from stored import SEED, SPACES, World, timed, true_distances, where, worlds

from pipeline.stage import bar
from s3le.kernels.threads import use_threads
from s3le.report import growth
from s3le.search import neighbours
from s3le.store import documents

K = 8  # rows wanted
NEAR = 1.01
FEW = 150  # queries of an exact search
TABLE = Path("reports/study/query_time.csv")
PICTURE = Path("reports/study/query_time.png")


def main(
    sizes: Annotated[
        str, typer.Option(help="stored rows")
    ] = "10000,30000,100000,131000,300000,1000000",
    spaces: Annotated[str, typer.Option(help="of " + ", ".join(SPACES))] = ",".join(SPACES),
    queries: Annotated[int, typer.Option(help="people at most")] = 1500,
    clips: Annotated[Path, typer.Option(help="folder of motion files to take people from")] = None,
    data: Annotated[Path, typer.Option(help="folder of the tables")] = Path("data"),
    cache: Annotated[Path, typer.Option(help="keeps the poses from run to run (.npy)")] = None,
    draw_only: Annotated[bool, typer.Option(help="draw the table that is there")] = False,
) -> None:
    """Measure, write the table, draw it."""
    if not draw_only:
        documents.write_csv(measure(sizes, spaces, queries, clips, data, cache), TABLE)
    draw()


def measure(
    sizes: str, spaces: str, queries: int, clips: Path | None, data: Path, cache: Path | None
) -> list[dict]:
    """Rows of the table."""
    counts = [int(size) for size in sizes.split(",")]
    use_threads(1)
    rows, here = [], where()
    for space, world in worlds(data, clips, max(counts), spaces.split(","), queries, cache).items():
        for count in counts:
            part = World(world.stored[:count], world.queries)
            true = true_distances(part)
            with bar(count, f"linking {count} {SPACES[space]}") as progress:
                walk = neighbours.build(part.stored, progress=progress)
            for search, index, every in (
                ("walk", walk, 1),
                ("exact", neighbours.build(part.stored, exact=True), len(true) // FEW or 1),
            ):
                seek = index.seeker(K)
                cpu, _, far = timed(lambda z, s=seek: s(z)[1][0], part.queries[::every])
                rows.append(
                    {
                        "space": space,
                        "dim": part.stored.shape[1],
                        "search": search,
                        "rows": count,
                        "us_p50": round(float(np.median(cpu)), 1),
                        "us_p99": round(float(np.quantile(cpu, 0.99)), 1),
                        "within_1_percent": round(
                            float((np.array(far) <= NEAR * true[::every]).mean()), 4
                        ),
                        "queries": len(far),
                        "k": K,
                        "width": neighbours.WIDTH if search == "walk" else None,
                        "threads": 1,
                        "seed": SEED,
                    }
                    | here
                )
                print(rows[-1], flush=True)
    return rows


def draw() -> None:
    """Draw the table."""
    rows = documents.read_csv(TABLE, "query_time")
    worst = min(row["within_1_percent"] for row in rows if row["search"] == "walk")
    note = (
        f"Thick: median, thin: 99th percentile; {K} nearest of one human frame, one thread of "
        f"{rows[0]['robot']},\nprocessor time, the call from Python included. "
        f"The walk finds a row within 1 % of the true distance for at least {worst:.2%} of people."
    )
    growth.draw(PICTURE, rows, note)


if __name__ == "__main__":
    typer.run(main)
