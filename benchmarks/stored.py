"""Many stored poses and real people to look for among them; imported by the retrieval benchmarks.

The first rows are those that the pipeline stored for S3LE (`dvc repro index@s3le`, certified).
Beyond them come uniform relaxed poses through the same projection, feasible by the kernels but
not certified by coal: these are only searched, never handed to a robot.
"""

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

sys.path.append(str(Path(__file__).parents[1]))  # of `pipeline`, which is installed nowhere
from pipeline.stage import bar  # noqa: E402
from s3le.human import dataset  # noqa: E402
from s3le.human.read import SUFFIXES, read_clip, suffix_of  # noqa: E402
from s3le.human.splits import test_rows  # noqa: E402
from s3le.human.tables import SKELETONS  # noqa: E402
from s3le.kernels import batch  # noqa: E402
from s3le.learn import artifact  # noqa: E402
from s3le.robot.robot import Robot  # noqa: E402
from s3le.store import tables  # noqa: E402
from s3le.tuples.sampling import relaxed_limits  # noqa: E402

SPACES = {"s3le": "s3le latents", "skeleton": "skeletons"}
ALPHA = 0.2  # relaxation of the poses beyond the pipeline's own [-]
SEED = 1
RATE = 10.0  # frames a second taken of clips [Hz]
TILT = np.radians(60.0)


class World(NamedTuple):
    """One space to search."""

    stored: np.ndarray  # float32 (n, d)
    queries: np.ndarray  # float32 (m, d), of people


def worlds(
    data: Path, clips: Path | None, rows: int, spaces: list[str], queries: int, cache: Path | None
) -> dict[str, World]:
    """Stored rows and queries of each space.

    Args:
        data: the pipeline's folder of tables.
        clips: a folder of motion files; None: the test frames of data/skeletons.parquet.
        rows: stored rows wanted.
        spaces: keys of SPACES.
        queries: people at most, evenly spread over the frames.
        cache: a file that keeps the poses from run to run.
    """
    it = Robot.read(data / "robot")
    q = _poses(it, data, rows, cache)
    x = _people(data, clips)
    x = x[np.unique(np.linspace(0, len(x) - 1, min(queries, len(x))).astype(int))]
    made = {}
    for space in spaces:
        if space == "skeleton":
            with bar(rows, "skeletons", unit="rows") as progress:
                stored = batch.skeletons(it.chain, q, progress)
            made[space] = World(stored.astype(np.float32), x.astype(np.float32))
        else:
            net, _ = artifact.load_model(data / f"model-{space}.safetensors", robot_hash=it.tag)
            made[space] = World(artifact.encode_q(net, q), artifact.encode_x(net, x))
    return made


def _poses(it: Robot, data: Path, rows: int, cache: Path | None) -> np.ndarray:
    if cache and cache.is_file():
        q = np.load(cache)
        if len(q) >= rows:
            return q[:rows]
    q = pl.read_parquet(data / "index-s3le.parquet", columns=["q"])["q"].to_numpy()
    # The table has its sources one after another; any first part of the rows shall be a mixture.
    q = q[np.random.default_rng(SEED + 1).permutation(len(q))]
    if len(q) < rows:
        low, high = relaxed_limits(it.lower, it.upper, ALPHA)
        rng = np.random.default_rng(SEED)
        more = rng.uniform(low, high, (rows - len(q), it.n_dof))
        with bar(len(more), "projecting poses", unit="rows") as progress:
            made = batch.project(it.chain, it.anchor, more, it.margin, progress).q
        q = np.concatenate([q, made])
    if cache:
        tables.replace(cache, lambda part: _save(part, q))
    return q[:rows]


def _save(part: Path, q: np.ndarray) -> None:
    with part.open("wb") as file:
        np.save(file, q)


def _people(data: Path, clips: Path | None) -> np.ndarray:
    if clips is None:
        frames = tables.read(SKELETONS, data / "skeletons.parquet")
        return frames["x"][test_rows(frames)]
    parts = []
    for path in sorted(p for p in clips.rglob("*") if suffix_of(p) in SUFFIXES):
        clip = read_clip(path)
        step = max(1, round(clip.fps / RATE))
        parts.append(dataset.skeletons(clip.points[::step], "midpoint", TILT).x)
    return np.concatenate(parts)


def true_distances(world: World, k: int = 1) -> np.ndarray:
    """Distance of the k-th nearest stored row of each query, (m,).

    Float32 products pick sixteen candidates for each of them, which float64 puts in order.
    """
    squares = np.einsum("ij,ij->i", world.stored, world.stored)
    true = np.empty(len(world.queries))
    for i, z in enumerate(world.queries):
        near = squares - 2.0 * (world.stored @ z)
        some = world.stored[np.argpartition(near, min(16 * k, len(near) - 1))[: 16 * k]]
        true[i] = np.sqrt(np.sort(((some.astype(float) - z) ** 2).sum(axis=1))[k - 1])
    return true


def timed(search: Callable, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray, list]:
    """Processor and wall time of each query [us], and what each call gave.

    The thread's own processor time is what counts on a machine that others use too.
    """
    for z in queries[:50]:
        search(z)
    cpu, wall, found = np.empty(len(queries)), np.empty(len(queries)), []
    for i, z in enumerate(queries):
        began, used = time.perf_counter(), time.thread_time()
        answer = search(z)
        cpu[i], wall[i] = time.thread_time() - used, time.perf_counter() - began
        found.append(answer)
    return cpu * 1e6, wall * 1e6, found


def where() -> dict[str, str]:
    """Robot, threads and commit, for the head of a table."""
    here = Path(__file__).parent
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=here, capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip
    model = platform.processor()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
    return {"machine": f"{model}, {os.cpu_count()} processors", "commit": commit or "unknown"}
