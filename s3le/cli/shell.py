"""What the commands share: refusals in one line, progress bars, and which robot is meant."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from s3le.errors import ParameterError, RobotError, S3leError

if TYPE_CHECKING:  # for the reader; importing it takes a second
    from s3le.human.keypoints.how import How
    from s3le.retarget.stream import Retargeter
    from s3le.robot.robot import Robot

OK, BROKEN, UNREADABLE = 0, 1, 2  # exit status
MARGIN, NECK = 0.002, "midpoint"  # of a robot file, which has neither; see params.yaml
RESOLVED = Path("data/robot")  # what the stage `robot` writes
_ROBOTS = Path("data/robots")


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
        given: a folder that stage `robot` wrote or one that holds it, a robot file, or the name
            of one in data/robots; None: data/robot, or COMAN where there is none.
        margin: clearance of poses [m], for a robot file, which names none.

    Raises:
        RobotError: there is no such robot, or its files are unusable.
    """
    from s3le.robot.robot import SETTINGS, Robot

    if given is None:
        given = str(RESOLVED) if RESOLVED.is_dir() else "coman"
    # The anchor must keep what poses usually do, not whatever an audit asks of others.
    least = MARGIN if margin is None else min(margin, MARGIN)
    path = Path(given)
    for folder in (path, path / "robot"):
        if (folder / SETTINGS).is_file():
            return Robot.read(folder)
    if path.suffix in (".yaml", ".yml"):
        return Robot.adopt(path, least, NECK)
    own = Path(__file__).parents[2] / _ROBOTS
    for folder in (_ROBOTS, own):
        if (folder / f"{given}.yaml").is_file():
            return Robot.adopt(folder / f"{given}.yaml", least, NECK)
    known = sorted({p.stem for folder in (_ROBOTS, own) for p in folder.glob("*.yaml")})
    raise RobotError(
        f"there is no robot '{given}': give a folder with {SETTINGS}, a robot file "
        f"(.yaml), or one of: {', '.join(known) or 'none here'}"
    )


def velocities(given: list[str] | None) -> dict[str, float] | float | None:
    """What `--velocity` says: one limit for all joints, or JOINT=LIMIT, several times [rad/s].

    Raises:
        ParameterError: neither.
    """
    named: dict[str, float] = {}
    for word in given or []:
        joint, _, number = word.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            raise ParameterError(f"--velocity {word}: wanted RAD_S or JOINT=RAD_S") from None
        if not joint and len(given) > 1:
            raise ParameterError("--velocity: one number for all joints, or JOINT=RAD_S for some")
        if not joint:
            return value
        named[joint] = value
    return named or None


def retargeter(model: Path, method: str | None) -> "Retargeter":
    """The retargeter of a folder; says what a user waits for after a fresh installation.

    Raises:
        S3leError: see Retargeter.load.
    """
    from s3le.kernels import compiled
    from s3le.retarget.stream import Retargeter

    if Path(model).is_dir() and not compiled.stored("guard.frame"):
        typer.echo("compiling kernels, once for this installation: about a minute", err=True)
    return Retargeter.load(model, method=method)


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


def names(given: str | None) -> list[str] | None:
    """What `--joints` says: names parted by commas, or a file with one a line."""
    if given is None:
        return None
    if Path(given).is_file():
        return Path(given).read_text(encoding="utf-8").split()
    return [name.strip() for name in given.split(",")]
