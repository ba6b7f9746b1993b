"""What a job asks of the process that does it. Only numpy is needed: every environment reads this.

A job names the motions to make as pairs of a task's file and the file that the motion goes to, how
many frames of each at most, and the core to run on. A motion that stands is not made again.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np


def pin(job: dict[str, Any]) -> None:
    """Stay on the job's core, where it names one."""
    if job.get("core") is not None:
        os.sched_setaffinity(0, {job["core"]})


def asked(job: dict[str, Any]) -> Iterator[tuple[np.ndarray, np.ndarray, Path]]:
    """Of each motion to make: skeletons (m, 21), the pose to start at [rad] (n,), its file."""
    for task, out in job["motions"]:
        if not Path(out).is_file():
            with np.load(task) as given:
                yield given["x"][: job.get("most") or None], given["start"], Path(out)
