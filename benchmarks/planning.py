"""What planning is worth: whole files and streams of human motion, held to limits in time.

    python benchmarks/planning.py [CLIPS] [--robot s3le/robots/coman.yaml] [--acceleration 60]
    python benchmarks/planning.py --straight      # joints straight from row to row, no way to rest

CLIPS is a folder of CMU's originals, SS/SS_TT.amc.gz beside SS/SS.asf; the subjects named by
--subjects are taken. *wanted*: the pose that refinement finds for each frame, no limit in time.
*file*: all of them planned at once. *stream*: frame by frame, refined from where the robot is.
*guard*: the poses wanted, as joints, through s3le.Guard, reasons and coal's check included.
Counted after that, by coal, by the proof, and by differences of the rows: poses under the margin,
paths not proven, steps too fast, accelerations too high, rows without a proven way to rest. Rows
are positions and speeds, between which joints are accelerated evenly.
"""

import time as clock
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from s3le.guard.guard import SETTINGS, Guard
from s3le.human import dataset
from s3le.human.read import read_clip
from s3le.kernels import batch
from s3le.plan.flow import planner
from s3le.plan.limits import accelerations, limits, speeds
from s3le.plan.settings import Settings
from s3le.plan.smooth import walker
from s3le.retarget import refine
from s3le.retarget.propose import LookUp
from s3le.rng import stream
from s3le.robot.robot import Robot
from s3le.safety import paths
from s3le.safety.swept import swept
from s3le.search import neighbours
from s3le.skeleton import BONES, cosine_distance
from s3le.tuples import sampling

RATE = 30.0  # [Hz]
POOL = 30_000  # poses that are looked up
RULE = dict(target=0.004, ridge=1e-3, toll=0.003, steps=6)


class Clip(NamedTuple):
    """One motion."""

    name: str
    time: np.ndarray  # [s], (m,)
    x: np.ndarray  # (m, 21)
    starts: np.ndarray  # [rad], (m, k, n)
    wanted: np.ndarray  # [rad], (m, n)


class Made(NamedTuple):
    """What became of one."""

    q: np.ndarray  # [rad], (m, n)
    wanted: np.ndarray  # [rad], (m, n)
    taken: np.ndarray  # [s], (m,)
    v: np.ndarray | None = None  # [rad/s], (m, n); None: straight from row to row
    via: tuple = ()  # of each step the rows within it


def main(
    clips: Annotated[Path, typer.Argument(help="folder of clips")] = Path("../shared/mocap/cmu"),
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    subjects: Annotated[str, typer.Option(help="CMU subjects")] = "14,17,29",
    acceleration: Annotated[float, typer.Option(help="limit [rad/s^2]")] = 60.0,
    straight: Annotated[bool, typer.Option(help="joints straight from row to row")] = False,
) -> None:
    """Print the tables."""
    made = Robot.from_file(robot, 0.002, "midpoint")
    most, settings = limits(made, acceleration), Settings(check=False, curved=not straight)
    pool = sampling.draw_feasible(made, POOL, stream(7, "poses"))[0]
    seen = batch.skeletons(made.chain, pool).astype(np.float32)
    look = LookUp(pool, neighbours.build(seen, "l2"), 8, None)
    known = [read(made, look, path) for path in sorted(clips.rglob("*.amc.gz"))
             if path.parent.name in subjects.split(",")]  # fmt: skip
    planner(made, most, settings).warm_up(everything=True)  # compiles
    _stream(made, most, settings, known[0])
    frames = sum(len(clip.x) for clip in known)
    print(f"{made.name}, {len(known)} motions, {frames} frames, {acceleration:g} rad/s^2")
    print(
        f"{'':10}{'to human':>9}{'p99':>7}{'trunk':>8}{'most':>7}{'lag':>8}{'ms':>7}{'p50':>7}"
        f"{'p99':>7}{'fastest':>9}{'hardest':>9}{'poses':>7}{'paths':>7}{'fast':>6}{'hard':>6}{'stops':>7}"
    )
    wanted = [Made(clip.wanted, clip.wanted, np.zeros(1)) for clip in known]
    _say(made, most, "wanted", known, wanted, judged=False)
    _say(made, most, "file", known, [_file(made, most, settings, clip) for clip in known])
    alone: list[float] = []
    found = [_stream(made, most, settings, clip, alone) for clip in known]
    _say(made, most, "stream", known, found)
    _say(made, most, "guard", known, [_guard(made, acceleration, straight, clip) for clip in known])
    print(
        f"a stream's step alone, without refinement: {1e3 * np.median(alone):.3f} ms median, "
        f"{1e3 * np.quantile(alone, 0.99):.3f} p99; of a file the time is the plan's alone"
    )


def read(made: Robot, look: LookUp, path: Path) -> Clip:
    """A clip at the rate, the poses looked up for it, and the poses wanted."""
    raw = read_clip(path, None)
    m = len(raw.points)
    frames, _ = dataset.at_rate(
        {
            "split": np.full(m, "test"), "clip": np.full(m, path.name.split(".")[0]),
            "frame": np.arange(m, dtype=np.int32), "fps": np.full(m, float(raw.fps)),
            "points": raw.points.reshape(m, -1),
        },
        RATE, made.neck, np.radians(60.0),
    )  # fmt: skip
    x = np.ascontiguousarray(made.seen(frames.x))
    starts = np.array([look.propose(row) for row in x], float)
    rule = _rule(made)
    balls, out = swept(made.chain).balls, np.empty(3)
    wanted = np.zeros((len(x), made.n_dof))
    for i in range(len(x)):
        last = wanted[max(i - 1, 0)].copy()
        wanted[i] = last
        refine.refine(made.chain, balls, x[i], starts[i], last, last, i > 0, rule, wanted[i], out)
    return Clip(path.name.split(".")[0], np.asarray(frames.time, float), x, starts, wanted)


def _rule(made: Robot) -> refine.Rule:
    return refine.Rule(margin=made.margin, **RULE)


def _file(made, most, settings, clip: Clip) -> Made:
    its = planner(made, most, settings)
    began = clock.thread_time()
    plan = its.plan(clip.time, clip.wanted, skeleton=True)
    took = (clock.thread_time() - began) / len(plan.q)
    return Made(plan.q, clip.wanted, np.full(len(plan.q), took), plan.v)


def _stream(made, most, settings, clip: Clip, alone: list[float] | None = None) -> Made:
    alone = [] if alone is None else alone
    balls, out, rule = swept(made.chain).balls, np.empty(3), _rule(made)
    it = walker(made, most, settings, q=clip.wanted[0], skeleton=True)
    q, wanted, taken = clip.wanted.copy(), clip.wanted.copy(), np.zeros(len(clip.x))
    v, via = np.zeros_like(q), [()]
    for i in range(1, len(q)):
        began = clock.thread_time()
        refine.refine(
            made.chain, balls, clip.x[i], clip.starts[i], wanted[i - 1], q[i - 1], True, rule,
            wanted[i], out,
        )  # fmt: skip
        between = clock.thread_time()
        step = it.step(wanted[i], clip.time[i] - clip.time[i - 1], clip.starts[i])
        taken[i] = clock.thread_time() - began
        alone.append(clock.thread_time() - between)
        q[i], v[i] = step.q, it.v
        via.append(step.via)
    return Made(q, wanted, taken, v if settings.curved else None, tuple(via))


def _guard(made, acceleration, straight, clip: Clip) -> Made:
    guard = Guard(made, acceleration=acceleration, settings=replace(SETTINGS, curved=not straight))
    guard.start(clip.wanted[0])
    q, taken = clip.wanted.copy(), np.zeros(len(clip.x))
    v, via = np.zeros_like(q), [()]
    for i in range(1, len(q)):
        began = clock.thread_time()
        step = guard.step(clip.wanted[i], clip.time[i] - clip.time[i - 1])
        taken[i] = clock.thread_time() - began
        q[i], v[i] = step.q, step.v
        via.append(step.via)
    return Made(q, clip.wanted, taken, None if straight else v, tuple(via))


def _rows(time: np.ndarray, one: Made) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and speeds of all rows of a curve, those within steps too."""
    t, q, v = [time[0]], [one.q[0]], [one.v[0]]
    for i in range(1, len(time)):
        for after, at, fast in one.via[i] if one.via else ():
            t, q, v = [*t, time[i - 1] + after], [*q, at], [*v, fast]
        t, q, v = [*t, time[i]], [*q, one.q[i]], [*v, one.v[i]]
    return np.array(t), np.array(q), np.array(v)


def _say(made, most, name, known, found, judged=True) -> None:
    """A line: how near, how the trunk stands, how late, how long it took, and what is broken."""
    far, lean, lag, bones, counts = [], [], [], [], np.zeros(5, int)
    fastest = hardest = 0.0
    for clip, one in zip(known, found, strict=True):
        q, wanted = one.q, one.wanted
        x, x_wanted = batch.skeletons(made.chain, q), batch.skeletons(made.chain, wanted)
        far.append(cosine_distance(x, clip.x, made.followed))
        bones.append(1.0 - (x * clip.x).reshape(-1, 7, 3).sum(axis=2))
        cosine = (x[:, :3] * x_wanted[:, :3]).sum(axis=1)
        lean.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        lag.append(_lag(q, wanted))
        resting = 0
        if one.v is None:
            speed, hard = np.abs(speeds(clip.time, q)), np.abs(accelerations(clip.time, q))
            proven = paths.certify(made, q, 0.0005).status == paths.CERTIFIED if judged else None
        else:
            t, at, v = _rows(clip.time, one)
            took = np.diff(t)[:, None]
            speed, hard = np.abs(v), np.abs(np.diff(v, axis=0)) / took
            even = np.abs(np.diff(at, axis=0) - 0.5 * took * (v[1:] + v[:-1])).max(axis=1)
            proven = paths.certify(made, at, 0.0005, time=t, v=v).status == paths.CERTIFIED
            proven &= even < 1e-9
            rests = paths.rests(made, clip.time, q, one.v, most.acceleration, 0.0005)
            resting = int((~rests).sum())
        fastest, hardest = max(fastest, speed.max()), max(hardest, hard.max())
        if judged:
            report = made.certifier().check(q)
            held = (report.clearance >= made.margin) & (report.limit_margin >= 0.0)
            counts += [
                (~held).sum(), (~proven).sum(), (speed > most.speed * (1.0 + 1e-9)).any(1).sum(),
                (hard > most.acceleration * (1.0 + 1e-6)).any(1).sum(), resting,
            ]  # fmt: skip
    far, lean = np.concatenate(far), np.concatenate(lean)
    taken = 1e3 * np.concatenate([one.taken for one in found])
    print(
        f"{name:10}{far.mean():9.4f}{np.quantile(far, 0.99):7.3f}{np.mean(lean > 10.0):8.2%}"
        f"{lean.max():7.1f}{np.mean(lag) * 1e3 / RATE:6.0f}ms{taken.mean():7.3f}"
        f"{np.median(taken):7.3f}{np.quantile(taken, 0.99):7.3f}{fastest:9.4f}{hardest:9.3f}"
        + (
            f"{counts[0]:7d}{counts[1]:7d}{counts[2]:6d}{counts[3]:6d}{counts[4]:7d}"
            if judged
            else ""
        ),
        flush=True,
    )
    each = np.concatenate(bones).mean(axis=0)
    print(" " * 12 + ", ".join(f"{b} {v:.4f}" for b, v in zip(BONES, each, strict=True)))


def _lag(q: np.ndarray, wanted: np.ndarray) -> float:
    """Rows by which q is best explained as a late copy of what is wanted."""
    most = min(10, len(q) // 4)
    errors = [
        np.square(q[most:] - wanted[most - k : len(wanted) - k]).mean() for k in range(most + 1)
    ]
    k = int(np.argmin(errors))
    if not 0 < k < most:
        return float(k)
    before, here, after = errors[k - 1 : k + 2]
    return k + 0.5 * (before - after) / (before - 2.0 * here + after)


if __name__ == "__main__":
    typer.run(main)
