"""The URDF that a xacro file means, by ROS' own package `xacro` where that is installed."""

from pathlib import Path

from s3le.errors import RobotError


def expanded(path: Path) -> bytes:
    """Expand a xacro file with the values that it has for its arguments.

    Xacro evaluates the expressions in the file, so expand only files from whom you trust.

    Raises:
        RobotError: the package is not there, or it refuses the file; passes its words on.
    """
    try:
        import xacro
    except ImportError:
        raise RobotError(
            f"{path} is a xacro file; `pip install xacro` lets it be expanded here, or expand it "
            f"first: xacro {path.name} > my.urdf"
        ) from None
    try:
        return xacro.process_file(str(path)).toprettyxml(indent="  ").encode()
    except Exception as error:  # whatever the expressions in the file may raise
        reason = " ".join(str(error).split())[:200]
        raise RobotError(
            f"{path}: xacro cannot expand it ({type(error).__name__}: {reason}); expand it where "
            f"its packages are found: xacro {path.name} > my.urdf"
        ) from None
