"""What a kinematic tuple costs: each part of it on one core, and whole shards by the engine.

Imported by benchmarks/projection.py, which prints it.
"""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))  # of `pipeline`, which is installed nowhere
from pipeline.stage import bar, say  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.kernels.distance import reach  # noqa: E402
from s3le.kernels.solver import blend, minimise  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.store import tables  # noqa: E402
from s3le.tuples import sampling  # noqa: E402
from s3le.tuples.certified import certificate  # noqa: E402
from s3le.tuples.engine import run  # noqa: E402
from s3le.tuples.shards import TupleShards  # noqa: E402
from s3le.tuples.tables import HOW, kinematic_pairs  # noqa: E402

SHARD = 2000  # rows; small, so that every core makes many
PROJECTION, COAL = "projection", "coal certificate"


class Cost(NamedTuple):
    """Times [us] for each row, on one core."""

    rows: int
    parts: dict[str, float]  # of a tuple
    collide: float  # share of rows whose clipped pose collides
    at_once: float  # projection of a row that does not collide when clipped
    solved: float  # projection of a row that does
    iterations: np.ndarray  # (2,), mean of those rows: from the clipped pose, from the blended one
    clearance: float  # of one pose
    size: float  # bytes of a row in Parquet

    @property
    def whole(self) -> float:
        """All parts together."""
        return sum(self.parts.values())

    @property
    def shared(self) -> float:
        """What a tuple needs beside its projection and its certificate."""
        return self.whole - self.parts[PROJECTION] - self.parts[COAL]


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and all that start in it, on one processor."""
    all_of_them = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(all_of_them)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, all_of_them)


def timed(work: Callable, rows: int, repeat: int = 1) -> tuple[object, float]:
    """Result of work and its time [us] for each of rows; the best of several times."""
    best = np.inf
    for _ in range(repeat):
        began = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - began)
    return result, best / rows * 1e6


def measure(it: Robot, rows: int, alpha: float) -> Cost:
    """Time each part of rows tuples; call it within one_core."""
    arm, chain, checker = it, it.chain, it.certifier()
    low, high = sampling.relaxed_limits(arm.lower, arm.upper, alpha)
    rng = np.random.default_rng(1)
    project = partial(batch.project, chain, arm.anchor, margin=it.margin)
    parts = {}
    q, parts["draw"] = timed(lambda: rng.uniform(low, high, (rows, arm.n_dof)), rows, 3)
    mix = rng.uniform(0.0, 1.0, rows)
    found, parts[PROJECTION] = timed(lambda: project(q), rows, 3)
    x, parts["FK of q~ and q-bar"] = timed(
        lambda: [batch.skeletons(chain, poses) for poses in (q, found.q)], rows, 3
    )
    mixed, parts["mixup"] = timed(lambda: sampling.mixup(*x, mix, False), rows, 3)
    report, parts[COAL] = timed(lambda: certificate(it, found.q, checker=checker), rows)
    columns = {
        "row": np.arange(rows, dtype=np.int32), "mix": mix, "x_mixed": mixed, "x_relaxed": x[0],
        "x_feasible": x[1], "q_relaxed": q, "q_feasible": found.q,
        "projection": np.array(HOW)[found.how],
    }  # fmt: skip
    table = kinematic_pairs(arm.n_dof, it.margin)
    data, parts["Parquet"] = timed(lambda: tables.encode(columns | report, table, it.tag), rows, 3)
    clipped = np.clip(q, arm.lower, arm.upper)
    clearance, clearance_us = timed(lambda: batch.clearances(chain, clipped), rows, 3)
    hit = clearance < it.margin
    return Cost(
        rows=rows,
        parts=parts,
        collide=float(hit.mean()),
        at_once=timed(lambda: project(q[~hit]), max((~hit).sum(), 1), 3)[1],
        solved=timed(lambda: project(q[hit]), max(hit.sum(), 1), 3)[1],
        iterations=_iterations(it, q[hit][:500]),
        clearance=clearance_us,
        size=len(data) / rows,
    )


def show(cost: Cost) -> None:
    """Print where the time goes."""
    print(f"\nWhere the time goes: {cost.rows} tuples on one core, {cost.size:.0f} bytes each")
    for name, us in cost.parts.items():
        print(f"  {name:22}{us:8.2f} us {us / cost.whole:7.1%}")
        if name == PROJECTION:
            clipped, blended = cost.iterations
            print(
                f"    {1 - cost.collide:.1%} of rows are feasible at once, clipped at most:"
                f" {cost.at_once:.2f} us each\n"
                f"    {cost.collide:.1%} of rows are solved: {cost.solved:.2f} us each,"
                f" iterations {clipped:.1f} from the clipped pose and {blended:.1f} from the"
                f" blended one\n    one clearance of a pose: {cost.clearance:.2f} us"
            )
    print(f"  {'together':22}{cost.whole:8.2f} us, {1e6 / cost.whole:.0f} tuples/s")


def _iterations(it: Robot, q: np.ndarray) -> np.ndarray:
    """Mean iterations of the solver from the clipped pose and from the blended one, (2,)."""
    arm, balls, none, out = it, reach(it.chain), np.empty(0), np.empty(3)
    counts = []
    for pose in q:
        back = np.clip(pose, arm.lower, arm.upper)
        blend(it.chain, balls, arm.anchor, it.margin, back)
        counts.append([])
        for start in (pose.copy(), back):
            minimise(it.chain, balls, False, none, pose, 0.0, it.margin, True, 60, start, out)
            counts[-1].append(out[2])
    return np.mean(counts, axis=0)


def throughput(task: TupleShards, rows: int, folder: Path) -> None:
    """Tuples a second through the engine, shards written and fsynced."""
    print("\nTuples/s through the engine, every shard certified, written and fsynced")
    for cores in sorted({1, len(os.sched_getaffinity(0))}):
        total, done = rows * cores // SHARD * SHARD, [(time.perf_counter(), 0)]
        out, shelf = folder / f"out{cores}", folder / f"shelf{cores}"
        with bar(total, f"{cores} cores", wait="workers start") as advance:

            def progress(n: int, _: dict, advance: Callable = advance, done: list = done) -> None:
                done.append((time.perf_counter(), done[-1][1] + n))
                advance(n)

            where = run.Where(workers=cores)
            if cores == 1:
                with one_core():
                    run.produce(task, total, out, where, progress, say, shelf)
            else:
                run.produce(task, total, out, where, progress, say, shelf)
        # Steady rate: from when every worker has delivered its first shard.
        (start, _), (ready, first), (end, _) = done[0], done[min(cores, len(done) - 1)], done[-1]
        rate = (total - first) / (end - ready) if total > first else np.nan
        print(f"  cores: {cores:3} {rate:9.0f}, after {ready - start:.1f} s of starting up")
