"""Pictures that lie in a page itself: charts as elements, painted pictures as shrunk WebP."""

import base64
import io
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from s3le.errors import FilmError
from s3le.report.html import Html, scrolled, tag
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
    return Media(made.getvalue(), *rgb.size, drawn=False)


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
    except OSError as error:
        raise FilmError(f"{path} cannot be read ({error.strerror}); make it anew") from None
    if len(data) > _LARGEST:
        raise FilmError(f"{path} is larger than {_LARGEST >> 20} MiB; make it smaller")
    return data


def shown(media: Media, name: str, alt: str, narrowest: int) -> Html:
    """A picture as an element of a page.

    Args:
        media: the picture.
        name: letters and hyphens; no other picture of the page has it.
        alt: what it shows, in words.
        narrowest: below this width the picture scrolls in its box instead [CSS pixels].
    """
    least = f"min-width:{min(narrowest, round(media.width))}px"
    if media.drawn:
        least = f"min-width:{max(narrowest, round(0.8 * media.width))}px"
        element = svg.inline(media.content.decode("utf-8"), name)
        most = round(1.25 * media.width * 96 / 72)  # drawn in points, letters of 9 of them
        start = tag("div", class_="drawn", role="img", aria_label=alt,
                    style=f"{least};max-width:{most}px")  # fmt: skip
        element = Html(start.removesuffix("</div>") + element + "</div>")
    else:
        data = base64.b64encode(media.content).decode("ascii")
        element = tag(
            "img", src=f"data:image/webp;base64,{data}", alt=alt, style=least,
            width=media.width, height=media.height,
        )  # fmt: skip
    kind = "media" if media.drawn else "media painted"
    return tag("div", scrolled(element, f"picture: {name}"), class_=kind)
