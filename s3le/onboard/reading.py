"""A robot as somebody wrote it, whatever it is written in: URDF, xacro, or MuJoCo's MJCF."""

from collections.abc import Sequence
from pathlib import Path

from s3le.errors import RobotError
from s3le.onboard import mjcf, mjcf_source, source


def read(path: Path, packages: Sequence[Path] = (), collision_only: bool = False) -> source.Source:
    """Read a robot's file, by what is in it; see source.read and mjcf_source.read.

    Raises:
        RobotError: it cannot be read as what it is; names the file and the place.
    """
    path = Path(path)
    if not path.is_file():
        raise RobotError(f"{path} does not exist; give the URDF or MJCF of the robot")
    try:
        with path.open("rb") as stream:
            head = stream.read(mjcf.LARGEST)
    except OSError as error:
        raise RobotError(f"{path}: not readable ({error.strerror})") from None
    if mjcf.is_mjcf(head):
        return mjcf_source.read(path, collision_only)
    return source.read(path, packages, collision_only)
