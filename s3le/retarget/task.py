"""The retargeting of many clips as a task of the engine: a worker computes, the caller writes.

A worker reads a clip itself; what became of it travels back as plain arrays and JSON.
"""

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import BundleError, ClipError, S3leError
from s3le.human.keypoints.how import How
from s3le.human.origin import CLIP_HASH
from s3le.human.read import digest, fingerprint
from s3le.human.skeletons import TILT_MAX, ClipFrames, read_frames, refuse_minority
from s3le.motion import trajectory
from s3le.motion.trajectory import Placed
from s3le.retarget import among, exported, others, stored
from s3le.retarget.clip import Result, convert
from s3le.retarget.others import Other
from s3le.retarget.stream import Retargeter
from s3le.robot.robot import Files, Robot
from s3le.tuples.engine import parcel
from s3le.tuples.engine.parcel import Refusal
from s3le.tuples.engine.task import Job, Made
from s3le.types import Progress

_COLUMNS = ("time", "q", "clearance", "mode", "heading", "v")  # of a motion
Bar = Callable[[ClipFrames], AbstractContextManager[Progress | None]]


class Asked(NamedTuple):
    """What is asked of every clip; see read_frames, refuse_minority and convert."""

    fps: float | None = None
    tilt_max: float = TILT_MAX
    how: How = How()
    minority: bool = False  # a clip of which most frames are left out is taken too
    rate: float | None = None
    even: bool = False
    lead_in: float = 0.0
    others: Other | None = None  # the file whose joints, root and rows the motion has
    jerk: float | None = None  # that is aimed at [rad/s^3]; None: as the retargeter's settings say

    def about(self) -> dict[str, Any]:
        """As JSON."""
        others = None if self.others is None else self.others.about()
        return self._asdict() | {"how": self.how._asdict(), "others": others}


class Lead(NamedTuple):
    """Who leads the robot: plain data, from which each process makes its own retargeter."""

    files: Files  # of the robot
    model: str | None  # folder of a retargeter; None: poses that are made for the robot
    method: str | None  # refuse any other
    digest: str | None  # of the model

    @classmethod
    def of(cls, robot: Robot, model: Path | None, method: str | None) -> "Lead":
        """What leads a robot.

        Raises:
            BundleError: the model cannot be read.
        """
        if model is None:
            return cls(robot.to_bytes(), None, None, None)
        return cls((), str(model), method, exported.digest(model))


class Answer(NamedTuple):
    """What became of one clip."""

    found: Result | Refusal
    notes: tuple[str, ...]  # what was assumed of it, for people


@dataclass(frozen=True, kw_only=True)
class Retargeting:
    """Retargeting of clips, one a shard."""

    table: str = "retarget"
    module: str = "s3le.retarget.many"  # which also writes what is made here
    shard_rows: int = 1
    robot: str  # its tag (Robot.tag)
    lead: Lead
    asked: Asked
    words: Mapping[str, Any]  # that every motion says of itself: model, method, poses
    written: Mapping[str, Any]  # which files, outputs.Shape.about
    sources: tuple[str, ...] = ()  # paths
    hashes: tuple[str, ...] = ()  # of all that they are read from (human.read.fingerprint)
    origins: tuple[Mapping[str, str], ...] = ()  # what each motion says of its clip (human.origin)

    def __hash__(self) -> int:
        """By value, for the engine keeps its fingerprint under it."""
        return hash((self.robot, self.sources, self.hashes))

    def about(self) -> Mapping[str, Any]:
        """What can change a result beside the clip, code and machine; see engine.task."""
        return {
            "table": self.table,
            "robot": self.robot,
            "model": self.lead.digest,
            "words": dict(self.words),
            "asked": self.asked.about(),
            "written": dict(self.written),
        }

    def note(self) -> Mapping[str, Any]:
        """Nothing: these shards are no table's."""
        return {}

    def make(self, job: Job) -> Made:
        """Retarget one clip; see engine.task. What it is refused for is a result too."""
        return Made(job, self.answer(opened(self.lead), job.number), {})

    def answer(self, its: Retargeter, number: int, bar: Bar | None = None) -> bytes:
        """Retarget one clip.

        Args:
            its: what leads.
            number: of the clip.
            bar: takes the frames, gives a context that yields what takes frames done; None: none.

        Returns:
            What `decode` takes.
        """
        source = Path(self.sources[number])
        notes: tuple[str, ...] = ()
        try:
            frames = read_frames(
                source, its.robot.neck, self.asked.tilt_max, self.asked.fps, how=self.asked.how
            )
            own = digest(source)
            now = (own, fingerprint(source, own))
            if now != (self.origins[number][CLIP_HASH], self.hashes[number]):
                raise ClipError(f"{source}: changed while it was read; run again")
            if not self.asked.minority:
                refuse_minority(source, frames)
            notes = frames.reading.told if frames.reading else ()
            about = {**self.words, **self.origins[number]}
            if self.asked.jerk is not None:
                its = its.gentler(self.asked.jerk)
            if (other := self.asked.others) is not None:
                read = others.read(other, its.robot)
                notes = (*notes, *read.notes, *among.told(frames, read, other.offset))
                with bar(frames) if bar else nullcontext() as progress:
                    made = among.convert_among(
                        its, frames, read, other, about=about, progress=progress
                    )
                return encode(Answer(made, notes))
            with bar(frames) if bar else nullcontext() as progress:
                made = convert(
                    its, frames, rate=self.asked.rate, even=self.asked.even,
                    lead_in=self.asked.lead_in, about=about, progress=progress,
                )  # fmt: skip
            return encode(Answer(made, notes))
        except (S3leError, OSError) as error:
            unreadable = isinstance(error, (ClipError, OSError))
            return encode(Answer(Refusal(unreadable, why(source, error)), notes))


def why(clip: Path, error: Exception) -> str:
    """An error's words, behind the clip that it is about."""
    words = (isinstance(error, OSError) and error.strerror) or str(error)
    words = words.replace("\n", " ")
    return words if words.startswith(str(clip)) else f"{clip}: {words}"


@cache
def opened(lead: Lead) -> Retargeter:
    """The retargeter, made once in a process.

    Raises:
        BundleError: the model is another by now.
        S3leError: see Retargeter.load and stored.retargeter_for.
    """
    if lead.model is None:
        its = stored.retargeter_for(Robot.from_bytes(lead.files))
    else:
        its = Retargeter.load(Path(lead.model), method=lead.method)
        if exported.digest(Path(lead.model)) != lead.digest:
            raise BundleError(f"{lead.model}: changed while clips were retargeted; run again")
    its.warm_up_plan()  # so that no clip is said to have taken the time for it
    return its


def encode(answer: Answer) -> bytes:
    """What became of a clip, as bytes.

    Raises:
        EngineError: its summary is no JSON.
    """
    tree: dict[str, Any] = {"notes": list(answer.notes)}
    if isinstance(answer.found, Refusal):
        return parcel.pack(tree | {"refusal": answer.found._asdict()}, {})
    motion, summary = answer.found
    tree |= {
        "name": motion.name, "joints": motion.joints, "about": motion.about, "summary": summary,
    }  # fmt: skip
    columns = {name: getattr(motion, name) for name in _COLUMNS}
    if motion.root is not None:
        columns |= motion.root._asdict()
    return parcel.pack(tree, {name: each for name, each in columns.items() if each is not None})


def decode(data: bytes) -> Answer:
    """What `encode` made bytes of."""
    tree, arrays = parcel.unpack(data)
    notes = tuple(tree["notes"])
    if "refusal" in tree:
        return Answer(Refusal(**tree["refusal"]), notes)
    motion = trajectory.make(
        tree["name"], tree["joints"], arrays["time"], arrays["q"], arrays.get("clearance"),
        arrays.get("mode"), tree["about"], heading=arrays.get("heading"), v=arrays.get("v"),
    )  # fmt: skip
    if "turn" in arrays:
        motion = dataclasses.replace(motion, root=Placed(arrays["position"], arrays["turn"]))
    return Answer(Result(motion, tree["summary"]), notes)
