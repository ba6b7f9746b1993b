"""The command line as tests call it, and small motions and clips for it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from handmade import bvh
from typer.testing import CliRunner
from worlds import coman

from s3le.cli.main import app
from s3le.motion import trajectory

ROOT = Path(__file__).parents[1]
ROBOT = ["--robot", str(ROOT / "s3le" / "robots" / "coman.yaml")]


def run(*words, given=None):
    return CliRunner().invoke(app, [str(word) for word in words], input=given)


def alone(*words, given=None):
    """The same in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "s3le.cli", *map(str, words)],
        input=given, capture_output=True, text=True, timeout=300,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def motion(rows=20, **more):
    robot = coman()
    q = np.repeat(robot.anchor[None], rows, 0)
    q[:, 3] += 0.3 * np.sin(np.arange(rows) / 10)
    return trajectory.make("m", robot.joint_names, np.arange(rows) / 30, q, **more)


def waving(frames=12):
    angles = np.linspace(0, 40, frames)
    return bvh([[0, 0, 0, 0, 0, 0, -a, 0, 0, 0, 0, 0] for a in angles], order="ZXY", step=".033")


# --- retarget


TABLE = {"retarget.parquet", ".retarget.lock"}
