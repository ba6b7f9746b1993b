"""The torch kernels on a device: rows a second, and how far they are from the compiled kernels.

    python benchmarks/gpu.py --device cuda [--samples 200000] [--rows 65536,262144] [--fuse]

Written without a GPU at hand; the aim there is 200,000 projections a second on one of H200's class.
On a CPU the compiled kernels are the ones to use, and this only shows that both agree.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer

from s3le.gpu import batch as gpu
from s3le.gpu.chain import device_of
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.tuples.sampling import relaxed_limits


def timed(work: Callable, warm: bool) -> tuple[float, object]:
    """Seconds of a call and its answer, after one call that does not count if warm."""
    if warm:
        work()  # loads libraries, fills the allocator, compiles what is fused
    began = time.perf_counter()
    answer = work()  # ends with a copy to the host, so nothing is left running
    return time.perf_counter() - began, answer


def main(
    device: Annotated[str, typer.Option(help="cuda or cpu")] = "cuda",
    samples: Annotated[int, typer.Option(help="relaxed poses")] = 200_000,
    compared: Annotated[int, typer.Option(help="of them projected by the compiled kernel")] = 2000,
    rows: Annotated[str, typer.Option(help="chunk sizes to try, with commas")] = "",
    fuse: Annotated[bool, typer.Option(help="also run fused by torch.compile")] = False,
    alpha: Annotated[float, typer.Option(help="width of the relaxed limits")] = 0.2,
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("data/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
) -> None:
    """Print a table; assert nothing but feasibility."""
    device_of(device)  # refuses before anything is computed for nothing
    it = Robot.from_file(robot, margin, "midpoint")
    arm, chain = it, it.chain
    low, high = relaxed_limits(arm.lower, arm.upper, alpha)
    q = np.random.default_rng(0).uniform(low, high, (samples, arm.n_dof))
    compared = min(compared, samples)
    want_clearance = batch.clearances(chain, q[:compared])
    want = batch.project(chain, arm.anchor, q[:compared], margin)
    wanted = np.linalg.norm(want.q - q[:compared], axis=1)
    where = torch.cuda.get_device_name(device) if device.startswith("cuda") else device
    print(f"{arm.name}: {len(chain.pair)} pairs, {samples} poses, alpha {alpha:g}, on {where}")
    print("chunk    fused  question    rows/s     us/row  | against the compiled kernel")
    sizes = [int(size) for size in rows.split(",") if size] or [gpu.ROWS[device.split(":")[0]]]
    for size in sizes:
        for fused in (False, True) if fuse else (False,):
            keys = {"rows": size, "fuse": fused}
            tag = f"{size:7d}  {'yes' if fused else 'no ':5}"
            warm = fused or device != "cpu"
            took, clearance = timed(lambda k=keys: gpu.clearances(chain, q, device, **k), warm)
            off = np.abs(clearance[:compared] - want_clearance).max()
            report(tag, "clearance", samples, took, f"off by at most {off:.1e} m")
            took, found = timed(
                lambda k=keys: gpu.project(chain, arm.anchor, q, margin, device, **k), warm
            )
            it.certifier().require(found.q[:compared], margin)
            moved = np.linalg.norm(found.q[:compared] - q[:compared], axis=1)
            hit = wanted > 0.0
            ratio = moved[hit] / wanted[hit]
            fallback = (found.how == batch.FALLBACK).mean()
            words = (
                f"distance moved: median ratio {np.median(ratio):.6f}, p95 "
                f"{np.quantile(ratio, 0.95):.4f}, {ratio.min():.3f} to {ratio.max():.3f}; "
                f"{(np.abs(found.q[:compared] - want.q).max(axis=1) < 1e-6).mean():.1%} the same "
                f"to 1e-6 rad; "
                f"fallback {fallback:.2%}"
            )
            report(tag, "projection", samples, took, words)
    if device.startswith("cuda"):
        print(f"most device memory: {torch.cuda.max_memory_allocated(device) / 2**30:.1f} GiB")


def report(tag: str, question: str, samples: int, took: float, words: str) -> None:
    """One line of the table."""
    print(f"{tag}  {question:10} {samples / took:8.0f} {took / samples * 1e6:10.1f}  | {words}")


if __name__ == "__main__":
    typer.run(main)
