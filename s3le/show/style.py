"""What every figure shares: colours, words, fonts, and how a file comes to be.

A method has one colour wherever it appears. Colours are from Okabe and Ito's palette, which
stays apart for colour-blind readers; a brute-force search wears a darker shade of the colour
of the method whose pool it searches. Nothing here reads a clock or writes a version.
"""

import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
from anyascii import anyascii
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.text import Text

from s3le.learn.methods import ENTRIES, label
from s3le.show import svg
from s3le.store.atomic import replace

COLOURS = {
    "truth": "#4d4d4d",
    "ale": "#CC79A7",
    "lwl2_pairs": "#D55E00",
    "lwl2": "#E69F00",
    "lwl2_all": "#F0E442",
    "s3le": "#0072B2",
    "certified_lookup": "#56B4E9",
    "certified_refined": "#009E73",
    "skeleton_pairs": "#6b2f00",
    "skeleton_poses": "#7a5400",
    "skeleton_all": "#003a5c",
}
SPARE = ("#8c6d31", "#7f7f7f", "#9a8ac7", "#b3b36b")  # for methods without a colour of their own

METHODS = tuple((key, label(key)) for key in ENTRIES)  # in reading order
BRUTE_FORCE = {  # method -> brute-force search of the same pool
    key: entry.twin for key, entry in ENTRIES.items() if entry.twin
}
TRAINED = {"ale": "ALE", "lwl2": "LWL2", "s3le": "S3LE"}  # what one training makes

INK = "#222222"
QUIET = "#6a6a6a"
FAINT = "#dddddd"
BAND = "#f2f4f6"
ALARM = "#c4161c"

DPI = 150

_SHEET: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so every machine has it
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "text.color": INK,
    "xtick.color": QUIET,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "text.parse_math": False,  # a clip may be named anything
    "svg.fonttype": "path",
    "svg.hashsalt": "s3le",  # else names within a drawing are drawn by lot
}


@contextmanager
def sheet() -> Iterator[None]:
    """Draw with this project's settings, whatever the user's own matplotlib settings are."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SHEET)
        yield


def figure(width: float, height: float) -> Figure:
    """An empty white figure of width x height [inch], drawn by Agg; call within `sheet`."""
    made = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(made)
    return made


def save(figure: Figure, path: Path) -> None:
    """Write a figure: the whole file or none of it, the same bytes for the same figure.

    Args:
        figure: what to draw, at its own resolution.
        path: where, `.png` or `.svg` (svg.themed, without a background of its own); the folder is
            made if need be.

    Raises:
        OSError: the disk refuses; whatever stood at path still stands.
    """
    for words in figure.findobj(Text):
        words.set_text(printable(words.get_text()))
    drawn = BytesIO()
    if Path(path).suffix == ".svg":
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(drawn, format="svg", dpi=figure.dpi, transparent=True, metadata=nothing)
        made = svg.themed(drawn.getvalue().decode()).encode()
    else:
        figure.savefig(drawn, format="png", dpi=figure.dpi, metadata={"Software": None})
        made = drawn.getvalue()
    replace(path, lambda part: part.write_bytes(made))


def colour(method: str, spare: int = 0) -> str:
    """The colour of a method; for one unknown here, the spare colour of that number."""
    return COLOURS.get(method, SPARE[spare % len(SPARE)])


@cache
def _drawn() -> frozenset[int]:
    """Characters that the font of every figure has."""
    return frozenset(get_font(findfont(_SHEET["font.family"])).get_charmap())


def printable(text: str) -> str:
    """Words as a figure can print them: letters that its font lacks in Latin ones.

    The font comes with matplotlib and has Latin, Greek, Cyrillic and more, but no Chinese, Japanese
    or Korean; what a machine's own fonts have would make its pictures differ from another's.
    """
    text = unicodedata.normalize("NFC", text)
    whole = [c if ord(c) in _drawn() or c == "\n" else anyascii(c) or "?" for c in text]
    return "".join(whole)


def wide(text: str, size: float, bold: bool = False) -> float:
    """How wide one line of so many points is printed [inch]."""
    return sum(map(_advance(bold).__getitem__, printable(text))) * size / 72.0


def wrapped(text: str, width: float, size: float, bold: bool = False) -> str:
    """Words in lines of at most `width` [inch] at so many points, printable, and none lost.

    Lines end after blanks, underscores, strokes and points where they can, else anywhere.
    """
    lines = [""]
    for piece in re.findall(r"[^\s_/.-]*[\s_/.-]*", printable(text)):
        if wide(lines[-1] + piece.rstrip(), size, bold) > width and lines[-1]:
            lines.append("")
        for letter in piece:
            if letter == "\n" or (lines[-1] and wide(lines[-1] + letter, size, bold) > width):
                lines.append("")
            lines[-1] += letter.strip("\n")
    return "\n".join(line.strip() for line in lines if line.strip())


@cache
def _advance(bold: bool) -> "_Advance":
    return _Advance("bold" if bold else "normal")


class _Advance(dict[str, float]):
    """How far each letter of the font moves on, as a share of its size."""

    def __init__(self, weight: str):
        face = FontProperties(family=_SHEET["font.family"], weight=weight)
        self._font = get_font(findfont(face))

    def __missing__(self, letter: str) -> float:
        # Matplotlib hands this font to everybody who draws: its size is theirs after each figure.
        self._font.set_size(1000.0, 72)
        self[letter] = self._font.load_char(ord(letter)).linearHoriAdvance / 65536.0 / 1000.0
        return self[letter]


def note(figure: Figure, text: str) -> None:
    """Say in the middle of a figure why there is nothing to see."""
    figure.text(0.5, 0.5, text, ha="center", va="center", color=QUIET, size=10)
