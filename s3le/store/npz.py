"""NPZ and NPY files that nothing can run from: read by their own headers, within bounds.

Each array is held to what its header claims before memory is asked for; what is pickled inside
stays closed. numpy's own reader is not used: it mends headers of Python 2, and warns or worse.
"""

import ast
import math
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np

from s3le.errors import S3leError

MOST_ARRAYS = 256
LONGEST_HEADER = 65_536  # [bytes]
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError
)  # fmt: skip
_PLAIN = "biufU"  # kinds of dtype that are data and nothing else


def read_npz(
    path: Path,
    error: type[S3leError],
    most: int,
    closed: list[str] | None = None,
) -> dict[str, np.ndarray]:
    """Every array of an archive by its name, read-only.

    Args:
        path: the file.
        error: what a refusal is raised as.
        most: bytes of all arrays together, unpacked.
        closed: takes the names of arrays that are no plain numbers or words, such as pickled
            ones; None: the first of these refuses the file.

    Raises:
        error: no NPZ, damaged, larger than most, or more than MOST_ARRAYS.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            names = [entry.filename.removesuffix(".npy") for entry in entries]
            if len(entries) > MOST_ARRAYS or len(set(names)) < len(names):
                raise error(f"{path}: {len(entries)} arrays, or two of one name")
            if sum(entry.file_size for entry in entries) > most:
                raise error(f"{path}: unpacks to more than {_size(most)}")
            arrays = {}
            for name, entry in zip(names, entries, strict=True):
                with archive.open(entry) as stream:
                    read = _array(f"{path}: '{name[:40]}'", stream, entry.file_size, error, closed)
                if read is not None:
                    arrays[name] = read
                elif closed is not None:
                    closed.append(name)
    except _DAMAGE as damage:
        raise error(f"{path}: is no sound NPZ ({_line(damage)})") from None
    return arrays


def read_npy(path: Path, error: type[S3leError], most: int) -> np.ndarray:
    """The one array of a file, read-only.

    Raises:
        error: as read_npz.
    """
    size = path.stat().st_size
    if size > most + LONGEST_HEADER:
        raise error(f"{path}: holds more than {_size(most)}")
    with path.open("rb") as stream:
        read = _array(str(path), stream, size, error, None)
    assert read is not None  # where no list takes closed ones, they are refused
    return read


def pickled(path: Path, error: type[S3leError], most: int) -> bytes | None:
    """The pickle of a file whose array holds objects, as bytes; None: it holds no objects.

    Raises:
        error: no array of numpy's, or longer than most.
    """
    with path.open("rb") as stream:
        if not _header(str(path), stream, error)[2].hasobject:
            return None
        data = stream.read(most + 1)
    if len(data) > most:
        raise error(f"{path}: holds more than {_size(most)}")
    return data


def _array(
    name: str, stream: IO[bytes], size: int, error: type[S3leError], closed: list[str] | None
) -> np.ndarray | None:
    """One .npy, held to its own header before memory is asked for; None: it stays closed."""
    shape, fortran, dtype = _header(name, stream, error)
    if dtype.hasobject:
        if closed is not None:
            return None
        raise error(
            f"{name} is pickled, which can run any program when opened; "
            "save it again as plain numbers or words"
        )
    if dtype.kind not in _PLAIN or dtype.shape:
        if closed is not None:
            return None
        raise error(f"{name} holds {dtype}, which is neither numbers nor words")
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > size:
        raise error(f"{name} claims {claimed} bytes, the file has {size}")
    data = stream.read(claimed)
    if len(data) < claimed or stream.read(1):
        raise error(f"{name} does not hold the {claimed} bytes that it claims")
    if not dtype.itemsize:
        return np.zeros(shape, "U1")
    array = np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
    if dtype.kind == "U":
        codes = np.frombuffer(data, np.dtype("u4").newbyteorder(dtype.byteorder))
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes <= 0xDFFF))).any():
            raise error(f"{name} holds words that are no text")
    return array


def _header(
    name: str, stream: IO[bytes], error: type[S3leError]
) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type."""
    magic = stream.read(8)
    width = {b"\x01\x00": 2, b"\x02\x00": 4, b"\x03\x00": 4}.get(magic[6:])
    if magic[:6] != b"\x93NUMPY" or width is None:
        raise error(f"{name} is no array of numpy's")
    length = int.from_bytes(stream.read(width), "little")
    if length > LONGEST_HEADER:
        raise error(f"{name} is no array of numpy's (a header of {length} bytes)")
    try:
        header = ast.literal_eval(stream.read(length).decode().strip(" \n"))
        shape, fortran = header["shape"], header["fortran_order"]
        dtype = np.dtype(header["descr"])
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError) as damage:
        raise error(f"{name} is no array of numpy's ({_line(damage)})") from None
    whole = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
    if not whole or type(fortran) is not bool:
        raise error(f"{name} is no array of numpy's (its shape is {shape!r:.40})")
    return shape, fortran, dtype


def _size(count: int) -> str:
    return f"{count >> 30} GiB" if count >= 1 << 30 else f"{count >> 20} MiB"


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]
