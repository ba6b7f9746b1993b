"""Many files: what is finished is kept, what is missing is made, by one process or by many.

A result counts once its sidecar lies beside it; the sidecar names the input, what was asked, the
code, and what the result holds, each by a hash. Whatever ends this process, a result is the old
one, the new one or none, and the next run goes on from there.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, cast

from s3le.errors import CertificateError, S3leError, TrajectoryError
from s3le.guard.clean import Cleaned
from s3le.guard.forced import sentence
from s3le.guard.places import Piece, fingerprint
from s3le.guard.task import Cleaning, Reading, decode, opened
from s3le.motion.fit import Others
from s3le.robot.robot import Robot
from s3le.store import documents, sidecar
from s3le.tuples.engine import key, run
from s3le.tuples.engine.parcel import Refusal
from s3le.tuples.engine.task import Job, Task

FORMAT = "guard 1"
CERTIFIED, MADE, FORCED, BROKEN, REFUSED, UNREADABLE = (
    "certified", "made certified", "forced", "broken", "refused", "unreadable",
)  # fmt: skip
_WHOLE = {
    "frames", "seconds", "episodes", "before", "after", "moved", "certificate", "changed", "holds",
    "notes",
}  # fmt: skip


class Record(NamedTuple):
    """What became of one file."""

    piece: Piece
    status: str  # CERTIFIED: it was so already; MADE; FORCED: but for steps for which given joints
    # leave no way; BROKEN: looked at only; REFUSED; UNREADABLE
    kept: bool  # an earlier run had made it
    summary: dict[str, Any]  # see clean.Guard; empty where there is none
    why: str  # there is no answer, or steps are forced; else empty

    @property
    def good(self) -> bool:
        """Whether there is a motion that holds."""
        return self.status in (CERTIFIED, MADE)


def process(
    pieces: Sequence[Piece],
    robot: Robot,
    cleaning: Callable[[tuple[str, ...], tuple[str, ...]], Cleaning],
    where: run.Where,
    bar: Any = None,
) -> Iterator[Record]:
    """Clean, or look at, many files; yields records in whatever order they get done.

    Args:
        pieces: what is read and where results go.
        robot: of the claim.
        cleaning: makes the task of files and their hashes.
        where: who computes.
        bar: for files that this process computes itself, see Cleaning.clean.

    Raises:
        EngineError: no such executor, or workers were lost; what is finished is kept.
    """
    todo: list[Piece] = []
    hashes: list[str] = []
    asked = cleaning((), ())
    check, own = asked.check, key.fingerprint(_as_task(asked))
    tag = key.key(_as_task(asked), own)
    for piece in pieces:
        try:
            held = fingerprint(piece.source)
        except OSError as error:
            why = f"{piece.source}: {error.strerror or error}"
            yield Record(piece, UNREADABLE, False, {}, why)
            continue
        if not check and (summary := finished(piece, held, tag)):
            yield Record(piece, _status(summary), True, summary, _why(summary))
            continue
        todo.append(piece)
        hashes.append(held)
    task = cleaning(tuple(str(piece.source.absolute()) for piece in todo), tuple(hashes))
    for number, found in _found(task, len(todo), where, own, bar):
        piece = todo[number]
        if isinstance(found, Cleaned) and not check:
            try:
                summary = put(piece, found, robot, task.reading, tag, hashes[number])
                yield Record(piece, _status(summary), False, summary, _why(summary))
                continue
            except CertificateError as error:
                found = Refusal(False, str(error))
            except (S3leError, OSError) as error:
                found = Refusal(True, str(error))
        if isinstance(found, Refusal):
            yield _refused(piece, found, check)
        else:
            status = CERTIFIED if found.summary["holds"] else BROKEN
            yield Record(piece, status, False, found.summary, "")


def _found(
    task: Cleaning, count: int, where: run.Where, own: dict[str, str], bar: Any
) -> Iterator[tuple[int, Cleaned | Refusal]]:
    jobs = [Job(number, 1) for number in range(count)]
    if where.executor == "local" and (where.workers == 1 or count <= 1):
        guard = opened(task.files, task.claim, task.change) if count else None
        for job in jobs:
            assert guard is not None  # there is a job
            yield job.number, task.clean(guard, job.number, bar)
        return
    for made in run.spread(_as_task(task), jobs, where, own):
        yield made.job.number, decode(made.data)


def _as_task(task: Cleaning) -> Task:
    """The same; what is frozen is not settable, as the protocol's fields would be."""
    return cast(Task, task)


def put(
    piece: Piece, found: Cleaned, robot: Robot, reading: Reading, tag: str, held: str
) -> dict[str, Any]:
    """Write a result and, once what lies there is what was proven, what is said of it.

    Args:
        piece: where.
        found: what was proven.
        robot: of the claim.
        reading: how the file was read.
        tag: hash of what was asked and of the code.
        held: hash of the file as it was read.

    Raises:
        TrajectoryError: the file changed meanwhile, or its layout refuses the motion.
        CertificateError: what lies in the result is not what was proven.
        OSError: the disk refuses.
    """
    layout = reading.open(piece.source, robot)
    if fingerprint(piece.source) != held:
        raise TrajectoryError(f"{piece.source}: changed while it was read; run again")
    pairs = zip(layout.episodes, found.q, strict=True)
    q = [one.q if new is None else new for one, new in pairs]
    piece.sidecar.unlink(missing_ok=True)  # nothing is claimed of what is about to be replaced
    piece.target.parent.mkdir(parents=True, exist_ok=True)
    about = {
        "robot": robot.name,
        "robot_hash": robot.digest,
        "certificate": found.summary["certificate"],
    }
    layout.write(piece.target, q, about, found.v)
    written = reading.open(piece.target, robot)
    same = len(written.episodes) == len(q) and all(
        new.q.shape == old.shape
        and (new.q == old).all()
        and (v is None or (new.v is not None and bool((new.v == v).all())))
        and (new.time == one.time).all()
        and _same(new.others, one.others)
        for new, old, v, one in zip(written.episodes, q, found.v, layout.episodes, strict=True)
    )
    if not same:
        piece.withdraw()
        raise CertificateError(
            f"{piece.source}: {piece.target} did not hold the motion that was proven, and was "
            "removed; this is a fault of the layout's writer, please report it"
        )
    summary = found.summary | {
        sidecar.FORMAT: FORMAT,
        "file": piece.name,
        sidecar.INPUT: held,
        sidecar.OUTPUT: fingerprint(piece.target),
        sidecar.TAG: tag,
        "changed": any(new is not None for new in (*found.q, *found.v)),
    }
    documents.write_json(summary, piece.sidecar)
    return summary


def _same(one: Others | None, other: Others | None) -> bool:
    """Do others move the same joints in the same way?"""
    if one is None or other is None:
        return one is other
    return one.joints == other.joints and bool((one.q == other.q).all())


def finished(piece: Piece, held: str, tag: str) -> dict[str, Any] | None:
    """The summary of a result that an earlier run has finished for the same input and code."""
    summary = _said(piece)
    if summary is None or not (summary.get("holds") is True or summary.get("forced")):
        return None
    if not sidecar.answers(summary, held, tag):
        return None
    try:
        return summary if summary[sidecar.OUTPUT] == fingerprint(piece.target) else None
    except OSError:
        return None


def _refused(piece: Piece, found: Refusal, check: bool) -> Record:
    """A refusal; an earlier result of other numbers must not stand in for the missing one."""
    why, said = found.why, None if check else _said(piece)
    if said is not None:
        try:
            own = said[sidecar.OUTPUT] == fingerprint(piece.target)
        except OSError:
            own = False
        if own:
            piece.withdraw()
            why += f"; its earlier result {piece.target} is removed"
    return Record(piece, UNREADABLE if found.unreadable else REFUSED, False, {}, why)


def _said(piece: Piece) -> dict[str, Any] | None:
    return sidecar.read(piece.sidecar, FORMAT, _WHOLE)


def _status(summary: dict[str, Any]) -> str:
    if summary.get("forced"):
        return FORCED
    return MADE if summary["changed"] else CERTIFIED


def _why(summary: dict[str, Any]) -> str:
    return sentence(summary) if summary.get("forced") else ""
