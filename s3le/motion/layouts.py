"""Motions as other tools save and read them: a free base, then every joint, at one rate.

Joints come as MuJoCo numbers them, for these tools put a row into its `qpos`.

    gmr     walk.gmr.npz     what General Motion Retargeting pickles, as plain arrays: fps, root_pos
                             [m] (n, 3), root_rot x y z w (n, 4), dof_pos (n, all joints)
    mjlab   walk.mjlab.csv   what csv_to_npz of mjlab and of BeyondMimic reads, and Unitree's
                             retargeted LAFAN1 is written in: a row is root position [m], root
                             quaternion x y z w, joints; no line of names

The CSV's side file and arrays that these tools pass over say the rest: names, modes, certificate.
"""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.motion import root, text
from s3le.motion.root import Root
from s3le.motion.trajectory import Placed, Trajectory, runs, unit
from s3le.store import documents
from s3le.store.atomic import replace

SUFFIX = {"gmr": ".gmr.npz", "mjlab": ".mjlab.csv"}


def write(trajectory: Trajectory, base: Root, fps: float, layout: str, path: Path) -> None:
    """Write a motion in a tool's layout, whole or not at all.

    Args:
        trajectory: of the whole robot (whole.numbered), rows at one rate, with its heading.
        base: where the base link is, unless the trajectory says it.
        fps: rows per second [Hz].
        layout: one of SUFFIX.
        path: where.

    Raises:
        TrajectoryError: the layout is unknown, or rows are not at this rate.
    """
    if layout not in SUFFIX:
        raise TrajectoryError(f"no layout '{layout}'; there are {', '.join(SUFFIX)}")
    rate = trajectory.rate
    if not (len(trajectory.time) == 1 or (rate and abs(rate - fps) <= 1e-6 * fps)):
        raise TrajectoryError(f"{trajectory.name}: rows are not all 1 / {fps:g} s apart")
    heading = trajectory.heading
    if heading is None:
        heading = np.zeros(len(trajectory.time))
    placed = trajectory.root
    if placed is None:
        placed = Placed(root.positions(base, len(trajectory.time)), root.turned(base, heading))
        told = {
            "root_position": f"m, z up: 0, 0, {base.height!r} in every row",
            "root_height_m": base.height,
            "root_height": base.because,
            "root_quaternion": "x y z w: base link -> world, x faces a heading of 0",
        }
    else:
        told = {
            "root_position": "m, as the file of the given joints has it",
            "root_quaternion": "x y z w, as the file of the given joints has it",
        }
    place, turn = placed
    about = {**trajectory.about, "layout": _tree(trajectory, base, layout, told)}
    if layout == "gmr":
        arrays = {
            "fps": np.array(int(fps) if fps == int(fps) else fps),
            "root_pos": place,
            "root_rot": turn,
            "dof_pos": trajectory.q,
            "joint_names": np.array(trajectory.joints),
            "time": trajectory.time,
            "heading": heading,
            "clearance": trajectory.clearance,
            "mode": trajectory.mode,
            "about": np.array(json.dumps(about, sort_keys=True)),
        }
        kept = {key: value for key, value in arrays.items() if value is not None}
        replace(path, lambda part: _save(part, kept))
        return
    sink = io.StringIO()
    rows = np.hstack([place, turn, trajectory.q])
    csv.writer(sink, lineterminator="\n").writerows(rows.tolist())
    about |= {"joint_names": list(trajectory.joints), "fps": fps}
    if trajectory.mode is not None:
        about["mode_runs"] = runs(trajectory.mode)
    documents.write_text(sink.getvalue(), path)
    documents.write_text(text.side(about, sink.getvalue()), text.side_file(path))


def _save(part: Path, arrays: dict[str, Any]) -> None:
    with part.open("wb") as stream:  # savez would add a suffix to a name
        np.savez_compressed(stream, **arrays)


def _tree(
    trajectory: Trajectory, base: Root, layout: str, placed: dict[str, Any]
) -> dict[str, Any]:
    """What the file says about its own columns."""
    return {
        "name": layout,
        "root_link": base.link,
        **placed,
        "joints": [f"{joint} [{unit(trajectory, joint)}]" for joint in trajectory.joints],
    }
