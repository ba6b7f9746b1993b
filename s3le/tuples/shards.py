"""The two tables that the engine makes, shard by shard: kinematic tuples and robot poses.

A shard is drawn from its own random stream, projected, certified by coal and encoded; it depends
on nothing but its task and its number. Fewer rows of it are the first rows of the whole.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from s3le import rng
from s3le.kernels import batch
from s3le.robot.certificate import Certifier
from s3le.robot.robot import Files, Robot
from s3le.store import tables
from s3le.tuples import samplers, sampling
from s3le.tuples.certified import certificate, projection_counts
from s3le.tuples.engine.task import Job, Made
from s3le.tuples.tables import HOW, kinematic_pairs, robot_poses


@cache
def _opened(files: Files) -> tuple[Robot, Certifier]:
    """The robot and its checker, read once in a process."""
    made = Robot.from_bytes(files)
    return made, made.certifier()


@dataclass(frozen=True, kw_only=True)
class _Shards:
    """What both kinds share."""

    module: ClassVar[str] = "s3le.tuples.shards"
    table: ClassVar[str]
    stage: ClassVar[str]
    files: Files
    seed: int  # root of every random stream
    shard_rows: int

    def about(self) -> Mapping[str, Any]:
        """What can change a row beside code and machine; see engine.task."""
        parameters = {name: value for name, value in asdict(self).items() if name != "files"}
        robot = {name: hashlib.sha256(data).hexdigest() for name, data in self.files}
        return {"table": self.table, "robot": robot} | parameters

    def note(self) -> Mapping[str, Any]:
        """What the manifest says; nothing in it changes where the rows do not."""
        made, _ = _opened(self.files)
        parameters = {name: value for name, value in asdict(self).items() if name != "files"}
        return {"table": self.table, "robot": made.tag, "parameters": parameters}

    def _rows(self, job: Job) -> np.ndarray:
        first = job.number * self.shard_rows
        return np.arange(first, first + job.rows, dtype=np.int32)


@dataclass(frozen=True, kw_only=True)
class TupleShards(_Shards):
    """Shards of table kinematic_pairs (Sec. IV-C)."""

    table: ClassVar[str] = "kinematic_pairs"
    stage: ClassVar[str] = "sample"
    sampler: str  # samplers.SAMPLERS
    alpha: float  # relaxation of the joint ranges [-]
    renormalise_mix: bool  # give the bones of x' unit length
    projection: str = "nearest"  # kernels.batch.PROJECTIONS

    def make(self, job: Job) -> Made:
        """Draw relaxed poses, project them, certify, mix; see engine.task.

        Raises:
            CertificateError: a projected pose is not feasible by the independent check.
        """
        it, checker = _opened(self.files)
        low, high = sampling.relaxed_limits(it.lower, it.upper, self.alpha)
        stream = rng.stream(self.seed, self.stage, job.number)
        first = job.number * self.shard_rows
        q_relaxed = samplers.draw(self.sampler, it, low, high, first, job.rows, stream, self.seed)
        mix = rng.stream(self.seed, "mix", job.number).uniform(0.0, 1.0, job.rows)
        project = sampling.projector(it, self.projection)
        drawn = sampling.tuples(it, q_relaxed, mix, self.renormalise_mix, project)
        columns = {
            "row": self._rows(job),
            "mix": drawn.mix,
            "x_mixed": drawn.x_mixed,
            "x_relaxed": drawn.x_relaxed,
            "x_feasible": drawn.x_feasible,
            "q_relaxed": drawn.q_relaxed,
            "q_feasible": drawn.q_feasible,
            "projection": np.array(HOW)[drawn.how],
        } | certificate(it, drawn.q_feasible, checker=checker)
        table = kinematic_pairs(it.n_dof, it.margin)
        counts = projection_counts(it, q_relaxed, batch.Projection(drawn.q_feasible, drawn.how))
        return Made(job, tables.encode(columns, table, it.tag), counts)


@dataclass(frozen=True, kw_only=True)
class PoseShards(_Shards):
    """Shards of table robot_poses, the robot domain D_Y (Sec. III)."""

    table: ClassVar[str] = "robot_poses"
    stage: ClassVar[str] = "poses"

    def make(self, job: Job) -> Made:
        """Draw feasible poses and certify them; see engine.task.

        Raises:
            RobotError: hardly any pose is feasible.
            CertificateError: a pose is not feasible by the independent check.
        """
        it, checker = _opened(self.files)
        stream = rng.stream(self.seed, self.stage, job.number)
        q, accepted, drawn = sampling.draw_feasible(it, job.rows, stream)
        columns = {
            "row": self._rows(job),
            "q": q,
            "x": batch.skeletons(it.chain, q),
        } | certificate(it, q, checker=checker)
        data = tables.encode(columns, robot_poses(it.n_dof, it.margin), it.tag)
        return Made(job, data, {"rows": job.rows, "accepted": accepted, "drawn": drawn})
