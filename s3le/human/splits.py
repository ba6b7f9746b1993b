"""Which rows of table skeletons a stage may look at."""

from collections.abc import Mapping

import numpy as np

from s3le.errors import ClipError
from s3le.types import Columns


def train_rows(frames: Columns, count: int) -> np.ndarray:
    """Rows of table skeletons that pairs are made from: training frames, evenly, at most count.

    Raises:
        ClipError: there are none.
    """
    rows = np.flatnonzero(frames["split"] == "train")
    if not len(rows):
        raise ClipError("no training frame is left; look at the dropped frames of stage skeletons")
    if len(rows) > count:
        rows = rows[np.linspace(0, len(rows) - 1, count).round().astype(int)]
    return rows


def test_rows(frames: Mapping[str, np.ndarray]) -> np.ndarray:
    """Rows of table skeletons that belong to clips not trained on, in order.

    Raises:
        ClipError: there are none.
    """
    rows = np.flatnonzero(frames["split"] != "train")
    if not len(rows):
        raise ClipError("no test frame is left; put a clip into the split 'test'")
    return rows
