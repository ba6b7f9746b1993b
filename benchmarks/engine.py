"""What a large table of tuples costs: rows a second, memory of all processes, bytes on disk.

    python benchmarks/engine.py [--rows 1000000] [--shard-rows 10000] [--workers 0] [--folder DIR]

The table is made in a folder of its own and removed at the end unless --keep is given; with --keep
a run that was stopped goes on where it was.
"""

import shutil
import tempfile
import threading
import time
from pathlib import Path
from typing import Annotated

import psutil
import typer
from tqdm import tqdm

from s3le.robot.robot import Robot
from s3le.tuples.engine import run
from s3le.tuples.samplers import SAMPLERS
from s3le.tuples.shards import TupleShards

EVERY = 0.5  # [s] between two looks at the memory


class Memory(threading.Thread):
    """The most memory that this process and its workers held at once."""

    def __init__(self) -> None:
        """Start looking."""
        super().__init__(daemon=True)
        self.peak, self.ended = 0, threading.Event()
        self.start()

    def run(self) -> None:
        """Look at the whole family now and then; shared pages count once for each process."""
        me = psutil.Process()
        while not self.ended.wait(EVERY):
            held = 0
            for process in [me, *me.children(recursive=True)]:
                try:
                    held += process.memory_info().rss
                except psutil.NoSuchProcess:
                    continue
            self.peak = max(self.peak, held)


def main(
    rows: Annotated[int, typer.Option(help="tuples to make")] = 1_000_000,
    shard_rows: Annotated[int, typer.Option(help="rows of a shard")] = 10_000,
    workers: Annotated[int, typer.Option(help="processes; 0: all processors")] = 0,
    sampler: Annotated[str, typer.Option(help=", ".join(SAMPLERS))] = "uniform",
    alpha: Annotated[float, typer.Option(help="relaxation of the joint ranges [-]")] = 0.2,
    robot: Annotated[Path, typer.Option(help="robot file")] = Path("s3le/robots/coman.yaml"),
    margin: Annotated[float, typer.Option(help="clearance to keep [m]")] = 0.002,
    folder: Annotated[Path | None, typer.Option(help="where; a temporary one if none")] = None,
    keep: Annotated[bool, typer.Option(help="leave the table there")] = False,
) -> None:
    """Make the table as stage `sample` does; print what it took."""
    folder = Path(tempfile.mkdtemp(prefix="engine-")) if folder is None else folder
    Robot.from_file(robot, margin, "midpoint").write(folder / "robot")
    task = TupleShards(
        files=Robot.read(folder / "robot").to_bytes(),
        seed=7,
        shard_rows=shard_rows,
        sampler=sampler,
        alpha=alpha,
        renormalise_mix=False,
    )
    memory, began = Memory(), time.perf_counter()
    with tqdm(total=rows, unit=" rows", unit_scale=True, disable=None) as bar:
        counts = run.produce(
            task, rows, folder / "table", run.Where(workers=workers),
            lambda done, _: bar.update(done), print, folder / "shards",
        )  # fmt: skip
    took = time.perf_counter() - began
    memory.ended.set()
    size = sum(path.stat().st_size for path in (folder / "table").iterdir())
    print(f"{rows:,} tuples in {took:,.0f} s: {rows / took:,.0f} a second, certified and written")
    print(f"memory of all processes together, at most: {memory.peak / 2**30:.2f} GiB")
    print(f"on disk: {size / 2**30:.2f} GiB, {size / rows:.0f} bytes a row")
    print(f"needed the fallback: {counts['fallback'] / rows:.4%}")
    if not keep:
        shutil.rmtree(folder)


if __name__ == "__main__":
    typer.run(main)
