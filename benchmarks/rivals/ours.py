"""Runs this project's own entrants over motions: python ours.py JOB.json, as worker.py does others.

Before frames are timed the kernels are compiled or loaded; that counts into the seconds to the
first motion, as the imports and models of the others do.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import motions
import numpy as np
from tasks import RATE, save

from s3le import Robot, __version__, retargeter_for
from s3le.retarget import Retargeter
from s3le.retarget.follow import follow


def main(job: dict[str, Any]) -> None:
    """Make the motions of a job."""
    motions.pin(job)
    its = retargeter_for(Robot.load(job["name"]), streams=job["module"] == "stream")
    its.warm_up()
    if job["module"] == "file":
        its.warm_up_plan()
    make = {"file": by_file, "stream": by_stream}[job["module"]]
    first = None
    for x, start, out in motions.asked(job):
        made = make(its, x, start if job["protocol"] == 1 else None)
        first = time.time() - float(job["asked"]) if first is None else first
        about = {"about": {"s3le": __version__}, "first": first, "made": 0.0, "said": ""}
        save(out, **made, failed=np.zeros(len(x), bool), about=np.array(json.dumps(about)))


def by_file(its: Retargeter, x: np.ndarray, start: np.ndarray | None) -> dict[str, np.ndarray]:
    """A whole motion at once; from row to row joints are accelerated evenly."""
    made = follow(its, x, np.arange(len(x)) / RATE, fps=RATE, start=start)
    assert made.clip_from == 0
    return {"q": made.q, "v": made.v, "seconds": made.seconds, "mode": made.mode.astype(str),
            "t": made.time, "at": made.q, "fast": made.v}  # fmt: skip


def by_stream(its: Retargeter, x: np.ndarray, start: np.ndarray | None) -> dict[str, np.ndarray]:
    """Frame by frame; rows within a step are kept too."""
    stream, dt = its.start(start), 1.0 / RATE
    q, v, mode, seconds = [], [], [], []
    t, at, fast = [], [], []
    for i, frame in enumerate(x):
        began = time.perf_counter()
        step = stream.step(frame, dt)
        seconds.append(time.perf_counter() - began)
        for after, there, moving in step.via if i else ():
            t.append((i - 1) * dt + after)
            at.append(np.array(there))
            fast.append(np.array(moving))
        q.append(step.q)
        v.append(np.zeros(len(step.q)) if step.v is None else step.v)
        mode.append(str(step.mode))
        t.append(i * dt)
        at.append(q[-1])
        fast.append(v[-1])
    return {"q": np.array(q), "v": np.array(v), "seconds": np.array(seconds),
            "mode": np.array(mode), "t": np.array(t), "at": np.array(at),
            "fast": np.array(fast)}  # fmt: skip


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
