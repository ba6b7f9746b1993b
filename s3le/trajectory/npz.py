"""Trajectories as NPZ, for those who train policies; nothing in one is ever unpickled.

Arrays `time` [s], `q` [rad] (n, n_dof), `joint_names`, `heading` [rad], `clearance` [m], `mode`,
`about` (JSON text), and `fps` [Hz] where the steps in time are alike. `np.load(path)` reads it.
"""

import ast
import json
import math
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from s3le.errors import TrajectoryError
from s3le.trajectory.columns import ANGLES, interpret
from s3le.trajectory.trajectory import Trajectory

MOST_BYTES = 4 << 30  # of one array, unpacked; ten hours of forty joints at 1 kHz
MOST_ARRAYS = 256
LONGEST_HEADER = 65_536  # [bytes]
_PLAIN = "biufU"  # kinds of dtype that are data and nothing else


def write(trajectory: Trajectory, part: Path) -> None:
    """Write one file; the same trajectory gives the same bytes."""
    arrays = {
        "time": trajectory.time,
        "q": trajectory.q,
        "joint_names": np.array(trajectory.joints),
        "heading": trajectory.heading,
        "clearance": trajectory.clearance,
        "mode": trajectory.mode,
        "fps": None if trajectory.rate is None else np.float64(trajectory.rate),
        "about": np.array(json.dumps(trajectory.about, sort_keys=True)),
    }
    with part.open("wb") as stream:  # savez would add a suffix to a name
        np.savez_compressed(stream, **{k: v for k, v in arrays.items() if v is not None})


def read(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read ours or another tool's.

    Raises:
        TrajectoryError: no NPZ, damaged, larger than MOST_BYTES, or what interpret refuses.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = _arrays(path, archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise TrajectoryError(f"{path}: is no sound NPZ ({_line(error)})") from None
    about = _about(arrays.pop("about", None))
    return interpret(str(path), arrays, fps, joints, about)


def read_npy(path: Path, fps: float | None, joints: Sequence[str] | None) -> Trajectory:
    """Read a single array (n, n_dof) of angles, named by joints.

    Raises:
        TrajectoryError: as read.
    """
    with path.open("rb") as stream:
        array = _array(str(path), stream, path.stat().st_size)
    return interpret(str(path), {ANGLES[0]: array}, fps, joints)


def _arrays(path: Path, archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    entries = archive.infolist()
    names = [entry.filename.removesuffix(".npy") for entry in entries]
    if len(entries) > MOST_ARRAYS or len(set(names)) < len(names):
        raise TrajectoryError(f"{path}: {len(entries)} arrays, or two of one name")
    if sum(entry.file_size for entry in entries) > MOST_BYTES:
        raise TrajectoryError(f"{path}: unpacks to more than {MOST_BYTES >> 30} GiB")
    arrays = {}
    for name, entry in zip(names, entries, strict=True):
        with archive.open(entry) as stream:
            arrays[name] = _array(f"{path}: '{name[:40]}'", stream, entry.file_size)
    return arrays


def _array(name: str, stream: BinaryIO, size: int) -> np.ndarray:
    """One .npy, held to its own header before memory is asked for."""
    shape, fortran, dtype = _header(name, stream)
    if dtype.hasobject:
        raise TrajectoryError(
            f"{name} is pickled, which can run any program when opened; "
            "save it again as plain numbers or words"
        )
    if dtype.kind not in _PLAIN or dtype.shape:
        raise TrajectoryError(f"{name} holds {dtype}, which is neither numbers nor words")
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > min(size, MOST_BYTES):
        raise TrajectoryError(f"{name} claims {claimed} bytes, the file has {size}")
    data = stream.read(claimed)
    if len(data) < claimed or stream.read(1):
        raise TrajectoryError(f"{name} does not hold the {claimed} bytes that it claims")
    if not dtype.itemsize:
        return np.zeros(shape, "U1")
    array = np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
    if dtype.kind == "U":
        codes = np.frombuffer(data, np.dtype("u4").newbyteorder(dtype.byteorder))
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes <= 0xDFFF))).any():
            raise TrajectoryError(f"{name} holds words that are no text")
    return array


def _header(name: str, stream: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type. numpy's own reader mends headers of Python 2, and warns or worse."""
    magic = stream.read(8)
    width = {b"\x01\x00": 2, b"\x02\x00": 4, b"\x03\x00": 4}.get(magic[6:])
    if magic[:6] != b"\x93NUMPY" or width is None:
        raise TrajectoryError(f"{name} is no array of numpy's")
    length = int.from_bytes(stream.read(width), "little")
    if length > LONGEST_HEADER:
        raise TrajectoryError(f"{name} is no array of numpy's (a header of {length} bytes)")
    try:
        header = ast.literal_eval(stream.read(length).decode().strip())
        shape, fortran = header["shape"], header["fortran_order"]
        dtype = np.dtype(header["descr"])
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError) as error:
        raise TrajectoryError(f"{name} is no array of numpy's ({_line(error)})") from None
    whole = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
    if not whole or type(fortran) is not bool:
        raise TrajectoryError(f"{name} is no array of numpy's (its shape is {shape!r:.40})")
    return shape, fortran, dtype


def _about(text: np.ndarray | None) -> dict:
    """What the file says about itself, as far as it can be read."""
    try:
        about = json.loads(str(text))
    except (ValueError, RecursionError):
        return {}
    return about if isinstance(about, dict) else {}


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]
