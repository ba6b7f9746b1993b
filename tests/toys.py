"""A task for the engine that needs no robot: plain data, so that spawned workers can read it."""

import hashlib
import os
import signal
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from s3le.errors import RobotError
from s3le.tuples.engine.task import Job, Made


@dataclass(frozen=True, kw_only=True)
class Toy:
    """Rows of text; may be slow, may die, may refuse."""

    table: ClassVar[str] = "toy"
    module: ClassVar[str] = "toys"
    shard_rows: int = 10
    seed: int = 1
    seconds: float = 0.0  # that a shard takes
    quick: int = -1  # number of the shard that takes no time
    dies_in: str = ""  # folder; each shard kills its worker once, as long as it is not noted there
    always_dies: bool = False
    refuses: int = -1  # number of the shard that is refused

    def about(self):
        return {"table": self.table, "seed": self.seed, "shard_rows": self.shard_rows}

    def note(self):
        return {"table": self.table, "robot": "none"}

    def make(self, job: Job) -> Made:
        if job.number != self.quick:
            time.sleep(self.seconds)
        if self.always_dies:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.dies_in:
            mark = Path(self.dies_in) / str(job.number)
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        if job.number == self.refuses:
            raise RobotError(f"shard {job.number} is refused")
        rows = [
            hashlib.sha256(f"{self.seed} {job.number} {k}".encode()).hexdigest()
            for k in range(job.rows)
        ]
        return Made(job, "\n".join(rows).encode(), {"rows": job.rows, "tenths": job.rows * 0.1})

    def words(self) -> list[str]:
        """This task as arguments of the program below."""
        return [f"{name}={value}" for name, value in asdict(self).items()]


def main(words: list[str]) -> None:
    """Make a toy table: toys.py OUT ROWS WORKERS [name=value ...]."""
    from s3le.tuples.engine import run

    kinds = {name: type(value) for name, value in asdict(Toy()).items()}
    given = dict(word.split("=") for word in words[3:])
    toy = Toy(
        **{
            name: value == "True" if kinds[name] is bool else kinds[name](value)
            for name, value in given.items()
        }
    )
    where = run.Where(workers=int(words[2]))
    out = Path(words[0])
    run.produce(toy, int(words[1]), out, where, lambda *_: None, print, out.parent / "shelf")


if __name__ == "__main__":
    import sys

    import toys  # so that workers know the task by the name they can import

    toys.main(sys.argv[1:])
