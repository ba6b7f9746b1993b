"""The door for joint motions of any tool: opened here, and written back as they came."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from s3le.errors import TrajectoryError
from s3le.guard.layouts import hdf5, lerobot, npz, parquet, pickled, text
from s3le.guard.layouts.episode import Layout
from s3le.motion import files as motions
from s3le.robot.model import Geometry

_Open = Callable[[Path, Geometry, float | None, Sequence[str] | None, bool, Sequence[str]], Layout]
_OPEN: dict[str, _Open] = {
    ".parquet": parquet.open_parquet,
    ".csv": text.open_csv,
    ".npz": npz.open_npz,
    ".npy": npz.open_npy,
    ".pkl": pickled.open_pickle,
    ".pickle": pickled.open_pickle,
    ".h5": hdf5.open_hdf5,
    ".hdf5": hdf5.open_hdf5,
}
KNOWN = tuple(_OPEN)
_BEGIN = {
    ".parquet": b"PAR1", ".npz": b"PK", ".npy": b"\x93NUMPY", ".pkl": b"\x80",
    ".pickle": b"\x80", ".h5": b"\x89HDF", ".hdf5": b"\x89HDF",
}  # fmt: skip
_SAVE = "np.savez('motion.npz', dof_pos=..., joint_names=[...], fps=...)"
_ROUTES = {  # what is asked for and not read here -> the way round
    **dict.fromkeys((".pt", ".pth", ".p", ".joblib", ".mat", ".json"), f"save numbers: {_SAVE}"),
    **dict.fromkeys((".bag", ".mcap", ".db3"), "save its JointTrajectory or JointState as a CSV "
                    "with a column 'time' and one a joint"),
    ".bvh": "it is of a human: s3le retarget",
    ".urdf": "it is a robot: s3le robot new",
}  # fmt: skip


def open_layout(
    path: Path | str,
    robot: Geometry,
    *,
    fps: float | None = None,
    joints: Sequence[str] | None = None,
    degrees: bool = False,
    given: Sequence[str] = (),
    column: str | None = None,
    straight: bool = False,
) -> Layout:
    """Read the motions of a file or folder, and remember how they were written.

    Args:
        path: of KNOWN, or a folder of LeRobot's (v3).
        robot: whose motions they are said to be.
        fps: rows per second [Hz], instead of the file's own times.
        joints: names of the columns, for files that have none.
        degrees: the angles are in degrees.
        given: joints that others move, see motion.fit; any other stands as the robot file says.
        column: of a LeRobot folder: which column holds the joints; None: action.
        straight: speeds of files that are not ours are not looked at.

    Raises:
        TrajectoryError: names the file, the place in it, what is wrong and what to do.
    """
    path = Path(path)
    kind = path.suffix.lower()
    try:
        if path.is_dir():
            if not lerobot.is_dataset(path):
                raise TrajectoryError(
                    f"{path}: is a folder without {lerobot.INFO}, so no LeRobot data set; name "
                    "its files"
                )
            return lerobot.open_lerobot(path, robot, fps, joints, degrees, given, column)
        if column is not None:
            raise TrajectoryError(f"{path}: a column is named of LeRobot's folders alone")
        if path.exists() and not path.is_file():
            raise TrajectoryError(f"{path}: is no file")
        with path.open("rb") as stream:
            begin = stream.read(8)
        if kind not in _OPEN:
            way = _ROUTES.get(kind, f"motions end in {', '.join(KNOWN)}")
            raise TrajectoryError(f"{path}: is not read here; {way}")
        if not begin.startswith(_BEGIN.get(kind, b"")):
            name = "Python 3's pickle" if _BEGIN[kind] == b"\x80" else kind[1:]
            what = "is empty" if not begin else f"is no {name}"
            raise TrajectoryError(f"{path}: {what}")
        layout = _OPEN[kind](path, robot, fps, joints, degrees, given)
        if straight and layout.episodes[0].v is not None and not motions.tells_speeds(path):
            layout.episodes[0].notes.append("its speeds stay as they are")
            layout.episodes[0] = layout.episodes[0]._replace(v=None)
        return layout
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror or error}") from None


def find(path: Path | str) -> list[Path]:
    """The motions known here below a folder, in order of their names; a file is itself.

    A folder of LeRobot's is one. Hidden files, and Parquet files that say that they are other
    tables of this project, are passed over.

    Raises:
        TrajectoryError: there is nothing at path, or no motion below it.
    """
    path = Path(path)
    if path.is_file() or lerobot.is_dataset(path):
        return [path]
    if not path.is_dir():
        raise TrajectoryError(f"{path}: there is no such file or folder")
    found: list[Path] = []
    for place, folders, names in os.walk(path):
        here = Path(place)
        for name in [name for name in folders if lerobot.is_dataset(here / name)]:
            folders.remove(name)
            if not name.startswith("."):
                found.append(here / name)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [here / name for name in names if _is_motion(here / name)]
    if not found:
        raise TrajectoryError(f"{path}: holds no motion ({', '.join(KNOWN)}, or LeRobot's folder)")
    return sorted(found)


def _is_motion(path: Path) -> bool:
    kind = path.suffix.lower()
    if path.name.startswith(".") or kind not in _OPEN:
        return False
    return kind != ".parquet" or not parquet.is_other(path)
