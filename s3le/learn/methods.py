"""The rows of the comparison: what each one trains on, stores and returns."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from s3le.errors import ParameterError


class Entry(NamedTuple):
    """One row of the comparison.

    Attributes:
        model: method whose training it uses; None: none, the skeleton itself is searched.
        pool: tables whose feasible poses it stores; empty: it stores none and decodes.
        twin: the entry that searches the same pool in skeleton space.
        label: what people read; {} is what proposes poses, where that is chosen at export.
        online: the exported retargeter follows each motion as a stream, all of it certified.
    """

    model: str | None
    pool: tuple[str, ...]
    twin: str | None
    label: str
    online: bool = False


_PAIRS = ("mocap_pairs",)
_POSES = ("mocap_pairs", "robot_poses")
_ALL = ("mocap_pairs", "robot_poses", "kinematic_pairs")

ENTRIES = {
    "ale": Entry("ale", (), None, "ALE (decoder)"),
    "lwl2_pairs": Entry("lwl2", _PAIRS, "skeleton_pairs", "LWL2, mocap pairs"),
    "lwl2": Entry("lwl2", _POSES, "skeleton_poses", "LWL2, pairs and robot poses"),
    "lwl2_all": Entry("lwl2", _ALL, "skeleton_all", "LWL2, S3LE's poses"),
    "s3le": Entry("s3le", _ALL, "skeleton_all", "S3LE"),
    "certified_lookup": Entry(None, (), None, "{} + certify", online=True),
    "certified_refined": Entry(None, (), None, "{} + refine + certify", online=True),
    "skeleton_pairs": Entry(None, _PAIRS, None, "nearest skeleton, mocap pairs"),
    "skeleton_poses": Entry(None, _POSES, None, "nearest skeleton, pairs and robot poses"),
    "skeleton_all": Entry(None, _ALL, None, "nearest skeleton, all poses"),
}

POOLS = {"pairs": _PAIRS, "poses": _POSES, "all": _ALL}  # what can be stored, and is compared

PROPOSERS = {  # what a retargeter can be exported with (s3le/retarget/exported.py)
    "s3le": "S3LE",
    "lwl2": "LWL2",
    "ale": "ALE",
    "skeleton": "nearest skeleton",
}


def label(name: str, proposed_by: str = "s3le") -> str:
    """What people read of an entry whose poses were proposed by this method."""
    return ENTRIES[name].label.format(PROPOSERS.get(proposed_by, proposed_by))


def labels(splits: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Entries and what people read of them, by the metrics' own word on what proposes poses."""
    found = {
        name: got["proposed_by"]
        for split in splits.values()
        for name, got in split["methods"].items()
    }
    return [(name, label(name, found.get(name, "s3le"))) for name in ENTRIES]


def entry(name: str) -> Entry:
    """Look up one row of the comparison.

    Raises:
        ParameterError: there is none of that name.
    """
    if name not in ENTRIES:
        raise ParameterError(f"no method '{name}'; there are: {', '.join(ENTRIES)}")
    return ENTRIES[name]
