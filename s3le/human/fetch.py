"""One file from a web server onto disk: whole and checked under its name, or not at all.

pooch transfers to a file beside it, tries again after 1, 2, 3 ... seconds, and gives it its name.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

from s3le.errors import FetchError
from s3le.human.text import MAX_BYTES

Check = Callable[[Path], str]  # says what is wrong with a complete file; "" is nothing
_FINAL = (400, 401, 403, 404, 410)  # statuses that another try will not change
_PLAIN = {"User-Agent": "s3le", "Accept-Encoding": "identity"}  # a .gz arrives as it lies there


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
    limit: int = MAX_BYTES,
) -> None:
    """Fetch a file over HTTP.

    Args:
        url: http or https.
        target: where the file shall be; its folder is made, what is there is replaced.
        check: run on the complete file before it gets its name.
        tries: requests before giving up.
        timeout: of the connection and of every read [s].
        limit: refuse a file of more bytes.

    Raises:
        NotThereError: the server answers that it has no such file.
        UnreachableError: no connection in the last try.
        FetchError: cut short in every try, too long, or not what check wants.
    """
    import pooch  # here, so that who fetches nothing needs neither it nor requests
    from requests import exceptions

    if not url.startswith(("http://", "https://")):
        raise FetchError(f"{url}: only http:// and https:// are fetched")
    transfer = pooch.HTTPDownloader(timeout=timeout, headers=_PLAIN)

    def whole(_: str, part: str, pup: pooch.Pooch) -> None:
        with Path(part).open("wb") as out:
            try:
                transfer(url, _Bounded(out, limit, url), pup)
            except exceptions.HTTPError as error:
                if error.response.status_code in _FINAL:
                    raise NotThereError(f"{url}: {_reason(error)}") from None
                raise
            except exceptions.ConnectionError as error:
                if out.tell():  # there is a server, it only fell silent
                    raise exceptions.ChunkedEncodingError(_reason(error)) from None
                raise
        if wrong := check(Path(part)):  # a complete file that is wrong stays wrong
            raise FetchError(f"{url}: {wrong}")

    pooch.get_logger().setLevel("WARNING")
    target.unlink(missing_ok=True)
    one = pooch.Pooch(
        target.parent.absolute(), "", {target.name: None}, {target.name: url}, tries - 1
    )
    try:
        one.fetch(target.name, downloader=whole)
    except exceptions.ConnectionError as error:
        raise UnreachableError(f"{url}: {_reason(error)} (in {tries} tries)") from None
    except exceptions.RequestException as error:
        raise FetchError(f"{url}: {_reason(error)} (in {tries} tries)") from None


class _Bounded:
    """A file that takes no more than so many bytes."""

    def __init__(self, out, limit: int, url: str) -> None:
        self._out, self._limit, self._url = out, limit, url

    def write(self, chunk: bytes) -> None:
        self._out.write(chunk)
        if self._out.tell() > self._limit:
            raise FetchError(f"{self._url}: more than the {self._limit} bytes that are read")

    def flush(self) -> None:
        """Nothing is read before the end."""


def _reason(error: Exception) -> str:
    """What went wrong, without what requests and urllib3 wrap around it."""
    if (response := getattr(error, "response", None)) is not None:
        return f"HTTP status {response.status_code}"
    inner = error.args[0] if error.args else error
    return str(getattr(inner, "reason", inner)).rpartition(": ")[2] or type(error).__name__
