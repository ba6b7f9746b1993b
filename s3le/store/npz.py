"""NPZ and NPY files that nothing can run from: numpy reads them, held to bounds beforehand.

What the directory of the archive and each array's header claim is looked at before memory is
asked for; what is pickled inside stays closed.
"""

import io
import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from s3le.errors import S3leError

MOST_ARRAYS = 4096
LONGEST_HEADER = 65_536  # [bytes]
_PLAIN = "biufU"  # kinds of dtype that are data and nothing else
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npz(
    path: Path,
    error: type[S3leError],
    most: int,
    closed: list[str] | None = None,
    data: bytes | None = None,
) -> dict[str, np.ndarray]:
    """Every array of an archive by its name, read-only.

    Args:
        path: the file.
        error: what a refusal is raised as.
        most: bytes of all arrays together, unpacked.
        closed: takes the names of arrays that are no plain numbers or words, such as pickled
            ones; None: the first of these refuses the file.
        data: what the file holds, where that is in memory; path then only names it.

    Raises:
        error: no NPZ, damaged, larger than most, or more than MOST_ARRAYS.
    """
    arrays = {}
    with (
        _refusing(f"{path}: is no sound NPZ", error),
        zipfile.ZipFile(path if data is None else io.BytesIO(data)) as archive,
    ):
        entries = archive.infolist()
        names = [entry.filename.removesuffix(".npy") for entry in entries]
        if len(entries) > MOST_ARRAYS or len(set(names)) < len(names):
            raise error(f"{path}: {len(entries)} arrays, or two of one name")
        if sum(entry.file_size for entry in entries) > most:
            raise error(f"{path}: unpacks to more than {_size(most)}")
        for name, entry in zip(names, entries, strict=True):
            with archive.open(entry) as stream:
                read = _array(f"{path}: '{name[:40]}'", stream, entry.file_size, error, closed)
            if read is not None:
                arrays[name] = read
            elif closed is not None:  # else _array has refused it
                closed.append(name)
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
        array = _array(str(path), stream, size, error, None)
    if array is None:
        raise error(f"{path} holds neither numbers nor words")
    return array


def pickled(path: Path, error: type[S3leError], most: int) -> bytes | None:
    """The pickle of a file whose array holds objects, as bytes; None: it holds no objects.

    Raises:
        error: no array of numpy's, or longer than most.
    """
    with _refusing(f"{path} is no array of numpy's", error), path.open("rb") as stream:
        if not _header(stream)[2].hasobject:
            return None
        data = stream.read(most + 1)
    if len(data) > most:
        raise error(f"{path}: holds more than {_size(most)}")
    return data


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type; the stream then stands behind it."""
    return _HEADERS[npy.read_magic(stream)](stream, max_header_size=LONGEST_HEADER)


def _array(
    name: str, stream: IO[bytes], size: int, error: type[S3leError], closed: list[str] | None
) -> np.ndarray | None:
    """One .npy, held to its own header before memory is asked for; None: it stays closed."""
    with _refusing(f"{name} is no array of numpy's", error):
        shape, _, dtype = _header(stream)
        if dtype.kind not in _PLAIN or dtype.shape:
            if closed is not None:
                return None
            if dtype.hasobject:
                raise error(
                    f"{name} is pickled, which can run any program when opened; "
                    "save it again as plain numbers or words"
                )
            raise error(f"{name} holds {dtype}, which is neither numbers nor words")
        claimed = math.prod(shape) * max(dtype.itemsize, 1)  # words of no letters have size 0
        if claimed > size or min(shape, default=0) < 0:
            raise error(f"{name} claims {claimed} bytes, the file has {size}")
        stream.seek(0)
        array = npy.read_array(stream, allow_pickle=False, max_header_size=LONGEST_HEADER)
        if stream.read(1):
            raise error(f"{name} does not hold the {claimed} bytes that it claims but more")
    if dtype.kind == "U" and array.size:
        codes = np.frombuffer(array.tobytes(), np.dtype("u4").newbyteorder(dtype.byteorder))
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes <= 0xDFFF))).any():
            raise error(f"{name} holds words that are no text")
    array.setflags(write=False)
    return array


@contextmanager
def _refusing(what: str, error: type[S3leError]) -> Iterator[None]:
    """Whatever numpy, its parser, zipfile and what unpacks for it may raise, as one refusal."""
    try:
        with warnings.catch_warnings(action="error"):  # numpy would mend a header of Python 2
            yield
    except error:
        raise
    except Exception as damage:
        reason = (str(damage).splitlines() or [type(damage).__name__])[0][:160]
        raise error(f"{what} ({reason})") from None


def _size(count: int) -> str:
    return f"{count >> 30} GiB" if count >= 1 << 30 else f"{count >> 20} MiB"
