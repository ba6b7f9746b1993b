"""One shard of the judgement: motions drawn from its number, followed, and every step judged.

A third of the shards are streams of skeletons, a third whole motions by the file door, a third
joint motions through the guard; in a cycle of CYCLE, the settings alternating from one to the next.
"""

import hashlib
import signal
import time
from collections import Counter
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joints
import numpy as np
import plans
import streams
from continuous import Continuous, Heard, installed
from engines import Coal, Mujoco, mujoco
from judging import FAR, Judge, Promise, Verdict, promise_of

from s3le.errors import BundleError, ClipError
from s3le.human.skeletons import read_frames
from s3le.human.tables import SKELETONS
from s3le.retarget.stream import Retargeter
from s3le.store import tables

STEPS = 1000  # of a shard
FILES, JOINTS = "files", "joints"
CYCLE = tuple(kind for one in streams.KINDS for kind in (one, FILES, JOINTS))
FILES_ROUND = (
    1e-6  # share by which a file's numbers may exceed a limit in time, as they are rounded
)
PLANS_ROUND = 1e-9
IN_TIME = ("speed", "acceleration", "held")  # what a robot is held to that is led out
MUJOCO_EVERY = 10  # one step in so many is judged by MuJoCo too
HPP_EVERY = 25  # and one in so many proven by HPP
UNGUARDED_EVERY = 20  # and one in so many as it would be with the guard off
KEPT = 3  # violations of a shard that are written out
CLIPS = (".bvh", ".amc", ".amc.gz")


class Court:
    """A retargeter, twice: as it was exported, and without a distance to keep beyond its margin."""

    def __init__(self, folder: Path, source: Path) -> None:
        """Load everything.

        Args:
            folder: exported retargeter.
            source: folder of clips, or table skeletons.

        Raises:
            BundleError, ClipError: something is missing or cannot be read.
        """
        self.folder, self.source = Path(folder), Path(source)
        if not self.folder.is_dir():
            raise BundleError(f"{folder} is missing; write it with: dvc repro export")
        self.plain = Retargeter.load(self.folder)
        close = {"target": self.plain.robot.margin, "check": False}
        self.close = Retargeter.load(self.folder, close)
        self.clips = read_clips(self.source, self.plain.robot.neck)
        digest = hashlib.sha256()
        for rate, x in self.clips:
            digest.update(np.float64(rate).tobytes() + x.tobytes())
        self.digest = digest.hexdigest()
        robot, promise = self.plain.robot, promise_of(self.plain)
        self.sit(
            promise,
            Coal(robot, promise.between),
            Mujoco(robot, promise.between) if mujoco else None,
        )
        self.between = promise.between
        # A curve is proven by chords, from which it strays by less.
        self.hpp = Continuous(robot, self.between - streams.SAG) if installed() else None
        self.certifier = robot.certifier()
        names = ["coal", "pin"] + ["mujoco"] * bool(mujoco) + ["hpp-core"] * bool(self.hpp)
        self.versions = {name: version(name) for name in names}

    def sit(self, promise: Promise, coal: Coal, mujoco: Mujoco | None) -> None:
        """Appoint judges for what is promised of streams, of files and of guarded joints."""
        robot, self.guards = self.plain.robot, {}
        rounded = {
            **dict.fromkeys(streams.KINDS, promise),
            FILES: promise._replace(rounding=PLANS_ROUND),
            JOINTS: promise._replace(rounding=FILES_ROUND),
        }
        self.coals = {kind: Judge(robot, one, coal) for kind, one in rounded.items()}
        self.mujocos = (
            {kind: Judge(robot, one, mujoco) for kind, one in rounded.items()} if mujoco else {}
        )
        self.coal = self.coals[streams.KINDS[0]]
        self.mujoco = self.mujocos.get(streams.KINDS[0])

    def driven(self, kind: str, close: bool, rng: np.random.Generator) -> streams.Steps:
        """What is made of one script of a kind.

        Raises:
            Exception: whatever comes but what is documented.
        """
        it = self.close if close else self.plain
        if kind == FILES:
            return plans.drive(it, plans.draw(it, rng, self.clips))
        if kind == JOINTS:
            if close not in self.guards:
                self.guards[close] = joints.guards_of(it.robot, close)
            return joints.drive(self.guards[close], joints.draw(self.plain, rng, self.clips))
        return streams.drive(it, streams.draw(kind, it, rng, self.clips))

    def proven(self, heard: Heard, chords: np.ndarray, seen: Verdict) -> bool:
        """Let HPP look at a path that coal has judged, chord by chord; True where it refuses it."""
        if not np.isfinite(chords).all():
            return False  # that is for coal's judge to say
        there = np.nan
        for q0, q1 in zip(chords, chords[1:], strict=False):
            said = self.hpp.path(q0, q1)
            if not said.free:
                pose = (1.0 - said.t) * q0 + said.t * q1
                there = float(self.certifier.check(pose[None]).clearance[0])
                break
        return heard.add(said, seen.clearance, there, self.between - streams.SAG)

    def shard(self, seed: int, number: int) -> dict[str, Any]:
        """Judge a shard."""
        kind, began = CYCLE[number % len(CYCLE)], time.process_time()
        close = bool(number // len(CYCLE) % 2)
        rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
        tally = {name: Tally() for name in ("coal", "mujoco", "unguarded")}
        heard = {name: Heard() for name in ("hpp", "hpp_unguarded")}
        coal, mujoco = self.coals[kind], self.mujocos.get(kind)
        modes: Counter = Counter()
        count = refused = near = scripts = led = 0
        fastest = hardest = 0.0
        first: list[dict[str, Any]] = []
        while count < STEPS:
            scripts += 1
            try:
                made = self.driven(kind, close, rng)
            except Exception as escaped:  # the robot must survive every input
                first.append({"broken": ["escaped"], "where": repr(escaped)[:300]})
                count += 1
                modes["escaped"] += 1
                continue
            refused += made.refused
            first += [{"broken": ["answered"], "where": words[:300]} for words in made.wrong]
            keep = slice(0, STEPS - count)
            modes.update(streams.shares(made.mode[keep]))
            for i in range(*keep.indices(len(made.q1))):
                seen = made.judged(coal, i)
                fastest, hardest = max(fastest, seen.speed), max(hardest, seen.hardest)
                if made.led[i]:  # it begins where nothing holds
                    led += 1
                    broken = tuple(one for one in seen.broken if one in IN_TIME)
                    if broken:
                        first.append(written(self.plain, made, i, broken, seen))
                    count += 1
                    continue
                tally["coal"].add(seen)
                near += seen.clearance < FAR
                broken = seen.broken
                if mujoco and count % MUJOCO_EVERY == 0:
                    broken += tally["mujoco"].add(made.judged(mujoco, i)).broken
                if self.hpp and count % HPP_EVERY == 0:
                    if self.proven(heard["hpp"], made.chords(coal, i), seen):
                        broken += ("refused",)
                if count % UNGUARDED_EVERY == 0:
                    free = made.free0[i], made.free1[i]
                    off = tally["unguarded"].add(coal.step(*free, float(made.dt[i])))
                    if self.hpp:
                        self.proven(heard["hpp_unguarded"], np.stack(free), off)
                if broken:
                    first.append(written(self.plain, made, i, broken, seen))
                count += 1
        return (
            {
                "number": number,
                "kind": kind,
                "steps": count,
                "scripts": scripts,
                "refused": refused,
                "led_out": led,
                "modes": dict(modes),
                "near": int(near),
                "fastest": fastest,
                "hardest": hardest,
                "seconds": round(time.process_time() - began, 3),  # is no part of the record
                "violations": len(first),
                "first": first[:KEPT],
            }
            | {name: one.record() for name, one in (tally | heard).items() if one.steps}
        )


class Tally:
    """What one judge saw."""

    def __init__(self) -> None:
        """Nothing yet."""
        self.steps = self.distances = self.steps_broken = 0
        self.broken: Counter = Counter()
        self.between = self.end = FAR

    def add(self, seen: Verdict) -> Verdict:
        """Count a verdict."""
        self.steps += 1
        self.distances += seen.checks
        self.steps_broken += bool(seen.broken)
        self.broken.update(seen.broken)
        self.between = min(self.between, seen.clearance)
        self.end = min(self.end, seen.end)
        return seen

    def record(self) -> dict[str, Any]:
        """As JSON holds it; a clearance of FAR: never so near."""
        return {
            "steps": self.steps,
            "distances": self.distances,
            "steps_broken": self.steps_broken,
            "broken": dict(self.broken),
            "least_between_m": self.between,
            "least_end_m": self.end,
        }


def written(
    it: Retargeter, made: streams.Steps, i: int, broken: Iterable[str], seen: Verdict
) -> dict[str, Any]:
    """A violation as it can be reproduced: both poses to the bit."""
    name = it.robot.pair_name(seen.pair) if seen.pair >= 0 else "no pair"
    return {
        "broken": list(broken),
        "where": f"{name}, {seen.clearance * 1e3:.4f} mm at {seen.t:.3f} of a step of "
        f"{made.dt[i]!r} s, {seen.speed:.3f} of the speed limit, {seen.hardest:.3f} of the "
        "acceleration's",
        "mode": str(made.mode[i]),
        "q0": [float(v).hex() for v in made.q0[i]],
        "q1": [float(v).hex() for v in made.q1[i]],
        "dt": float(made.dt[i]).hex(),
        "v0": [float(v).hex() for v in made.v0[i]],
        "dt0": float(made.dt0[i]).hex(),
        "rows": [[float(v).hex() for v in (one.t, *one.q, *one.v)] for one in made.rows[i]],
    }


def read_clips(source: Path, neck: str) -> list[tuple[float, np.ndarray]]:
    """Rate [Hz] and skeletons (n, 21) of every clip.

    Raises:
        ClipError: there is none, or one cannot be read.
    """
    if source.is_dir():
        paths = sorted(p for p in source.rglob("*") if p.name.lower().endswith(CLIPS))
        found = [read_frames(path, neck) for path in paths]
        out = [(clip.fps, clip.x) for clip in found]
    elif source.is_file():
        table = tables.read(SKELETONS, source)
        names = np.unique(table["clip"])
        out = [(30.0, table["x"][table["clip"] == name]) for name in names]
    else:
        raise ClipError(f"{source} is missing; write it with dvc repro, or give --clips FOLDER")
    out = [(float(rate), np.ascontiguousarray(x, float)) for rate, x in out if len(x) > 1]
    if not out:
        raise ClipError(f"{source}: no clip (.bvh, .amc) in it")
    return out


_court: Court | None = None  # of a worker process


def begin(folder: Path, source: Path) -> None:
    """Load, once in each worker."""
    global _court
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is for the parent to stop
    _court = Court(folder, source)


def judged(seed: int, number: int) -> dict[str, Any]:
    """A shard, in a worker."""
    return _court.shard(seed, number)
