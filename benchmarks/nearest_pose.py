"""How far Proj_Q is from the nearest feasible pose that a global search finds.

    python benchmarks/nearest_pose.py [--samples 500] [--starts 40] [--near 20] [--alpha 0.2]

For each relaxed pose whose clipped pose collides, the projection's solver is started from random
feasible poses and from poses around the answer; the nearest feasible pose of all is the best known.
That it is the nearest of all poses is not proven. Seeded: the same numbers every time.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

ROOT = Path(__file__).parents[1]
sys.path += [str(ROOT / "tests"), str(ROOT)]  # ROOT of `pipeline`, which is installed nowhere
from reference import around, search  # noqa: E402  (the tests measure against it too)

from pipeline.stage import bar  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.rng import stream  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.tuples import sampling  # noqa: E402

POOL = 2000  # feasible poses that random starts are chosen from
ROUNDING = 1e-9  # [rad]


def main(
    samples: Annotated[int, typer.Option(help="relaxed poses that collide when clipped")] = 500,
    starts: Annotated[int, typer.Option(help="random feasible starts for each")] = 40,
    near: Annotated[int, typer.Option(help="starts around the answer for each")] = 20,
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
    alpha: Annotated[float, typer.Option(help="relaxation of the joint ranges [-]")] = 0.2,
    seed: Annotated[int, typer.Option(help="root of the random streams")] = 0,
) -> None:
    """Print the distribution of our distance over the best one found."""
    it = Robot.from_file(robot, margin, "midpoint")
    arm, chain = it, it.chain
    q = _colliding(it, samples, alpha, seed)
    ours = batch.project(chain, arm.anchor, q, margin).q
    pool = sampling.draw_feasible(it, POOL, stream(seed, "starts"))[0]

    def best_of(row: int) -> np.ndarray:
        rng = stream(seed, "search", row)
        tried = pool[rng.choice(len(pool), starts, replace=False)]
        tried = np.concatenate([tried, around(ours[row], near, arm.lower, arm.upper, rng)])
        return search(chain, q[row], tried, margin, ours[row])

    best = np.empty_like(q)
    with (
        bar(samples, "global search", "samples") as advance,
        ThreadPoolExecutor(batch.workers()) as threads,
    ):
        for row, pose in enumerate(threads.map(best_of, range(samples))):
            best[row] = pose
            advance(1)
    it.certifier().require(best, margin)

    far, least = (np.linalg.norm(poses - q, axis=1) for poses in (ours, best))
    ratio = far / least
    print(
        f"{arm.name}: {samples} samples that collide, alpha {alpha:g}, margin {margin * 1e3:g} mm,"
        f" {starts} random and {near} near starts each\n"
        "distance of Proj_Q over that of the best pose found:\n"
        f"  median {np.median(ratio):.6f}, p95 {np.quantile(ratio, 0.95):.6f},"
        f" p99 {np.quantile(ratio, 0.99):.4f}, max {ratio.max():.4f}\n"
        f"  within 0.1 %: {np.mean(ratio <= 1.001):.1%} of samples;"
        f" beaten by more than rounding: {np.mean(far > least + ROUNDING):.1%}\n"
        f"  mean distance: ours {far.mean():.4f} rad, best {least.mean():.4f} rad"
    )


def _colliding(it: Robot, samples: int, alpha: float, seed: int) -> np.ndarray:
    """The first relaxed poses [rad] whose clipped pose collides, (samples, n_dof)."""
    arm, rng = it, stream(seed, "samples")
    low, high = sampling.relaxed_limits(arm.lower, arm.upper, alpha)
    kept, have = [], 0
    while have < samples:
        q = rng.uniform(low, high, (1000, arm.n_dof))
        hit = batch.clearances(it.chain, np.clip(q, arm.lower, arm.upper)) < it.margin
        kept.append(q[hit])
        have += hit.sum()
    return np.concatenate(kept)[:samples]


if __name__ == "__main__":
    typer.run(main)
