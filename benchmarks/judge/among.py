"""Streams among joints that others move, before the independent judge; and without their word.

    python benchmarks/judge/among.py [--robot g1] [--steps 1000000] [--workers 2]

Three kinds of shards. *known*: others move straight to where they said they would be. *bounded*:
they said how fast they may move, and go any way within that, corners and back. *ranges*: nothing is
said, they are anywhere in the ranges of the robot file. Wanted motion leads through the robot's own
body; others swing, jump to their ends, and are raised under the arms. What came out is judged with
all joints moving by coal, at samples no more than 1 mm apart (judging.py). *held*: the same input
through a guard that holds the others where the robot file does, today's certificate: how many of
its steps are broken by what the others do.

Forced steps are held to limits, speed and acceleration alone; they are counted. A shard that was
judged with the same code is not judged again, so a run that was stopped goes on.
"""

import hashlib
import time
from collections import Counter
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import run
import typer
from engines import Coal
from judging import Came, Judge, Promise

from s3le.guard.guard import Guard
from s3le.robot import model
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody, movable, whole_body
from s3le.store import documents
from s3le.tuples.engine.key import closure

HERE = Path(__file__).resolve().parent
KINDS = ("known", "bounded", "ranges")
STEPS, ROWS = 500, 100  # of a shard; of a motion
BETWEEN = 0.0005  # [m], what every path keeps; engines agree to 1e-7
RATES = (30.0, 100.0, 250.0, 500.0)
STANDING = {  # [rad], a balance controller's: hips, knees, ankles of the left leg
    "hip_pitch": (-0.6, 0.4), "hip_roll": (-0.1, 0.25), "hip_yaw": (-0.2, 0.2),
    "knee": (0.0, 0.8), "ankle_pitch": (-0.6, 0.3), "ankle_roll": (-0.2, 0.2),
}  # fmt: skip


@cache
def parts(name: str) -> tuple[WholeBody, WholeBody, Guard, Guard, Guard, Judge, Judge]:
    """Bodies of the two kinds of given joints, the guards, and the judges."""
    plain = Robot.load(name)
    every = whole_body(plain, movable(plain))
    text = plain.description
    ranged = Robot._settled(
        model.from_description(replace(text, ranges=standing(plain))), text.source, plain.margin,
        plain.neck,
    )  # fmt: skip
    legs = whole_body(plain, tuple(ranged.description.ranges))
    guards = Guard(plain, given="all"), Guard(ranged), Guard(plain)
    return every, legs, *guards, judge(every, guards[0]), judge(legs, guards[1])


def standing(robot: Robot) -> dict[str, tuple[float, float]]:
    """Ranges of a robot's legs, by the words in their joints' names."""
    found = {}
    for joint in movable(robot):
        for part, (low, high) in STANDING.items():
            if f"_{part}" in joint:
                mirror = joint.startswith("right") and ("roll" in part or "yaw" in part)
                found[joint] = (-high, -low) if mirror else (low, high)
    if not found:
        raise SystemExit(f"{robot.name}: no joint is called as those of {', '.join(STANDING)}")
    return found


def judge(body: WholeBody, guard: Guard) -> Judge:
    """The judge of ours among others."""
    n = body.robot.n_dof
    ends = {"speed": np.full(n, np.inf), "acceleration": np.full(n, np.inf),
            "lower": np.full(n, -np.inf), "upper": np.full(n, np.inf)}  # fmt: skip
    for key, own in zip(ends, (guard.most.speed, guard.most.acceleration, guard.most.lower,
                               guard.most.upper), strict=True):  # fmt: skip
        ends[key][body.own] = own
    return Judge(
        body.robot,
        Promise(body.base.margin, guard.settings.between, **ends),
        Coal(body.robot, guard.settings.between),
    )


def wanted(robot: Robot, rng: np.random.Generator, rate: float) -> np.ndarray:
    """Ours through everything, (ROWS, n) [rad]: smooth, or jumping."""
    n, times = robot.n_dof, np.arange(ROWS) / rate
    if rng.random() < 0.3:
        places = rng.uniform(robot.lower, robot.upper, (ROWS, n))
        return places[np.arange(ROWS) // int(rng.integers(5, 40))]
    middle, wide = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    wave = np.sin(2 * np.pi * rng.uniform(0.1, 1.0, n) * times[:, None] + rng.uniform(0, 6, n))
    return np.clip(robot.anchor + rng.uniform(0, 1, n) * (middle - robot.anchor) + wide * wave,
                   robot.lower, robot.upper)  # fmt: skip


def others(
    low: np.ndarray, high: np.ndarray, hold: np.ndarray, speed: float, rng, rate: float
) -> np.ndarray:
    """Theirs, (ROWS, k) [rad], no joint faster than speed."""
    k, made = len(low), [hold.copy()]
    aims = np.where(rng.random(k) < 0.5, low, high)
    for _ in range(1, ROWS):
        turn = rng.random(k) < 0.02
        aims = np.where(turn, np.where(rng.random(k) < 0.5, low, high), aims)
        made.append(made[-1] + np.clip(aims - made[-1], -speed / rate, speed / rate))
    return np.array(made)


def shard(name: str, seed: int, number: int) -> dict[str, Any]:
    """Judge STEPS steps."""
    every, legs, told, ranged, plain, all_judge, leg_judge = parts(name)
    kind = KINDS[number % len(KINDS)]
    rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
    body, its, seat = (legs, ranged, leg_judge) if kind == "ranges" else (every, told, all_judge)
    count, forced, held, notours = 0, 0, 0, 0
    broken: Counter = Counter()
    first: list[str] = []
    least, began = np.inf, time.process_time()
    while count < STEPS:
        rate = float(rng.choice(RATES))
        ours = wanted(body.base, rng, rate)
        speed = float(rng.choice([0.2, 1.0, 3.0] if kind == "bounded" else [0.5, 2.0, 6.0]))
        if kind == "ranges":
            low, high = np.array(list(standing(body.base).values())).T
        else:
            low, high = body.robot.lower[body.others], body.robot.upper[body.others]
            hold = body.robot.anchor[body.others]
            low, high = hold + 0.6 * (low - hold), hold + 0.6 * (high - hold)
        theirs = others(low, high, body.robot.anchor[body.others], speed, rng, rate)
        if kind == "ranges":
            its.start()
        else:
            its.start(None, theirs[0])
        plain.start()
        q, v, before = its.q, np.zeros(body.robot.n_dof), np.nan
        old = plain.q
        for i in range(1, ROWS):
            said: dict[str, Any] = {}
            if kind == "known":
                said = {"given": theirs[i - 1], "given_next": theirs[i]}
            elif kind == "bounded":
                said = {"given": theirs[i - 1], "given_speed": speed}
            step = its.step(ours[i], 1.0 / rate, **said)
            good = step.certified
            if not good and "not ours" in step.reason:
                good, notours = True, notours + 1  # of the pairs of ours all is still promised
            way = [theirs[i - 1], theirs[i]]
            if kind == "bounded" and rng.random() < 0.5:  # out to a corner and back
                room = speed / rate
                there = theirs[i - 1] + room * rng.choice([-1.0, 1.0], len(low))
                way = [theirs[i - 1], there, theirs[i]]
            elif kind == "ranges" and rng.random() < 0.5:
                way = [rng.choice([low, high]) for _ in range(2)]
            seen = walk(seat, body, q, step.q, way, 1.0 / rate, Came(v, before))
            words = set(seen[0])
            if not good:
                forced += 1
                words &= {"limits", "speed", "acceleration"}
            else:
                least = min(least, seen[1])
            broken.update(words)
            if words and len(first) < 3:
                first.append(f"{kind} {rate:g} Hz row {i}: {sorted(words)} {seen[1]:.6f} m")
            now = plain.step(ours[i], 1.0 / rate)
            held += bool(set(walk(seat, body, old, now.q, way, 1.0 / rate, None)[0])
                         & {"collision", "between", "margin"})  # fmt: skip
            old = now.q
            v = np.zeros(body.robot.n_dof)
            v[body.own], before, q = step.v, 1.0 / rate, step.q
            count += 1
            if count == STEPS:
                break
    return {
        "number": number, "kind": kind, "steps": count, "forced": forced, "not_ours": notours,
        "broken": dict(broken), "held_broken": held, "least_between_m": float(least),
        "first": first, "seconds": round(time.process_time() - began, 3),
    }  # fmt: skip


def walk(seat: Judge, body: WholeBody, q0, q1, way, dt: float, came: Came | None):
    """What is broken on the way, and the least clearance [m]: ours straight, others piece by piece.

    The pose at the end of the step keeps the margin wherever the others are then.
    """
    share = np.linspace(0.0, 1.0, len(way))[:, None]
    whole = body.poses((1.0 - share) * q0 + share * q1, np.array(way))
    seen = seat.step(whole[0], whole[-1], dt, came) if len(way) == 2 else None
    if seen is not None:
        return seen.broken, seen.clearance
    ends = seat.step(body.poses(q0[None], way[-1][None])[0], whole[-1], dt, came)
    words = {one for one in ends.broken if one not in ("collision", "between")}
    least = np.inf
    for a, b in zip(whole[:-1], whole[1:], strict=True):
        least = min(least, seat.path(a, b).clearance)
    if not least > 0.0:
        words.add("collision")
    if not least >= BETWEEN - 1e-7:
        words.add("between")
    return tuple(sorted(words)), least


def main(
    robot: Annotated[str, typer.Option(help="name or robot file")] = "g1",
    steps: Annotated[int, typer.Option(min=1, help="steps to judge")] = 1_000_000,
    seconds: Annotated[float, typer.Option(help="stop after so long; 0: when done")] = 0.0,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="root of all chance")] = 1,
    work: Annotated[Path, typer.Option(help="where shards are kept")] = Path("data/judge"),
    reports: Annotated[Path, typer.Option(help="where the record is")] = Path("reports/judge"),
) -> None:
    """Judge; exit status 1 if a promise is broken."""
    digest = hashlib.sha256(f"{robot} {seed} {STEPS}".encode())
    for path in sorted([*closure("s3le.guard.guard"), *(HERE / name for name in (
        "among.py", "engines.py", "judging.py"))]):  # fmt: skip
        digest.update(path.read_bytes())
    digest.update(Robot.load(robot).tag.encode())
    shelf = work / f"given-{digest.hexdigest()[:16]}"
    count = -(-steps // STEPS)
    done = {i: known for i in range(count) if (known := run.read(shelf / f"{i:06d}.json"))}
    stop = time.monotonic() + seconds if seconds > 0.0 else np.inf
    todo = (i for i in range(count) if i not in done and time.monotonic() < stop)
    with run.bar(count * STEPS, "steps", len(done) * STEPS) as bar:
        for i, made in run.perform(partial(shard, robot, seed), todo, workers):
            documents.write_json(made, shelf / f"{i:06d}.json")
            done[i] = made
            bar.update(STEPS)
    record: dict[str, Any] = {"robot": Robot.load(robot).tag, "seed": seed, "steps_planned": steps}
    print("| kind | steps | forced | not ours to change | broken | held legs: broken | least |")
    print("|---|---|---|---|---|---|---|")
    for kind in (*KINDS, "all"):
        mine = [one for one in done.values() if kind in ("all", one["kind"])]
        if not mine:
            continue
        row = {key: sum(one[key] for one in mine)
               for key in ("steps", "forced", "not_ours", "held_broken")}  # fmt: skip
        row["broken"] = dict(sum((Counter(one["broken"]) for one in mine), Counter()))
        row["least_between_m"] = min(one["least_between_m"] for one in mine)
        record[kind] = row
        print(
            f"| {kind} | {row['steps']:,} | {row['forced']:,} | {row['not_ours']:,} | "
            f"{row['broken'] or 0} | {row['held_broken'] / row['steps']:.1%} | "
            f"{row['least_between_m'] * 1e3:.4f} mm |"
        )
    record["first"] = [one for part in done.values() for one in part["first"]][:10]
    documents.write_json(record, reports / "given.json")
    for line in record["first"]:
        print(line)
    raise SystemExit(1 if record["all"]["broken"] else 0)


if __name__ == "__main__":
    typer.run(main)
