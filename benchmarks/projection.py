"""Proj_Q against blending towards the anchor: how far the joints move, and what it costs.

    python benchmarks/projection.py [--samples 1500] [--robot data/robots/coman.yaml]

Blending is the authors' rule: while bodies collide, move every joint on their chains a twentieth
of the way to the T-pose. Both are compiled and run on one core here, and both are checked by coal.
"""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from s3le import machine
from s3le.kernels import batch
from s3le.kernels.distance import reach
from s3le.kernels.solver import blend
from s3le.sampling import relaxed_limits


def main(
    samples: Annotated[int, typer.Option(help="relaxed poses for each alpha")] = 1500,
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("data/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
) -> None:
    """Print a table; assert nothing but feasibility."""
    it = machine.make(robot, margin, "midpoint")
    arm, chain, balls = it.robot, it.chain, reach(it.chain)
    checker = it.certifier()
    rows = batch.CHUNK
    batch.project(chain, arm.anchor, np.zeros((2, arm.n_dof)), margin)  # compile
    blend(chain, balls, arm.anchor, margin, arm.anchor.copy())
    print(f"{arm.name}: {len(it.watched)} pairs, margin {margin * 1e3:g} mm, {samples} samples")
    print(
        "alpha  collide  | moved by blending  by Proj_Q  median ratio  p95 ratio | fallback"
        "  us a sample: blending  Proj_Q  (one core)"
    )
    for alpha in (0.2, 0.5, 1.0):
        low, high = relaxed_limits(arm.lower, arm.upper, alpha)
        q = np.random.default_rng(0).uniform(low, high, (samples, arm.n_dof))
        clipped = np.clip(q, arm.lower, arm.upper)
        hit = batch.clearances(chain, clipped) < margin

        began = time.perf_counter()
        blended = clipped.copy()
        for row in blended:
            blend(chain, balls, arm.anchor, margin, row)
        blend_us = (time.perf_counter() - began) / samples * 1e6

        began = time.perf_counter()
        parts = [
            batch.project(chain, arm.anchor, q[i : i + rows], margin)  # one chunk: one worker
            for i in range(0, samples, rows)
        ]
        ours_us = (time.perf_counter() - began) / samples * 1e6
        found = np.concatenate([part.q for part in parts])
        fallback = np.concatenate([part.how for part in parts]) == batch.FALLBACK
        checker.require(found, margin)
        checker.require(blended, margin)

        far = np.linalg.norm(blended - clipped, axis=1)[hit]
        near = np.linalg.norm(found - clipped, axis=1)[hit]
        ratio = near / far
        print(
            f"{alpha:5.1f}  {hit.mean():6.1%}   | {far.mean():12.3f} rad {near.mean():8.3f} rad"
            f" {np.median(ratio):12.3f} {np.quantile(ratio, 0.95):11.3f} | {fallback.mean():7.2%}"
            f" {blend_us:20.0f} {ours_us:8.0f}"
        )


if __name__ == "__main__":
    typer.run(main)
