"""What an estimator's joints are worth, frame by frame: who is seen, and where the thread breaks.

An estimator follows one person. At a cut, or where it leaves one person for another, two frames
that follow each other do not belong together: nothing is interpolated or filtered across, and the
first frame after it is left out. Where it takes left for right or front for back, a person seems
to turn round within one frame and back again later; the frames between are left out.
"""

from typing import NamedTuple

import numpy as np

from s3le.skeleton import POINTS
from s3le.video.estimator import JOINTS

_AT = {name: i for i, name in enumerate(JOINTS)}
# The joints that the ten points come from, besides their midpoints.
UPPER = [_AT[f"{s}_{p}"] for s in "rl" for p in ("shoulder", "elbow", "hand", "hip")]
_TORSO = [_AT[f"{s}_{p}"] for s in "rl" for p in ("shoulder", "hip")]

CUT, CUT_IF_MOVED = 0.15, 0.04  # change of the picture, as a share of black to white
STANDS_OUT = 5.0  # a cut's change is that many times what is usual around it
_AROUND = 15  # frames to either side that say what is usual
# Torso lengths that a torso moves in the picture at most: of an error, and per second of a sprint.
FAR, FAST = 0.5, 15.0
GROWS = 1.5  # how much larger or smaller it becomes from frame to frame at most
_TWISTS = np.pi / 2  # [rad] by which shoulders turn against hips at most
_CLEAR = np.cos(np.radians(70.0))  # a body that is seen in between has no side
_MEMORY = 0.07  # [s] over which the side that it shows is remembered
_NEITHER = -1
_NEAR = 0.12  # [s] beyond which two frames are too far apart to tell a jump from a motion


class Breaks(NamedTuple):
    """Frames that are not to be used although somebody is seen; bool (n,) each, no two of one."""

    cut: np.ndarray  # the first of another scene
    jump: np.ndarray  # the first of another person, or of another size
    flip: np.ndarray  # left and right, or front and back, are taken for each other

    @property
    def ends(self) -> np.ndarray:
        """Frames that do not go on from the last one in which somebody was seen."""
        return self.cut | self.jump


def seen(joints: np.ndarray) -> np.ndarray:
    """Frames in which there is somebody, bool (n,)."""
    return np.isfinite(joints[:, UPPER]).all(axis=(1, 2))


def breaks(time: np.ndarray, joints: np.ndarray, change: np.ndarray) -> Breaks:
    """Find where the thread breaks.

    A cut is a picture that changes much more than those around it, and either beyond doubt or
    with a person who moves as nobody can. A jump is such a move without a cut.

    Args:
        time: of the frames [s], (n,), rising.
        joints: see estimator.Estimator, (n, 12, 6).
        change: see estimator.Picture, (n,).
    """
    rows = np.flatnonzero(seen(joints))
    usual = _median_around(change)
    loud = (change > CUT_IF_MOVED) & (change > STANDS_OUT * usual)
    scene = (change > CUT) & loud
    cut, jump, flip = (np.zeros(len(time), bool) for _ in range(3))
    if len(rows) < 2:
        return Breaks(cut, jump, flip)
    a, b = joints[rows[:-1]], joints[rows[1:]]
    since = np.diff(time[rows])
    centre = [p[:, _TORSO, 4:].mean(axis=1) for p in (a, b)]
    size = np.maximum(_size(a), _size(b))
    moved = np.linalg.norm(centre[1] - centre[0], axis=1) > size * (FAR + FAST * since)
    grew = np.abs(np.log(_size(b) / _size(a))) > np.log(GROWS)
    far = moved | (grew & (since < _NEAR))
    # How often the picture changed since the last frame in which somebody was seen.
    passed = [np.diff(np.cumsum(kind)[rows]) > 0 for kind in (scene, loud)]
    cut[rows[1:]] = passed[0] | (passed[1] & far)
    jump[rows[1:]] = far & ~cut[rows[1:]]
    flip[rows] = _flipped(time[rows], joints[rows], (cut | jump)[rows]) & ~(cut | jump)[rows]
    return Breaks(cut, jump, flip)


def _median_around(change: np.ndarray) -> np.ndarray:
    padded = np.pad(change, _AROUND, mode="reflect" if len(change) > _AROUND else "edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1), axis=1)


def _size(joints: np.ndarray) -> np.ndarray:
    """Longest distance between two corners of the torso in the picture, (n,)."""
    corners = joints[:, _TORSO, 4:]
    apart = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3)
    return np.maximum(apart.max(axis=(1, 2)), 1e-6)


def _flipped(time: np.ndarray, joints: np.ndarray, anew: np.ndarray) -> np.ndarray:
    """Frames in which left and right, or front and back, are taken for each other, bool (n,).

    The side that a body shows is compared with where it was just before, so that a frame on the
    way from one to the other does not hide a flip. Of the two sides of a stretch the one
    with fewer frames is the wrong one; frames that fit neither belong to none.
    """
    facing, twisted = _facing(joints)
    side, group = np.full(len(time), _NEITHER), np.zeros(len(time), int)
    usual, last, number = None, -np.inf, 0
    for i in range(len(time)):  # each frame hangs on those before; microseconds beside estimating
        if usual is None or anew[i] or time[i] - last > _NEAR:
            usual, number = None, number + 1
        group[i] = number
        if twisted[i]:
            continue
        if usual is None:
            usual, side[i] = facing[i], 0
        else:
            agrees = float(facing[i] @ usual)
            if abs(agrees) < _CLEAR:
                continue
            side[i] = int(agrees < 0.0)
            share = 1.0 - np.exp(-(time[i] - last) / _MEMORY)
            usual = usual + share * (np.copysign(1.0, agrees) * facing[i] - usual)
            usual /= max(float(np.linalg.norm(usual)), 1e-9)
        last = time[i]
    count = np.stack([np.bincount(group[side == s], minlength=number + 1) for s in (0, 1)])
    return side != np.argmax(count, axis=0)[group]


def _facing(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right to left of each frame's body, (n, 3); and where hips and shoulders contradict."""
    hips, shoulders = (
        d / np.maximum(np.linalg.norm(d, axis=1), 1e-9)[:, None]
        for d in (
            joints[:, _AT[f"l_{p}"], :3] - joints[:, _AT[f"r_{p}"], :3] for p in ("hip", "shoulder")
        )
    )
    both = hips + shoulders
    both /= np.maximum(np.linalg.norm(both, axis=1), 1e-9)[:, None]
    return both, np.einsum("ij,ij->i", hips, shoulders) < np.cos(_TWISTS)


def ten_points(joints: np.ndarray, least: float, pitch: float, roll: float = 0.0) -> np.ndarray:
    """The ten points of each frame, z up, the mid of the hips at the origin.

    Args:
        joints: see estimator.Estimator, (n, 12, 6).
        least: visibility below which a joint is not used.
        pitch, roll: see upright.

    Returns:
        Positions [m], (n, 10, 3), ordered as skeleton.POINTS, x towards the camera, y to the
        image's right, z up; NaN where a joint is not used.
    """
    used = np.isfinite(joints).all(axis=2) & (joints[:, :, 3] >= least)
    place = np.where(used[:, :, None], upright(joints[:, :, :3], pitch, roll), np.nan)
    part = {name: place[:, i] for name, i in _AT.items()}
    part["r_pelvis"], part["l_pelvis"] = part["r_hip"], part["l_hip"]
    part["hip"] = (part["r_hip"] + part["l_hip"]) / 2.0
    part["neck"] = (part["r_shoulder"] + part["l_shoulder"]) / 2.0
    points = np.stack([part[name] for name in POINTS], axis=1)
    return points - points[:, :1]


def upright(camera: np.ndarray, pitch: float, roll: float = 0.0) -> np.ndarray:
    """Positions in the frame of a tilted camera (x right, y down, z away), with z up.

    Args:
        camera: positions [m], (..., 3).
        pitch: angle by which the camera looks down [rad].
        roll: angle by which what is upright leans to the right in its image [rad].

    Returns:
        Positions [m], (..., 3): x towards the camera, y to the image's right, z up.
    """
    x, y, z = -camera[..., 2], camera[..., 0], -camera[..., 1]
    c, s = np.cos(roll), np.sin(roll)
    y, z = c * y - s * z, s * y + c * z
    c, s = np.cos(pitch), np.sin(pitch)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


class Pitch(NamedTuple):
    """What standing people say about the camera."""

    angle: float  # [rad] it looks down; NaN: nobody stands
    spread: float  # [rad] half of the middle half of the frames
    frames: int  # that say it


_STRAIGHT = np.cos(np.radians(25.0))  # of knees and hips, for somebody who stands


def standing_pitch(joints: np.ndarray, least: float, roll: float = 0.0) -> Pitch:
    """How far the camera looks down, from frames in which somebody stands with both legs straight.

    From ankles to shoulders such a body is vertical, give or take a stride: the median over the
    frames of its lean in the camera's eyes.

    Args:
        joints: see estimator.Estimator, (n, 12, 6).
        least: visibility that hips, knees, ankles and shoulders must have.
        roll: see upright.
    """
    legs = [_AT[f"{s}_{p}"] for s in "rl" for p in ("knee", "ankle")]
    needed = [*_TORSO, *legs]
    good = np.isfinite(joints[:, needed]).all(axis=(1, 2))
    good &= (joints[:, needed, 3] >= least).all(axis=1)
    place = upright(joints[good, :, :3], 0.0, roll)
    part = {name: place[:, i] for name, i in _AT.items()}
    shoulders, ankles = ((part[f"r_{p}"] + part[f"l_{p}"]) / 2.0 for p in ("shoulder", "ankle"))
    hips = (part["r_hip"] + part["l_hip"]) / 2.0
    stands = _cosine(shoulders - hips, hips - ankles) > _STRAIGHT
    for s in "rl":
        thigh = part[f"{s}_hip"] - part[f"{s}_knee"]
        stands &= _cosine(thigh, part[f"{s}_knee"] - part[f"{s}_ankle"]) > _STRAIGHT
    body = (shoulders - ankles)[stands]
    if not len(body):
        return Pitch(np.nan, np.nan, 0)
    lean = np.arctan2(body[:, 0], body[:, 2])
    low, middle, high = np.quantile(lean, (0.25, 0.5, 0.75))
    return Pitch(float(middle), float((high - low) / 2.0), len(body))


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.einsum("ij,ij->i", a, b) / np.maximum(length, 1e-9)
