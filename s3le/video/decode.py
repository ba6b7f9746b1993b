"""The pictures of a video file, upright and with their true times: the door to PyAV for reading."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import VideoError
from s3le.video.estimator import Picture

LONGEST_SIDE = 1920  # pixels that an estimator is given; larger pictures are made smaller
LARGEST_SIDE = 16_384  # pixels of a video's side at most
MOST_FRAMES = 500_000  # two hours at 60 Hz
_THUMBNAIL = 32, 18  # pixels, for telling cuts
# Demuxers of single files; playlists and the like, which name other files, are not among them.
_FORMATS = "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,ogg,asf,gif,h264,hevc,mjpeg,ivf"
_ONLY = {"format_whitelist": _FORMATS}


class Video:
    """A video file; iterate once, then see what was odd about it.

    Attributes:
        path: of the file.
        rotation: counterclockwise quarter turns that its pictures were given.
        size: width and height of the upright pictures, as handed out.
        damaged: packets that could not be decoded.
        late: frames left out because their time does not rise.
        untimed: frames without a time of their own; they follow the one before at the mean rate.
    """

    def __init__(
        self, path: Path | str, begin: float | None = None, end: float | None = None
    ) -> None:
        """Note the file; it is opened when the pictures are asked for.

        Args:
            path: of the file.
            begin, end: part of it that is wanted, from its first frame on [s].
        """
        self.path = Path(path)
        self._begin, self._end = begin or 0.0, np.inf if end is None else end
        self.rotation = 0
        self.size = 0, 0
        self._aspect = 1.0
        self.damaged = self.late = self.untimed = 0

    def expected(self) -> int | None:
        """How many frames the file says that it has, for a progress bar; None: it does not say."""
        try:
            import av
        except ModuleNotFoundError:
            return None  # `pictures` says what is missing
        try:
            with av.open(str(self.path.resolve()), options=_ONLY) as file:
                return file.streams.video[0].frames or None
        except (av.FFmpegError, OSError, ValueError, IndexError):
            return None  # `pictures` says what is wrong

    def pictures(self) -> Iterator[Picture]:
        """Every frame once, in the order of time.

        Raises:
            VideoError: no such file, no video in it, a size or length beyond what is read, not one
                frame that can be decoded, or none in the part that is wanted.
        """
        try:
            import av
        except ModuleNotFoundError:
            raise VideoError(
                f"{self.path}: reading video needs PyAV: pip install 's3le[view]'"
            ) from None
        if not self.path.is_file():
            raise VideoError(f"{self.path}: no such file")
        before, first, last, count = None, None, -np.inf, 0
        try:
            with av.open(str(self.path.resolve()), options=_ONLY) as file:
                if not file.streams.video:
                    raise VideoError(f"{self.path}: has no pictures in it, only sound or data")
                stream = file.streams.video[0]
                stream.thread_type = "AUTO"
                side = max(stream.width or 0, stream.height or 0)
                if side > LARGEST_SIDE:
                    raise VideoError(f"{self.path}: {side} pixels a side, at most {LARGEST_SIDE}")
                self._aspect = float(stream.sample_aspect_ratio or 1.0)
                step = 1.0 / float(stream.average_rate or stream.guessed_rate or 25)
                for frame in self._frames(file, stream, av):
                    if frame.time is None:
                        self.untimed += 1
                    time = 0.0 if first is None else last + step
                    time = time if frame.time is None else float(frame.time)
                    if not time > last:
                        self.late += 1
                        continue
                    first, last = time if first is None else first, time
                    if time - first > self._end:
                        break
                    if time - first < self._begin:
                        continue
                    if count == MOST_FRAMES:
                        raise VideoError(
                            f"{self.path}: more than {MOST_FRAMES} frames; cut it into parts"
                        )
                    small = frame.reformat(*_THUMBNAIL, format="gray").to_ndarray().astype(float)
                    change = 0.0 if before is None else np.abs(small - before).mean() / 255.0
                    before, count = small, count + 1
                    yield Picture(time, self._upright(frame), float(change))
        except (av.FFmpegError, OSError, EOFError) as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise VideoError(
                f"{self.path}: is no video that can be read ({reason}); damaged, cut short, or of "
                "another format"
            ) from None
        if not count and first is not None:
            raise VideoError(
                f"{self.path}: nothing from {self._begin:g} to {self._end:g} s; it lasts "
                f"{last - first:.2f} s"
            )
        if not count:
            raise VideoError(
                f"{self.path}: holds not one frame that can be decoded "
                f"({self.damaged} damaged packets)"
            )

    def _frames(self, file: Any, stream: Any, av: Any) -> Iterator[Any]:
        """Decoded frames; what cannot be decoded is counted."""
        packets = file.demux(stream)
        while True:
            try:
                packet = next(packets, None)
            except (av.InvalidDataError, av.EOFError):  # the end is missing
                self.damaged += 1
                return
            if packet is None:
                return
            try:
                yield from packet.decode()
            except av.InvalidDataError:
                self.damaged += 1

    def _upright(self, frame: Any) -> np.ndarray:
        side = max(frame.width, frame.height)
        if not 0 < side <= LARGEST_SIDE:
            raise VideoError(f"{self.path}: a frame of {frame.width} x {frame.height} pixels")
        aspect = self._aspect if 0.1 < self._aspect < 10.0 else 1.0  # wide pixels, as on a DV tape
        wide = frame.width * aspect
        scale = min(1.0, LONGEST_SIDE / max(wide, frame.height))
        width, height = (max(round(n * scale), 1) for n in (wide, frame.height))
        rgb = frame.reformat(width, height, format="rgb24").to_ndarray()
        self.rotation = round(frame.rotation / 90) % 4
        rgb = np.ascontiguousarray(np.rot90(rgb, self.rotation))
        self.size = rgb.shape[1], rgb.shape[0]
        return rgb
