"""Positions at uneven times, with holes, to a constant rate: short holes filled, noise filtered.

The filter is zero-phase: at every moment a straight line is fitted to what lies around it, with
Gaussian weights. Away from the ends that is a Gaussian low-pass; at the ends it does not bend
the motion towards what is not there.
"""

from typing import NamedTuple

import numpy as np

_REACH = 4.0  # standard deviations
_AT_END = 0.25  # frames by which a moment may lie outside a piece: times are rounded in files
_HOLE = 1.75  # frames between two samples from which on something is missing


class Sampled(NamedTuple):
    """Positions at a constant rate."""

    time: np.ndarray  # [s], (m,)
    points: np.ndarray  # [m], (m, k, 3), NaN where nothing is known
    filled: np.ndarray  # bool (m,): some point is interpolated across a hole


def at_rate(
    time: np.ndarray,
    points: np.ndarray,
    piece: np.ndarray,
    rate: float,
    fill: float,
    cutoff: float,
) -> Sampled:
    """Resample, fill and filter, each point for itself.

    Args:
        time: of the frames [s], (n,), rising, n >= 2.
        points: positions [m], (n, k, 3), NaN where they are not known.
        piece: int (n,), rising: frames of different pieces have nothing to do with each other.
        rate: wanted frames per second [Hz].
        fill: longest hole that is filled [s]; a hole is what is missing between two frames
            beyond the usual time between frames.
        cutoff: frequency of which the filter leaves 71 % [Hz]; 0: no filter.
    """
    usual = float(np.median(np.diff(time)))
    finer = max(int(np.ceil((len(time) - 1) / (time[-1] - time[0]) / rate - 0.01)), 1)
    count = int((time[-1] - time[0]) * rate + _AT_END) + 1
    fine = time[0] + np.arange((count - 1) * finer + 1) / (rate * finer)
    out = np.full((count, points.shape[1], 3), np.nan)
    filled = np.zeros(count, bool)
    for k in range(points.shape[1]):
        rows = np.flatnonzero(np.isfinite(points[:, k]).all(axis=1))
        if not len(rows):
            continue
        at, place = time[rows], points[rows, k]
        span = np.diff(at)
        apart = (np.diff(piece[rows]) != 0) | (span - usual > fill)
        part = np.concatenate([[0], np.cumsum(apart)])
        left = np.clip(np.searchsorted(at, fine, side="right") - 1, 0, len(at) - 1)
        right = np.minimum(left + 1, len(at) - 1)
        near = np.where(np.abs(fine - at[left]) <= np.abs(fine - at[right]), left, right)
        inside = (part[left] == part[right]) & (fine >= at[0]) & (fine <= at[-1])
        at_end = ~inside & (np.abs(fine - at[near]) <= _AT_END * usual)
        weight = np.where(inside, fine - at[left], 0.0) / np.maximum(at[right] - at[left], 1e-12)
        value = place[left] + weight[:, None] * (place[right] - place[left])
        value = np.where(at_end[:, None], place[near], value)
        known = inside | at_end
        owner = np.where(known, part[near], -1)
        on_frame = np.minimum(fine - at[left], at[right] - fine) <= _AT_END * usual
        bridged = inside & (at[right] - at[left] > _HOLE * usual) & ~on_frame
        ends = np.flatnonzero(np.diff(owner)) + 1
        for begin, end in zip(np.r_[0, ends], np.r_[ends, len(fine)], strict=True):
            if owner[begin] >= 0:
                value[begin:end] = low_pass(value[begin:end], rate * finer, cutoff)
        value[~known] = np.nan
        out[:, k] = value[::finer]
        filled |= bridged[::finer]
    return Sampled(fine[::finer], out, filled)


def low_pass(values: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Filter one uninterrupted piece without a delay.

    Args:
        values: (n, k), finite.
        rate: rows per second [Hz].
        cutoff: frequency of which 71 % (-3 dB) is left [Hz]; 0: as given.
    """
    if not cutoff or len(values) < 3:
        return values
    width = np.sqrt(np.log(2.0)) / (2.0 * np.pi * cutoff) * rate  # one standard deviation, in rows
    reach = int(np.ceil(_REACH * width))
    step = np.arange(-reach, reach + 1)
    weight = np.exp(-0.5 * (step / width) ** 2)
    weights = np.stack([weight, weight * step, weight * step**2])  # (3, 2 reach + 1)
    windows = np.lib.stride_tricks.sliding_window_view
    around = windows(np.pad(np.ones(len(values)), reach), len(step))
    s0, s1, s2 = (around @ w for w in weights)
    padded = np.pad(values, ((reach, reach), (0, 0)))
    t0, t1 = (windows(padded, len(step), axis=0) @ w for w in weights[:2])  # (n, k)
    line = (s2[:, None] * t0 - s1[:, None] * t1) / (s0 * s2 - s1**2)[:, None]
    alone = s2 < 1e-12 * s0  # so narrow a filter that no other row counts
    return np.where(alone[:, None], values, line)
