"""Many clips: what is finished is kept, what is missing is made, by one process or by many.

A result counts once its summary lies beside it; the summary names the clip, what was asked, the
code, and each file of the result, by hashes. Whatever ends this process, a file is the old one,
the new one or none, and the next run goes on from there.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from s3le.errors import S3leError
from s3le.guard.forced import sentence
from s3le.human.clip import clip_name
from s3le.human.origin import CLIP, CLIP_HASH, about_clip
from s3le.human.read import fingerprint
from s3le.retarget import clips, outputs
from s3le.retarget.clips import CERTIFIED, FORCED, REFUSED, UNREADABLE, Record
from s3le.retarget.outputs import Shape
from s3le.retarget.stream import Retargeter
from s3le.retarget.task import Answer, Bar, Retargeting, decode, why
from s3le.robot.robot import Robot
from s3le.store import sidecar
from s3le.tuples.engine import key, local
from s3le.tuples.engine.parcel import Refusal
from s3le.tuples.engine.task import Job, Task

FORMAT = "retarget 1"


class _Todo(NamedTuple):
    """A clip that is to be retargeted."""

    path: Path
    file: str  # the same, from the folder of results
    origin: dict[str, str]  # what a motion says of it
    held: str  # hash of all that it is read from


def process(
    paths: Sequence[Path],
    out: Path,
    its: Retargeter,
    shape: Shape,
    task: Retargeting,
    *,
    workers: int = 1,
    again: bool = False,
    bar: Bar | None = None,
) -> Iterator[Record]:
    """Retarget many clips; yields records in whatever order they get done.

    Args:
        paths: of the clips; no two have one name.
        out: folder of the results.
        its: what leads; other processes make their own, task.lead.
        shape: what is written.
        task: what is asked, of no clip yet.
        workers: processes; with one, or one clip, this process computes.
        again: keep nothing.
        bar: for clips that this process computes itself, see Retargeting.answer.

    Raises:
        EngineError: workers were lost; what is finished is kept.
        S3leError: a worker cannot make its retargeter.
    """
    own = key.fingerprint(_as_task(task))
    tag = key.key(_as_task(task), own)
    todo: list[_Todo] = []
    for path in paths:
        file = Path(os.path.relpath(path, out)).as_posix()
        try:
            origin = about_clip(path, out)
            one = _Todo(path, file, origin, fingerprint(path, origin[CLIP_HASH]))
        except OSError as error:
            yield Record(path, file, UNREADABLE, False, {}, why(path, error))
            continue
        summary = None if again else finished(one, out, shape, tag)
        if summary is None:
            todo.append(one)
        else:
            yield _found(path, file, True, summary)
    task = replace(
        task,
        sources=tuple(str(one.path) for one in todo),
        hashes=tuple(one.held for one in todo),
        origins=tuple(one.origin for one in todo),
    )
    for number, answer in _answers(task, its, workers, own, bar):
        yield _record(todo[number], answer, its.robot, out, shape, tag)


def _answers(
    task: Retargeting, its: Retargeter, workers: int, own: dict[str, str], bar: Bar | None
) -> Iterator[tuple[int, Answer]]:
    jobs = [Job(number, 1) for number in range(len(task.sources))]
    if min(workers, len(jobs)) <= 1:
        for job in jobs:
            yield job.number, decode(task.answer(its, job.number, bar))
        return
    for made in local.make(_as_task(task), jobs, workers, own):
        yield made.job.number, decode(made.data)


def _as_task(task: Retargeting) -> Task:
    """The same; what is frozen is not settable, as the protocol's fields would be."""
    return cast(Task, task)


def _record(one: _Todo, answer: Answer, robot: Robot, out: Path, shape: Shape, tag: str) -> Record:
    """Write what became of a clip; a clip that cannot be written does not stop the others."""
    found = answer.found
    if not isinstance(found, Refusal):
        about = {sidecar.FORMAT: FORMAT, sidecar.INPUT: one.held, sidecar.TAG: tag}
        try:
            summary = outputs.write(found, robot, out, shape, about).summary
            return _found(one.path, one.file, False, summary, answer.notes)
        except (S3leError, OSError) as error:
            found = Refusal(True, why(one.path, error))
    words = found.why
    if _said(one.path, out) is not None:
        words += f"; its earlier result in {out} stays, of another clip or other options"
    status = UNREADABLE if found.unreadable else REFUSED
    return Record(one.path, one.file, status, False, {}, words, answer.notes)


def _found(
    path: Path, file: str, kept: bool, summary: dict[str, Any], notes: tuple[str, ...] = ()
) -> Record:
    """A clip that has a result."""
    if summary.get("forced"):
        return Record(path, file, FORCED, kept, summary, sentence(summary), notes)
    return Record(path, file, CERTIFIED, kept, summary, "", notes)


def finished(one: _Todo, out: Path, shape: Shape, tag: str) -> dict[str, Any] | None:
    """The summary of a result that an earlier run has finished for the same clip and code."""
    said = _said(one.path, out)
    if said is None or not sidecar.answers(said, one.held, tag):
        return None
    if said[CLIP] != one.origin[CLIP]:
        return None  # its motion would lead to where the clip lay
    names = shape.files(clip_name(one.path))
    try:
        held = {name: sidecar.digest(out / name) for name in names}
    except OSError:
        return None
    return said if said[sidecar.OUTPUT] == held else None


def _said(path: Path, out: Path) -> dict[str, Any] | None:
    """What the summary of a clip says, if it is one of ours and whole."""
    said = sidecar.read(out / outputs.summary_of(clip_name(path)), FORMAT, (CLIP, "certificate"))
    try:
        if said is None:
            return None
        if said["certificate"]["holds"] is not True and not said.get("forced"):
            return None
        clips.row(Record(path, "", CERTIFIED, True, said, ""))
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    return said
