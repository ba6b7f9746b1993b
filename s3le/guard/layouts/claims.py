"""What a file says of its own motion, after the motion was changed.

A certificate speaks of angles that are gone: it goes too. So do the clearance that was measured
for a row and the word on how the row came about, where the row was changed. Speeds go altogether
where rows are changed and none are told with them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from s3le.guard.layouts.episode import GUARDED, Episode
from s3le.motion.trajectory import SPEED

STALE = ("certificate",)  # what is only true of the angles it was made for


def renewed(old: Mapping[str, Any], about: Mapping[str, Any] | None) -> dict[str, Any]:
    """What a file says about itself: the old without its certificate, and what is new."""
    return {key: value for key, value in old.items() if key not in STALE} | dict(about or {})


def clearance(old: np.ndarray, changed: np.ndarray) -> np.ndarray:
    """Clearances as claimed, NaN (no claim) where a row was changed; (m,), in the type of old."""
    new = np.array(old)
    new[changed] = np.nan
    return new


def speeds(names: Sequence[str]) -> list[str]:
    """Which columns of ours tell speeds of others."""
    return [one for one in names if one.endswith(SPEED) and one.removesuffix(SPEED) in names]


def paced(one: Episode, v: Sequence[np.ndarray | None] | None) -> list[np.ndarray] | None:
    """Numbers of a file for speeds that are told with the only motion of it; None: none are."""
    if v is None or v[0] is None or one.pace is None:
        return None
    return one.pace.encode(f"{one.name}, speeds", v[0])


def mode(old: np.ndarray, changed: np.ndarray) -> np.ndarray:
    """How rows came about, str (m,)."""
    return np.where(changed, GUARDED, old)
