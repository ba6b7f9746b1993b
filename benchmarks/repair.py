"""Repair: what the guard makes of other solvers' motions, and how little could have been enough.

    pip install mink==1.3.0 pin-pink==4.4.0 daqp
    python benchmarks/repair.py [--robots coman,g1] [--solvers mink,pink] [--keep data/repair]

mink and pink (benchmarks/rivals/solvers: collision limits on, four solves a frame, from the anchor
pose) follow 21 clips, at most 450 frames each at 30 Hz: the 15 of DeepMimic in data/downloads/demo
(`dvc repro clips`) and six of CMU. What they give goes through the guard's file door, three ways:

    both    brought within speeds and accelerations first, joint by joint
    speed   as they gave it, with the joints' speeds as their limits
    fast    as they gave it without limits of speed

What is broken is counted before and after by the audit: coal at poses, the proof of paths, limits
in time with the robot file's accelerations or 60 rad/s^2. *moved*: frames with a joint more than
0.05 degrees off, over these the median, p95 and most of the joint farthest off; *later*: without
the first second, in which solvers jump from the anchor to the clip. *over 10*: frames with a joint
more than 10 degrees off, and how many a motion needs that keeps the limits in time alone, bodies
left out, and goes as little beyond 10 degrees as can be. Floors (benchmarks/floor.py): over frames
in collision, the medians of what some joint must turn by the lengths of links, of the
clear pose nearest by the joint farthest off, of the one nearest in the guard's weights, and of what
the guard did.

Motions are kept in --keep, one file each: what solvers made is not made again, what the guard makes
of it is.
"""

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from floor import Floor, in_time
from tqdm import tqdm
from tuple_cost import one_core

sys.path.append(str(Path(__file__).parent / "rivals"))
from inside import followed  # noqa: E402

from s3le.errors import CertificateError  # noqa: E402
from s3le.guard.claim import Claim, claim  # noqa: E402
from s3le.guard.clean import Guard  # noqa: E402
from s3le.guard.layouts.episode import Episode  # noqa: E402
from s3le.guard.layouts.numbers import Numbers  # noqa: E402
from s3le.human.skeletons import read_frames  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.plan import chase, weights  # noqa: E402
from s3le.plan.limits import Limits, limits  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.skeleton import cosine_distance  # noqa: E402
from s3le.store import atomic  # noqa: E402

RATE, SOLVES = 30.0, 4  # [Hz]; quadratic programs a frame
TILT = 89.0  # [deg], for one of the clips crawls
CMU = ("14_05", "14_07", "14_14", "14_20", "14_26", "14_30")
DEMO, ORIGINALS = Path("data/downloads/demo"), Path("../shared/mocap/cmu")
WAYS = ("both", "speed", "fast")
UNLIMITED = 1e3  # [rad/s], a speed limit that is none; solvers want a number
MOVED, FAR = 0.05, 10.0  # [deg]; the second is the mark of the p95 of inputs within speed
FLOORS = 400  # poses of a row of the table whose floor is looked for
BROKEN = ("limits", "velocities", "accelerations", "poses", "paths")


class Motion(NamedTuple):
    """One repaired motion."""

    time: np.ndarray  # [s], (m,)
    x: np.ndarray  # the human, (m, 21)
    wanted: np.ndarray  # [rad], (m, n)
    q: np.ndarray  # [rad], (m, n), repaired; all NaN: refused
    failed: int  # frames in which the solver found nothing and the robot stayed


def main(
    robots: Annotated[str, typer.Option(help="robots by name, or robot files")] = "coman,g1",
    solvers: Annotated[str, typer.Option(help="of mink, pink")] = "mink,pink",
    demo: Annotated[Path, typer.Option(help="folder of DeepMimic's clips")] = DEMO,
    cmu: Annotated[Path, typer.Option(help="folder of CMU's originals")] = ORIGINALS,
    frames: Annotated[int, typer.Option(help="most frames of a clip")] = 450,
    keep: Annotated[Path, typer.Option(help="where motions are kept")] = Path("data/repair"),
) -> None:
    """Print the tables."""
    clips = found(demo, cmu)
    for name in robots.split(","):
        robot, asked = claim(Robot.load(name), straight=True)  # nearest in the joints alone
        guard = Guard(robot, asked)
        most = limits(robot, np.array(asked.acceleration), asked.speed_factor)
        table = {}
        for solver in solvers.split(","):
            for way in WAYS:
                table[solver, way] = []
            for clip in tqdm(clips, f"{robot.name}, {solver}", disable=None, leave=False):
                for way, motion in repaired(guard, asked, solver, clip, frames, keep).items():
                    table[solver, way].append(motion)
        say(guard, most, table)


def found(demo: Path, cmu: Path) -> list[Path]:
    """The clips.

    Raises:
        SystemExit: some are missing.
    """
    clips = [cmu / name[:2] / f"{name}.amc.gz" for name in CMU]
    clips += sorted(demo.glob("*.txt"))
    missing = [str(clip) for clip in clips if not clip.is_file()]
    if missing or len(clips) == len(CMU):
        raise SystemExit(f"clips are missing: {', '.join(missing) or demo}; see --demo, --cmu")
    return clips


def repaired(
    guard: Guard, asked: Claim, solver: str, clip: Path, most: int, keep: Path
) -> dict[str, Motion]:
    """One clip by one solver, each way, and what the guard makes of it."""
    robot, name = guard.robot, clip.name.split(".")[0]
    at = {way: keep / robot.name / solver / f"{name}_{way}.npz" for way in WAYS}
    if not all(path.is_file() for path in at.values()):
        given = read_frames(clip, robot.neck, TILT, rate=RATE)
        x, time = given.x[:most], given.time[:most]
        own = limits(robot, np.array(asked.acceleration), asked.speed_factor)
        speed = np.where(np.isfinite(own.speed), own.speed, UNLIMITED)
        runs = {}
        for way, fastest in (("speed", speed), ("fast", np.full(robot.n_dof, UNLIMITED))):
            with one_core():
                runs[way] = followed(
                    solver, robot, fastest, 1.0 / RATE, x, robot.anchor, solves=SOLVES
                )
        made = {way: run.q for way, run in runs.items()}
        made["both"] = within(time, made["speed"], own)
        for way, path in at.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            failed = runs["speed" if way == "both" else way].failed
            _save(path, time=time, x=x, wanted=made[way], failed=np.array(failed))
    out = {}
    for way, path in at.items():
        with np.load(path) as kept:
            given = {part: kept[part] for part in ("time", "x", "wanted", "failed")}
        q = mended(guard, f"{name}, {way}", given["time"], given["wanted"])
        _save(path, **given, q=q)
        out[way] = Motion(**given, q=q)
    return out


def _save(path: Path, **arrays: np.ndarray) -> None:
    """Whole or not at all."""

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.savez(stream, **arrays)

    atomic.replace(path, write)


def within(time: np.ndarray, q: np.ndarray, most) -> np.ndarray:
    """The motion brought within limits of range, speed and acceleration, joint by joint.

    The mean of two chases, one told backwards: it lags by little, and all these limits are convex.
    """
    ahead, back = np.empty_like(q), np.empty_like(q)
    arguments = most.lower, most.upper, most.speed, most.acceleration, 1e-6
    chase.chase(time, q, *arguments, 0, ahead)
    chase.chase(time[::-1].copy(), q[::-1].copy(), *arguments, 0, back)
    return 0.5 * (ahead + back[::-1])


def episode(name: str, time: np.ndarray, q: np.ndarray, robot: Robot) -> Episode:
    """A motion as a file of float64 in radians gives it."""
    raw = Numbers(tuple(q.T.copy()), (False,) * q.shape[1], q, robot.lower, robot.upper)
    return Episode(name, time, q, [], raw)


def mended(guard: Guard, name: str, time: np.ndarray, q: np.ndarray) -> np.ndarray:
    """What the guard makes of a motion; NaN where it refuses it, which is told."""
    try:
        return guard.nearest(episode(name, time, q, guard.robot)).q
    except CertificateError as refusal:
        tqdm.write(f"refused: {refusal}")
        return np.full_like(q, np.nan)


@dataclass
class Sum:
    """A row of the table."""

    frames: int = 0
    failed: int = 0
    refused: int = 0
    before: Counter = field(default_factory=Counter)
    after: Counter = field(default_factory=Counter)
    near: list[np.ndarray] = field(default_factory=list)  # distance to the human before
    far: list[np.ndarray] = field(default_factory=list)  # and after
    off: list[np.ndarray] = field(default_factory=list)  # [deg], (m,), joint farthest off
    later: list[np.ndarray] = field(default_factory=list)  # the same after a second
    late: list[np.ndarray] = field(default_factory=list)  # of floor.in_time
    deep: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)  # wanted, q: collides
    joints: Counter = field(default_factory=Counter)  # which was farthest off, over moved frames

    def add(self, guard: Guard, most: Limits, one: Motion) -> None:
        """Count a motion."""
        robot = guard.robot
        self.frames, self.failed = self.frames + len(one.q), self.failed + int(one.failed)
        before = guard.check(episode("", one.time, one.wanted, robot), one.wanted)
        self.before.update({check.name: check.broken for check in before.checks})
        if not np.isfinite(one.q).all():
            self.refused += 1
            return
        after = guard.check(episode("", one.time, one.wanted, robot), one.q)
        self.after.update({check.name: check.broken for check in after.checks})
        for into, q in ((self.near, one.wanted), (self.far, one.q)):
            into.append(cosine_distance(batch.skeletons(robot.chain, q), one.x, robot.followed))
        turned = np.degrees(np.abs(one.q - one.wanted))
        off = turned.max(axis=1)
        self.off.append(off)
        self.later.append(off[one.time >= one.time[0] + 1.0])
        timed = in_time(one.time, one.wanted, most, np.radians(FAR))
        self.late.append(np.degrees(np.abs(timed - one.wanted)).max(axis=1))
        for joint in turned.argmax(axis=1)[off > MOVED]:
            self.joints[robot.joint_names[joint]] += 1
        deep = before.clearance < robot.margin
        self.deep += list(zip(one.wanted[deep], one.q[deep], strict=True))


def say(guard: Guard, most: Limits, table: dict[tuple[str, str], list[Motion]]) -> None:
    """Print the table of one robot, and what its floors are."""
    robot = guard.robot
    print(f"{robot.name}: {len(robot.watched)} pairs, margin {robot.margin * 1e3:g} mm")
    print(
        "| input | frames | poses under | paths unproven | too fast | too hard | after | moved |"
        " median, p95, most [deg] | later | over 10 | to the human | solver failed | refused |\n"
        "|---|---:|---:|---:|---:|---:|---:|---:|---|---|---|---|---:|---:|"
    )
    sums: dict[str, Sum] = {}
    for way in WAYS:
        for solver in dict.fromkeys(solver for solver, _ in table):
            one = Sum()
            for motion in table[solver, way]:
                one.add(guard, most, motion)
            sums[f"{way}, {solver}"] = one
            _row(f"{way}, {solver}", one)
        sums[f"{way}, all"] = _together([s for k, s in sums.items() if k.startswith(way)])
        _row(f"{way}, all", sums[f"{way}, all"])
    _floors(robot, sums)


def _row(name: str, one: Sum) -> None:
    b, a = one.before, one.after
    off, later = np.concatenate(one.off), np.concatenate(one.later)
    near, far = np.concatenate(one.near).mean(), np.concatenate(one.far).mean()
    print(
        f"| {name} | {one.frames} | {b['poses']} | {b['paths']} | {b['velocities']} |"
        f" {b['accelerations']} | {', '.join(str(a[kind]) for kind in BROKEN)} |"
        f" {np.mean(off > MOVED):.0%} | {_three(off)} | {_three(later)} |"
        f" {(off > FAR).sum()}, {(np.concatenate(one.late) > FAR + 1e-6).sum()} |"
        f" {near:.4f}, {far:.4f} | {one.failed} | {one.refused} |",
        flush=True,
    )


def _three(off: np.ndarray) -> str:
    moved = off[off > MOVED]
    if not len(moved):
        return "-"
    return ", ".join(f"{v:.2f}" for v in [*np.quantile(moved, (0.5, 0.95)), moved.max()])


def _together(parts: list[Sum]) -> Sum:
    whole = Sum()
    for part in parts:
        for name, value in vars(part).items():
            mine: Any = getattr(whole, name)
            setattr(whole, name, mine + value)
    return whole


def _floors(robot: Robot, sums: dict[str, Sum]) -> None:
    floor, reach = Floor(robot), weights.of_joints(robot)
    print(
        "\nframes in collision: medians (p95) of the joint farthest off [deg]\n"
        "| input | frames | must, by lengths | nearest by that joint | nearest in the guard's"
        " weights | the guard | which joint |\n|---|---:|---|---|---|---|---|"
    )
    for name, one in sums.items():
        picked = one.deep[:: max(1, -(-len(one.deep) // FLOORS))]
        if not picked:
            continue
        rows: list[list[float]] = []
        for wanted, q in tqdm(picked, name, disable=None, leave=False):
            lacks = robot.margin - batch.pair_distances(robot.chain, wanted[None])
            first = batch.project(robot.chain, robot.anchor, wanted[None], margin=robot.margin).q[0]
            starts = (wanted, q, first)
            poses = (floor.nearest(wanted, starts), floor.nearest(wanted, starts, reach), q)
            rows.append(
                [float(floor.least(lacks)[0]), *(np.abs(pose - wanted).max() for pose in poses)]
            )
        columns = np.degrees(np.array(rows)).T
        told = " | ".join(f"{np.median(v):.2f} ({np.quantile(v, 0.95):.1f})" for v in columns)
        joints = ", ".join(f"{joint} {n}" for joint, n in one.joints.most_common(4))
        print(f"| {name} | {len(one.deep)} | {told} | {joints} |", flush=True)


if __name__ == "__main__":
    typer.run(main)
