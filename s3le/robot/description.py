"""The robot file: one small YAML beside a URDF that says which joints move and where the body is.

Adding a robot means writing this file, never touching code.
"""

import re
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent

from s3le.errors import RobotError

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
_KEYS = ("name", "urdf", "base_rpy", "points", "joints", "hold", "anchor", "pair_inflation")
_OPTIONAL = {"base_rpy": [0.0, 0.0, 0.0], "hold": {}, "pair_inflation": 1.1}
LARGEST = 32 * 2**10  # [bytes] of a robot file; real ones have two thousand
WIDEST = 100.0  # [rad] an angle beyond this is damage or another unit


@dataclass(frozen=True, kw_only=True)
class Description:
    """A checked robot file; names are not yet held against the URDF."""

    name: str
    source: Path  # the robot file itself
    urdf_name: str  # as the robot file writes it
    urdf: Path  # beside or below the robot file
    base_rpy: tuple[float, float, float]  # [rad]
    points: dict[str, str]  # role -> joint, link or frame name
    joints: tuple[str, ...]
    hold: dict[str, float]  # joint -> angle [rad]
    anchor: dict[str, float]  # joint -> angle [rad]
    pair_inflation: float  # [-]


def read_description(path: Path) -> Description:
    """Read and check a robot file.

    Raises:
        RobotError: the file is missing, too long, is not YAML, lacks a key, has an unknown one,
            or holds a value of the wrong kind or out of its range; names the file, the key and
            what is wanted.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise RobotError(f"{path}: longer than the {LARGEST / 1024:g} KiB of a robot file")
        text = data.decode("utf-8")
        # Aliases have no use here, and a few lines of them unfold to more than memory holds.
        if any(isinstance(event, AliasEvent) for event in YAML(typ="safe").parse(text)):
            raise RobotError(f"{path}: YAML aliases (*name) are not read; write the value out")
        tree = YAML(typ="safe").load(text)
    except FileNotFoundError:
        known = ", ".join(sorted(p.stem for p in path.parent.glob("*.yaml"))) or "none"
        raise RobotError(f"{path} does not exist; robots here: {known}") from None
    except (YAMLError, ValueError, OSError, RecursionError) as error:
        raise RobotError(f"{path}: not readable as YAML ({str(error).splitlines()[0]})") from None
    if not isinstance(tree, dict):
        raise RobotError(f"{path}: expected a mapping with the keys {', '.join(_KEYS)}")
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
    urdf = path.parent / str(tree["urdf"])
    if not _is_file(urdf):
        raise RobotError(f"{path}: urdf {tree['urdf']!r} does not exist below {path.parent}")
    rpy = tree["base_rpy"]
    if not isinstance(rpy, list) or len(rpy) != 3:
        raise RobotError(f"{path}: base_rpy must be three angles [rad], got {rpy!r}")
    points = _mapping(path, "points", tree["points"])
    if missing := [role for role in MAPPED if role not in points]:
        raise RobotError(f"{path}: points lacks {', '.join(missing)}")
    if extra := [role for role in points if role not in MAPPED]:
        raise RobotError(
            f"{path}: points has the unknown role '{extra[0]}'; roles: {', '.join(MAPPED)}"
        )
    joints = tree["joints"]
    if not isinstance(joints, list) or not joints or len(set(map(str, joints))) != len(joints):
        raise RobotError(f"{path}: joints must be a list of different joint names, got {joints!r}")
    return Description(
        name=str(tree["name"]),
        source=path,
        urdf_name=str(tree["urdf"]),
        urdf=urdf,
        base_rpy=tuple(_number(path, "base_rpy", v, -WIDEST, WIDEST) for v in rpy),
        points={role: str(points[role]) for role in MAPPED},
        joints=tuple(map(str, joints)),
        hold=_angles(path, "hold", tree["hold"]),
        anchor=_angles(path, "anchor", tree["anchor"]),
        pair_inflation=_number(path, "pair_inflation", tree["pair_inflation"], 1.0, 10.0),
    )


def _mapping(path: Path, key: str, value: Any) -> dict:
    if not isinstance(value, dict):
        raise RobotError(f"{path}: {key} must be a mapping, got {value!r}")
    return value


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
