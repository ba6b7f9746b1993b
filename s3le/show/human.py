"""The human as a picture shows one: thin capsules along the seven directions of a skeleton.

A skeleton x holds directions only, so the lengths are somebody's: a nominal adult's, or a
robot's, to lay the human over it.
"""

from typing import NamedTuple

import numpy as np

from s3le.errors import ParameterError
from s3le.skeleton import DIM

TRUNK, SHOULDER, UPPER_ARM, FOREARM = 0.50, 0.19, 0.30, 0.26  # [m] nominal adult segments
PELVIS = 0.11  # [m] half width; the pelvis line lies along y by the skeleton's convention

LEFT, RIGHT, MIDDLE, PALE = "#1f9e89", "#8455a8", "#5c6670", "#e2e6ea"


class Size(NamedTuple):
    """Lengths of the segments [m]."""

    trunk: float = TRUNK
    shoulder: float = SHOULDER
    upper_arm: float = UPPER_ARM
    forearm: float = FOREARM


NOMINAL = Size()


class Figures(NamedTuple):
    """Humans as capsules, the hip of each at the origin."""

    ends: np.ndarray  # [m], (n, b, 2, 3)
    radius: np.ndarray  # [m], (b,)
    colours: list[str]  # (b,)


def stick_figures(x: np.ndarray, size: Size = NOMINAL, slim: float = 1.0) -> Figures:
    """The humans that have the skeletons x.

    Head and pelvis are there to tell which way is up and front; the skeleton does not hold them.

    Args:
        x: skeletons, (n, 21); rows that are not finite give ends that are not.
        size: lengths of the segments; all that is not measured scales with the trunk.
        slim: factor on the radii.

    Raises:
        ParameterError: x has another shape.
    """
    x = np.asarray(x, float)
    if x.ndim != 2 or x.shape[1] != DIM:
        raise ParameterError(f"skeletons must have shape (n, {DIM}), got {x.shape}")
    bone = x.reshape(-1, 7, 3)
    scale = size.trunk / TRUNK
    hip = np.zeros((len(x), 3))
    side = hip + [0.0, PELVIS * scale, 0.0]
    up = bone[:, 0]
    neck = size.trunk * up
    head = neck + 0.20 * scale * up
    front = np.cross(bone[:, 4] - bone[:, 1], up)  # of the chest
    length = np.linalg.norm(front, axis=1, keepdims=True)
    nose = head + 0.085 * scale * front / np.maximum(length, 1e-9)
    parts = [
        (hip - side, hip + side, 0.020, PALE),
        (neck, neck + 0.13 * scale * up, 0.020, PALE),
        (head, head + 0.03 * scale * up, 0.078, PALE),
        (nose, nose, 0.018, PALE),
        (hip, neck, 0.024, MIDDLE),
        (hip, hip, 0.038, MIDDLE),
        (neck, neck, 0.036, MIDDLE),
    ]
    for first, colour in ((1, RIGHT), (4, LEFT)):
        shoulder = neck + size.shoulder * bone[:, first]
        elbow = shoulder + size.upper_arm * bone[:, first + 1]
        hand = elbow + size.forearm * bone[:, first + 2]
        for a, b in ((neck, shoulder), (shoulder, elbow), (elbow, hand)):
            parts.append((a, b, 0.022, colour))
        for joint, thick in ((shoulder, 0.036), (elbow, 0.034), (hand, 0.042)):
            parts.append((joint, joint, thick, colour))
    ends = np.stack([np.stack([a, b], axis=1) for a, b, _, _ in parts], axis=1)
    radius = np.array([r for _, _, r, _ in parts]) * scale * slim
    return Figures(ends, radius, [c for _, _, _, c in parts])


def stand(hip: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """What holds a figure without legs up at a height, the hip at the origin.

    Args:
        hip: height of the hip above the floor [m].

    Returns:
        Ends (b, 2, 3) [m], radius (b,) [m], colour names (b,).
    """
    foot = np.array([0.0, 0.0, 0.012 - hip])
    ends = np.array([[np.zeros(3), foot], *([foot, foot + step] for step in _FEET)])
    return ends, np.full(len(ends), 0.012), [PALE] * len(ends)


_FEET = 0.13 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.866, 0.0], [-0.5, -0.866, 0.0]])
