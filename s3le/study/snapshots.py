"""The moments and rows of the snapshot strip: human, ground truth and methods, side by side."""

from collections.abc import Mapping

import numpy as np

from s3le.errors import ParameterError
from s3le.kernels import batch
from s3le.robot.robot import Robot
from s3le.show.strip import Row
from s3le.show.style import colour
from s3le.types import Columns


def choose(frames: Columns, clip: str, count: int) -> tuple[str, np.ndarray]:
    """A test clip and evenly spread frames of it.

    Args:
        frames: columns of table skeletons.
        clip: name of a test clip, or "auto": the one in which both hands are raised highest.
        count: moments wanted.

    Returns:
        Pair (clip, rows of frames).

    Raises:
        ParameterError: there is no test clip of that name.
    """
    test = np.flatnonzero(frames["split"] != "train")
    names = frames["clip"][test]
    if clip == "auto":
        x = frames["x"][test].reshape(-1, 7, 3)
        # Height of the lower hand over its shoulder, in bone lengths: upper arm plus forearm.
        lower = np.minimum(x[:, 2, 2] + x[:, 3, 2], x[:, 5, 2] + x[:, 6, 2])
        clip = str(names[int(np.argmax(lower))])
    if clip not in names:
        known = ", ".join(dict.fromkeys(names.tolist()))
        raise ParameterError(f"report.strip_clip: no test clip '{clip}'; there are: {known}")
    rows = test[names == clip]
    pick = np.unique(np.linspace(0, len(rows) - 1, min(count, len(rows))).round().astype(int))
    return clip, rows[pick]


def strip(
    robot: Robot,
    frames: Columns,
    rows: np.ndarray,
    truth: Columns,
    answers: Mapping[str, Columns],
    labels: Mapping[str, str],
) -> list[Row]:
    """Rows of the strip: the human, the ground truth, then each method.

    Args:
        robot: the robot.
        frames: columns of table skeletons.
        rows: which of them to show.
        truth: columns of table ground_truth.
        answers: by entry, columns of table retargeted.
        labels: what people read of each entry.
    """
    wanted = set(zip(frames["clip"][rows], frames["frame"][rows].tolist(), strict=True))

    def at(table: Columns) -> np.ndarray:
        keys = zip(table["clip"], table["frame"].tolist(), strict=True)
        return np.array([i for i, key in enumerate(keys) if key in wanted])

    def posed(label: str, table: Columns, distances: np.ndarray, key: str) -> Row:
        found = at(table)
        return Row(
            label,
            ends=batch.capsule_ends(robot.chain, table["q"][found]),
            radius=robot.chain.body_radius,
            marked=table["clearance"][found] < 0.0,
            note=[f"{distance:.3f}" for distance in distances[found]],
            colour=colour(key),
        )

    return [
        Row("human", skeleton=frames["x"][rows]),
        posed("ground truth", truth, truth["to_human"], "truth"),
        *(posed(labels[name], table, table["to_truth"], name) for name, table in answers.items()),
    ]
