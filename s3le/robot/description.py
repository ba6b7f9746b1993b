"""The robot file: one small YAML beside a URDF that says which joints move and where the body is.

Adding a robot means writing this file, never touching code.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import RobotError
from s3le.store import yaml

MAPPED = (
    "hip",
    "neck",
    "r_shoulder",
    "r_elbow",
    "r_hand",
    "l_shoulder",
    "l_elbow",
    "l_hand",
)
ARMS = {side: tuple(f"{side}_{part}" for part in ("shoulder", "elbow", "hand")) for side in "rl"}
_KEYS = (
    "name", "urdf", "base_rpy", "points", "joints", "hold", "anchor", "pair_inflation",
    "srdf", "hulls", "velocity", "acceleration", "given", "stand",
    "finer", "baselines",
)  # fmt: skip
_OPTIONAL: dict[str, Any] = {
    "srdf": None, "hulls": None, "base_rpy": [0.0, 0.0, 0.0], "hold": {}, "velocity": {},
    "acceleration": {}, "pair_inflation": 1.1, "given": [], "stand": None, "finer": [],
    "baselines": False,
}  # fmt: skip
WIDEST = 100.0  # [rad] an angle beyond this is damage or another unit
LARGEST = 64 * 2**20  # [bytes] of any file that a robot file names
HARDEST = 1e5  # [rad/s^2] an acceleration beyond this is damage or another unit
ALL = "all"  # as the only one given: whatever a motion says of other joints
FARTHEST = 10.0  # [m] a length or a place beyond this is damage or another unit


class Place(NamedTuple):
    """Where a skeleton point is: a joint, link or frame, and how far from its origin."""

    frame: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m], in the frame


@dataclass(frozen=True, kw_only=True)
class Description:
    """A checked robot file; names are not yet held against the URDF."""

    name: str
    source: Path  # the robot file itself
    urdf_name: str  # as the robot file writes it
    urdf: Path  # beside or below the robot file
    srdf_name: str | None  # as the robot file writes it; None: there is none
    srdf: Path | None
    hulls_name: str | None  # of convex hulls of the robot's own meshes
    hulls: Path | None
    base_rpy: tuple[float, float, float]  # [rad]
    points: dict[str, Place]  # by role; an arm that the robot lacks is left out
    joints: tuple[str, ...]
    hold: dict[str, float]  # joint -> angle [rad]
    anchor: dict[str, float]  # joint -> angle [rad]
    stand: dict[str, float] | None  # how its maker stands it, zero where not named; None: unsaid
    velocity: dict[str, float]  # joint -> limit [rad/s], where the URDF's is not to be used
    acceleration: dict[str, float]  # joint -> limit [rad/s^2]; not named: the default's
    pair_inflation: float  # [-]
    given: tuple[str, ...]  # joints that others move, in motions that say how; or ALL
    ranges: dict[str, tuple[float, float]]  # joints that others move in these ranges [rad], any way
    finer: frozenset[frozenset[str]]  # pairs of links that are watched by their finer bodies
    baselines: bool  # pairs that overlap at the anchor are held to that, not passed over
    files: dict[str, bytes] = field(repr=False)  # robot, urdf, srdf, hulls: as they were read


def read_description(path: Path, held: Mapping[str, bytes] | None = None) -> Description:
    """Read and check a robot file, and read the files that it names.

    Args:
        path: the robot file.
        held: its bytes and those of the files beside it, by name, instead of the disk's.

    Raises:
        RobotError: the file is missing, too long, is not YAML, lacks a key, has an unknown one,
            or holds a value of the wrong kind or out of its range; names the file, the key and
            what is wanted.
    """
    path = Path(path)
    wanted = f"the keys {', '.join(_KEYS)}"
    own = None if held is None else held.get(path.name)
    if own is None:
        own = _bytes(path, yaml.LARGEST) if path.is_file() else None
    tree = read_mapping(path, wanted, data=own)
    for key in tree:
        if key not in _KEYS:
            near = get_close_matches(str(key), _KEYS, n=1)
            raise RobotError(
                f"{path}: unknown key '{key}'" + (f"; did you mean {near[0]}?" if near else "")
            )
    for key in _KEYS:
        if key not in tree and key not in _OPTIONAL:
            raise RobotError(f"{path}: key '{key}' is missing")
    tree = _OPTIONAL | tree

    if not re.fullmatch(r"[A-Za-z0-9_.+-]{1,100}", str(tree["name"])):
        raise RobotError(f"{path}: name must be of letters, digits and _.+-, got {tree['name']!r}")
    files = {key: None if tree[key] is None else path.parent / str(tree[key])
             for key in ("urdf", "srdf", "hulls")}  # fmt: skip
    for key, file in files.items():
        if file is None and key != "urdf":
            continue
        inside = held is not None and file is not None and file.name in held
        if file is None or not (inside or _is_file(file)):
            raise RobotError(f"{path}: {key} {tree[key]!r} does not exist below {path.parent}")
    rpy = tree["base_rpy"]
    if not isinstance(rpy, list) or len(rpy) != 3:
        raise RobotError(f"{path}: base_rpy must be three angles [rad], got {rpy!r}")
    points = _mapping(path, "points", tree["points"])
    missing = [role for role in ("hip", "neck") if role not in points]
    lacks = {side: [role for role in arm if role not in points] for side, arm in ARMS.items()}
    for side, roles in lacks.items():
        whole = len(roles) == len(ARMS[side])
        if roles and not (whole and not lacks["l" if side == "r" else "r"]):
            missing += roles  # half an arm, or the second one that is not there
    if missing:
        raise RobotError(f"{path}: points lacks {', '.join(missing)}")
    if extra := [role for role in points if role not in MAPPED]:
        raise RobotError(
            f"{path}: points has the unknown role '{extra[0]}'; roles: {', '.join(MAPPED)}"
        )
    joints = tree["joints"]
    if not isinstance(joints, list) or not joints or len(set(map(str, joints))) != len(joints):
        raise RobotError(f"{path}: joints must be a list of different joint names, got {joints!r}")
    roll, pitch, yaw = (_number(path, "base_rpy", v, -WIDEST, WIDEST) for v in rpy)
    urdf = files["urdf"]
    if own is None or urdf is None:
        raise RobotError(f"{path}: it or its URDF has gone while it was read; try again")
    return Description(
        name=str(tree["name"]),
        source=path,
        urdf_name=str(tree["urdf"]),
        urdf=urdf,
        srdf_name=None if tree["srdf"] is None else str(tree["srdf"]),
        srdf=files["srdf"],
        hulls_name=None if tree["hulls"] is None else str(tree["hulls"]),
        hulls=files["hulls"],
        base_rpy=(roll, pitch, yaw),
        points={role: _place(path, role, points[role]) for role in MAPPED if role in points},
        joints=tuple(map(str, joints)),
        hold=_angles(path, "hold", tree["hold"]),
        anchor=_angles(path, "anchor", tree["anchor"]),
        stand=None if tree["stand"] is None else _angles(path, "stand", tree["stand"]),
        velocity=_limits(path, "velocity", tree["velocity"], 1e3),
        acceleration=_accelerations(path, tree["acceleration"], list(map(str, joints))),
        pair_inflation=_number(path, "pair_inflation", tree["pair_inflation"], 1.0, 10.0),
        given=_given(path, tree["given"], list(map(str, joints))),
        ranges=_ranges(path, tree["given"]),
        finer=_finer(path, tree["finer"]),
        baselines=_switch(path, "baselines", tree["baselines"]),
        files={"robot": own}
        | {
            key: held[file.name] if held is not None else _bytes(file, LARGEST)
            for key, file in files.items()
            if file is not None
        },
    )


def _bytes(path: Path, largest: int) -> bytes:
    """The bytes of a file, at most one more than the longest that is taken."""
    try:
        with path.open("rb") as stream:
            return stream.read(largest + 1)
    except OSError as error:
        raise RobotError(f"{path}: not readable ({error.strerror})") from None


def read_mapping(
    path: Path, wanted: str, largest: int = yaml.LARGEST, data: bytes | None = None
) -> dict:
    """A YAML file that holds one mapping.

    Args:
        path: the file.
        wanted: what the mapping holds, for a refusal.
        largest: longest file that is read [bytes].
        data: its bytes, where it was read already.

    Raises:
        RobotError: the file is missing, too long, not YAML, uses aliases, or holds something else.
    """
    try:
        return yaml.mapping(path, wanted, RobotError, largest, data)[0]
    except FileNotFoundError:
        known = ", ".join(sorted(p.stem for p in path.parent.glob("*.yaml"))) or "none"
        raise RobotError(f"{path} does not exist; robots here: {known}") from None


def _mapping(path: Path, key: str, value: Any) -> dict:
    if not isinstance(value, dict):
        raise RobotError(f"{path}: {key} must be a mapping, got {value!r}")
    return value


def _place(path: Path, role: str, value: Any) -> Place:
    if not isinstance(value, dict):
        return Place(str(value))
    offset = value.get("offset")
    if set(value) != {"frame", "offset"} or not isinstance(offset, list) or len(offset) != 3:
        raise RobotError(
            f"{path}: points.{role} must be a name, or {{frame: name, offset: [x, y, z]}} [m], "
            f"got {value!r}"
        )
    key = f"points.{role}.offset"
    x, y, z = (_number(path, key, v, -FARTHEST, FARTHEST) for v in offset)
    return Place(str(value["frame"]), (x, y, z))


def _limits(path: Path, key: str, value: Any, most: float) -> dict[str, float]:
    return {
        str(joint): _number(path, f"{key}.{joint}", limit, 1e-3, most)
        for joint, limit in _mapping(path, key, value).items()
    }


def _given(path: Path, value: Any, joints: list[str]) -> tuple[str, ...]:
    """Joints that others move, in motions that say how."""
    if value == ALL:
        return (ALL,)
    if isinstance(value, dict):
        if both := [name for name in map(str, value) if name in joints]:
            raise RobotError(f"{path}: '{both[0]}' is both decided here (joints) and given (given)")
        return ()
    if not isinstance(value, list) or len(set(map(str, value))) != len(value):
        raise RobotError(
            f"{path}: given must be a list of different joint names, {ALL}, or a mapping of "
            f"names to ranges [rad], got {value!r}"
        )
    if both := [name for name in map(str, value) if name in joints]:
        raise RobotError(f"{path}: '{both[0]}' is both decided here (joints) and given (given)")
    return tuple(map(str, value))


def _ranges(path: Path, value: Any) -> dict[str, tuple[float, float]]:
    """Ranges of joints that others move in a way that nobody says."""
    found = {}
    for name, ends in value.items() if isinstance(value, dict) else ():
        key = f"given.{name}"
        if not isinstance(ends, list) or len(ends) != 2:
            raise RobotError(f"{path}: {key} must be two angles [low, high] [rad], got {ends!r}")
        low, high = (_number(path, key, end, -WIDEST, WIDEST) for end in ends)
        if not low <= high:
            raise RobotError(f"{path}: {key} must be [low, high], got {ends!r}")
        found[str(name)] = low, high
    return found


def _switch(path: Path, key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise RobotError(f"{path}: {key} must be true or false, got {value!r}")
    return value


def _finer(path: Path, value: Any) -> frozenset[frozenset[str]]:
    """Pairs of links."""
    pairs = value if isinstance(value, list) else [None]
    for pair in pairs:
        two = pair if isinstance(pair, list) else []
        if not all(isinstance(name, str) for name in two) or len(two) != 2 or two[0] == two[1]:
            raise RobotError(
                f"{path}: finer must be pairs of links, [[LINK, LINK], ...], got {value!r}"
            )
    return frozenset(map(frozenset, pairs))


def _accelerations(path: Path, value: Any, joints: list[str]) -> dict[str, float]:
    """Limits by joint, or one for all of them."""
    if isinstance(value, dict):
        return _limits(path, "acceleration", value, HARDEST)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RobotError(
            f"{path}: acceleration must be a number [rad/s^2], or a mapping of joints to numbers, "
            f"got {value!r}"
        )
    return dict.fromkeys(joints, _number(path, "acceleration", value, 1e-3, HARDEST))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name too long for any file
        return False


def _number(path: Path, key: str, value: Any, low: float, high: float) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not low <= value <= high:  # NaN compares False
        raise RobotError(f"{path}: {key} must be a number in [{low:g}, {high:g}], got {value!r}")
    return float(value)


def _angles(path: Path, key: str, value: Any) -> dict[str, float]:
    return {
        str(joint): _number(path, f"{key}.{joint}", angle, -WIDEST, WIDEST)
        for joint, angle in _mapping(path, key, value).items()
    }
