"""How often bodies, which are fatter than the robot, keep it from a pose nearer to the human.

    python benchmarks/robots/share.py SOURCES g1 h1 t1 [made/g1.yaml] [--frames 1000]

For a seeded sample of frames of CMU clips (--subjects, which nothing was trained on) three best
poses are found, each the nearest to the human that is allowed: (a) within joint limits alone, (b)
with the robot file's bodies, (c) with the convex hulls that these bodies contain (solids.py), over
the same pairs of links. Counted are frames in which (b) is more than FARTHER farther than (c). (c)
is (a) where (b) is hardly farther, or (a) keeps the margin by hulls; elsewhere it is searched from
several starts, and each solution is measured by coal; where none is found (a) stands for it, which
can only count against bodies. *at most* is the share if (c) were (a) everywhere. (b) starts from
many poses too, and from (c). A robot file's stem is its name in recipes.yaml, which says where in
SOURCES its maker's file is; otherwise FILE.yaml=ORIGINAL.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from solids import Solids, original
from tqdm import tqdm

from s3le.human.skeletons import read_frames
from s3le.kernels import batch
from s3le.report import robot as picture
from s3le.retarget.propose import LookUp
from s3le.rng import stream
from s3le.robot import chain, pairs
from s3le.robot.robot import Robot
from s3le.search import neighbours
from s3le.skeleton import cosine_distance
from s3le.tuples import sampling

FARTHER = 0.005  # of distance that counts
RATE = 30.0  # [Hz]
RIDGE = 1e-4  # pull towards mid-range
POOL = 30_000  # poses that (b) is looked up in
LOOKED = 8
SHARES = (0.0, 0.5, 1.0)  # of the way from (b) to (a) at which a search for (c) starts


class Frames(NamedTuple):
    """Frames and what each robot can do there; distances to the human, (n,)."""

    x: np.ndarray  # (n, 21)
    free: np.ndarray  # (a)
    bodies: np.ndarray  # (b)
    hulls: np.ndarray  # (c)
    with_bodies: np.ndarray  # [rad], (n, n_dof)
    with_hulls: np.ndarray  # [rad], (n, n_dof)
    searched: int  # frames in which (c) was searched
    failed: int  # of them, those in which (a) had to stand for it

    @property
    def lost(self) -> np.ndarray:
        """By how much bodies are farther, (n,)."""
        return self.bodies - self.hulls


def main(
    folder: Annotated[Path, typer.Argument(metavar="SOURCES", help="folder of sources")],
    robots: Annotated[list[str], typer.Argument(help="names, or files whose stems are names")],
    clips: Annotated[Path, typer.Option(help="folder of CMU")] = Path("../shared/mocap/cmu"),
    subjects: Annotated[str, typer.Option(help="CMU subjects")] = "14,17,29",
    frames: Annotated[int, typer.Option(min=10)] = 1000,
    seed: Annotated[int, typer.Option(help="of the sample")] = 1,
    pictures: Annotated[Path | None, typer.Option(help="folder of the worst frames")] = None,
    most: Annotated[int, typer.Option(min=0, help="pairs that are named")] = 6,
) -> None:
    """Print a line for each robot, and the pairs of links that cost it most."""
    files = sorted(p for p in clips.rglob("*.amc.gz") if p.parent.name in subjects.split(","))
    if not files:
        raise SystemExit(f"{clips}: no clip of CMU's subjects {subjects} there")
    print(f"{len(files)} clips, {frames} frames of each robot; distance to the human")
    print(
        "| robot | pairs | limits alone | with bodies | with hulls | farther by 0.005 | at most "
        "| most | searched, not found |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    )
    for word in robots:
        name = word.partition("=")[0]
        robot = Robot.load(name)
        solids = original(robot, word, folder)
        x = np.concatenate([read_frames(file, robot.neck, rate=RATE).x for file in files])
        kept = np.sort(np.random.default_rng(seed).choice(len(x), min(frames, len(x)), False))
        found = measured(robot, solids, np.ascontiguousarray(robot.seen(x[kept])))
        row = int(found.lost.argmax())
        print(
            f"| {name} | {len(robot.watched)} | {found.free.mean():.4f} | "
            f"{found.bodies.mean():.4f} | {found.hulls.mean():.4f} | "
            f"{(found.lost > FARTHER).mean():.1%} | "
            f"{(found.bodies - found.free > FARTHER).mean():.1%} | {found.lost[row]:.3f} | "
            f"{found.searched}, {found.failed} |",
            flush=True,
        )
        for line in blamed(robot, found)[:most]:
            print(f"    {line}")
        beyond = 1e3 * np.median(list(solids.reach().values()))
        print(f"    bodies reach {beyond:.0f} mm beyond the hulls in the median link")
        print(f"    at most: {'; '.join(_forbidding(robot, found.with_hulls[row])[:3])}")
        if built := sorted(set(solids.built)):
            print(f"    built into each other, not asked of hulls: {', '.join(built)}")
        if pictures:
            pictures.mkdir(parents=True, exist_ok=True)
            _draw(robot, solids, found, row, pictures / f"{robot.name}_worst.png")


def measured(robot: Robot, solids: Solids, x: np.ndarray) -> Frames:
    """The three best poses of frames x (n, 21), as the robot sees them."""
    middle = (robot.lower + robot.upper) / 2
    zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
    pool = sampling.draw_feasible(robot, POOL, stream(7, "poses"))[0]
    seen = batch.skeletons(robot.chain, pool).astype(np.float32)
    look = LookUp(pool, neighbours.build(seen, "l2"), LOOKED, None)
    named = np.array([robot.anchor, zero, middle, *([] if robot.stand is None else [robot.stand])])
    near = np.array([look.propose(row) for row in x], float)
    starts = np.concatenate([np.broadcast_to(named, (len(x), *named.shape)), near], axis=1)
    bare = chain.build(robot, np.empty((0, 2), np.int64), robot.neck)
    free = batch.follow(bare, x, starts, middle, RIDGE, 0.0, True).q
    q = _held(robot, x, np.concatenate([starts, free[:, None]], axis=1), middle)
    far = [_far(robot, pose, x) for pose in (free, q)]
    hulls, best, searched, failed = far[0].copy(), free.copy(), 0, 0
    for i in tqdm(np.flatnonzero(far[1] - far[0] > FARTHER), robot.name, disable=None):
        if solids.clear(free[i]) >= robot.margin:
            continue
        searched += 1
        tried = [solids.best(x[i], q[i] + share * (free[i] - q[i]), RIDGE) for share in SHARES]
        there = np.array([pose for pose in tried if pose is not None])
        if not len(there):
            failed += 1
            continue
        away = _far(robot, there, np.broadcast_to(x[i], (len(there), 21)))
        hulls[i], best[i] = away.min(), there[away.argmin()]
    # Bodies may find their way to where hulls led.
    rows = np.flatnonzero(far[1] - hulls > FARTHER)
    if len(rows):
        ways = np.stack([q[rows] + share * (best[rows] - q[rows]) for share in SHARES], axis=1)
        again = _held(robot, x[rows], np.concatenate([ways, q[rows][:, None]], axis=1), middle)
        away = _far(robot, again, x[rows])
        nearer = away < far[1][rows]
        q[rows[nearer]], far[1][rows[nearer]] = again[nearer], away[nearer]
    lower = far[1] < hulls  # what bodies allow hulls do
    hulls[lower], best[lower] = far[1][lower], q[lower]
    return Frames(x, far[0], far[1], hulls, q, best, searched, failed)


def _held(robot: Robot, x: np.ndarray, starts: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """The best poses with bodies [rad], (n, n_dof), verified by coal."""
    q = batch.follow(robot.chain, x, starts, middle, RIDGE, robot.margin, True).q
    robot.certifier().require(q, robot.margin)
    return q


def _far(robot: Robot, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    return cosine_distance(batch.skeletons(robot.chain, q), x, robot.followed)


def blamed(robot: Robot, found: Frames) -> list[str]:
    """Pairs of links whose bodies forbid what hulls allow, in how many of the frames counted."""
    rows = np.flatnonzero(found.lost > FARTHER)
    count: Counter[str] = Counter()
    for row in rows:
        lines = _forbidding(robot, found.with_hulls[row])
        count.update({line.rpartition(" (")[0] for line in lines})
    return [f"{name}: {many / len(found.x):.1%}" for name, many in count.most_common()]


def _forbidding(robot: Robot, q: np.ndarray) -> list[str]:
    """Pairs of links whose bodies forbid a pose and how far below the margin, the deepest first."""
    apart = batch.pair_distances(robot.chain, q[None])[0]
    least: dict[str, float] = {}
    for row in np.flatnonzero(apart < robot.margin):
        links = " and ".join(sorted(robot.bodies[k].link for k in robot.watched[row]))
        least[links] = min(least.get(links, np.inf), float(apart[row] - robot.margin))
    deepest = sorted(least.items(), key=lambda item: item[1])
    return [f"{name} ({far * 1e3:.0f} mm)" for name, far in deepest]


def _draw(robot: Robot, solids: Solids, found: Frames, row: int, path: Path) -> None:
    """The worst frame: the best pose with bodies, and with hulls, where red bodies forbid it."""
    held, free = found.with_bodies[row], found.with_hulls[row]
    apart = batch.pair_distances(robot.chain, free[None])[0]
    forbid = [(int(a), int(b)) for a, b in robot.watched[apart < robot.margin]]
    tail, head = (
        batch.points(robot.chain, held[None])[0][ends].mean(axis=1)
        for ends in (robot.chain.tail, robot.chain.head)
    )
    shown = picture.Shown(
        f"{robot.name}: {found.bodies[row]:.3f} from the human with bodies, "
        f"{found.hulls[row]:.3f} with hulls",
        batch.capsule_ends(robot.chain, held[None])[0], robot.chain.body_radius,
        pairs.body_kinds(robot), np.stack([tail, head], axis=1), [str(k) for k in range(len(tail))],
        [], _forbidding(robot, free)[:6],
        picture.Standing(batch.capsule_ends(robot.chain, free[None])[0], forbid,
                         solids.placed(free)),
    )  # fmt: skip
    picture.draw(path, shown)


if __name__ == "__main__":
    typer.run(main)
