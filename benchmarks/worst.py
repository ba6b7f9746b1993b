"""The worst moments before and after: strips and films of human, wanted and certified, to look at.

    python benchmarks/worst.py OUT [--folder data/retargeter] [--keep data/repair] [--cmu FOLDER]

Guarded motions are those of benchmarks/repair.py (`--keep`), as mink and pink gave them and as the
guard left them, without their first second. Retargeted ones are CMU's of `--subjects`, the pose
wanted for each frame beside the plan. A clip's worst frame is the one with the joint farthest off
(guarded; one clip for each robot and solver), the trunk most degrees from the wanted one, or the
greatest distance to the human (retargeted; three clips each). They become strips of a second and a
half around that frame, ten in all, and the worst of both doors a film (GIF).
"""

import copy
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from repair import ORIGINALS, Motion
from tqdm import tqdm

from s3le.human.skeletons import read_frames
from s3le.kernels import batch
from s3le.plan.whole import Plan, Planner
from s3le.retarget import Retargeter
from s3le.retarget.follow import follow
from s3le.robot.robot import Robot
from s3le.show import camera, film, movie, strip, style
from s3le.show.figures import Row
from s3le.skeleton import cosine_distance

KEPT = ("coman", "g1")
TAKEN = {"joint": 1, "trunk": 3, "distance": 3}  # strips of a kind; joint: of each robot and solver
AROUND, MOMENTS = 0.75, 9  # [s] before and after the worst frame; of a strip
FILM, RATE = 2.0, 30.0  # [s] before and after, [Hz]
WANTED, CERTIFIED = style.colour("ale"), style.colour("s3le")


class Pair(NamedTuple):
    """One motion before and after."""

    name: str
    door: str  # guarded or retargeted
    robot: Robot
    motion: Motion

    def trunk(self) -> np.ndarray:
        """Degrees by which the trunk is off the wanted one, (m,)."""
        made, wanted = (
            batch.skeletons(self.robot.chain, q)[:, :3] for q in (self.motion.q, self.motion.wanted)
        )
        return np.degrees(np.arccos(np.clip((made * wanted).sum(axis=1), -1.0, 1.0)))

    def joint(self) -> np.ndarray:
        """Degrees by which the joint farthest off is off, (m,)."""
        return np.degrees(np.abs(self.motion.q - self.motion.wanted)).max(axis=1)

    def distance(self) -> np.ndarray:
        """Distance to the human of what came out, (m,)."""
        x = batch.skeletons(self.robot.chain, self.motion.q)
        return cosine_distance(x, self.motion.x, self.robot.followed)


class _Overheard:
    """A planner that remembers what it was asked for."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner

    def plan(self, times: np.ndarray, wanted: np.ndarray, **how) -> Plan:
        self.wanted = wanted
        return self._planner.plan(times, wanted, **how)


def main(
    out: Annotated[Path, typer.Argument(help="folder of the pictures")],
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    keep: Annotated[Path, typer.Option(help="what repair.py kept")] = Path("data/repair"),
    cmu: Annotated[Path, typer.Option(help="folder of CMU's originals")] = ORIGINALS,
    subjects: Annotated[str, typer.Option(help="CMU subjects")] = "14,17,29",
) -> None:
    """Draw ten strips and two films, and print what is in them."""
    out.mkdir(parents=True, exist_ok=True)
    guarded = [pair for name in KEPT for pair in _guarded(name, keep)]
    known = sorted(p for p in cmu.rglob("*.amc.gz") if p.parent.name in subjects.split(","))
    it = Retargeter.load(folder)
    retargeted = [_retargeted(it, path) for path in tqdm(known, "retargeting", disable=None)]
    number, seen = 0, set()
    for kind, count in TAKEN.items():
        pairs = guarded if kind == "joint" else retargeted
        groups = [pairs] if kind != "joint" else _apart(pairs)
        for pair, row in [one for group in groups for one in _worst(group, kind, count, seen)]:
            number += 1
            path = out / f"{number:02d}_{kind}_{pair.name.replace('/', '_')}.png"
            _strip(pair, row, path)
            print(
                f"{path.name}: {pair.door}, {pair.motion.time[row]:.2f} s, joint off by "
                f"{pair.joint()[row]:.1f} deg, trunk {pair.trunk()[row]:.1f} deg, "
                f"{pair.distance()[row]:.4f} from the human",
                flush=True,
            )
    for kind, pairs in (("joint", guarded), ("trunk", retargeted)):
        (pair, row), *_ = _worst(pairs, kind, 1, set())
        path = out / f"{pair.door}_{pair.name.replace('/', '_')}.gif"
        _film(pair, row, path)
        print(path.name, flush=True)


def _guarded(name: str, keep: Path) -> list[Pair]:
    robot, found = Robot.load(name), []
    for path in sorted((keep / robot.name).glob("*/*_speed.npz")):
        with np.load(path) as kept:
            motion = Motion(*(kept[part] for part in Motion._fields))
        if np.isfinite(motion.q).all():
            clip = path.stem.removesuffix("_speed")
            found.append(Pair(f"{robot.name}/{path.parent.name}/{clip}", "guarded", robot, motion))
    if not found:
        raise SystemExit(f"{keep / robot.name}: nothing is kept; run benchmarks/repair.py first")
    return found


def _retargeted(it: Retargeter, path: Path) -> Pair:
    frames = read_frames(path, it.robot.neck, rate=RATE)
    heard, watched = _Overheard(it.planner()), copy.copy(it)
    watched.planner = lambda: heard  # type: ignore[method-assign]
    made = follow(watched, frames.x, frames.time, fps=RATE)
    motion = Motion(made.time, it.robot.seen(frames.x), heard.wanted, made.q, np.array(0))
    return Pair(frames.name, "retargeted", it.robot, motion)


def _apart(pairs: list[Pair]) -> list[list[Pair]]:
    """By robot and solver."""
    names = dict.fromkeys(pair.name.rpartition("/")[0] for pair in pairs)
    return [[pair for pair in pairs if pair.name.startswith(f"{name}/")] for name in names]


def _worst(pairs: list[Pair], kind: str, count: int, seen: set[str]) -> list[tuple[Pair, int]]:
    """The clips with the worst frames, the worst first; none that was seen, which grows."""
    found = []
    for pair in pairs:
        value = getattr(pair, kind)().copy()
        value[pair.motion.time < pair.motion.time[0] + 1.0] = 0.0
        row = int(value.argmax())
        found.append((float(value[row]), pair, row))
    best = []
    for _, pair, row in sorted(found, key=lambda one: -one[0]):
        clip = pair.name.rpartition("/")[2]
        if clip not in seen and len(best) < count:
            seen.add(clip)
            best.append((pair, row))
    return best


def _rows(pair: Pair, times: np.ndarray) -> list[Row]:
    """Human, wanted and certified at some moments; between two rows joints move straight."""
    motion, chain = pair.motion, pair.robot.chain
    at = np.searchsorted(motion.time, times + 1e-6, side="right") - 1
    rows = [Row("human", skeleton=motion.x[at])]
    wanted, made = (
        np.stack([np.interp(times, motion.time, column) for column in q.T], axis=1)
        for q in (motion.wanted, motion.q)
    )
    joint = np.degrees(np.abs(made - wanted)).max(axis=1)
    for label, q, colour in (
        ("wanted", wanted, WANTED), ("certified", made, CERTIFIED),
    ):  # fmt: skip
        clearance = batch.clearances(chain, q)
        note = [f"{c * 1e3:.1f} mm" for c in clearance]
        if label == "certified":
            note = [f"{n}, {j:.0f}° off" for n, j in zip(note, joint, strict=True)]
        rows.append(
            Row(
                label,
                ends=batch.capsule_ends(chain, q),
                radius=chain.body_radius,
                marked=~(clearance >= 0.0),
                note=note,
                colour=colour,
                still=chain.body_frame == 0,
            )  # fmt: skip
        )
    return rows


def _moments(pair: Pair, row: int, around: float, rate: float) -> np.ndarray:
    time = pair.motion.time
    middle = float(np.clip(time[row], time[0] + around, max(time[-1] - around, time[0] + around)))
    count = round(2.0 * around * rate) + 1
    times = middle + np.linspace(-around, around, count)
    return times[(times >= time[0] - 1e-6) & (times <= time[-1] + 1e-6)]


def _strip(pair: Pair, row: int, path: Path) -> None:
    times = _moments(pair, row, AROUND, (MOMENTS - 1) / (2.0 * AROUND))
    title = (
        f"{pair.name.replace('/', ', ')}, {pair.door}; worst at {pair.motion.time[row]:.2f} s: "
        f"joint {pair.joint()[row]:.0f}°, trunk {pair.trunk()[row]:.0f}° off"
    )
    strip.draw(path, times, _rows(pair, times), title, camera.USUAL, 1500)


def _film(pair: Pair, row: int, path: Path) -> None:
    times = _moments(pair, row, FILM, RATE)
    with style.sheet():
        made = film.Film(times, _rows(pair, times), [], [], camera.USUAL, 720, fine=2)
        movie.write(path, iter(made), len(times), made.size, RATE, (style.ALARM,))


if __name__ == "__main__":
    typer.run(main)
