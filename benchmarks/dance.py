"""A robot on dances: how near, how fast, and what the hulls of its own meshes say about it.

    python benchmarks/dance.py CLIP... [--folder data/retargeter] [--samples 8]

Every clip is followed at 30 Hz within the robot's limits in time: planned as a whole, and as a
stream. Then somebody else looks: coal measures the convex hulls of the robot's meshes, which
know nothing of capsules, over every pair of links but neighbours, watched or not, at the frames
and at `--samples` poses between any two of them. The robot file must name hulls
(`s3le robot new --hulls`). *above 3 pi*: frames in which a joint turns faster than 3 pi rad/s, as
other retargeters are measured; *too fast*: faster than its own limit. Nothing is asserted.
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from tqdm import tqdm
from tuple_cost import one_core

from s3le.human.skeletons import ClipFrames, read_frames
from s3le.kernels import batch
from s3le.retarget import Retargeter
from s3le.retarget import follow as whole
from s3le.retarget.rows import Mode
from s3le.robot.hulls import HullCheck
from s3le.skeleton import cosine_distance

RATE = 30.0  # [Hz]
FAST = 3.0 * np.pi  # [rad/s]
DEEP = 0.01  # [m], from where on others count an arm as inside the body


class Run(NamedTuple):
    """One clip as it was followed, one entry a frame."""

    far: np.ndarray  # mean cosine distance to the human
    wanted: np.ndarray  # the same before the guard
    mode: np.ndarray  # Mode
    micros: np.ndarray  # [us]
    speed: np.ndarray  # [rad/s], (n, n_dof); zero in the first frame
    apart: np.ndarray  # [m], (n, pairs), least distance of each pair of hulls, here and before


def main(
    clips: Annotated[list[Path], typer.Argument(help="motion files")],
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    samples: Annotated[int, typer.Option(min=0, help="poses between two frames")] = 8,
) -> None:
    """Print the tables."""
    limited = Retargeter.load(folder)
    robot = limited.robot
    hulls = HullCheck(robot)
    found = [read_frames(clip, robot.neck, rate=RATE) for clip in clips]
    print(
        f"{robot.name}: {robot.n_dof} joints, at most {limited.speed.min():g} to "
        f"{limited.speed.max():g} rad/s; {len(robot.watched)} pairs of bodies watched, "
        f"{len(hulls.pairs)} pairs of hulls; margin {robot.margin * 1e3:g} mm"
    )
    print(
        f"{'':26}{'frames':>7}{'to human':>10}{'before guard':>14}{'us':>6}{'p99':>7}"
        f"{'above 3 pi':>12}{'too fast':>10}{'limited':>9}{'braked':>7}{'hulls overlap':>15}"
        f"{'over 1 cm':>11}"
    )
    every = []
    for title, ahead in (("planned as a whole", True), ("as a stream", False)):
        print(f"{title}:")
        runs = [follow(limited, hulls, frames, samples, ahead) for frames in found]
        for frames, run in zip(found, runs, strict=True):
            say(frames.name, run, limited.speed)
        both = Run(*(np.concatenate(part) for part in zip(*runs, strict=True)))
        if len(runs) > 1:
            say("all", both, limited.speed)
        every.append(both.apart)
    whose(hulls, np.concatenate(every))


def follow(it: Retargeter, hulls: HullCheck, frames: ClipFrames, samples: int, ahead: bool) -> Run:
    """Follow a clip, then measure the hulls."""
    chain, robot = it.robot.chain, it.robot
    x = robot.seen(frames.x)
    before = np.diff(frames.time, prepend=frames.time[0] - 1.0 / RATE)
    with one_core():
        made = whole.follow(it, x, frames.time, fps=RATE, look_ahead=ahead)
    q = made.q
    speed = np.abs(np.diff(q, axis=0, prepend=q[:1])) / before[:, None]
    apart = np.empty((len(q), len(hulls.pairs)))
    shares = np.arange(1, samples + 2)[:, None] / (samples + 1)
    for i in tqdm(range(len(q)), frames.name, unit=" frames", disable=None, leave=False):
        last = q[max(i - 1, 0)]
        path = q[:1] if i == 0 else last + shares * (q[i] - last)
        apart[i] = hulls.distances(path).min(axis=0)
    return Run(
        cosine_distance(batch.skeletons(chain, q), x, robot.followed),
        made.wanted, made.mode, made.seconds * 1e6, speed, apart,
    )  # fmt: skip


def say(name: str, run: Run, limit: np.ndarray) -> None:
    """One line."""
    deepest = run.apart.min(axis=1, initial=np.inf)
    print(
        f"  {name:24}{len(run.far):7}{run.far.mean():10.4f}{run.wanted.mean():14.4f}"
        f"{np.median(run.micros):6.0f}{np.quantile(run.micros, 0.99):7.0f}"
        f"{(run.speed > FAST).any(axis=1).mean():12.1%}"
        f"{(run.speed > limit * (1.0 + 1e-6)).any(axis=1).mean():10.1%}"
        f"{np.isin(run.mode, (Mode.LIMITED, Mode.PLANNED)).mean():9.1%}"
        f"{np.isin(run.mode, (Mode.HELD, Mode.BRAKED)).mean():7.1%}{(deepest < 0.0).mean():15.1%}"
        f"{(deepest < -DEEP).mean():11.1%}",
        flush=True,
    )


def whose(hulls: HullCheck, apart: np.ndarray) -> None:
    """Which hulls overlapped, and the nearest of those that did not."""
    least = apart.min(axis=0)
    for row in np.flatnonzero(least < 0.0):
        share = (apart[:, row] < 0.0).mean()
        print(f"overlap: {hulls.name(row)}, {-least[row] * 1e3:.1f} mm, {share:.1%} of frames")
    clear = least[least >= 0.0]
    if len(clear):
        print(f"the other {len(clear)} pairs stay {clear.min() * 1e3:.2f} mm apart or more")


if __name__ == "__main__":
    typer.run(main)
