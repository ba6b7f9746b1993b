"""What it costs in motion to watch every pair but neighbours: the best poses with it and without.

    python benchmarks/baselines.py coman_covered my.yaml --clips /path/to/clips [--frames 700]

For each robot file that asks for it (`baselines: true`), frames of the clips, evenly spread, each
with its best pose from three starts, frame by frame, no limits in time: as the file is, and with
the pairs that overlap by design left out, as without `baselines`. Nothing is asserted.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from s3le.human.skeletons import read_frames
from s3le.kernels import batch
from s3le.robot import pairs
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance

FARTHER = 0.005  # of distance that counts as a frame lost
RIDGE = 1e-4  # pull towards mid-range
KINDS = (".bvh", ".amc", ".bvh.gz", ".amc.gz")


def main(
    robots: Annotated[list[str], typer.Argument(help="names or robot files")],
    clips: Annotated[Path, typer.Option(help="folder of clips")],
    frames: Annotated[int, typer.Option(min=10)] = 700,
) -> None:
    """Print a line for each robot."""
    files = sorted(file for file in clips.rglob("*") if file.name.endswith(KINDS))
    print(f"{len(files)} clips, {frames} frames; distance to the human, mean and 99th percentile")
    print(f"{'robot':<16}{'pairs':>7}{'with baseline':>15}{'without it':>22}{'with':>18}"
          f"{'farther by 0.005':>18}")  # fmt: skip
    for name in robots:
        robot = Robot.load(name)
        x = np.concatenate([read_frames(file, robot.neck).x for file in files])
        x = robot.seen(x[np.linspace(0, len(x) - 1, frames).astype(int)])
        plain = replace(robot, pairs=tuple(
            pair._replace(reason=pairs.OVERLAP) if robot.designed(pair) else pair
            for pair in robot.pairs
        ))  # fmt: skip
        off, on = _best(plain, x), _best(robot, x)
        held = int((robot.slack() > 0.0).sum())
        print(f"{robot.name:<16}{len(robot.watched):>7}{held:>15}"
              f"{off.mean():>13.5f}{np.percentile(off, 99):>9.4f}"
              f"{on.mean():>9.5f}{np.percentile(on, 99):>9.4f}"
              f"{(on - off > FARTHER).mean():>18.1%}")  # fmt: skip


def _best(robot: Robot, x: np.ndarray) -> np.ndarray:
    """Distance of the best feasible pose to each skeleton, (n,)."""
    middle = (robot.lower + robot.upper) / 2
    zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
    starts = np.broadcast_to(np.stack([robot.anchor, zero, middle]), (len(x), 3, robot.n_dof))
    found = batch.follow(robot.chain, x, starts, middle, RIDGE, robot.margin, True)
    robot.certifier().require(found.q, robot.margin)
    return cosine_distance(batch.skeletons(robot.chain, found.q), x, robot.followed)


if __name__ == "__main__":
    typer.run(main)
