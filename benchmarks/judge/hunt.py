"""A search for an input that breaks a promise: streams bred for what the judge sees of them.

Two herds, one bred for the least clearance between two poses, one for the highest speed. A child
is a parent with a few frames turned, held, swapped, replaced by what is no frame, or played in
another time, or with the tail of another's, or begun where the parent came nearest to contact. The
better ones stay. Anything that is broken on the way is kept, whatever the herd was bred for.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import streams
from shards import KEPT, Court, Tally, written
from streams import ODD, ODD_TIMES, Script

HERD = 16
FRAMES = 24  # of a stream at most
GOALS = ("clearance", "speed")


class Bred(NamedTuple):
    """A stream, and what the judge saw of it."""

    close: bool  # by the retargeter that keeps no distance beyond its margin
    script: Script
    clearance: float  # [m], least between two poses
    speed: float  # highest share of a joint's limit
    nearest: np.ndarray | None  # [rad], where the step began that came nearest

    def cost(self, goal: str) -> float:
        """What the herd is bred for, the less the better."""
        return self.clearance if goal == "clearance" else -self.speed


class _Seen:
    """What the whole search saw."""

    def __init__(self, court: Court) -> None:
        self.court, self.coal, self.mujoco = court, Tally(), Tally()
        self.streams = self.violations = self.refused = 0
        self.first: list[dict[str, Any]] = []

    def judge(self, close: bool, script: Script) -> Bred:
        """Let the retargeter follow a stream and judge every step."""
        it = self.court.close if close else self.court.plain
        self.streams += 1
        try:
            made = streams.drive(it, script)
        except Exception as escaped:  # the stream must survive every input
            self.violations += 1
            self.first.append({"broken": ["escaped"], "where": repr(escaped)[:300]})
            return Bred(close, script, -1.0, np.inf, None)
        self.refused += made.refused
        least, fastest, nearest = np.inf, 0.0, None
        for i in range(len(made.q1)):
            seen = self.coal.add(made.judged(self.court.coal, i))
            broken = seen.broken
            fastest = max(fastest, seen.speed)
            if not seen.clearance >= least:
                least, nearest = seen.clearance, made.q0[i]
                if self.court.mujoco:
                    broken += self.mujoco.add(made.judged(self.court.mujoco, i)).broken
            if broken:
                self.violations += 1
                self.first.append(written(it, made, i, broken, seen))
        return Bred(close, script, least, fastest, nearest)


def search(
    court: Court, seconds: float, seed: int, bar: Callable[[float, str], Any]
) -> dict[str, Any]:
    """Search for so long.

    Args:
        court: who is judged, and by whom.
        seconds: how long.
        seed: root of all chance; how far the search comes depends on the machine too.
        bar: makes a progress bar of (total, unit).

    Returns:
        The record.
    """
    rng, seen = np.random.default_rng(np.random.SeedSequence([seed, 2**32])), _Seen(court)
    began = last = time.monotonic()
    worked = time.process_time()
    herds: dict[str, list[Bred]] = {goal: [] for goal in GOALS}
    with bar(round(seconds), "s") as shown:
        while (now := time.monotonic()) - began < seconds:
            shown.update(round(now - began) - round(last - began))
            last = now
            goal = GOALS[rng.random() < 0.25]
            herd = herds[goal]
            if len(herd) < HERD or rng.random() < 0.1:  # new blood
                it = court.plain
                drawn = streams.draw(streams.KINDS[rng.integers(3)], it, rng, court.clips)
                child = drawn._replace(kind="search", frames=drawn.frames[:FRAMES])
                close = bool(rng.random() < 0.7)
            else:
                parent = herd[min(rng.integers(len(herd), size=2))]  # they are in order
                other = herd[rng.integers(len(herd))]
                close, child = parent.close, changed(parent, other, court, rng)
            herd.append(seen.judge(close, child))
            herd.sort(key=lambda one: one.cost(goal))
            del herd[HERD:]
    best = {goal: herd[0] for goal, herd in herds.items() if herd}
    return (
        {
            "seconds": round(seconds),
            "processor_seconds": round(time.process_time() - worked),  # less on a busy machine
            "streams": seen.streams,
            "steps": seen.coal.steps,
            "violations": seen.violations,
            "refused_frames": seen.refused,
            "coal": seen.coal.record(),
            "fastest_of_limit": max((one.speed for one in best.values()), default=0.0),
            "first": seen.first[:KEPT],
        }
        | ({"mujoco": seen.mujoco.record()} if court.mujoco else {})
    )


def changed(parent: Bred, other: Bred, court: Court, rng: np.random.Generator) -> Script:
    """A child."""
    start, frames = parent.script.start, list(parent.script.frames)
    for _ in range(int(rng.integers(1, 4))):
        first = int(rng.integers(len(frames)))
        run = range(first, min(len(frames), first + int(rng.integers(1, 9))))
        what = rng.integers(8)
        if what <= 1:  # turn some bones, a little or a lot
            size = 10.0 ** rng.uniform(-2.5, 0.3)
            push = rng.normal(0.0, size, 21) * np.repeat(rng.random(7) < 0.4, 3)
            for i in run:
                x, dt = frames[i]
                frames[i] = (x if x is None else x + push, dt)
        elif what == 2:  # another time
            dt = float(rng.choice(ODD_TIMES)) if rng.random() < 0.3 else 10.0 ** rng.uniform(-5, 0)
            for i in run:
                frames[i] = (frames[i][0], dt)
        elif what == 3:  # stand still
            for i in run:
                frames[i] = (frames[first][0], frames[i][1])
        elif what == 4:  # what is hardly a frame, or none
            x = frames[first][0]
            x = np.ones(21) if x is None else x
            with np.errstate(over="ignore", invalid="ignore"):
                frames[first] = (ODD[str(rng.choice(list(ODD)))](x, rng), frames[first][1])
        elif what == 5:  # elsewhere
            x = streams.targets(court.plain, rng, 1)[0]
            for i in run:
                frames[i] = (x, frames[i][1])
        elif what == 6:
            frames = frames[: first + 1] + list(other.script.frames[first + 1 :])
        elif parent.nearest is not None:  # from where it was nearest to contact
            start, frames = parent.nearest, frames[first:] + frames[:first]
    return Script("search", start, frames[:FRAMES])
