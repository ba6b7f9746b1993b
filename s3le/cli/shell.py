"""What the commands share: refusals in one line, progress bars, and which robot is meant."""

import errno
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from s3le.errors import ModelError, ParameterError, S3leError
from s3le.robot.known import MARGIN

if TYPE_CHECKING:  # for the reader; importing it takes a second
    from s3le.human.keypoints.how import How
    from s3le.retarget.stored import Watch
    from s3le.retarget.stream import Retargeter
    from s3le.robot.robot import Robot

OK, BROKEN, UNREADABLE = 0, 1, 2  # exit status
_ONCE = "once for this machine"
_RESULTS = ("guard", "retarget")  # tables that lie beside motions
RESOLVED = Path("data/robot")  # what the stage `robot` writes


@contextmanager
def guarded() -> Iterator[None]:
    """Turn a refusal into a line and an exit status."""
    try:
        yield
    except S3leError as refusal:
        complain(refusal)
        raise SystemExit(UNREADABLE) from None
    except BrokenPipeError:  # the reader has left, as `| head` does
        sys.stderr.close()
        raise SystemExit(UNREADABLE) from None
    except OSError as refusal:
        complain(refusal)
        raise SystemExit(UNREADABLE) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def complain(refusal: Exception) -> None:
    """One line on stderr."""
    words = str(refusal).replace("\n", " ")
    typer.echo(f"{type(refusal).__name__}: {words}", err=True)


def say(words: str, err: bool = False) -> None:
    """One line that does not run into a progress bar.

    Args:
        words: the line.
        err: on stderr.
    """
    from tqdm import tqdm

    with tqdm.external_write_mode(sys.stderr if err else sys.stdout):
        typer.echo(words, err=err)


def motions(files: list[Path]) -> list[Path]:
    """The files without the tables of results that lie beside them, as `out/*.parquet` meets them.

    Where nothing else is given they stay, for whoever opens them says what they are not.
    """
    from s3le.store.tables import name_of

    others = [path for path in files if name_of(path) in _RESULTS]
    if len(others) == len(files):
        return files
    for path in others:
        say(f"{path}: note: is no motion but the table of results, and passed over", err=True)
    return [path for path in files if path not in others]


@contextmanager
def bar(
    total: int | None, what: str, unit: str = "rows", wait: str = "kernels compile at first use"
) -> Iterator[Callable[[int], object]]:
    """A progress bar on a terminal, nothing elsewhere; yields what takes rows done."""
    from tqdm import tqdm

    with tqdm(
        total=total, desc=what, unit=f" {unit}", file=sys.stderr, disable=None, unit_scale=True
    ) as shown:
        shown.set_postfix_str(wait)

        def advance(rows: int) -> None:
            if shown.n == 0:
                shown.set_postfix_str("", refresh=False)
            shown.update(rows)

        yield advance


def robot(given: str | None, margin: float | None = None) -> "Robot":
    """The robot that is meant.

    Args:
        given: see Robot.load; None: data/robot, or COMAN where there is none.
        margin: clearance of poses [m], for a robot file, which names none.

    Raises:
        RobotError: there is no such robot, or its files are unusable.
    """
    from s3le.robot.robot import Robot

    if given is None:
        given = str(RESOLVED) if RESOLVED.is_dir() else "coman"
    # The anchor must keep what poses usually do, not whatever an audit asks of others.
    return Robot.load(given, MARGIN if margin is None else min(margin, MARGIN))


def warn_of(robot: "Robot") -> None:
    """Say what certificates of a robot leave out of what is drawn of it, if they do."""
    from s3le.safety import covered

    if said := covered.warning(robot):
        say(f"warning: {said}", err=True)


def jerk(told: dict[str, Any]) -> str:
    """What a summary tells of the jerk that was aimed at."""
    beyond = f"{told['beyond']} of {told['of']} steps" if told["beyond"] else "nothing"
    return (
        f"jerk at most {told['largest_rad_s3']:.0f} rad/s^3, {beyond} beyond "
        f"{told['limit_rad_s3']:g}"
    )


def by_joint(given: list[str] | None, option: str, unit: str) -> dict[str, float] | float | None:
    """What an option says of joints: one number for all, or JOINT=NUMBER, several times.

    Args:
        given: the words behind the option.
        option: its name, for a refusal.
        unit: of the numbers, as the option's help calls it.

    Raises:
        ParameterError: neither.
    """
    named: dict[str, float] = {}
    words = given or []
    for word in words:
        joint, _, number = word.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            raise ParameterError(f"{option} {word}: wanted {unit} or JOINT={unit}") from None
        if not joint and len(words) > 1:
            raise ParameterError(f"{option}: one number for all joints, or JOINT={unit} for some")
        if not joint:
            return value
        named[joint] = value
    return named or None


class Meant(NamedTuple):
    """A retargeter, and where its poses come from."""

    retargeter: "Retargeter"
    about: dict[str, Any]  # for a motion's metadata
    line: str  # for a person


def retargeter(
    model: Path | None, method: str | None, given: str | None, streams: bool = False
) -> Meant:
    """The retargeter that is meant; shows on stderr what a user waits for at first.

    Args:
        model: folder that stage `export` wrote; None: poses made for the robot by itself.
        method: refuse any other method of look-up.
        given: the robot, see `robot`; None: the model's.
        streams: it is to follow a stream; False: files.

    Raises:
        ModelError: the model is for another robot, or there is none and the method needs one.
        S3leError: see Retargeter.load and stored.retargeter_for.
    """
    from s3le.kernels import compiled
    from s3le.plan import steps, whole
    from s3le.retarget import exported, stored
    from s3le.retarget.stream import Retargeter

    if model is None:
        if method not in (None, stored.METHOD):
            raise ModelError(
                f"look-up by '{method}' takes a model that the pipeline trained: --model FOLDER; "
                f"without one poses are found by '{stored.METHOD}'"
            )
        it = robot(given)
        with _watched(it.name) as watch:
            made = stored.retargeter_for(it, watch=watch, streams=streams)
        line = (
            f"robot {it.name} ({it.description.source}), {stored.ROWS:,} stored poses, found by "
            f"the skeleton itself: {stored.folder(it)}"
        )
        return Meant(made, {"model": None} | stored.about(it), line)
    if Path(model).is_dir() and not compiled.stored(steps.SLOWEST if streams else whole.SLOWEST):
        typer.echo(f"compiling kernels, {_ONCE}: about a minute", err=True)
    made = Retargeter.load(model, method=method)
    own = made.robot
    if given not in (None, own.name) and robot(given).digest != own.digest:
        raise ModelError(f"{model} is for robot '{own.name}', not '{given}'")
    found = exported.method(model)
    about = {"model": str(model), "method": found}
    return Meant(made, about, f"robot {own.name}, model {model}, poses found by {found}")


@contextmanager
def _watched(name: str) -> "Iterator[Watch]":
    """Bars for what is done once: on a terminal they move, elsewhere a line says it."""
    from tqdm import tqdm

    words = {
        "kernels": f"compiling kernels, {_ONCE}, about a minute",
        "poses": f"making the poses of {name}, {_ONCE}",
    }
    bars: dict[str, tqdm] = {}
    with ExitStack() as stack:

        def watch(what: str, more: int, total: int) -> None:
            if what not in bars:
                if not sys.stderr.isatty():
                    typer.echo(words[what], err=True)
                bars[what] = stack.enter_context(
                    tqdm(
                        total=total, desc=words[what], unit=f" {what}", file=sys.stderr,
                        disable=None, position=len(bars), unit_scale=what == "poses",
                    )
                )  # fmt: skip
            bars[what].total = total
            bars[what].update(more)

        yield watch


def how(
    layout: str | None,
    axes: str | None,
    pitch: float | None,
    person: int | None,
    confidence: float | None,
    animation: str | None,
    names: Path | None,
) -> "How":
    """What the command line says about how a clip is to be read.

    Raises:
        ParameterError: a value is out of its range.
    """
    from s3le.human.keypoints.how import How
    from s3le.human.namesmap import read_names

    named = None if names is None else read_names(names)
    return How(layout, axes, pitch, person, confidence, animation, named).check()


def given(said: str | None, robot: "Robot") -> tuple[str, ...]:
    """Which joints others move, as s3le.motion.fit takes it.

    Args:
        said: what `--given` says: names parted by commas, all, none; None: nothing.
        robot: its file may say it too.
    """
    from s3le.motion.fit import MOVING

    if said is None:
        return robot.description.given or (MOVING,)
    named = tuple(name.strip() for name in said.split(",") if name.strip())
    return () if named in ((), ("none",)) else named


def names(given: str | None) -> list[str] | None:
    """What `--joints` says: names parted by commas, or a file with one a line."""
    if given is None:
        return None
    try:
        if Path(given).is_file():
            return Path(given).read_text(encoding="utf-8").split()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:  # as the names of 29 joints are
            raise
    return [name.strip() for name in given.split(",")]
