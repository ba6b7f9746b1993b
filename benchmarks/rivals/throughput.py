"""A data set: frames a second on all cores by tool, and what a billion frames would cost.

Clips are made of those at hand: mirrored or not, and played slower or faster. Ours are written as
motion files and go through the library's door for many clips; of the rivals a sample is run, as it
is judged, with the settings of protocol 1. Motions are made anew each time, for it is their time
that is asked.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import entrants
import install
import numpy as np
import tasks
from entrants import HERE, Entrant
from streams import mirrored
from tasks import Task

from s3le import Robot, retargeter_for
from s3le.retarget import Retargeter
from s3le.rng import stream
from s3le.store import documents

CLIPS, SAMPLE, FRAMES = 1000, 50, 150
PRICE = 0.05  # of a core and hour, in any currency; an assumption, stated on the page
SPEEDS = (0.7, 1.4)  # range of how fast clips are played


def table(
    who: list[Entrant], name: str, cmu: Path, demo: Path, work: Path, workers: int,
    count: int = CLIPS, sample: int = SAMPLE,
) -> dict[str, Any]:  # fmt: skip
    """Time every entrant that takes part in protocol 1, and ours as files."""
    robot = Robot.load(name)
    its = retargeter_for(robot)
    folder = work / robot.name / "data_set"
    every = variants(its, tasks.cmu(cmu, tasks.TEST) + tasks.demo(demo), count)
    files = tasks.write(folder, tasks.plain_of(robot), every)
    rows = []
    for one in who:
        ours = one.module == "ours"
        if (1 not in one.protocols and not ours) or (one.robots and robot.name not in one.robots):
            continue
        listed = every if one.key == "file" else every[:sample]
        rows.append(_timed(one, name, listed, files, folder, workers))
    says = (
        f"{robot.name}; clips made of the test clips by mirroring them and playing them "
        f"{SPEEDS[0]} to {SPEEDS[1]} times as fast, {FRAMES} frames at most; {workers} processes, "
        f"each on a core of its own; what a process needs to its first motion is left out. Ours as "
        f"files on {count} "
        f"clips, all others on {sample} of these. The price is an assumption; days are measured."
    )
    return {"says": says, "workers": workers, "price": PRICE, "rows": rows}


def variants(its: Retargeter, paths: list[Path], count: int) -> list[Task]:
    """Clips mirrored and played at other speeds."""
    found = tasks.clips(its, paths, "made", 0, 1)
    rng, out = stream(tasks.SEED, "data set"), []
    for i in range(count):
        x = found[i % len(found)].x
        fast = float(rng.uniform(*SPEEDS))
        at = np.arange(0.0, len(x) - 1.0, fast)[:FRAMES]
        left = np.minimum(at.astype(int), len(x) - 2)
        share = (at - left)[:, None]
        between = tasks.usable((1.0 - share) * x[left] + share * x[left + 1])
        if i // len(found) % 2:
            between = mirrored(between)
        out.append(tasks.task(its, f"made_{i}", "made", its.robot.seen(between), 1))
    return out


def _timed(
    one: Entrant, name: str, listed: list[Task], files: dict[str, Path], folder: Path, workers: int
) -> dict[str, Any]:
    """Run an entrant on clips and time it."""
    ours = one.module == "ours"
    out = folder / f"made_{one.key}"
    shutil.rmtree(out, ignore_errors=True)
    cores = sorted(os.sched_getaffinity(0))
    settings = entrants.settings(one, 1, Robot.load(name).name)

    def part(i: int) -> tuple[int, float]:
        """Frames after the first motion, and the seconds that they took, start left out."""
        mine = listed[i::workers]
        job = {
            "name": name, "robot": str(folder / "robot.json"), "settings": settings,
            "module": one.key if ours else one.module, "core": cores[i % len(cores)],
            "protocol": 1, "dt": 1.0 / tasks.RATE, "most": 0, "clones": [], "asked": time.time(),
            "motions": [[str(files[t.digest]), str(out / f"{t.name}.npz")] for t in mine],
        }  # fmt: skip
        where = folder / f"job_{one.key}_{i}.json"
        documents.write_json(job, where)
        python = sys.executable if ours else str(install.python(one.environment))
        script = str(HERE / ("ours.py" if ours else "worker.py"))
        single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
        single["PYTHONPATH"] = str(HERE.parents[1]) if ours else ""
        subprocess.run(
            [python, script, str(where)], env=os.environ | single, capture_output=True, check=False
        )
        ended = time.time()
        first, *rest = [(t, out / f"{t.name}.npz") for t in mine]
        if not first[1].is_file():
            return 0, 0.0
        # Of a whole motion the first moment is its end; of frames, the first frame.
        frames = sum(len(t.x) for t, path in rest if path.is_file())
        frames += 0 if one.key == "file" else len(first[0].x) - 1
        with np.load(first[1]) as held:
            return frames, ended - job["asked"] - json.loads(str(held["about"]))["first"]

    with ThreadPoolExecutor(workers) as pool:
        told = list(pool.map(part, range(workers)))
    made = [t for t in listed if (out / f"{t.name}.npz").is_file()]
    frames, took = sum(n for n, _ in told), max(seconds for _, seconds in told)
    shutil.rmtree(out, ignore_errors=True)
    rate = sum(n / seconds for n, seconds in told if seconds > 0.0)
    days = 1e9 / max(rate, 1e-9) / 86400.0
    return {
        "key": one.key, "label": one.label, "own": ours, "clips": len(made), "frames": frames,
        "lost": len(listed) - len(made), "seconds": took, "rate": rate, "days": days,
        "cost": days * 24.0 * workers * PRICE,
    }  # fmt: skip
