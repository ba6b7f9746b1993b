"""Charts as SVG whose colours a page may change, so that one drawing serves light and dark.

Every colour of a drawing becomes a CSS variable that falls back to that colour: `#0072b2` is
written `var(--c0072b2, #0072b2)`. A drawing by itself looks as it was drawn; a page that sets the
variables (page.css.j2 does so for dark) recolours it. Letters are drawn as paths, so that they
stand where they stood on any machine, and no word in a drawing can become markup.
"""

import re

DARK = {  # colours that would be lost on dark paper, and what takes their place there
    "#ffffff": "#1b1f24",
    "#000000": "#e6e8ea",
    "#222222": "#e6e8ea",
    "#4d4d4d": "#b9bec4",
    "#6a6a6a": "#a7aeb6",
    "#7f7f7f": "#a6acb3",
    "#dddddd": "#343a41",
    "#f2f4f6": "#242a31",
    "#c4161c": "#ff7a7d",
    "#0072b2": "#2f8ada",
    "#56b4e9": "#9ad6f9",
    "#d55e00": "#ef7d2b",
    "#003a5c": "#c9e7fb",
    "#6b2f00": "#ffd9bd",
    "#7a5400": "#fff0c4",
    "#8c6d31": "#c9a45c",
    "#7f3c8d": "#c98ad6",
    "#8855aa": "#b98fd6",
    "#aa4455": "#e5808f",
}
_COLOUR = re.compile(r"((?:fill|stroke|stop-color): ?)(#[0-9a-fA-F]{6})\b")
_COMMENT = re.compile(r"\s*<!--.*?-->", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_PATH = re.compile(r'(?<= d=")[^"]*')
_LONG = re.compile(r"-?\d+\.\d{3,}")  # more digits than a hundredth of a point
_USED = re.compile(r'(href="#|url\(#)([^")]+)')
_ID = re.compile(r' id="([^"]+)"')


def variable(colour: str) -> str:
    """Name of the CSS variable that a colour is drawn with."""
    return f"--c{colour.removeprefix('#').lower()}"


def themed(drawing: str) -> str:
    """A drawing by matplotlib, every colour a variable that falls back to it, fewer digits."""
    bare = _METADATA.sub("", _COMMENT.sub("", drawing))
    bare = _PATH.sub(lambda path: _LONG.sub(lambda m: f"{float(m[0]):.2f}", path[0]), bare)
    return _COLOUR.sub(lambda m: f"{m[1]}var({variable(m[2])}, {m[2].lower()})", bare)


def inline(drawing: str, name: str) -> str:
    """A drawing as an element of a page.

    Args:
        drawing: SVG as a file.
        name: told apart from the other drawings of the page by it: letters and hyphens.

    Returns:
        The element, from <svg to </svg>; names within it begin with `name`.
    """
    element = drawing[drawing.index("<svg") :].strip()
    used = {found[1] for found in _USED.findall(element)}
    element = _ID.sub(lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", element)
    return _USED.sub(rf"\g<1>{name}-\g<2>", element)


def size(drawing: str) -> tuple[float, float]:
    """Width and height of a drawing, in its own units."""
    box = re.search(r'viewBox="0 0 ([0-9.]+) ([0-9.]+)"', drawing)
    if box is None:
        raise ValueError("a drawing without a viewBox from 0 0")
    return float(box[1]), float(box[2])
