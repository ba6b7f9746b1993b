"""Runs one entrant over motions, in the environment of the rivals.

It is called as `python worker.py JOB.json`. The job names a robot, an entrant's module in solvers/,
its settings, and pairs of a task and the file its motion goes to. Each motion is written as soon as
it is done; one that stands is not made again. Of this project it reads what wants numpy alone:
motions.py, plain.py, person.py.
"""

import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import motions
import plain
import solvers

SAID = 120  # letters of an error that are kept


def main(job: dict[str, Any]) -> None:
    """Make the motions of a job."""
    motions.pin(job)
    sys.path[:0] = job["clones"]
    robot, dt = plain.load(Path(job["robot"])), float(job["dt"])
    maker = importlib.import_module(f"solvers.{job['module']}")
    told = maker.about() | solvers.commits(job["clones"])
    first = None
    for x, start, out in motions.asked(job):
        if hasattr(maker, "whole"):
            q, seconds, failed, base = maker.whole(robot, dt, dict(job["settings"]), x, start)
            first = time.time() - float(job["asked"]) if first is None else first
            about = {"about": told, "first": first, "made": 0.0, "said": ""}
            write(out, about, q=q, seconds=seconds, failed=failed, base=base)
            continue
        goals = robot.goals(x)
        began = time.perf_counter()
        solve = maker.make(robot, dt, dict(job["settings"]))
        made = time.perf_counter() - began
        q, rows, seconds, failed, said = start.copy(), [], [], [], ""
        leans, base = hasattr(solve, "base"), []
        for goal in goals:
            began = time.perf_counter()
            try:
                found = np.asarray(solve(goal, q), float)
                if not np.isfinite(found).all():
                    raise ValueError("a pose that is not finite")
                q = found
                failed.append(False)
            except Exception as error:  # each library has its own; the robot stays where it is
                said = said or f"{type(error).__name__}: {' '.join(str(error).split())[:SAID]}"
                failed.append(True)
            seconds.append(time.perf_counter() - began)
            rows.append(q.copy())
            if leans:
                base.append(solve.base())
            if first is None:
                first = time.time() - float(job["asked"])
        about = {"about": told, "first": first, "made": made, "said": said}
        more = {"base": np.array(base)} if leans else {}
        write(
            out, about, q=np.array(rows), seconds=np.array(seconds), failed=np.array(failed), **more
        )


def write(out: Path, about: dict[str, Any], **made: np.ndarray) -> None:
    """Write a motion, whole or not at all."""
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as stream:
        np.savez(stream, **made, about=json.dumps(about))
    part.replace(out)


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
