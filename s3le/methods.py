"""The rows of the comparison: what each one trains on, stores and returns."""

from typing import NamedTuple

from s3le.errors import ParameterError


class Entry(NamedTuple):
    """One row of the comparison.

    Attributes:
        model: method whose training it uses; None: none, the skeleton itself is searched.
        pool: tables whose feasible poses it stores; empty: it stores none and decodes.
        twin: the entry that searches the same pool in skeleton space.
        label: what people read.
    """

    model: str | None
    pool: tuple[str, ...]
    twin: str | None
    label: str


_PAIRS = ("mocap_pairs",)
_POSES = ("mocap_pairs", "robot_poses")
_ALL = ("mocap_pairs", "robot_poses", "kinematic_pairs")

ENTRIES = {
    "ale": Entry("ale", (), None, "ALE (decoder)"),
    "lwl2_pairs": Entry("lwl2", _PAIRS, "skeleton_pairs", "LWL2, mocap pairs"),
    "lwl2": Entry("lwl2", _POSES, "skeleton_poses", "LWL2, pairs and robot poses"),
    "s3le": Entry("s3le", _ALL, "skeleton_all", "S3LE"),
    "skeleton_pairs": Entry(None, _PAIRS, None, "nearest skeleton, mocap pairs"),
    "skeleton_poses": Entry(None, _POSES, None, "nearest skeleton, pairs and robot poses"),
    "skeleton_all": Entry(None, _ALL, None, "nearest skeleton, all poses"),
}


def entry(name: str) -> Entry:
    """Look up one row of the comparison.

    Raises:
        ParameterError: there is none of that name.
    """
    if name not in ENTRIES:
        raise ParameterError(f"no method '{name}'; there are: {', '.join(ENTRIES)}")
    return ENTRIES[name]
