"""Keys of a glTF animation at any moments: LINEAR, STEP and CUBICSPLINE as the format says.

Positions and scales go linearly, rotations along the shortest arc. Source: the glTF 2.0
specification of Khronos, appendix C.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.human.clip import FPS_RANGE
from s3le.human.keypoints.clocks import EVEN, USUAL
from s3le.human.text import refusal

LINEAR, STEP, SPLINE = "LINEAR", "STEP", "CUBICSPLINE"
MOST_FRAMES = 200_000
SMOOTH = 30.0  # [Hz] at least, where keys are uneven or sparse: between them rotations are arcs
SPARSE = 10.0  # [Hz]
_NEAR = 0.02  # of a key to a moment of the grid, in its steps
_FINEST = 12  # parts of the shortest step that are tried for a grid that meets all keys
_ROUND = 1e-6  # [s] by which a time in four bytes may be off


class Keys(NamedTuple):
    """The keys of one path of one node."""

    time: np.ndarray  # [s], (k,), rising
    value: np.ndarray  # (k, width); of splines (k, 3, width): tangent in, value, tangent out
    how: str  # LINEAR, STEP or SPLINE
    turns: bool  # quaternions, scalar last


def times(path: Path, keys: Iterable[Keys]) -> tuple[np.ndarray, float, str]:
    """Moments [s] from the first key to the last, their rate, and how it was found.

    Where the densest keys are at even times and all others lie among them, these are the moments.
    Otherwise the moments are so dense that all keys lie on them, or as near as 1000 Hz brings them.

    Args:
        path: for messages.
        keys: of all that moves.

    Raises:
        ClipError: more than MOST_FRAMES, or keys at no rate.
    """
    keys = list(keys)
    steps = [np.diff(own.time) for own in keys if len(own.time) > 1]
    if not steps:
        return np.zeros(1), SMOOTH, ""  # one pose has no rate
    densest = min(steps, key=np.median)
    middle = float(np.median(densest))
    even = np.abs(densest / middle - 1.0).max() <= EVEN and _on_grid(keys, middle)
    if even and middle <= 1.001 / SPARSE:
        rate, told = 1.0 / middle, ""
        if abs(round(rate) - rate) <= 1e-2 * rate and round(rate):
            rate = float(round(rate))
    else:
        rate = _grid(keys, min(float(own.min()) for own in steps))
        told = f"keys at {'few' if even else 'uneven'} times, sampled at {rate:g} Hz"
    first = min(own.time[0] for own in keys)
    span = max(own.time[-1] for own in keys) - first
    if not FPS_RANGE[0] <= rate <= FPS_RANGE[1] or span * rate > MOST_FRAMES:
        raise refusal(path, None, f"{span * rate:.0f} frames at {rate:g} Hz by its keys")
    return first + np.arange(int(span * rate + _NEAR) + 1) / rate, rate, told


def _on_grid(keys: list[Keys], step: float) -> bool:
    """Whether all keys lie on moments that are so far apart."""
    first = min(own.time[0] for own in keys)
    places = np.concatenate([own.time - first for own in keys]) / step
    return bool((np.abs(places - np.round(places)) <= _NEAR + _ROUND / step).all())


def _grid(keys: list[Keys], shortest: float) -> float:
    """A rate [Hz] of at least SMOOTH on which all keys lie, if there is one up to 1000 Hz."""
    shortest = max(shortest, 1.0 / USUAL[1])
    for part in range(1, _FINEST + 1):
        rate = part / shortest
        if abs(round(rate) - rate) <= 1e-2 * rate and round(rate):
            rate = float(round(rate))
        if rate <= USUAL[1] and _on_grid(keys, 1.0 / rate):
            return rate * max(1.0, np.ceil(SMOOTH / rate - 1e-9))
    return float(min(max(np.ceil(4.0 / shortest), SMOOTH), USUAL[1]))


def sampled(keys: Keys, time: np.ndarray) -> np.ndarray:
    """Values at moments (n, width); before the first and after the last key they stand."""
    knots = keys.value[:, 1] if keys.how == SPLINE else keys.value
    if len(keys.time) == 1:
        return np.repeat(knots, len(time), axis=0)
    left = np.searchsorted(keys.time, time + _ROUND, "right") - 1
    left = np.clip(left, 0, len(keys.time) - 2)
    span = keys.time[left + 1] - keys.time[left]
    share = np.clip((time - keys.time[left]) / span, 0.0, 1.0)[:, None]
    a, b = knots[left], knots[left + 1]
    if keys.how == STEP:
        return np.where(time[:, None] + _ROUND >= keys.time[left + 1][:, None], b, a)
    if keys.how == SPLINE:
        out, into = keys.value[left, 2] * span[:, None], keys.value[left + 1, 0] * span[:, None]
        return _spline(a, out, b, into, share, keys.turns)
    return _arc(a, b, share) if keys.turns else (1.0 - share) * a + share * b


def _spline(
    a: np.ndarray, out: np.ndarray, b: np.ndarray, into: np.ndarray, t: np.ndarray, turns: bool
) -> np.ndarray:
    """Hermite's cubic from a to b by tangents that are scaled with the time between them."""
    made = (2 * t**3 - 3 * t**2 + 1) * a + (t**3 - 2 * t**2 + t) * out
    made = made + (-2 * t**3 + 3 * t**2) * b + (t**3 - t**2) * into
    if not turns:
        return made
    length = np.linalg.norm(made, axis=1, keepdims=True)
    if not (length > 1e-6).all():
        raise ValueError("a spline of rotations passes through zero")
    return made / length


def _arc(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Between unit quaternions, the shorter way."""
    cos = (a * b).sum(axis=1, keepdims=True)
    b = np.where(cos < 0.0, -b, b)
    angle = np.arccos(np.clip(np.abs(cos), 0.0, 1.0))
    sin = np.sin(angle)
    near = sin < 1e-6
    safe = np.where(near, 1.0, sin)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    return first * a + np.where(near, share, np.sin(share * angle) / safe) * b
