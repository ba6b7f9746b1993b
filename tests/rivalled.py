"""The modules of benchmarks/rivals, for its tests; and motions for its judges."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import coman

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared/mocap"
NAMES = (
    "plain", "person", "motions", "meshes", "tasks", "entrants", "kept", "install", "verdict",
    "sums", "changes", "book", "throughput", "run", "sweep", "engines", "continuous", "judging",
    "streams", "solvers",
)  # fmt: skip


def opened():
    """The modules of benchmarks/rivals; those of benchmarks/judge come with them."""
    for name in NAMES:
        sys.modules.pop(name, None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(ROOT / "benchmarks/rivals"), *sys.path])
        yield SimpleNamespace(**{name: __import__(name) for name in NAMES})
    for name in NAMES:
        sys.modules.pop(name, None)


def made_of(q):
    return {"q": q, "seconds": np.full(len(q), 1e-3), "failed": np.zeros(len(q), bool)}


def task_of(rooms, x, kind="cmu"):
    return rooms.tasks.Task("made", kind, x, coman().anchor, "0" * 16)
