"""What a LeRobot data set says of its columns: least, most, mean, spread, quantiles.

Training scales by these numbers, so they follow the joints: in meta/stats.json over all frames,
in meta/episodes over those of an episode. They are computed from the numbers themselves; LeRobot
takes its quantiles from histograms, and those of a whole set as a mean over episodes.
"""

import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from s3le.errors import TrajectoryError
from s3le.guard.layouts import parquet
from s3le.motion.parquet import numbers
from s3le.store.atomic import replace

STATS = Path("meta/stats.json")
_QUANTILE = re.compile(r"q(\d\d)")


def renew_all(part: Path, path: Path, key: str, moved: Mapping[int, np.ndarray]) -> None:
    """Bring meta/stats.json of a copy up to date.

    Args:
        part: the copy.
        path: what it is a copy of, for messages.
        key: the column.
        moved: place in the column -> all its numbers, of those that changed.

    Raises:
        TrajectoryError: it is no JSON.
    """
    file = part / STATS
    if not file.is_file():
        return
    try:
        tree = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise TrajectoryError(f"{path / STATS}: is no JSON ({error})") from None
    said = tree.get(key) if isinstance(tree, dict) else None
    for name, entries in said.items() if isinstance(said, dict) else ():
        for at, values in moved.items():
            new = _number(name, values)
            if new is not None and isinstance(entries, list) and at < len(entries):
                entries[at] = new
    text = json.dumps(tree, indent=4, ensure_ascii=False)
    replace(file, lambda to: to.write_text(text, encoding="utf-8"))


def renew_episodes(
    part: Path, path: Path, key: str, episodes: Mapping[int, Mapping[int, np.ndarray]]
) -> None:
    """Bring meta/episodes of a copy up to date.

    Args:
        part, path, key: see renew_all.
        episodes: episode -> place in the column -> its numbers, of those that changed.

    Raises:
        TrajectoryError: a file of them is no sound Parquet, or tells of other widths.
    """
    for file in sorted((part / "meta" / "episodes").glob("*/*.parquet")):
        table, how = parquet.load(file)
        where = path / file.relative_to(part)
        if "episode_index" not in table.column_names:
            raise TrajectoryError(f"{where}: has no column 'episode_index'")
        rows = numbers(where, "episode_index", table["episode_index"]).tolist()
        new: dict[str, np.ndarray] = {}
        for column in table.column_names:
            begin = f"stats/{key}/"
            name = column.removeprefix(begin)
            if not column.startswith(begin) or _number(name, np.zeros(1)) is None:
                continue
            values = np.array(numbers(where, column, table[column]))
            for row, number in enumerate(rows):
                for at, joint in episodes.get(number, {}).items():
                    if values.ndim != 2 or at >= values.shape[1]:
                        raise TrajectoryError(f"{where}: '{column}' has shape {values.shape}")
                    values[row, at] = _number(name, joint)
            new[column] = values
        if new:
            replace(file, partial(parquet.store, parquet.renewed(table, new), how=how))


def _number(name: str, values: np.ndarray) -> Any:
    """A named number of some numbers; None: it is none of these."""
    values = np.asarray(values, float)
    simple: dict[str, Callable[..., Any]] = {
        "min": np.min,
        "max": np.max,
        "mean": np.mean,
        "std": np.std,
    }
    if name in simple:
        return float(simple[name](values))
    if found := _QUANTILE.fullmatch(name):
        return float(np.quantile(values, int(found[1]) / 100.0))
    return None
