"""Files into lines: bounded reading, what a file looks like, and one form for every refusal.

A refusal reads `path:line: why`. Nothing here knows a motion format beyond its first line.
"""

import gzip
import logging
import re
import stat
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from s3le.errors import ClipError

MAX_BYTES = 128 * 2**20  # largest file read, unpacked: 150,000 frames of 96 channels
SMALL_BYTES = 4 * 2**20  # largest skeleton or list; real ones have kilobytes
LONGEST_LINE = 4 * 2**20  # [bytes]; a BVH frame of a skeleton with fingers has a few thousand
MOST_LINES = 2**23  # a line in memory takes 40 bytes more than in the file

_NUMBER = re.compile(rb"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_SHOWN = 40  # characters of a token quoted in a refusal
_LISTED = 60  # names listed in a refusal

log = logging.getLogger(__name__)


def refusal(path: Path | str, line: int | None, why: str) -> ClipError:
    """The error to raise for a place in a file; line counts from 1, None means the whole file."""
    return ClipError(f"{path}: {why}" if line is None else f"{path}:{line}: {why}")


def shown(token: bytes | str) -> str:
    """A token as a refusal quotes it: printable, in quotes, cut when long."""
    text = printed(token) if isinstance(token, bytes) else token
    return repr(text if len(text) <= _SHOWN else text[:_SHOWN] + "...")


def printed(token: bytes) -> str:
    """A word of a text as it is meant to be read: UTF-8, else Latin-1, which any bytes are."""
    try:
        return token.decode("utf-8")
    except UnicodeDecodeError:
        return token.decode("latin-1")


def listed(names: Iterable[str]) -> str:
    """Names as a refusal lists them: printable, with commas, cut when many."""
    names = list(names)
    text = ", ".join(repr(name)[1:-1][:_SHOWN] for name in names[:_LISTED])
    return text if len(names) <= _LISTED else f"{text}, ... ({len(names)} in all)"


def read_bytes(path: Path | str, limit: int = MAX_BYTES, packed: bool | None = None) -> bytes:
    """The whole content of a file, decompressed on the way where it is gzipped.

    Args:
        path: a regular file.
        limit: refuse content longer than this many bytes after decompression.
        packed: whether it is gzipped; None: it is where its name ends in .gz.

    Raises:
        ClipError: no such file, not a regular file, damaged gzip, or longer than limit.
    """
    path = Path(path)
    if why := no_file(path):
        raise refusal(path, None, why)
    packed = path.suffix.lower() == ".gz" if packed is None else packed
    try:
        with gzip.open(path) if packed else path.open("rb") as stream:
            data = stream.read(limit + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise refusal(path, None, f"cannot be read: {error}") from None
    if len(data) > limit:
        raise refusal(path, None, f"longer than the {limit / 2**20:g} MiB that are read")
    return data


def no_file(path: Path | str) -> str:
    """What stands at a path in place of a file, in words; empty where there is a file.

    Pipes and devices, which never end, are told here, before anybody opens them.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        gone = isinstance(error, (FileNotFoundError, NotADirectoryError, ValueError))
        words = error.strerror if isinstance(error, OSError) else None
        return "no such file" if gone else f"cannot be read: {words or error}"
    kinds = (
        (stat.S_ISDIR, "is a folder, not a file"),
        (stat.S_ISFIFO, "is a named pipe (FIFO), not a file; write what comes out of it to one"),
        (stat.S_ISSOCK, "is a socket, not a file"),
        (stat.S_ISCHR, "is a device, not a file"),
        (stat.S_ISBLK, "is a device, not a file"),
    )
    return next((words for is_one, words in kinds if is_one(mode)), "")


def split_lines(path: Path | str, data: bytes) -> list[bytes]:
    """The lines of a text, without their ends.

    Raises:
        ClipError: a line longer than LONGEST_LINE, or more than MOST_LINES.
    """
    if data.count(b"\n") + data.count(b"\r") - data.count(b"\r\n") > MOST_LINES:
        raise refusal(path, None, f"more than the {MOST_LINES} lines that are read")
    lines = data.splitlines()
    sizes = list(map(len, lines))
    if sizes and (longest := max(sizes)) > LONGEST_LINE:
        limit = f"the {LONGEST_LINE / 2**20:g} MiB of a line that are read"
        raise refusal(path, sizes.index(longest) + 1, f"longer than {limit}")
    return lines


def leave_out_last(path: Path | str, frames: int, why: str) -> None:
    """Tell the person who is watching that a clip is read without its last frame.

    Args:
        path: the file.
        frames: how many it has, the last one included.
        why: what is wrong with that one.

    Raises:
        ClipError: it is the only one.
    """
    if frames == 1:
        raise refusal(path, None, f"{why}, and there is no other frame; a truncated file?")
    log.warning("%s", refusal(path, None, f"{why}; the last of its {frames} frames is left out"))


def looks_like(head: bytes) -> str:
    """What the first bytes of a file look like, in words that fit after "looks like"."""
    body = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    first = body.split(b"\n", 1)[0].strip()
    if not body:
        return "an empty file"
    for magic, what in (
        (b"\x1f\x8b", "gzip data (name it .gz)"),
        (b"PK\x03\x04", "a zip archive"),
        (b"Kaydara FBX", "a binary FBX scene"),
    ):
        if head.startswith(magic):
            return what
    if b"\0" in head:
        return "binary C3D markers" if head[1:2] == b"\x50" else "binary data"
    if body[:1] == b"<":
        return "an HTML or XML page"
    if first.split(b" ")[0].split(b"\t")[0].upper() == b"HIERARCHY":
        return "BVH text"
    if body[:1] in b"{[":
        return "JSON text"
    if body[:1] in b"#:":
        kinds = {b":version": "ASF text", b":fully-specified": "AMC text", b":degrees": "AMC text"}
        for line in body.splitlines():
            for key, what in kinds.items():
                if line.lower().startswith(key):
                    return what
        return "ASF or AMC text without its :version or :FULLY-SPECIFIED line"
    return "text of no motion format known here"


def require(path: Path | str, data: bytes, what: str) -> None:
    """Refuse a file whose first bytes do not look like what its reader expects.

    Raises:
        ClipError: it is empty, binary, or of another format; the text says which.
    """
    nul = data.find(b"\0")
    if nul >= 0 and looks_like(data[: min(nul, 4096)]) == what:
        line = data.count(b"\n", 0, nul) + 1
        raise refusal(path, line, f"a NUL byte in what begins as {what}")
    if (seen := looks_like(data[:4096])) != what:
        raise refusal(path, None, f"looks like {seen}, not {what}")


def number(path: Path | str, line: int, token: bytes, what: str) -> float:
    """One strictly decimal, finite number.

    Raises:
        ClipError: the token is anything else (nan, inf, 1_0, 1.#QNAN, 1e999).
    """
    if _NUMBER.fullmatch(token) is None:
        raise refusal(path, line, f"{what} must be a number, got {shown(token)}")
    value = float(token)
    if not np.isfinite(value):
        raise refusal(path, line, f"{what} must be finite, got {shown(token)}")
    return value


def integer(path: Path | str, line: int, token: bytes, what: str) -> int:
    """One non-negative whole number of at most 18 digits.

    Raises:
        ClipError: the token is anything else.
    """
    if not (token.isdigit() and len(token) <= 18):
        raise refusal(path, line, f"{what} must be a whole number, got {shown(token)}")
    return int(token)


def floats(tokens: Iterable[bytes]) -> np.ndarray | None:
    """Many numbers at once, or None where one of them is not what `number` accepts."""
    tokens = list(tokens)
    try:
        values = np.array(list(map(float, tokens)))
    except ValueError:
        return None
    # float() takes 1_000 too; joined, one search covers all tokens.
    return values if np.isfinite(values).all() and b"_" not in b" ".join(tokens) else None
