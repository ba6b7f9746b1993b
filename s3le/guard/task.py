"""The cleaning of many files as a task of the engine: a worker computes, the caller writes.

A worker opens the file itself, so all machines must see it under the same path; what it found
travels back as plain arrays and JSON.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, NamedTuple

from s3le.errors import CertificateError, S3leError, TrajectoryError
from s3le.guard.claim import Claim
from s3le.guard.clean import Cleaned, Guard, Progress
from s3le.guard.layouts.door import open_layout
from s3le.guard.layouts.episode import Layout
from s3le.guard.places import fingerprint
from s3le.robot.robot import Files, Robot
from s3le.robot.wholebody import with_joints
from s3le.tuples.engine import parcel
from s3le.tuples.engine.parcel import Refusal
from s3le.tuples.engine.task import Job, Made


class Reading(NamedTuple):
    """How files are read; see layouts.door.open_layout."""

    fps: float | None = None
    joints: tuple[str, ...] | None = None
    degrees: bool = False
    column: str | None = None
    given: tuple[str, ...] = ()  # joints that others move, see motion.fit
    straight: bool = False  # see layouts.door.open_layout

    def open(self, path: Any, robot: Robot) -> Layout:
        """Read a file.

        Raises:
            TrajectoryError: as open_layout.
        """
        return open_layout(path, robot, **self._asdict())


@dataclass(frozen=True, kw_only=True)
class Cleaning:
    """Cleaning of files, one a shard."""

    table: str = "guard"
    module: str = "s3le.guard.task"
    shard_rows: int = 1
    files: Files  # of the robot
    claim: Claim
    reading: Reading
    check: bool  # look only
    sources: tuple[str, ...]  # paths
    hashes: tuple[str, ...]  # of what they hold
    change: tuple[str, ...] = ()  # joints beyond the robot file's that may be changed too

    def about(self) -> Mapping[str, Any]:
        """What can change a result beside the file, code and machine; see engine.task."""
        made = opened(self.files, self.claim, self.change).robot
        return {
            "table": self.table,
            "robot": made.tag,
            "claim": asdict(self.claim),
            "reading": self.reading._asdict(),
        }

    def note(self) -> Mapping[str, Any]:
        """Nothing: these shards are no table's."""
        return {}

    def make(self, job: Job) -> Made:
        """Clean one file; see engine.task. What it is refused for is a result too."""
        guard = opened(self.files, self.claim, self.change)
        return Made(job, encode(self.clean(guard, job.number)), {})

    def clean(self, guard: Guard, number: int, bar: Any = None) -> Cleaned | Refusal:
        """Clean or look at one file.

        Args:
            guard: of this robot and claim.
            number: of the file.
            bar: takes the layout, gives a context that yields a Progress; None: none.
        """
        source = self.sources[number]
        try:
            layout = self.reading.open(source, guard.robot)
            if fingerprint(layout.path) != self.hashes[number]:
                raise TrajectoryError(f"{source}: changed while it was read; run again")
            if bar is None:
                return self._clean(guard, layout, None)
            with bar(layout) as progress:
                return self._clean(guard, layout, progress)
        except CertificateError as refusal:
            return Refusal(False, str(refusal))
        except (S3leError, OSError) as refusal:
            return Refusal(True, str(refusal))

    def _clean(self, guard: Guard, layout: Layout, progress: Progress | None) -> Cleaned:
        how = guard.survey if self.check else guard.clean
        return how(layout, self.reading.degrees, progress)


@cache
def opened(files: Files, claim: Claim, change: tuple[str, ...] = ()) -> Guard:
    """The robot and its planner, made once in a process.

    Args:
        files: of the robot.
        claim: what is asked.
        change: joints beyond the robot file's that are ours too.
    """
    robot = Robot.from_bytes(files)
    return Guard(with_joints(robot, change) if change else robot, claim)


def encode(found: Cleaned | Refusal) -> bytes:
    """What was found as bytes."""
    if isinstance(found, Refusal):
        return parcel.pack({"refusal": found._asdict()}, {})
    tree = {"summary": found.summary, "episodes": len(found.q)}
    held = {f"q{i}": q for i, q in enumerate(found.q) if q is not None}
    held |= {f"v{i}": v for i, v in enumerate(found.v) if v is not None}
    return parcel.pack(tree, held)


def decode(data: bytes) -> Cleaned | Refusal:
    """What `encode` made bytes of."""
    tree, arrays = parcel.unpack(data)
    if "refusal" in tree:
        return Refusal(**tree["refusal"])
    q, v = ([arrays.get(f"{key}{i}") for i in range(tree["episodes"])] for key in "qv")
    return Cleaned(q, tree["summary"], v)
