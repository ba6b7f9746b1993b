"""A new data set in LeRobot's v3 layout, of motions that no folder held before.

    data/chunk-000/file-000.parquet           a row a frame: action [rad], LeRobot's counters
    meta/info.json, meta/stats.json           shapes, names, rate; what training scales by
    meta/tasks.parquet                        one task for each file that motions came from
    meta/episodes/chunk-000/file-000.parquet  where each episode lies, and its own numbers

There are no observations: nobody has measured anything. Angles are float32, as LeRobot has them, so
whatever was proven of rounder numbers is to be proven of these (guard.clean does).
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from s3le.errors import TrajectoryError
from s3le.guard.layouts.lerobot import COLUMN, INFO
from s3le.guard.layouts.lerobot_stats import STATS
from s3le.store import documents

VERSION = "v3.0"
UNIFORM = 1e-6  # share by which steps of one rate may differ
_FILE = "chunk-000/file-000.parquet"
_QUANTILES = (1, 10, 50, 90, 99)
_COUNTERS = {
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
    "task_index": "int64",
}  # fmt: skip


class Motion(NamedTuple):
    """One episode to write."""

    task: str  # what it is a motion of: the file that it came from
    time: np.ndarray  # [s], (m,), at one rate
    q: np.ndarray  # [rad], (m, n)


def create(target: Path, motions: Sequence[Motion], joints: Sequence[str], robot: str) -> None:
    """Write a data set; a folder that stands at target is replaced.

    Args:
        target: the folder.
        motions: its episodes, at least one.
        joints: names of the n joints.
        robot: its name.

    Raises:
        TrajectoryError: there is no motion, or they are not all at one rate.
        OSError: the disk refuses.
    """
    fps = _rate(target, motions)
    tasks = list(dict.fromkeys(motion.task for motion in motions))
    whole, episodes, first = [], [], 0
    for number, motion in enumerate(motions):
        rows = np.arange(len(motion.q))
        frames = {
            COLUMN: motion.q.astype("f4"),
            "timestamp": (rows / fps).astype("f4"),
            "frame_index": rows,
            "episode_index": np.full(len(rows), number),
            "index": first + rows,
            "task_index": np.full(len(rows), tasks.index(motion.task)),
        }
        whole.append(frames)
        last = first + len(rows)
        episodes.append(
            {
                "episode_index": number, "tasks": [motion.task], "length": len(rows),
                "data/chunk_index": 0, "data/file_index": 0,
                "dataset_from_index": first, "dataset_to_index": last,
                "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
            }
            | {f"stats/{key}/{name}": value for key, told in _stats(frames).items()
               for name, value in told.items()}
        )  # fmt: skip
        first = last
    columns = {key: np.concatenate([one[key] for one in whole]) for key in whole[0]}
    stats = _stats(columns)
    part = target.with_name(f".{target.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    for folder in ("data", "meta/episodes"):
        (part / folder / _FILE).parent.mkdir(parents=True)
    angles = pa.array(columns.pop(COLUMN).ravel())
    arrays: dict[str, pa.Array] = {
        COLUMN: pa.FixedSizeListArray.from_arrays(angles, len(joints)),
        **{key: pa.array(values) for key, values in columns.items()},
    }
    pq.write_table(pa.table(arrays), part / "data" / _FILE, compression="snappy")
    pq.write_table(pa.Table.from_pylist(episodes), part / "meta" / "episodes" / _FILE)
    pq.write_table(_tasks(tasks), part / "meta" / "tasks.parquet")
    documents.write_json(stats, part / STATS)
    documents.write_json(_info(robot, joints, fps, motions, tasks), part / INFO)
    if target.exists():
        shutil.rmtree(target)
    part.rename(target)


def _rate(target: Path, motions: Sequence[Motion]) -> float:
    """The one rate of all motions [Hz]."""
    steps = [np.diff(motion.time) for motion in motions if len(motion.time) > 1]
    if not steps:
        raise TrajectoryError(f"{target}: has no motion of two rows, so no rate")
    step = np.concatenate(steps)
    mean = float(np.median(step))
    if not (np.abs(step - mean) <= UNIFORM * mean + 1e-9).all():
        raise TrajectoryError(
            f"{target}: a LeRobot data set has one rate; these motions have steps of "
            f"{step.min():.6g} to {step.max():.6g} s"
        )
    return round(1.0 / mean, 6)


def _stats(columns: Mapping[str, np.ndarray]) -> dict[str, dict[str, list[float]]]:
    """What LeRobot says of each column, over its rows."""
    told = {}
    for key, values in columns.items():
        wide = values.reshape(len(values), -1).astype(float)
        found = {
            "min": wide.min(axis=0), "max": wide.max(axis=0), "mean": wide.mean(axis=0),
            "std": wide.std(axis=0), "count": np.array([len(wide)]),
        }  # fmt: skip
        found |= {f"q{q:02d}": np.quantile(wide, q / 100.0, axis=0) for q in _QUANTILES}
        told[key] = {name: value.tolist() for name, value in found.items()}
    return told


def _tasks(tasks: Sequence[str]) -> pa.Table:
    """Tasks by their number; the words are the index of what pandas reads."""

    def column(name: str, kind: str, numpy: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy,
                "metadata": None}  # fmt: skip

    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _info(
    robot: str, joints: Sequence[str], fps: float, motions: Sequence[Motion], tasks: Sequence[str]
) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": len(motions),
        "total_frames": sum(len(motion.q) for motion in motions),
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": int(fps) if fps == int(fps) else fps,
        "splits": {"train": f"0:{len(motions)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {
            COLUMN: {"dtype": "float32", "shape": [len(joints)], "names": list(joints)},
            **{
                key: {"dtype": kind, "shape": [1], "names": None} for key, kind in _COUNTERS.items()
            },
        },
    }
