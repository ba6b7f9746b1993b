"""Proj_Q against its competitors: how far the joints move, what it costs, where the time goes.

    python benchmarks/projection.py [--samples 1500] [--rows 40000] [--alpha 0.2] [--skip-feet]

Every competitor projects the same samples to the same margin, alone on one core, after a warm-up,
and coal certifies what it found. The one-at-a-time ones are those of tests/reference.py. Nothing
is asserted; times are those of this machine.
"""

import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from tuple_cost import SHARD, Cost, measure, one_core, show, throughput, timed

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from reference import OneByOne  # noqa: E402  (the tests measure against it too)

from pipeline.stage import bar  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.kernels.distance import reach  # noqa: E402
from s3le.kernels.solver import blend  # noqa: E402
from s3le.robot.robot import Robot
from s3le.tuples import sampling  # noqa: E402
from s3le.tuples.shards import TupleShards  # noqa: E402


@dataclass
class Found:
    """What one competitor made of the samples."""

    name: str
    q: np.ndarray  # [rad], (n, n_dof)
    solved: np.ndarray  # bool (n,), by its own account; later by the certificate too
    project: float  # [us] a sample
    certify: float = 0.0  # [us] a sample
    fallback: float = 0.0  # share of samples


def main(
    samples: Annotated[int, typer.Option(help="relaxed poses that all project")] = 1500,
    rows: Annotated[int, typer.Option(help="tuples for each core, for throughput")] = 40_000,
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
    alpha: Annotated[float, typer.Option(help="relaxation of the joint ranges [-]")] = 0.2,
    skip_feet: Annotated[bool, typer.Option(help="take the feet's capsules away")] = False,
) -> None:
    """Print how far, at what cost, and where the time goes; assert nothing."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "robot"
        Robot.from_file(robot, margin, "midpoint").write(place)
        if skip_feet:
            _without_feet(next(place.glob("*.urdf")))
        it = Robot.read(place)
        low, high = sampling.relaxed_limits(it.lower, it.upper, alpha)
        q = np.random.default_rng(0).uniform(low, high, (samples, it.n_dof))
        print(
            f"{it.name}: {len(it.watched)} pairs, margin {margin * 1e3:g} mm,"
            f" alpha {alpha:g}, {samples} samples"
        )
        with one_core():
            found = _competitors(it, q)
            cost = measure(it, min(rows, 20_000), alpha)
        _show(it, q, found, cost)
        show(cost)
        throughput(TupleShards(
            files=Robot.read(place).to_bytes(), alpha=alpha, renormalise_mix=False, seed=0,
            shard_rows=SHARD, sampler="uniform",
        ), rows, Path(folder))  # fmt: skip


def _without_feet(urdf: Path) -> None:
    """Strip the collision bodies of links called ...Foot; the ankles' motors stay."""
    tree = ElementTree.parse(urdf)
    for link in tree.getroot().findall("link"):
        if link.get("name").lower().endswith("foot"):
            for body in link.findall("collision"):
                link.remove(body)
    tree.write(urdf)


# --- the competitors


def _competitors(it: Robot, q: np.ndarray) -> list[Found]:
    slow = OneByOne(it, it.margin)

    def from_clipped(pose):
        return slow.nearest(pose, pose)

    def from_both(pose):
        back = slow.blend(pose)
        reached = [slow.nearest(pose, pose), slow.nearest(pose, back.q), back]
        return min(reached, key=lambda one: (not one.solved, np.linalg.norm(one.q - pose)))

    found = [
        _slowly("(a)  blending, pin + coal", slow.blend, q),
        _slowly("(b1) SQP, daqp + pin + coal", from_clipped, q),
        _slowly("(b)  the same, two starts", from_both, q),
        _compiled_blending(it, q),
    ]
    project = partial(batch.project, it.chain, it.anchor, margin=it.margin)
    project(q[:2])  # compiles
    projected, us = timed(lambda: project(q), len(q), repeat=3)
    by_fallback = projected.how == batch.FALLBACK
    found.append(
        Found(
            "(c)  ours", projected.q, np.full(len(q), True), us, fallback=float(by_fallback.mean())
        )
    )
    checker = it.certifier()
    checker.check(q[:20])
    for one in found:
        report, one.certify = timed(partial(checker.check, one.q), len(q))
        one.solved &= (report.clearance >= it.margin) & (report.limit_margin >= 0.0)
    return found


def _slowly(name: str, project: Callable, q: np.ndarray) -> Found:
    for pose in q[:3]:
        project(pose)
    poses, solved = np.empty_like(q), np.empty(len(q), bool)
    with bar(len(q), name.strip(), wait="") as advance:
        began = time.perf_counter()
        for row, pose in enumerate(q):
            poses[row], solved[row], _ = project(pose)
            advance(1)
        seconds = time.perf_counter() - began
    return Found(name, poses, solved, seconds / len(q) * 1e6)


def _compiled_blending(it: Robot, q: np.ndarray) -> Found:
    # Called pose by pose, so several microseconds of it are the call.
    arm, balls = it, reach(it.chain)
    clipped = np.clip(q, arm.lower, arm.upper)

    def work():
        poses = clipped.copy()
        return poses, [blend(it.chain, balls, arm.anchor, it.margin, pose) for pose in poses]

    blend(it.chain, balls, arm.anchor, it.margin, arm.anchor.copy())
    (poses, solved), us = timed(work, len(q))
    return Found("     blending, compiled", poses, np.array(solved), us)


def _show(it: Robot, q: np.ndarray, found: list[Found], cost: Cost) -> None:
    clipped = np.clip(q, it.lower, it.upper)
    hit = batch.clearances(it.chain, clipped) < it.margin
    moved = {one.name: np.linalg.norm(one.q - clipped, axis=1) for one in found}
    solved = {one.name: one.solved for one in found}
    print(
        f"\nMoved from the clipped pose [rad]: the {hit.mean():.1%} of samples whose clipped pose"
        " collides, if solved.\nA tuple is q~, x~, q-bar, x-bar, x' and certificate, encoded:"
        f" {cost.shared:.1f} us beside projection and coal.\n"
    )
    a, b = found[0].name, found[2].name
    print(
        f"{'one core each':29}{'mean':>7}{'median':>8}  {'median ratio to (a)':>20}{'to (b)':>8}"
        f"{'not solved':>12}{'fallback':>10}{'us project':>12}{'us coal':>9}{'tuples/s':>10}"
    )
    for one in found:
        rows = hit & solved[one.name]
        ratios = []
        for other in (a, b):
            both = rows & solved[other]
            ratios.append(np.median(moved[one.name][both] / moved[other][both]))
        print(
            f"{one.name:29}{moved[one.name][rows].mean():7.3f}"
            f"{np.median(moved[one.name][rows]):8.3f}  {ratios[0]:20.3f}{ratios[1]:8.4f}"
            f"{1 - one.solved.mean():12.2%}{one.fallback:10.2%}{one.project:12.1f}"
            f"{one.certify:9.1f}{1e6 / (one.project + one.certify + cost.shared):10.0f}"
        )


if __name__ == "__main__":
    typer.run(main)
