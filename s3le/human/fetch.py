"""One file from a web server onto disk: whole and checked under its name, or not at all.

A transfer goes to NAME.part. What arrived stays there when the line breaks, and the next try
or the next run asks the server for the rest.
"""

import hashlib
import http.client
import os
import re
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

from s3le.errors import FetchError
from s3le.human.text import MAX_BYTES

Check = Callable[[Path], str]  # says what is wrong with a complete file; "" is nothing
_CHUNK = 1 << 16
_FINAL = (400, 401, 403, 404, 410)  # statuses that another try will not change
_FIRST_WAIT = 0.5  # [s] before the second try; doubles with each


class NotThereError(FetchError):
    """The server says that it has no such file."""


class UnreachableError(FetchError):
    """No server answers."""


def sha256(path: Path) -> str:
    """Hex digest of a file as it lies on disk."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def download(
    url: str,
    target: Path,
    check: Check,
    *,
    tries: int = 4,
    timeout: float = 30.0,
    wait: float = _FIRST_WAIT,
    limit: int = MAX_BYTES,
) -> None:
    """Fetch a file over HTTP, resuming what an earlier try left.

    Args:
        url: http or https.
        target: where the file shall be; its folder is made.
        check: run on the complete file before it gets its name.
        tries: requests before giving up.
        timeout: of the connection and of every read [s].
        wait: before the second try [s]; doubles with each.
        limit: refuse a file of more bytes.

    Raises:
        NotThereError: the server answers that it has no such file.
        UnreachableError: no connection in any try.
        FetchError: cut short in every try, too long, or not what check wants.
    """
    if not url.startswith(("http://", "https://")):
        raise FetchError(f"{url}: only http:// and https:// are fetched")
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    why, reached = "", False
    for attempt in range(tries):
        if attempt:
            time.sleep(wait * 2 ** (attempt - 1))
        resumed = part.stat().st_size if part.exists() else 0
        try:
            _transfer(url, part, timeout, limit)
        except FetchError:
            part.unlink(missing_ok=True)
            raise
        except urllib.error.HTTPError as error:
            reached, why = True, f"HTTP status {error.code}"
            if error.code in _FINAL:
                part.unlink(missing_ok=True)
                raise NotThereError(f"{url}: {why}") from None
            continue
        except urllib.error.URLError as error:
            why = str(error.reason)
            continue
        except (OSError, http.client.HTTPException) as error:
            reached, why = True, str(error) or type(error).__name__
            continue
        reached = True
        wrong = check(part)
        if not wrong:
            os.replace(part, target)
            return
        part.unlink()
        why = wrong
        if not resumed:  # a fresh, complete file that is wrong stays wrong
            raise FetchError(f"{url}: {wrong}")
    kind = FetchError if reached else UnreachableError
    raise kind(f"{url}: {why} (in {tries} tries)")


class _CutShortError(OSError):
    pass


def _transfer(url: str, part: Path, timeout: float, limit: int) -> None:
    """Append to the part file until it is complete; OSError or HTTPError where it is not."""
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={"User-Agent": "s3le"})
    if have:
        request.add_header("Range", f"bytes={have}-")
    try:
        answer = urllib.request.urlopen(request, timeout=timeout)
    except urllib.error.HTTPError as error:
        if error.code == 416:  # nothing beyond what is here: begin again next time
            part.unlink(missing_ok=True)
        raise
    with answer:
        total = _length(answer.headers.get("Content-Length"))
        if answer.status == 206:
            sent = answer.headers.get("Content-Range", "")
            span = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", sent)
            if not span or int(span[1]) != have:
                part.unlink(missing_ok=True)
                raise _CutShortError("the server sent another part than was asked for")
            total = _length(span[2])
        else:
            have = 0  # the server sends the whole file, whatever was asked for
        if total is not None and total > limit:
            raise FetchError(f"{url}: {total} bytes, more than the {limit} that are read")
        with part.open("ab" if have else "wb") as out:
            while chunk := answer.read(_CHUNK):
                have += len(chunk)
                if have > limit:
                    raise FetchError(f"{url}: more than the {limit} bytes that are read")
                out.write(chunk)
    if total is not None and have != total:
        raise _CutShortError(f"cut short, {have} of {total} bytes")


def _length(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() else None
