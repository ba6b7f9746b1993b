"""Repair a motion of GMR's: the nearest certified joints, all else as it was.

    pip install s3le
    python examples/repair_gmr.py walk.pkl repaired.pkl --robot g1

The pickle is read as data and never run. Root, rate and the joints that the robot file holds stay
to the bit. This goes row by row, as a robot would be guarded live; `s3le guard walk.pkl --robot g1
--out repaired` looks ahead instead, which is nearer, and takes folders.
"""

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from s3le.errors import S3leError
from s3le.guard import Guard
from s3le.guard.guard import SETTINGS
from s3le.guard.layouts.door import open_layout
from s3le.safety import audit

STRAIGHT = replace(SETTINGS, curved=False)  # who reads such a file goes straight from row to row


def repair(guard: Guard, path: Path, target: Path) -> Counter[str]:
    """Write a file's motions again, certified.

    Args:
        guard: of the robot.
        path: any file that open_layout reads.
        target: the new file.

    Returns:
        How many rows were written for what reason; 'NOT CERTIFIED' counts those that an audit of
        the written angles does not let pass.

    Raises:
        TrajectoryError: the file cannot be read.
        CertificateError: no way leads out of its first pose.
    """
    layout = open_layout(path, guard.robot)
    told: Counter[str] = Counter()
    repaired = []
    for one in layout.episodes:
        guard.start(one.q[0])
        rows = [guard.q]
        for wanted, dt in zip(one.q[1:], np.diff(one.time), strict=True):
            made = guard.step(wanted, dt)
            rows.append(made.q)
            told[made.reason] += 1
        repaired.append(one.as_written(np.array(rows)))  # what the file's numbers can hold
        asked = audit.demands(guard.robot)
        for check in audit.audit(guard.robot, one.time, repaired[-1], asked).checks:
            told["NOT CERTIFIED"] += check.broken
    layout.write(target, repaired)
    return told


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--robot", default="g1", help="name, robot file or folder")
    given = parser.parse_args()
    try:
        told = repair(Guard.load(given.robot, settings=STRAIGHT), given.path, given.target)
    except (S3leError, OSError) as refusal:
        sys.exit(f"{type(refusal).__name__}: {refusal}")
    for reason, rows in told.most_common():
        print(f"{rows:6d} rows: {reason}")
    sys.exit(1 if told["NOT CERTIFIED"] else 0)


if __name__ == "__main__":
    main()
