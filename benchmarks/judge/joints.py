"""Wanted joint motions through the guard, by its three doors, drawn from a seed.

Motions: through the robot's own body, jumps to poses within and beyond the limits, and recorded
ones that the planner made, shaken. Doors: *step* with hostile input among good (NaN, degrees,
names, times that are none, stops, measured poses), *chunk*, and whole *files* as `s3le guard` reads
and writes them (uneven times, degrees, float32). What documents say is refused must be refused by
the documented error and change nothing; what comes out must hold.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import plans
import streams
from streams import Log, Steps

from s3le.errors import CertificateError, ParameterError, StateError, TrajectoryError
from s3le.guard import clean
from s3le.guard.claim import claim
from s3le.guard.guard import SETTINGS, Guard
from s3le.guard.reasons import LEADING_OUT
from s3le.guard.task import Reading
from s3le.retarget.follow import follow
from s3le.retarget.stream import Retargeter
from s3le.robot.robot import Robot

DOORS = ("step", "chunk", "file")
FRAMES, ROWS = 60, (24, 150)  # of a stream; of a file, least and most
TURN = 2.0 * np.pi
WILD, MEDIAN = 5.0, 3.0  # times as far from zero as a range goes: one row, the median row


class Guards(NamedTuple):
    """One robot's guards."""

    live: Guard
    files: clean.Guard


class Wanted(NamedTuple):
    """A joint motion."""

    door: str  # one of DOORS
    start: np.ndarray | None  # [rad], (n,), where the robot is said to stand; not of a file
    q: np.ndarray  # [rad], (m, n)
    times: np.ndarray  # [s], (m,)
    seed: int  # of what else happens


def guards_of(robot: Robot, close: bool) -> Guards:
    """The guards of a robot; close: the live one aims at the margin and not beyond."""
    near = replace(SETTINGS, target=robot.margin, reserve=0.0, check=False)
    settings = near if close else None
    return Guards(Guard(robot, settings=settings), clean.Guard(*claim(robot)))


def draw(
    retargeter: Retargeter,
    rng: np.random.Generator,
    clips: Sequence[tuple[float, np.ndarray]],
) -> Wanted:
    """A wanted motion of the retargeter's robot."""
    robot, door = retargeter.robot, DOORS[rng.integers(len(DOORS))]
    rows = int(rng.integers(*ROWS)) if door == "file" else FRAMES
    q, dt = _motion(retargeter, rng, clips, rows)
    times = np.arange(len(q)) * dt
    if rng.random() < 0.3:
        times = plans.uneven(len(q), dt, rng)
    start = None
    if rng.random() < 0.6:
        start = robot.anchor if rng.random() < 0.2 else streams.poses(retargeter, rng, 1)[0]
    elif rng.random() < 0.5:
        start = q[0].clip(robot.lower, robot.upper)
    return Wanted(door, start, q, times, int(rng.integers(2**32)))


def _motion(retargeter, rng, clips, rows) -> tuple[np.ndarray, float]:
    """Rows [rad], and the time from one to the next [s]."""
    robot, kind = retargeter.robot, rng.integers(3)
    dt = float(rng.choice([0.1, 1 / 30, 1 / 30, 1 / 60, 1 / 120, 1 / 250]))
    if kind == 0:
        return streams.smooth(retargeter, rng, rows, int(rng.integers(4, 30))), dt
    if kind == 1:
        stays = int(rng.integers(1, 25))
        places = rng.uniform(robot.lower - 0.3, robot.upper + 0.3, (rows, robot.n_dof))
        return places[np.arange(rows) // stays], dt
    while True:
        x, dt = plans.recorded(rng, clips, rows)
        times = np.arange(len(x)) * dt
        try:
            made = follow(retargeter, x, times, fps=1.0 / dt)
        except CertificateError:
            continue  # as hard as that: another one
        shaken = rng.choice([0.0, 0.01, 0.1]) * rng.normal(size=made.q.shape)
        return made.q + shaken, dt / float(rng.choice([1.0, 1.5, 3.0]))


def drive(its: Guards, wanted: Wanted) -> Steps:
    """Give a motion to a guard.

    Raises:
        Exception: whatever comes but the documented refusals.
    """
    log, rng = Log(its.live.robot.n_dof), np.random.default_rng(wanted.seed)
    if wanted.door == "file":
        _file(its.files, wanted, rng, log)
        return log.steps()
    guard = its.live
    try:
        guard.start(wanted.start)
    except CertificateError:  # documented: no way out
        log.refused += 1
        return log.steps()
    (_steps if wanted.door == "step" else _chunks)(guard, wanted, rng, log)
    return log.steps()


# --- what must be refused


def impossible(robot: Robot, q: np.ndarray) -> bool:
    """Whether a row of finite angles must be refused: degrees, or a turn beyond the limits."""
    beyond = float(np.maximum(robot.lower - q, q - robot.upper).max())
    turned = np.radians(q)
    fits = bool(((robot.lower <= turned) & (turned <= robot.upper)).all())
    return beyond > TURN or (beyond > np.pi and fits)


def foreign(robot: Robot, q: np.ndarray) -> bool:
    """Whether a file's rows must be refused: not finite, wild, or degrees."""
    if not np.isfinite(q).all():
        return True
    far = np.abs(q) / np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    return bool(far.max() > WILD or np.median(far.max(axis=1)) > MEDIAN)


def _named(q: np.ndarray, robot: Robot) -> dict[str, float]:
    return dict(zip(robot.joint_names, q.tolist(), strict=True))


def _one(q: np.ndarray, rng: np.random.Generator, value: float) -> np.ndarray:
    q = q.copy()
    q[rng.integers(len(q))] = value
    return q


# What may be given instead of a row.
ODD: dict[str, Callable[[np.ndarray, Robot, np.random.Generator], Any]] = {
    "nan": lambda q, robot, rng: _one(q, rng, np.nan),
    "inf": lambda q, robot, rng: _one(q, rng, np.inf),
    "short": lambda q, robot, rng: q[:-1],
    "text": lambda q, robot, rng: ["x"] * len(q),
    "missing": lambda q, robot, rng: dict(list(_named(q, robot).items())[1:]),
    "unknown": lambda q, robot, rng: _named(q, robot) | {"no_such_joint": 0.0},
    "far": lambda q, robot, rng: _one(q, rng, robot.upper.max() + TURN + 0.1),
    "huge": lambda q, robot, rng: q + 1e300,
    "degrees": lambda q, robot, rng: np.degrees(q),
    "named": lambda q, robot, rng: _named(q, robot),
    "list": lambda q, robot, rng: q.tolist(),
}
REFUSED = frozenset(ODD) - {"degrees", "named", "list"}


# --- the doors


def _steps(guard: Guard, wanted: Wanted, rng: np.random.Generator, log: Log) -> None:
    robot, free = guard.robot, guard.q
    often = rng.choice([0.0, 0.1, 0.3])
    usual = np.diff(wanted.times, append=2 * wanted.times[-1] - wanted.times[-2])
    for i, (row, dt) in enumerate(zip(wanted.q, usual.tolist(), strict=True)):
        given, must, measured = row, impossible(robot, row), None
        if rng.random() < often:
            name = str(rng.choice(list(ODD)))
            given = ODD[name](row, robot, rng)
            must = name in REFUSED or must
            if name == "degrees":
                must = impossible(robot, given)
        elif rng.random() < often / 2:
            given, must = None, False
        if rng.random() < often / 2:
            guard.stop()
        elif rng.random() < 0.3:
            guard.release()
        if guard.stopped:
            must = False  # what is wanted is not looked at
        if rng.random() < often / 4:
            dt = float(rng.choice(streams.ODD_TIMES))
            must = must or not 1e-6 <= dt < np.inf
        far = rng.random() < often / 8
        if far:
            measured = guard.q + np.where(np.arange(robot.n_dof) == 0, 1.0, 0.0) * 0.5
        _step(guard, log, i, (given, dt, measured), must or far, (free, row))
        free = row


def _step(guard: Guard, log: Log, i: int, given: tuple, must: bool, free: tuple) -> None:
    """One call of step, and whether it was rightly refused."""
    before, v, out = guard.q, guard.v, guard.leading_out
    try:
        made = guard.step(*given)
    except (ParameterError, StateError) as refusal:
        log.refused += 1
        if not must:
            log.wrong.append(f"row {i} was refused: {refusal}")
        if not ((guard.q == before).all() and (guard.v == v).all()):
            log.wrong.append(f"row {i} was refused, and the state has changed")
        return
    if must:
        log.wrong.append(f"row {i} had to be refused, and was answered: {str(given)[:200]}")
    if made.certified and made.reason == LEADING_OUT:
        log.wrong.append(f"row {i} leads out, and is called certified")
    rows = () if out else streams.moved(before, v, made.q, made.v, float(given[1]), made.via)
    log.add(
        before, made.q, given[1], made.reason.split(" ")[0], i, free,
        smooth=made.certified or out, led=out, rows=rows, v1=made.v,
        short=not made.certified,
    )  # fmt: skip
    if i % streams.STOP_EVERY == 0:
        streams.stopped(log, guard.rest(), i, free)


def _chunks(guard: Guard, wanted: Wanted, rng: np.random.Generator, log: Log) -> None:
    first, usual = 0, float(np.median(np.diff(wanted.times)))
    free = guard.q
    while first < len(wanted.q):
        h = int(rng.integers(1, 17))
        rows = wanted.q[first : first + h].copy()
        dt: Any = usual if rng.random() < 0.5 else usual * rng.uniform(0.5, 2.0, len(rows))
        must = any(impossible(guard.robot, row) for row in rows)
        if rng.random() < 0.1:
            rows[rng.integers(len(rows))] = np.nan
            must = True
        driven = int(rng.integers(1, len(rows) + 1))
        before, v, out = guard.q, guard.v, guard.leading_out
        try:
            guard.chunk(rows, dt)  # moves nothing
            if (guard.q != before).any():
                log.wrong.append(f"rows {first}: a chunk that is only asked for moved the robot")
            made = guard.chunk(rows, dt, advance=driven)
        except ParameterError as refusal:
            log.refused += 1
            if not must or (guard.q != before).any():
                log.wrong.append(f"rows {first}: refused, must {must}: {refusal}")
            first += h
            continue
        if must:
            log.wrong.append(f"rows {first} had to be refused")
        each = np.broadcast_to(dt, len(rows))
        for k in range(driven):
            led = out and made.reason[k] == LEADING_OUT
            curve = () if led else streams.moved(
                before, v, made.q[k], made.v[k], float(each[k]), made.via[k]
            )  # fmt: skip
            log.add(
                before, made.q[k], float(each[k]), made.reason[k].split(" ")[0], first + k,
                (free, rows[k]), smooth=bool(made.certified[k]) or led, led=led, rows=curve,
                v1=made.v[k], short=not made.certified[k],
            )  # fmt: skip
            before, v, free = made.q[k], made.v[k], rows[k]
        if (guard.q != made.q[driven - 1]).any():
            log.wrong.append(f"rows {first}: the robot is not where the driven rows lead")
        first += driven


def _file(guard: clean.Guard, wanted: Wanted, rng: np.random.Generator, log: Log) -> None:
    robot, q, times = guard.robot, wanted.q.copy(), wanted.times
    in_degrees, said = rng.random() < 0.3, rng.random() < 0.8
    if rng.random() < 0.1:
        q[rng.integers(len(q)), 0] = rng.choice([np.nan, np.inf, 1e3])
    numbers = np.degrees(q) if in_degrees else q
    degrees = bool(in_degrees and said)
    with tempfile.TemporaryDirectory() as folder:
        kind = str(rng.choice([".csv", ".npz"]))
        source, target = (Path(folder) / f"{name}{kind}" for name in ("in", "out"))
        held = _written(source, robot, times, numbers, rng)
        read = np.radians(held) if degrees else held
        must = foreign(robot, read)
        reading = Reading(degrees=degrees)
        try:
            layout = reading.open(source, robot)
            cleaned = guard.clean(layout, degrees)
        except (TrajectoryError, CertificateError) as refusal:
            log.refused += 1
            if not must and isinstance(refusal, TrajectoryError):
                log.wrong.append(f"a file was refused: {refusal}")
            return
        if must:
            log.wrong.append("a file had to be refused")
        one = layout.episodes[0]
        q = one.q if cleaned.q[0] is None else cleaned.q[0]
        layout.write(target, [q], None, cleaned.v)
        made = reading.open(target, robot).episodes[0]
    for i in range(1, len(made.q)):
        same = bool((made.q[i] == one.q[i]).all())
        dt, rows = float(made.time[i] - made.time[i - 1]), ()
        if made.v is None:
            log.wrong.append("a file came without speeds")
        else:
            rows = streams.moved(made.q[i - 1], made.v[i - 1], made.q[i], made.v[i], dt, ())
            rows = tuple(row._replace(cubic=True) for row in rows)
        log.add(
            made.q[i - 1], made.q[i], dt, "as wanted" if same else "guarded", i,
            (one.q[i - 1], one.q[i]), smooth=i > 1, rows=rows,
        )  # fmt: skip


def _written(
    path: Path, robot: Robot, times: np.ndarray, q: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Write a file; its numbers as they lie there, (m, n)."""
    if path.suffix == ".npz":
        q = q.astype(rng.choice([np.float32, np.float64]))
        np.savez(path, time=times, q=q, joint_names=np.array(robot.joint_names))
        return q.astype(float)
    lines = [",".join(["time", *robot.joint_names])]
    lines += [
        ",".join(map(repr, [float(t), *row])) for t, row in zip(times, q.tolist(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return q
