"""Films as files: MP4 (H.264, by PyAV, which carries its encoder) and GIF (by pillow).

A film appears whole or not at all, and the same pictures give the same bytes.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np

from s3le.errors import FilmError
from s3le.store.atomic import replace

FORMATS = (".mp4", ".gif")
_QUALITY = "20"  # of H.264: 18 is taken for lossless by eye, 23 is usual
_MOST_GIF = 50.0  # [Hz] browsers show faster GIFs slower
_COLOURS = 128
_APART = 12  # of 256, in each of red, green and blue


def write(
    path: Path,
    pictures: Iterable[np.ndarray],
    count: int,
    size: tuple[int, int],
    fps: float,
    keep: tuple[str, ...] = (),
) -> None:
    """Write a film.

    Args:
        path: .mp4 or .gif.
        pictures: uint8 (height, width, 3) each, at least one.
        count: how many there are.
        size: width and height, even numbers.
        fps: pictures per second [Hz].
        keep: colours ("#rrggbb") that a GIF must have, though its first picture may not.

    Raises:
        FilmError: another suffix, a package that is not installed, or a rate that it cannot have.
        OSError: the disk refuses; whatever stood at path still stands.
    """
    made = {".mp4": _mp4, ".gif": _gif}.get(path.suffix.lower())
    if made is None:
        raise FilmError(f"{path}: films end in {', '.join(FORMATS)}")
    if path.suffix.lower() == ".gif" and fps > _MOST_GIF:
        raise FilmError(f"{path}: a GIF has at most {_MOST_GIF:g} pictures a second, not {fps:g}")
    if made is _gif:
        replace(path, lambda part: _gif(part, pictures, count, fps, keep))
    else:
        replace(path, lambda part: _mp4(part, pictures, size, fps))


def _mp4(part: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], fps: float) -> None:
    try:
        import av
    except ModuleNotFoundError:
        raise FilmError("MP4 needs PyAV: pip install 's3le[view]', or write a .gif") from None
    rate = Fraction(fps).limit_denominator(1001)
    flags = {"movflags": "+faststart", "fflags": "+bitexact"}
    try:
        with av.open(str(part), "w", format="mp4", options=flags) as file:
            options = {"crf": _QUALITY, "preset": "veryfast"}
            stream = file.add_stream("libx264", rate=rate, options=options)
            stream.width, stream.height = size
            stream.pix_fmt = "yuv420p"  # what every player knows
            stream.codec_context.thread_count = 1  # so that the bytes do not depend on the machine
            for picture in pictures:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
    except av.FFmpegError as error:
        raise FilmError(f"the film cannot be encoded ({error})") from None


def _gif(
    part: Path, pictures: Iterable[np.ndarray], count: int, fps: float, keep: tuple[str, ...]
) -> None:
    from PIL import Image

    frames = iter(pictures)
    first = Image.fromarray(next(frames))
    # One palette for all, so that colours do not flicker.
    found = first.quantize(_COLOURS, Image.Quantize.MEDIANCUT).getpalette()[: 3 * _COLOURS]
    found = np.array(found).reshape(-1, 3)
    fixed = np.array([list(bytes.fromhex(colour[1:])) for colour in ("#ffffff", *keep)])
    # pillow takes a near colour for the nearest, so none may be near one that is to be kept.
    far = np.abs(found[:, None] - fixed).max(axis=2).min(axis=1) > _APART
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([fixed, found[far]]).ravel().tolist())

    def thin(picture: Image.Image) -> Image.Image:
        return picture.quantize(palette=palette, dither=Image.Dither.NONE)

    shown = (thin(Image.fromarray(picture)) for picture in frames)
    # GIF counts hundredths of a second: some pictures stay one longer, so that the film keeps time.
    ticks = np.diff(np.round(np.arange(count + 1) * 100 / fps).astype(int)) * 10
    thin(first).save(
        part, "GIF", save_all=True, append_images=shown, duration=ticks.tolist(), loop=0
    )
