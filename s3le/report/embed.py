"""Pictures that lie in a page itself: charts as elements, painted pictures as shrunk WebP."""

import base64
import io
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup
from PIL import Image

from s3le.errors import FilmError
from s3le.show import svg

WIDEST = 1800  # [pixels]; twice what a page gives a picture, for fine screens
_LARGEST, _MOST = 20 * 2**20, 40_000_000  # [bytes], [pixels] of a picture that is read
_QUALITY = 82  # of WebP; letters of 7 points stay sharp


class Media(NamedTuple):
    """A picture ready to be put into a page."""

    content: bytes  # SVG text, or WebP
    width: float  # [pixels]
    height: float
    drawn: bool  # an SVG that takes the page's colours

    def element(self, name: str) -> Markup:
        """The element of a drawing.

        Args:
            name: letters and hyphens; no other picture of the page has it.
        """
        return Markup(svg.inline(self.content.decode("utf-8"), name))

    @property
    def address(self) -> str:
        """The address of a painted picture, which holds it."""
        return f"data:image/webp;base64,{base64.b64encode(self.content).decode('ascii')}"


def read(path: Path) -> Media:
    """Read a picture.

    Args:
        path: an `.svg` of this project's own (style.save), or a PNG from anywhere.

    Raises:
        FilmError: missing, too large, not a PNG, or cut short; names the file.
    """
    path = Path(path)
    if path.suffix == ".svg":
        drawing = _bytes(path)
        return Media(drawing, *svg.size(drawing.decode("utf-8")), drawn=True)
    try:
        with Image.open(io.BytesIO(_bytes(path)), formats=["PNG"]) as picture:
            if picture.width * picture.height > _MOST:
                raise FilmError(
                    f"{path} has {picture.width} x {picture.height} pixels, at most {_MOST:,} "
                    "are shown; make it smaller"
                )
            rgb = picture.convert("RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise FilmError(f"{path} is not a whole PNG ({error}); make it anew") from None
    if rgb.width > WIDEST:
        rgb = rgb.resize((WIDEST, round(rgb.height * WIDEST / rgb.width)), Image.LANCZOS)
    made = io.BytesIO()
    rgb.save(made, format="WEBP", quality=_QUALITY, method=6)
    return Media(made.getvalue(), rgb.width, rgb.height, drawn=False)


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except OSError as error:
        raise FilmError(f"{path} cannot be read ({error.strerror}); make it anew") from None
    if len(data) > _LARGEST:
        raise FilmError(f"{path} is larger than {_LARGEST >> 20} MiB; make it smaller")
    return data
