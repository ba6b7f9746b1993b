"""What `view` and `render` share: which motions, which robots, which human."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

from s3le.cli import shell
from s3le.errors import ParameterError, RobotError

if TYPE_CHECKING:
    from s3le.human.keypoints.how import How
    from s3le.robot.robot import Robot
    from s3le.show.motions import Human, Shown

NOBODY = "none"  # what --human says to show none


class Loaded(NamedTuple):
    """Everything that the command line named."""

    motions: "list[Shown]"
    human: "Human | None"


def load(
    files: list[Path],
    human: str | None,
    robot: str | None,
    rate: float | None,
    joints: str | None,
    degrees: bool,
    how: "How | None" = None,
) -> Loaded:
    """Read what is to be shown; says on stderr what a person should know about it.

    Args:
        files: motions.
        human: a clip, NOBODY, or None: the clip that the first motion says it was made from.
        robot: see shell.robot; None: for each file the one it was made for, where it is known.
        rate, joints, degrees: of the files, see trajectory.files.read and trajectory.fit.
        how: what is known of the human's keypoints; nothing: as the motion says.

    Raises:
        S3leError: a file, the robot or the clip cannot be used.
    """
    from s3le.show import motions

    names = shell.names(joints)
    usual = shell.robot(robot)
    shown = []
    for path in shell.motions(files):
        one = _read(path, usual, robot is None, rate, names, degrees)
        for note in one.notes:
            typer.echo(f"{path}: note: {note}", err=True)
        shown.append(one)
    shown = motions.named(shown)
    if human == NOBODY:
        return Loaded(shown, None)
    clip, words = (Path(human), "") if human else motions.recorded_clip(shown[0])
    if words:
        typer.echo(f"note: {words}", err=True)
    for one in shown[1:] if clip and not human else []:
        other, _ = motions.recorded_clip(one)
        if clip and other and other.resolve() != clip.resolve():
            typer.echo(f"note: the human is {clip}; {one.path} was made from {other}", err=True)
    return Loaded(shown, motions.human(clip, shown[0], how) if clip else None)


def _read(
    path: Path,
    usual: "Robot",
    may_choose: bool,
    rate: float | None,
    names: list[str] | None,
    degrees: bool,
) -> "Shown":
    """One motion, of the usual robot or of the one that the file names."""
    from s3le.motion import files
    from s3le.show import motions

    trajectory = files.read(path, rate, names)
    if may_choose:
        about = trajectory.about
        made_for = about.get("robot_hash")
        if made_for not in (None, usual.digest):
            try:
                other = shell.robot(str(about.get("robot")))
            except RobotError:
                pass  # not known here; the reader says what does not fit
            else:
                if other.digest == made_for:
                    usual = other
    return motions.of(trajectory, path, usual, degrees)


def camera(given: str | None) -> tuple[float, float] | None:
    """What `--camera` says: azimuth and elevation [deg].

    Raises:
        ParameterError: neither a word nor one or two numbers in their ranges.
    """
    if given is None:
        return None
    if given in VIEWS:
        return VIEWS[given]
    try:
        numbers = [float(word) for word in given.split(",")]
        azimuth, elevation = numbers if len(numbers) == 2 else (numbers[0], 14.0)
        good = len(numbers) <= 2 and -360.0 <= azimuth <= 360.0 and 5.0 <= elevation <= 89.0
    except ValueError:
        good = False
    if not good:
        raise ParameterError(
            f"--camera {given}: wanted AZIMUTH or AZIMUTH,ELEVATION in degrees (from -360 to 360, "
            f"from 5 to 89), or one of {', '.join(VIEWS)}"
        )
    return azimuth, elevation


VIEWS = {"front": (0.0, 10.0), "left": (90.0, 10.0), "right": (-90.0, 10.0), "above": (0.0, 75.0)}
