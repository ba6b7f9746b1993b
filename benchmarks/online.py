"""From 21 numbers to a certified pose: how long it takes, part by part, and how near it comes.

    python benchmarks/online.py [--folder data/retargeter] [--frames 10000] [--check/--no-check]
    python benchmarks/online.py --skeleton       # retrieval by the skeleton itself, no encoder
    python benchmarks/online.py --record         # writes reports/latency.json, which the page shows

The frames are those of data/skeletons.parquet that are not of a training clip, played over and
over at 30 Hz. One core. Parts are timed by themselves on the same frames; the whole is
Stream.step as a robot would call it. *Look-up and certified step* goes for the nearest of the poses
looked up, as it is stored. Nothing is asserted; times are those of this machine.
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from stored import where
from tuple_cost import one_core

from s3le.human import splits
from s3le.human.tables import SKELETONS
from s3le.kernels import batch
from s3le.report import records
from s3le.retarget import propose
from s3le.retarget.rows import Mode
from s3le.retarget.stream import Retargeter
from s3le.search import neighbours
from s3le.store import documents, tables

DT = 1.0 / 30.0
RECORD = Path("reports/latency.json")


def main(
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    skeletons: Annotated[Path, typer.Option(help="frames")] = Path("data/skeletons.parquet"),
    frames: Annotated[int, typer.Option(help="frames to time")] = 10_000,
    check: Annotated[bool, typer.Option(help="coal at every pose")] = True,
    skeleton: Annotated[bool, typer.Option(help="look up by the skeleton itself")] = False,
    record: Annotated[bool, typer.Option("--record", help=f"write {RECORD} too")] = False,
) -> None:
    """Print the table."""
    it = Retargeter.load(folder, {"check": check})
    if skeleton:
        it = by_skeleton(it)
    table = tables.read(SKELETONS, skeletons)
    x = table["x"][splits.test_rows(table)]
    settings = it.settings
    print(
        f"{it.robot.name}, {len(it.robot.watched)} pairs; k {settings.k}, "
        f"at most {settings.iterations} iterations, proofs of at most {settings.budget} poses"
    )
    print(f"{'us':34}{'median':>9}{'p99':>9}{'worst':>10}")
    rows = []
    with one_core():
        for name, work in parts(it, x).items():
            rows.append(say(name, times(work, min(frames, 2000))))
        stream, modes, far, free = it.start(), Counter(), [], []

        def step(i: int) -> None:
            if i % len(x) == 0:
                stream.reset()  # the motion begins anew
            row = stream.step(x[i % len(x)], DT)
            modes[row.mode] += 1
            far.append(row.distance)
            free.append(row.wanted)

        rows.append(say(f"whole, {frames} frames", times(step, frames)) | {"part": "whole"})
        alone = times(looked_up(it, x), min(frames, 2000))
        rows.append(say("look-up and certificate alone", alone))
    shares = {str(mode): modes[mode] / modes.total() for mode in Mode if modes[mode]}
    print("\n" + ", ".join(f"{name} {share:.1%}" for name, share in shares.items()))
    print(f"mean cosine distance to the human: wanted {np.nanmean(free):.4f}, ", end="")
    print(f"after the guard {np.nanmean(far):.4f}")
    if record:
        robot = it.robot
        tree = {
            "format": records.FORMAT, "date": datetime.now(UTC).date().isoformat(),
            "machine": where()["machine"], "threads": 1,
            "robot": robot.name, "robot_tag": it.robot.tag, "joints": robot.n_dof,
            "pairs": len(it.robot.watched), "check": check,
            "method": "skeleton" if skeleton else method_of(folder),
            "settings": asdict(settings), "frames": frames, "modes": shares, "rows": rows,
        }  # fmt: skip
        records.checked(tree, f"{RECORD}: ")
        documents.write_json(tree, RECORD)
        print(f"recorded in {RECORD}")


def method_of(folder: Path) -> str:
    """What proposes the poses of an exported retargeter, and by which distance it looks them up."""
    about = documents.read_json(folder / folder.ABOUT, "export")
    return f"{about['method']}, {about['metric']}"


def looked_up(it: Retargeter, x: np.ndarray) -> Callable[[int], object]:
    """The certified step towards the nearest of the stored poses looked up."""
    chain, walkers = it.robot.chain, []

    def step(i: int) -> None:
        wanted = x[i % len(x)]
        found = it.propose(wanted)
        goal = found[np.argmax(batch.skeletons(chain, found) @ wanted)]
        if i % len(x) == 0:
            walkers[:] = [it.walker(goal)]
        else:
            walkers[0].step(goal, DT, found)

    return step


def by_skeleton(it: Retargeter) -> Retargeter:
    """The same retargeter with the same poses, found by their skeletons without a network."""
    poses = it._proposer._poses
    index = neighbours.build(batch.skeletons(it.robot.chain, poses), "l2")
    proposer = propose.LookUp(poses, index, it.settings.k, None)
    other = Retargeter(it.robot, proposer, it.settings)
    other.warm_up()
    return other


def parts(it: Retargeter, x: np.ndarray) -> dict[str, Callable[[int], object]]:
    """What the whole is made of, each as a function of the frame's number."""
    robot, proposer = it.robot, it._proposer
    checker, n = robot.certifier(), len(x)
    starts = [it.propose(row) for row in x]
    want, out = np.zeros((n, robot.n_dof)), np.zeros(3)
    walkers: list = []

    def refine(i: int) -> None:
        i %= n
        last = want[max(i - 1, 0)]
        want[i] = last
        it.refine(x[i], starts[i], last, last, i > 0, want[i], out)

    def step(i: int) -> None:
        i %= n
        if i == 0:
            walkers[:] = [it.walker(want[0])]
        else:
            walkers[0].step(want[i], DT, starts[i])

    for i in range(n):
        refine(i)
    found = {}
    if getattr(proposer, "_encoder", None):
        found["encoder"] = lambda i: proposer._encoder(x[i % len(x)])
    found["propose (encoder and search)"] = lambda i: it.propose(x[i % len(x)])
    found["refine"] = refine
    found["certified step, coal included"] = step
    found["coal, one pose"] = lambda i: checker.one(starts[i % len(x)][0])
    return found


def times(work: Callable[[int], object], count: int) -> np.ndarray:
    """Wall time of each call [us], the first few left out."""
    for i in range(3):
        work(i)
    taken = np.empty(count)
    for i in range(count):
        began = time.perf_counter_ns()
        work(i)
        taken[i] = (time.perf_counter_ns() - began) / 1e3
    return taken


def say(name: str, taken: np.ndarray) -> dict[str, object]:
    """One line, and the same as a row of the record [us]."""
    p50, p99 = np.quantile(taken, [0.5, 0.99])
    print(f"{name:34}{p50:9.1f}{p99:9.1f}{taken.max():10.1f}", flush=True)
    found = {"us_p50": p50, "us_p99": p99, "us_worst": taken.max()}
    return {"part": name, "calls": len(taken)} | {k: round(float(v), 1) for k, v in found.items()}


if __name__ == "__main__":
    typer.run(main)
