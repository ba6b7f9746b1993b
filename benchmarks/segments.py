"""Paths between poses: how many are certified, how many collide, and what a proof costs.

    python benchmarks/segments.py [--samples 1000] [--budgets 0,2,200] [--data data]

The paths are those between random feasible poses; between the frames of feasible random walks at
30 Hz, in which every joint moves at up to 4 or 1 rad/s; and between consecutive frames of the
looked-up motions and of the ground truth, where those tables are there. One core, best of three
rounds: a batch (certify), and path by path as a robot would ask (segment.prove, with the call from
Python). Nothing is asserted; times are those of this machine.
"""

import time
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from tuple_cost import one_core, timed

from s3le.kernels import batch
from s3le.rng import stream
from s3le.robot.robot import Robot
from s3le.safety import segment
from s3le.safety.paths import CERTIFIED, COLLIDES, UNDECIDED, Segments, certify
from s3le.safety.swept import swept
from s3le.store import tables
from s3le.study.tables import ground_truth, retargeted
from s3le.tuples import sampling

RATE = 30.0  # [Hz]
WALK = 250  # steps of a random walk


def main(
    samples: Annotated[int, typer.Option(help="paths of each random kind")] = 1000,
    budgets: Annotated[str, typer.Option(help="poses that may be looked at between")] = "0,2,200",
    margins: Annotated[str, typer.Option(help="clearances to keep between [m]")] = "0.0005,0.001",
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance of the poses [m]")] = 0.002,
    data: Annotated[Path, typer.Option(help="folder of the tables")] = Path("data"),
) -> None:
    """Print the table."""
    it = Robot.from_file(robot, margin, "midpoint")
    n_dof = it.n_dof
    motions = {
        "random feasible poses": [sampling.draw_feasible(it, samples + 1, stream(0, "pairs"))[0]],
        "walks at up to 4 rad/s": walks(it, samples, 4.0),
        "walks at up to 1 rad/s": walks(it, samples, 1.0),
        "looked-up motion": clips(retargeted(n_dof), data / "retargeted-s3le.parquet"),
        "ground truth": clips(ground_truth(n_dof, margin), data / "ground_truth.parquet"),
    }
    print(f"{it.name}: {len(it.watched)} pairs, poses keep {margin * 1e3:g} mm\n")
    print(
        f"{'':24}{'paths':>6}{'between':>9}{'budget':>8}{'certified':>11}{'collide':>9}"
        f"{'undecided':>11}{'looks':>7}{'most':>6}{'us batch':>10}{'us call p50':>13}{'p99':>7}"
    )
    with one_core():
        for name, parts in motions.items():
            if not parts:
                print(f"{name:24}no table")
            for between, budget in product(margins.split(","), budgets.split(",")):
                if parts:
                    print(f"{name:24}" + row(it, parts, float(between), int(budget)))


def walks(it: Robot, samples: int, speed: float) -> list[np.ndarray]:
    """Feasible random walks [rad]: a random step in every joint, then Proj_Q."""
    arm, rng, most = it, stream(0, f"walks {speed}"), speed / RATE
    q = sampling.draw_feasible(it, max(1, samples // WALK), rng)[0]
    frames = [q]
    for _ in range(WALK):
        wish = np.clip(q + rng.uniform(-most, most, q.shape), arm.lower, arm.upper)
        moved = batch.project(it.chain, arm.anchor, wish, it.margin).q
        near = np.abs(moved - q).max(axis=1, keepdims=True) <= most
        q = np.where(near, moved, q)  # a step that would be too fast is not taken
        frames.append(q)
    return list(np.stack(frames, axis=1))


def clips(table, path: Path) -> list[np.ndarray]:
    """Poses of each clip in a table [rad], in order; nothing where there is no table."""
    if not path.exists():
        return []
    found = tables.read(table, path, columns=["clip", "frame", "q"])
    cuts = 1 + np.flatnonzero(
        (found["clip"][1:] != found["clip"][:-1]) | (np.diff(found["frame"]) != 1)
    )
    return np.split(found["q"], cuts)


def row(it: Robot, parts: list[np.ndarray], between: float, budget: int) -> str:
    """One line of the table."""
    paths = sum(len(q) - 1 for q in parts)
    certify(it, parts[0][:2], between, budget)  # compiles
    found, us = timed(lambda: [certify(it, q, between, budget) for q in parts], paths, repeat=3)
    found = Segments(*map(np.concatenate, zip(*found, strict=True)))
    bounds, scratch = swept(it.chain), segment.scratch(it.chain)
    calls = np.full((3, paths), np.inf)
    ends = [pair for q in parts for pair in zip(q[:-1], q[1:], strict=True)]
    for again, (i, (q0, q1)) in product(range(3), enumerate(ends)):
        began = time.perf_counter_ns()
        segment.prove(it.chain, bounds, scratch, q0, q1, between, budget)
        calls[again, i] = (time.perf_counter_ns() - began) / 1e3
    p50, p99 = np.quantile(calls.min(axis=0), [0.5, 0.99])
    share = {status: np.mean(found.status == status) for status in (CERTIFIED, COLLIDES, UNDECIDED)}
    return (
        f"{paths:6}{between * 1e3:6g} mm{budget:8}{share[CERTIFIED]:11.1%}{share[COLLIDES]:9.1%}"
        f"{share[UNDECIDED]:11.1%}{found.used.mean():7.2f}{found.used.max():6}{us:10.1f}"
        f"{p50:13.1f}{p99:7.1f}"
    )


if __name__ == "__main__":
    typer.run(main)
