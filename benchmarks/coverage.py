"""How near each sampler's poses come to people it has not seen, over row counts and seeds.

    python benchmarks/coverage.py [--sizes 10000,30000] [--seeds 3] [--samplers uniform,human]

People are the test and held-out frames of data/skeletons.parquet (`dvc repro skeletons`). Every
row is projected and certified; the nearest is found by brute force in skeleton space.
"""

from itertools import groupby
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from tqdm import tqdm

from s3le.human.splits import test_rows
from s3le.human.tables import SKELETONS
from s3le.robot.robot import Robot
from s3le.skeleton import DIM
from s3le.store import tables
from s3le.study import coverage
from s3le.tuples.samplers import SAMPLERS


def main(
    sizes: Annotated[str, typer.Option(help="row counts")] = "10000,30000",
    seeds: Annotated[int, typer.Option(help="draws of each")] = 3,
    samplers: Annotated[str, typer.Option(help="which ones")] = ",".join(SAMPLERS),
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    skeletons: Annotated[Path, typer.Option(help="people")] = Path("data/skeletons.parquet"),
    alpha: Annotated[float, typer.Option(help="relaxation of the joint ranges [-]")] = 0.2,
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
) -> None:
    """Print mean and standard deviation over seeds; assert nothing but feasibility."""
    it = Robot.from_file(robot, margin, "midpoint")
    frames = tables.read(SKELETONS, skeletons)
    at = test_rows(frames)
    split = frames["split"][at]
    humans = {str(name): frames["x"][at[split == name]] for name in np.unique(split)}
    names, counts = samplers.split(","), [int(size) for size in sizes.split(",")]
    found = []
    with tqdm(total=2 * max(counts) * len(names) * seeds, unit=" rows", disable=None) as bar:
        for seed in range(seeds):
            none = np.empty((0, DIM))
            found += coverage.compare(it, humans, names, counts, alpha, seed, none, bar.update)

    def same(row: dict) -> tuple:
        return row["split"], row["rows"], names.index(row["sampler"])

    print("split          rows sampler      mean      sd     p90  feasible")
    for (where, rows, which), group in groupby(sorted(found, key=same), same):
        group = list(group)
        mean = [row["mean"] for row in group]
        p90, feasible = (np.mean([row[key] for row in group]) for key in ("p90", "feasible"))
        print(
            f"{where:10s} {rows:8d} {names[which]:9s} {np.mean(mean):7.4f} "
            f"{np.std(mean, ddof=1) if seeds > 1 else 0.0:7.4f} {p90:7.4f}  {feasible:7.1%}"
        )


if __name__ == "__main__":
    typer.run(main)
