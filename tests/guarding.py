"""Files for `s3le guard`, and what lies in a folder."""

import numpy as np
from worlds import coman

from s3le.motion import files, trajectory


def put(path, q, **more):
    """A motion in a file of our own; float64."""
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write(trajectory.make("m", coman().joint_names, np.arange(len(q)) / 30, q, **more), path)
    return path


def snapshot(place):
    return {p.relative_to(place): p.read_bytes() for p in place.rglob("*") if p.is_file()}
