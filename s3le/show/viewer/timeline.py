"""The line of time as HTML: where each robot is slowed or held, and how far it keeps clear."""

from html import escape

import numpy as np

from s3le.show import pace

_WIDE, _BAND, _CURVE, _GAP = 1000, 9, 34, 8  # [units of the picture; its height in pixels]
_POINTS = 400  # of a curve
LEAST, MOST = 5.0, 50.0  # [mm] of a curve's height


def picture(
    kinds: list[np.ndarray], clearances: list[np.ndarray], colours: list[str], margins: list[float]
) -> str:
    """The whole line, an SVG as wide as the page lets it be.

    Args:
        kinds: of each robot, index into pace.KINDS, (n,).
        clearances: of each robot [m], (n,).
        colours: of each robot.
        margins: clearance that each robot is to keep [m].
    """
    parts, y = [], 0.0
    top = _top(clearances)
    for kind, clearance, colour, margin in zip(kinds, clearances, colours, margins, strict=True):
        n = max(len(kind) - 1, 1)
        parts.append(_rect(0, y, _WIDE, _BAND, "#8aa0b3", 0.35))
        for first, end, what in pace.spans(kind):
            left, right = first / n * _WIDE, min(end, n) / n * _WIDE
            parts.append(_rect(left, y, max(right - left, 2.0), _BAND, what.colour))
        y += _BAND + 2
        parts.append(_rect(0, y, _WIDE, _CURVE, "#8aa0b3", 0.12))
        line = y + _CURVE * (1.0 - min(margin * 1e3 / top, 1.0))
        parts.append(
            f'<line x1="0" x2="{_WIDE}" y1="{line:.1f}" y2="{line:.1f}" stroke="#c4161c" '
            'stroke-width="1" stroke-dasharray="6 6" vector-effect="non-scaling-stroke"/>'
        )
        path = " ".join(f"{a:.1f},{y + b:.1f}" for a, b in _curve(clearance * 1e3 / top))
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="{escape(colour)}" stroke-width="1.5" '
            'vector-effect="non-scaling-stroke"/>'
        )
        y += _CURVE + _GAP
    return (
        f'<div style="padding:0 1em"><svg viewBox="0 0 {_WIDE} {y:.0f}" '
        'preserveAspectRatio="none" '
        f'style="display:block;width:100%;height:{y:.0f}px">{"".join(parts)}</svg>'
        f'<div style="{_SMALL}">{_legend(kinds, top, margins)}</div></div>'
    )


def height(robots: int) -> float:
    """Of the line without its legend [pixels]."""
    return robots * (_BAND + 2 + _CURVE + _GAP) - _GAP


def cursor(share: float, robots: int) -> str:
    """A mark over the line at a share of its length; stands above the line and has no height."""
    return (
        '<div style="height:0;position:relative;margin:0 1em">'
        f'<div style="position:absolute;z-index:2;left:{100 * share:.2f}%;top:-3px;width:2px;'
        f'height:{height(robots) + 6:.0f}px;background:currentColor"></div></div>'
    )


_SMALL = "font-size:0.75em;line-height:1.5;opacity:0.85;padding-top:2px"


def _legend(kinds: list[np.ndarray], top: float, margins: list[float]) -> str:
    seen = {int(k) for kind in kinds for k in np.unique(kind)}
    words = [
        f'<span style="color:{what.colour}">■</span>&nbsp;{what.label}'
        for i, what in enumerate(pace.KINDS)
        if i in seen and what is not pace.PLAIN
    ]
    asked = " / ".join(f"{m * 1e3:g}" for m in dict.fromkeys(margins))
    words.append(f"curve: clearance, 0 to {top:g} mm; dashed: {asked} mm")
    return " &nbsp; ".join(words)


def _top(clearances: list[np.ndarray]) -> float:
    """Height of the curves [mm]."""
    high = max((float(np.percentile(c, 99)) * 1e3 for c in clearances if len(c)), default=LEAST)
    return float(np.clip(np.ceil(high / 5.0) * 5.0, LEAST, MOST))


def _curve(share: np.ndarray) -> list[tuple[float, float]]:
    """Points of a curve; of many moments that fall together the least, which is what counts."""
    n = len(share)
    edges = np.unique(np.linspace(0, n, min(n, _POINTS) + 1).astype(int))[:-1]
    least = np.minimum.reduceat(share, edges)
    x = edges / max(n - 1, 1) * _WIDE
    return list(zip(x, _CURVE * (1.0 - np.clip(least, 0.0, 1.0)), strict=True))


def _rect(x: float, y: float, w: float, h: float, colour: str, opacity: float = 1.0) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="{colour}" '
        f'fill-opacity="{opacity:g}"/>'
    )
