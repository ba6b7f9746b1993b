"""What fat bodies cost: human frames whose best pose bodies forbid and the robot's own hulls allow.

    python benchmarks/tight.py g1.yaml h1.yaml [--clips ../shared/mocap/cmu] [--frames 300]

Robot files with hulls (s3le robot new --hulls). For frames spread evenly over clips of held-out
people, the pose nearest to the human is searched from several starts: with the bodies, without
any, and with bodies whose radii are shrunk. Of the last two kinds those count whose hulls keep the
margin by coal, over all pairs but neighbours and those that lie nearer at the anchor, the stand or
zero. The nearest of them is feasible by hulls, so the optimum with hulls is as near or nearer: the
share of frames printed is a lower bound of the true one.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from s3le.human.read import read_clip
from s3le.kernels import batch
from s3le.onboard import survey
from s3le.robot.hulls import HullCheck
from s3le.robot.robot import Robot
from s3le.skeleton import cosine_distance, features
from s3le.tuples.ik import ground_truth

SHRUNK = (0.0, 0.3, 0.6, 0.8, 0.9)  # of the radii; zero: no bodies at all
WORSE = 0.005  # mean of 1 - cos
STARTS, RIDGE = 6, 1e-4


def main(
    robots: Annotated[list[Path], typer.Argument(help="robot files with hulls")],
    clips: Annotated[Path, typer.Option(help="folder of clips")] = Path("../shared/mocap/cmu"),
    subjects: Annotated[str, typer.Option(help="CMU subjects")] = "14,17,29",
    frames: Annotated[int, typer.Option(help="of all clips together")] = 300,
) -> None:
    """Print the table."""
    human = people(clips, subjects.split(","), frames)
    print(f"{len(human)} frames; nearest pose: mean distance to the human, and frames in which")
    print(f"bodies make it more than {WORSE} worse than hulls (at least)")
    print(f"{'':12}{'bodies':>8}{'pairs':>8}{'with them':>11}{'by hulls':>10}{'share':>8}  stands")
    for file in robots:
        robot = Robot.load(file)
        with_bodies, by_hulls = distances(robot, np.ascontiguousarray(robot.seen(human)))
        found = survey.standing(robot)
        stands = "not said" if found is None else "yes" if not found.forbid else "no"
        print(
            f"{robot.name:12}{len(robot.bodies):8}{len(robot.watched):8}{with_bodies.mean():11.4f}"
            f"{by_hulls.mean():10.4f}{(with_bodies - by_hulls > WORSE).mean():8.1%}  {stands}",
            flush=True,
        )


def people(clips: Path, subjects: list[str], count: int) -> np.ndarray:
    """Skeletons of frames spread evenly over all clips, (count, 21)."""
    seen = []
    for path in sorted(clips.rglob("*.amc.gz")):
        if path.parent.name in subjects:
            x, good = features(read_clip(path, None).points)
            seen.append(x[good])
    every = np.concatenate(seen)
    return every[np.linspace(0, len(every) - 1, count).astype(int)]


def distances(robot: Robot, human: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to each frame (n,) of the best pose with bodies, and by hulls."""
    q, own = ground_truth(robot, human, STARTS, RIDGE, np.random.default_rng(0))
    check, middle = HullCheck(robot), (robot.lower + robot.upper) / 2
    known = [robot.anchor, np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)]
    known += [] if robot.stand is None else [robot.stand]
    loose = check.distances(np.array(known)).min(axis=0) >= robot.margin
    starts = np.concatenate([
        q[:, None], np.broadcast_to(robot.anchor, (len(q), 1, robot.n_dof)),
        np.broadcast_to(middle, (len(q), 1, robot.n_dof)),
    ], axis=1)  # fmt: skip
    best = own.copy()
    for share in SHRUNK:
        chain = robot.chain
        chain = chain._replace(body_radius=chain.body_radius * share)
        if share == 0.0:
            chain = chain._replace(pair=chain.pair[:0])
        found = batch.follow(chain, human, starts, middle, RIDGE, robot.margin, True)
        far = cosine_distance(batch.skeletons(robot.chain, found.q), human, robot.followed)
        rows = np.flatnonzero(found.feasible & (far < best))
        clear = check.distances(found.q[rows])[:, loose].min(axis=1, initial=np.inf)
        rows = rows[clear >= robot.margin]
        best[rows] = far[rows]
    return own, best


if __name__ == "__main__":
    typer.run(main)
