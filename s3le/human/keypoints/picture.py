"""Landmarks in shares of a picture, which are no places in metres.

An estimator gives a person twice: where the landmarks are in the picture, x and y from 0 to 1 of
its width and height, and where they are around the hips in metres. The former have the picture's
aspect in them, and every direction is bent by it.
"""

from pathlib import Path

import numpy as np

from s3le.human.text import refusal
from s3le.skeleton import POINTS

SHARE = 0.95  # of the joints that lie in the picture, where the whole person is seen
FLAT = 0.02  # [m] as taken for metres: the hips' depth, which is zero in a picture
OFF = 0.1  # [m] of the hips from the middle of people who are placed around these

_HIPS = [POINTS.index("r_pelvis"), POINTS.index("l_pelvis")]


def refuse(path: Path | str, joints: np.ndarray, points: np.ndarray, axes: str, unit: str) -> None:
    """Refuse joints whose x and y are shares of a picture.

    Nobody who is placed around the hips, and nobody of a metre or more, is between 0 and 1 in
    both; of a person who is cut by the picture's edge the hips tell, whose depth is zero there.

    Args:
        path: for messages.
        joints: in the file's axes and unit, (n, j, 3), NaN where unknown.
        points: the ten among them, (n, 10, 3).
        axes: as found.
        unit: as found.

    Raises:
        ClipError: so they look.
    """
    if unit != "m" or axes == "z-up":
        return
    seen = joints[np.isfinite(joints).all(axis=2)][:, :2]
    inside = ((seen >= 0.0) & (seen <= 1.0)).all(axis=1).mean()
    hips = points[:, _HIPS].mean(axis=1)
    hips = hips[np.isfinite(hips).all(axis=1)]
    x, y, z = np.median(np.abs(hips), axis=0)
    shown = ((hips[:, :2] >= 0.0) & (hips[:, :2] <= 1.0)).all(axis=1).mean() >= SHARE
    # Upwards from the ground at the origin, hips are off in height alone.
    off = max(x, y) if axes == "camera" else x
    placed = shown and z <= FLAT and off >= OFF
    if inside >= SHARE or placed:
        raise refusal(
            path, None,
            "x and y lie from 0 to 1, as shares of a picture's width and height do; these are no "
            "metres, and the picture's aspect bends every direction: give the world landmarks "
            "(MediaPipe: pose_world_landmarks), or the video itself to s3le video",
        )  # fmt: skip
