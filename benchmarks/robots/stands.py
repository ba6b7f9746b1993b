"""Whether each robot may stand as its maker stands it: by its bodies, and by its hulls.

    python benchmarks/robots/stands.py SOURCES [g1 made/h1.yaml my.yaml=original.urdf ...]

The stand pose is the robot file's; of one that says nothing it is what `s3le robot new` proposes
now: a pose of its maker's files, or arms hanging as straight as its hulls let them. Printed are the
pairs of links of which bodies come below the margin there, and how far their hulls are apart.
Without names: all robots of the package that have a recipe.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import sources
import typer
from solids import Solids, original

from s3le.errors import S3leError
from s3le.kernels import batch
from s3le.onboard import anchor, motion, watched
from s3le.robot.robot import Robot


def main(
    folder: Annotated[Path, typer.Argument(metavar="SOURCES", help="folder of sources")],
    robots: Annotated[list[str] | None, typer.Argument(help="names, or robot files")] = None,
) -> None:
    """Print the table."""
    print("| robot | stand | by bodies [mm] | by hulls [mm] | pairs that forbid it: by bodies, by "
          "hulls [mm] |\n|---|---|---:|---:|---|")  # fmt: skip
    for word in robots or [recipe.name for recipe in sources.recipes(None)]:
        name = word.partition("=")[0]
        try:
            robot = Robot.load(name)
            print(f"| {name} | {line(robot, original(robot, word, folder))} |", flush=True)
        except S3leError as refusal:
            print(f"| {name} | {refusal} | | | |", flush=True)


def line(robot: Robot, solids: Solids) -> str:
    """A robot in the table."""
    how, q = "its file's", robot.stand
    out = next((q for _, q in anchor.candidates(robot, robot.neck)), anchor.zero(robot))
    if q is None:
        found, out, _ = watched.standing(
            robot, robot.neck, solids.work, solids.origin.poses, robot.margin
        )
        how, q = found.how, found.q
    apart = batch.pair_distances(robot.chain, q[None])[0]
    least: dict[frozenset[str], float] = {}
    for row in np.flatnonzero(~(apart >= robot.margin)):
        links = frozenset(robot.bodies[k].link for k in robot.watched[row])
        least[links] = min(least.get(links, np.inf), float(apart[row]))
    hulls = motion.clearance(robot, solids.pieces, out, frozenset(robot.disabled))(q)
    said = [
        f"{' and '.join(sorted(links))} {far * 1e3:.1f}, {between(solids, links, q) * 1e3:.0f}"
        for links, far in sorted(least.items(), key=lambda item: item[1])
    ]
    more = [f"and {len(said) - 4} more"] if len(said) > 4 else []
    return (
        f"{how} | {apart.min() * 1e3:.1f} | {hulls * 1e3:.1f} | "
        f"{'; '.join([*said[:4], *more]) or 'none'}"
    )


def between(solids: Solids, links: frozenset[str], q: np.ndarray) -> float:
    """Signed distance of the hulls of two links at q [m]."""
    model, _ = solids.robot.reduced()
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    one, other = ([p for p in solids.pieces if p.link == link] for link in sorted(links))
    return motion.nearest(data, one, other)


if __name__ == "__main__":
    typer.run(main)
