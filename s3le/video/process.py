"""An estimator that runs in an environment of its own, behind a pipe.

Frames go to its standard input, answers come from its standard output (words of the pipe:
s3le/video/worker.py). Nothing that it says is believed beyond a bounded number of floats: an
estimator that is absent, dies, hangs or says anything else ends in one line.
"""

import json
import os
import re
import select
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from s3le.errors import VideoError
from s3le.video import worker

ENVIRONMENT = Path(".venv-video")  # what `make video` sets up
SCRIPT = Path(worker.__file__)
BEGIN, ANSWER = 120.0, 60.0  # [s] that it may take to start, and for one frame
_SETUP = "set it up with: make video"
_FIELDS = 6
_NOISE = re.compile(r"[IW]\d{4} |INFO: |WARNING: ")  # what MediaPipe always says
_FARTHEST = 1000.0  # [m], or widths of the picture; a person is not that large


def interpreter(environment: Path | None = None) -> Path:
    """The interpreter of the estimator's environment.

    Args:
        environment: its folder; None: `.venv-video` here, or beside the project's files.

    Raises:
        VideoError: there is none.
    """
    own = Path(__file__).parents[2] / ENVIRONMENT
    for folder in [environment] if environment else [ENVIRONMENT, own]:
        python = folder / "bin" / "python"
        if os.access(python, os.X_OK):
            return python.absolute()  # not resolved: the link is what makes it that environment's
    where = environment or ENVIRONMENT
    raise VideoError(f"{where}: no environment with MediaPipe there; {_SETUP} (seconds, 175 MB)")


class Process:
    """An estimator behind a pipe; a context manager."""

    def __init__(
        self, python: Path, script: Path = SCRIPT, begin: float = BEGIN, answer: float = ANSWER
    ) -> None:
        """Start it and hear its name.

        Args:
            python: interpreter that runs the script.
            script: speaks as s3le/video/worker.py does.
            begin, answer: time that it has to start and to answer a frame [s].

        Raises:
            VideoError: it does not start, or speaks otherwise.
        """
        self._begin, self._answer = begin, answer
        self._words = tempfile.TemporaryFile()  # a file never fills up, as a pipe would
        quiet = {"GLOG_minloglevel": "3", "TF_CPP_MIN_LOG_LEVEL": "3"}
        try:
            self._process = subprocess.Popen(
                [str(python), "-I", str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=self._words, bufsize=0, env=os.environ | quiet,
            )  # fmt: skip
        except OSError as error:
            self._words.close()
            raise VideoError(f"{python} cannot be run ({error.strerror}); {_SETUP}") from None
        assert self._process.stdin is not None and self._process.stdout is not None  # both piped
        self._to, self._from = self._process.stdin, self._process.stdout
        os.set_blocking(self._to.fileno(), False)
        try:
            kind, payload = self._read(time.monotonic() + begin, "to start")
            if kind != worker.HELLO:
                raise self._odd()
            said = json.loads(payload)
            self.name = " ".join(str(said[key])[:40] for key in ("estimator", "version"))
        except (ValueError, KeyError, TypeError, RecursionError):
            self.close()
            raise self._odd() from None
        except BaseException:
            self.close()
            raise

    def joints(self, pictures: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        """See estimator.Estimator; the next picture is decoded while one is looked at."""
        waiting = 0
        for picture in pictures:
            self._send(picture)
            waiting += 1
            if waiting > 1:  # an answer fits into the pipe, so neither end waits for the other
                yield self._joints()
                waiting -= 1
        while waiting:
            yield self._joints()
            waiting -= 1

    def close(self) -> None:
        """End it, whatever it does."""
        for pipe in (self._to, self._from):
            pipe.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._words.close()

    def __enter__(self) -> "Process":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.close()

    def _send(self, picture: np.ndarray) -> None:
        height, width, _ = picture.shape
        if max(height, width) > worker.LARGEST:
            raise VideoError(f"a picture of {width} x {height}, at most {worker.LARGEST} a side")
        pixels = np.ascontiguousarray(picture, np.uint8).tobytes()
        rest = memoryview(worker.message(worker.FRAME, pixels, width, height))
        deadline = time.monotonic() + self._answer
        pipe = self._to.fileno()
        while rest:
            if not select.select([], [pipe], [], max(deadline - time.monotonic(), 0.0))[1]:
                raise self._hung("to take a frame", self._answer)
            try:
                rest = rest[os.write(pipe, rest) :]
            except BlockingIOError:
                continue
            except OSError:  # it has closed its end: what it said last says why
                kind, _ = self._read(deadline, "to answer")
                while kind in (worker.JOINTS, worker.NOBODY):
                    kind, _ = self._read(deadline, "to answer")
                raise self._odd() from None

    def _joints(self) -> np.ndarray:
        kind, payload = self._read(time.monotonic() + self._answer, "to answer a frame")
        shape = len(worker.NAMES), _FIELDS
        if kind == worker.NOBODY and not payload:
            return np.full(shape, np.nan)
        if kind != worker.JOINTS or len(payload) != 4 * shape[0] * shape[1]:
            raise self._odd()
        joints = np.frombuffer(payload, "<f4").reshape(shape).astype(float)
        if (np.abs(joints) > _FARTHEST).any():
            raise self._odd()
        return joints

    def _read(self, deadline: float, what: str) -> tuple[int, bytes]:
        """One message; what ends the process ends in its last words."""
        head = self._bytes(worker.HEADER.size, deadline, what)
        magic, version, kind, _, _, size = worker.HEADER.unpack(head)
        if magic != worker.MAGIC or size > worker.ANSWER:
            raise self._odd()
        if version != worker.VERSION:
            raise VideoError(
                f"the estimator speaks version {version} of the protocol, wanted "
                f"{worker.VERSION}; {_SETUP}"
            )
        payload = self._bytes(size, deadline, what)
        if kind == worker.FAILED:
            words = payload.decode("utf-8", "replace") or "no reason given"
            raise VideoError(f"the estimator gave up: {words}; {_SETUP}")
        return kind, payload

    def _bytes(self, count: int, deadline: float, what: str) -> bytes:
        pipe = self._from.fileno()
        data = b""
        while len(data) < count:
            left = deadline - time.monotonic()
            if not select.select([pipe], [], [], max(left, 0.0))[0]:
                raise self._hung(what, self._begin if what == "to start" else self._answer)
            part = os.read(pipe, count - len(data))
            if not part:
                raise self._dead()
            data += part
        return data

    def _dead(self) -> VideoError:
        try:
            status = str(self._process.wait(5.0))
        except subprocess.TimeoutExpired:
            status = "none"
        self._words.seek(max(self._words.seek(0, os.SEEK_END) - 4096, 0))
        lines = self._words.read().decode("utf-8", "replace").split("\n")
        said = [line.strip() for line in lines if line.strip() and not _NOISE.match(line)]
        last = said[-1] if said else "it said nothing"
        return VideoError(f"the estimator ended with status {status} ({last[:300]}); {_SETUP}")

    def _hung(self, what: str, seconds: float) -> VideoError:
        self._process.kill()
        return VideoError(f"the estimator took more than {seconds:g} s {what} and was ended")

    def _odd(self) -> VideoError:
        self._process.kill()
        return VideoError(f"the estimator does not speak this project's protocol; {_SETUP}")
