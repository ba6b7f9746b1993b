"""What is to be followed: clips, and a robot's adversarial streams, as files every entrant gets.

A task is a file of skeletons (m, 21) at a constant rate and the pose that all start at: the one
that refinement finds for the first frame, or, in protocol two, the robot file's anchor. A frame
that is none (the judge's adversarial streams hold such) is for everybody the one before it.
"""

import hashlib
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import plain

sys.path.append(str(Path(__file__).resolve().parents[1] / "judge"))
import streams  # noqa: E402

from s3le.errors import ClipError  # noqa: E402
from s3le.human import sources  # noqa: E402
from s3le.human.skeletons import read_frames  # noqa: E402
from s3le.plan.limits import limits  # noqa: E402
from s3le.retarget import Retargeter  # noqa: E402
from s3le.rng import stream  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.store import atomic, documents  # noqa: E402

RATE = 30.0  # [Hz]
TILT = 89.0  # [deg], for one of the clips crawls
DANCES = ("05_02", "05_09", "05_18", "49_09", "49_10", "135_06")  # the last is a karate form
TEST = (*DANCES, "14_07")
TRAINING = ("02_05", "14_10", "17_03", "17_10", "29_05")  # settings are swept on these
STREAMS, SEED = 6, 19  # adversarial ones for each robot
UNLIMITED = 1e3  # [rad/s], a joint speed that is none; solvers want a number
WORST = 1e3  # a component of a skeleton beyond which a frame is no frame
DEMO, CMU = Path("data/downloads/demo"), Path("../shared/mocap/cmu")
MANIFEST = Path("data/clips/demo/manifest.csv")


class Task(NamedTuple):
    """One motion to follow."""

    name: str
    kind: str  # deepmimic, cmu, adversarial, lafan, own, made or training
    x: np.ndarray  # (m, 21)
    start: np.ndarray  # [rad], (n,), where the robot stands before the first frame
    digest: str

    @property
    def time(self) -> np.ndarray:
        """[s], (m,)."""
        return np.arange(len(self.x)) / RATE


def plain_of(robot: Robot) -> plain.Plain:
    """The robot in plain numbers."""
    most = limits(robot)
    speed = np.where(np.isfinite(most.speed), most.speed, UNLIMITED)
    joints = tuple(
        plain.Joint(j.name, j.parent, j.rotation, j.translation, j.axis, j.lower, j.upper, float(v))
        for j, v in zip(robot.joints, speed, strict=True)
    )
    return plain.Plain(
        robot.name, robot.digest, joints,
        tuple(plain.Capsule(b.joint, b.a, b.b, float(b.radius)) for b in robot.bodies),
        tuple((int(a), int(b)) for a, b in robot.watched),
        {role: plain.Place(p.joint, p.offset) for role, p in robot.points.items()},
        robot.base_rotation, robot.anchor, float(robot.margin),
        np.where(np.isfinite(most.acceleration), most.acceleration, 1e6),
    )  # fmt: skip


def demo(folder: Path = DEMO) -> list[Path]:
    """DeepMimic's clips: those of a folder, or all 15, fetched where there is none."""
    if here := sorted(folder.glob("*.txt")):
        return here
    return [source.path for source in sources.demo(MANIFEST, folder).clips]


def cmu(folder: Path, names: Sequence[str]) -> list[Path]:
    """Trials of CMU by name, those that are here: SS/SS_TT.amc.gz beside SS/SS.asf."""
    paths = [folder / name.split("_")[0] / f"{name}.amc.gz" for name in names]
    return [path for path in paths if path.is_file()]


def clips(its: Retargeter, paths: Sequence[Path], kind: str, most: int, protocol: int) -> list:
    """Tasks of motion files, of each its first `most` frames (0: all).

    A file that cannot be read is named and left out.
    """
    found = []
    for path in paths:
        try:
            given = read_frames(path, its.robot.neck, TILT, rate=RATE)
        except ClipError as error:
            _left_out(str(error))
            continue
        x = np.ascontiguousarray(its.robot.seen(given.x[: most or None]), float)
        found.append(task(its, path.name.split(".")[0], kind, x, protocol))
    return found


@cache
def _left_out(why: str) -> None:
    """Say it once, however many robots and protocols ask for the clip."""
    print(f"left out: {why}", file=sys.stderr)


def adversarial(its: Retargeter, count: int, protocol: int) -> list[Task]:
    """The judge's adversarial streams, at an even rate."""
    found = []
    for i in range(count):
        script = streams.draw("adversarial", its, stream(SEED, "rivals", i))
        x = usable(np.array([np.full(21, np.nan) if x is None else x for x, _ in script.frames]))
        found.append(task(its, f"adversarial_{i}", "adversarial", its.robot.seen(x), protocol))
    return found


def usable(x: np.ndarray) -> np.ndarray:
    """Skeletons of unit vectors: one that is none is the one before it; before all, the first."""
    with np.errstate(all="ignore"):
        length = np.linalg.norm(x.reshape(-1, 7, 3), axis=2)
        good = np.isfinite(length).all(axis=1) & ((length > 1e-6) & (length < WORST)).all(axis=1)
    rows = np.maximum.accumulate(np.where(good, np.arange(len(x)), -1))
    rows[rows < 0] = int(np.argmax(good))
    bones = x[rows].reshape(-1, 7, 3)
    return (bones / np.linalg.norm(bones, axis=2, keepdims=True)).reshape(-1, 21)


def task(its: Retargeter, name: str, kind: str, x: np.ndarray, protocol: int) -> Task:
    """One task: protocol 1 starts at the pose refined for its first frame, 2 at the anchor."""
    start = its.robot.anchor.copy()
    if protocol == 1:
        want, out, zero = start.copy(), np.zeros(3), np.zeros(len(start))
        its.refine(x[0], its.propose(x[0]), zero, zero, False, want, out)
        report = its.robot.certifier().check(want[None])
        if report.clearance[0] >= its.robot.margin and report.limit_margin[0] >= 0.0:
            start = want
    digest = hashlib.sha256(x.tobytes() + start.tobytes()).hexdigest()[:16]
    return Task(name, kind, x, start, digest)


def write(folder: Path, robot: plain.Plain, tasks: Sequence[Task]) -> dict[str, Path]:
    """Write robot.json and a file for each task; task digest -> file."""
    folder.mkdir(parents=True, exist_ok=True)
    documents.write_json(plain.dump(robot), folder / "robot.json")
    found = {}
    for one in tasks:
        found[one.digest] = folder / "tasks" / f"{one.name}_{one.digest}.npz"
        if not found[one.digest].is_file():
            found[one.digest].parent.mkdir(exist_ok=True)
            save(found[one.digest], x=one.x, start=one.start)
    return found


def save(path: Path, **arrays: np.ndarray) -> None:
    """Write arrays, whole or not at all."""

    def fill(part: Path) -> None:
        with part.open("wb") as stream:
            np.savez(stream, **arrays)

    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.replace(path, fill)
