"""What an estimator is: pictures in, twelve joints of one person out.

Any model that tells these joints in metres fits; `s3le.video.process` runs one in an environment
of its own.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np

from s3le.video.worker import NAMES

JOINTS = NAMES


class Picture(NamedTuple):
    """One frame as it is to be seen, upright.

    Attributes:
        time: when it is shown [s].
        rgb: uint8 (height, width, 3).
        change: mean absolute difference of its grey thumbnail to that of the frame before, in
            [0, 1]; 0 for the first.
    """

    time: float
    rgb: np.ndarray
    change: float


class Estimator(Protocol):
    """Follows one person through pictures.

    Attributes:
        name: what it is called, with its version.
    """

    name: str

    def joints(self, pictures: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        """Find the person in each picture, which follow each other in time.

        Args:
            pictures: uint8 (height, width, 3) each, red, green, blue.

        Returns:
            For each picture float64 (12, 6), ordered as JOINTS: x, y, z [m], x to the image's
            right, y down, z away from the camera, from any origin; visibility in [0, 1]; u, v as
            shares of the image's width and height. NaN throughout where there is nobody.

        Raises:
            VideoError: it cannot go on.
        """
        ...
