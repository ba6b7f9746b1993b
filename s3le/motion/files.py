"""The door for trajectory files: the suffix says what a file claims, its first bytes must agree."""

from collections.abc import Sequence
from pathlib import Path

from s3le.errors import TrajectoryError
from s3le.motion import npz, parquet, text
from s3le.motion.trajectory import Trajectory
from s3le.store import documents
from s3le.store.atomic import replace

_BEGIN = {".parquet": b"PAR1", ".npz": b"PK", ".npy": b"\x93NUMPY"}
READ = {".parquet": parquet.read, ".npz": npz.read, ".npy": npz.read_npy, ".csv": text.read}
WRITTEN = (".parquet", ".csv", ".npz")
PICKLES = (".pkl", ".pickle", ".p", ".joblib", ".pt", ".pth")


def read(
    path: Path | str, fps: float | None = None, joints: Sequence[str] | None = None
) -> Trajectory:
    """Read a trajectory of any format known here.

    Args:
        path: .parquet, .csv, .npz or .npy.
        fps: rows per second [Hz], instead of the file's own times.
        joints: names of the columns, for files that have none.

    Raises:
        TrajectoryError: missing, another suffix, a pickle, or what its reader refuses.
    """
    path = Path(path)
    kind = path.suffix.lower()
    try:
        with path.open("rb") as stream:
            begin = stream.read(8)
        if kind in PICKLES or begin[:1] == b"\x80":
            raise TrajectoryError(
                f"{path}: is a pickle, which can run any program when opened, so it is not; save "
                "its numbers where it was made: np.savez('motion.npz', dof_pos=..., "
                "joint_names=[...], fps=...) (docs/files.md)"
            )
        if kind not in READ:
            raise TrajectoryError(f"{path}: trajectories end in {', '.join(READ)}")
        if kind in _BEGIN and not begin.startswith(_BEGIN[kind]):
            raise TrajectoryError(f"{path}: is empty" if not begin else f"{path}: is no {kind[1:]}")
        return READ[kind](path, fps, joints)
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror or error}") from None


def tells_speeds(path: Path) -> bool:
    """Is a sound file one that this project wrote, and does it tell speeds?

    Raises:
        OSError: it cannot be opened.
    """
    tells = {".parquet": parquet.tells_speeds, ".npz": npz.tells_speeds, ".csv": text.tells_speeds}
    kind = path.suffix.lower()
    return kind in tells and tells[kind](path)


def write(trajectory: Trajectory, path: Path | str) -> None:
    """Write a trajectory, whole or not at all, in the format that the suffix names.

    Raises:
        TrajectoryError: another suffix.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".parquet":
        replace(path, lambda part: parquet.write(trajectory, part))
    elif kind == ".npz":
        replace(path, lambda part: npz.write(trajectory, part))
    elif kind == ".csv":
        lines = text.encode(trajectory)
        # The side file last: until it lies there nothing is claimed about the CSV.
        documents.write_text(lines, path)
        documents.write_text(text.encode_side(trajectory, lines), text.side_file(path))
    else:
        raise TrajectoryError(f"{path}: trajectories are written as {', '.join(WRITTEN)}")
