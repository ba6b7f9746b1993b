"""What refining is worth, before and after the guard, and how far it stays from the optimum.

    python benchmarks/refining.py [--skeletons data/skeletons.parquet] [--optimum 120]

Every motion of the table that was not trained on is planned as a whole, and played as a stream, at
its own rate. *before*: the pose wanted; *after*: where the robot gets, within all limits in time,
every pose and path certified.
The optimum of a frame is the best feasible pose that another solver (tests/reference.py: pinocchio,
coal, daqp) reaches from the poses looked up and from random feasible ones, 22 in all; it is sought
for frames that are drawn with a seed. CMU's: dvc exp run -S clips=cmu skeletons.
"""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

ROOT = Path(__file__).parents[1]
sys.path += [str(ROOT / "tests"), str(ROOT)]  # ROOT of `pipeline`, which is installed nowhere
from reference import OneByOne  # noqa: E402  (the tests measure against it too)

from pipeline.stage import bar  # noqa: E402
from s3le.human import splits  # noqa: E402
from s3le.human.tables import SKELETONS  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.retarget import Retargeter  # noqa: E402
from s3le.rng import stream  # noqa: E402
from s3le.skeleton import cosine_distance  # noqa: E402
from s3le.store import tables  # noqa: E402
from s3le.study import followed  # noqa: E402
from s3le.tuples import sampling  # noqa: E402

STARTS = 22  # of the other solver, for each frame
SHOWN = ("planned", "limited", "detour", "shortened", "braked")


def main(
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    skeletons: Annotated[Path, typer.Option(help="frames")] = Path("data/skeletons.parquet"),
    optimum: Annotated[int, typer.Option(help="frames to find the optimum of; 0: none")] = 120,
    seed: Annotated[int, typer.Option(help="root of the random streams")] = 0,
) -> None:
    """Print the tables."""
    table = tables.read(SKELETONS, skeletons)
    rows = splits.test_rows(table)
    x, clips, times = table["x"][rows], table["clip"][rows], table["time"][rows]
    own = Retargeter.load(folder)
    print(
        f"{own.robot.name}, {len(set(clips))} motions, {len(x)} frames; mean cosine "
        f"distance to the human\n{'':32}{'before':>8}{'after':>8}{'p99':>8}{'jerk':>7}"
        + "".join(f"{mode:>10}" for mode in SHOWN)
    )
    wanted, kept = _wanted(own, clips, times, x), np.empty(0)
    for refine in (False, True):
        for ahead in (True, False):
            q, mode = followed.follow(own.robot, own, clips, times, x, refine, look_ahead=ahead)
            _say(own, refine, ahead, wanted if refine else None, q, mode, clips, times, x)
            kept = q
    if optimum:
        _to_optimum(own, x, wanted, kept, min(optimum, len(x)), seed)


def _wanted(it: Retargeter, clips: np.ndarray, times: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The pose wanted for each frame [rad], (n, n_dof)."""
    found = np.empty((len(x), it.robot.n_dof))
    following = it.start()
    for i, row in enumerate(x):
        first = i == 0 or clips[i] != clips[i - 1]
        if first:
            following.reset()
        following.step(row, 1.0 / 30.0 if first else times[i] - times[i - 1])
        found[i] = following.wanted
    return found


def _say(it, refine, ahead, wanted, q, mode, clips, times, x) -> None:
    chain = it.robot.chain
    after = cosine_distance(batch.skeletons(chain, q), x)
    third = []
    for name in dict.fromkeys(clips):
        mine = clips == name
        dt = np.median(np.diff(times[mine]))
        third.append(np.abs(np.diff(q[mine], n=3, axis=0)).mean() / dt**3)
    if wanted is None:  # what is looked up is the best of the poses proposed
        before = np.mean([
            cosine_distance(batch.skeletons(chain, it.propose(row)), row[None]).min() for row in x
        ])  # fmt: skip
    else:
        before = cosine_distance(batch.skeletons(chain, wanted), x).mean()
    name = f"{'refined' if refine else 'look-up alone'}, " + ("file" if ahead else "stream")
    shares = "".join(f"{np.mean(mode == one):10.1%}" for one in SHOWN)
    print(
        f"{name:32}{before:8.4f}{after.mean():8.4f}{np.quantile(after, 0.99):8.3f}"
        f"{np.mean(third):7.0f}{shares}",
        flush=True,
    )


def _to_optimum(it: Retargeter, x, wanted, q, count: int, seed: int) -> None:
    robot = it.robot
    other = OneByOne(robot, robot.margin)
    rng = stream(seed, "optimum")
    rows = np.sort(rng.choice(len(x), count, replace=False))
    pool = sampling.draw_feasible(robot, 2000, stream(seed, "starts"))[0]
    looked = np.empty((count, robot.n_dof))
    best = np.empty_like(looked)
    with bar(count, "optimum", "frames") as advance:
        for i, row in enumerate(rows):
            near = it.propose(x[row])
            far = cosine_distance(batch.skeletons(robot.chain, near), x[row][None])
            looked[i] = near[np.argmin(far)]
            more = pool[rng.choice(len(pool), STARTS - len(near[:8]), replace=False)]
            best[i] = other.optimum(x[row], np.concatenate([near[:8], more]))
            advance(1)
    robot.certifier().require(best, robot.margin)
    shown = batch.skeletons(robot.chain, best)
    human = cosine_distance(shown, x[rows])
    print(f"\n{count} frames; the optimum is {human.mean():.4f} from the human. To the optimum:")
    for name, poses in (
        ("best of the look-up", looked), ("before the guard", wanted[rows]),
        ("after the guard", q[rows]),
    ):  # fmt: skip
        mine = batch.skeletons(robot.chain, poses)
        far, over = cosine_distance(mine, shown), cosine_distance(mine, x[rows]) - human
        print(
            f"  {name:22} mean {far.mean():.4f}, p95 {np.quantile(far, 0.95):.4f}; farther from "
            f"the human than it by {over.mean():+.4f}"
        )


if __name__ == "__main__":
    typer.run(main)
