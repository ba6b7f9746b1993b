"""How a robot's maker stands it: from its files, or arms hanging as straight as its parts allow."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.kernels import batch
from s3le.robot import chain, markup, sense, srdf
from s3le.robot.model import Geometry
from s3le.skeleton import BONES

HANGS = 0.7  # least mean cosine of upper arms and forearms with straight down
_NAMED = ("half_sitting", "stand", "home", "default", "ready")  # poses that files may hold
_AWAY = np.radians((0.0, 3.0, 6.0, 9.0, 12.0, 16.0, 20.0, 25.0))  # [rad] that arms hang outwards
_OFF = 0.02  # [rad] that a file's pose may lie beyond limits
_PULL = 1e-3  # of each joint towards zero, where the direction of a bone leaves it open


class Stand(NamedTuple):
    """The pose, and where it comes from."""

    q: np.ndarray  # [rad], (n_dof,)
    how: str
    hangs: bool  # arms were let down here; False: its file has the pose


def named(file: Path) -> dict[str, dict[str, float]]:
    """Poses that an SRDF holds (<group_state>), by name: joint -> angle [rad].

    Raises:
        RobotError: it cannot be read.
    """
    with file.open("rb") as stream:
        root = markup.parse(stream.read(srdf.LARGEST + 1), file, srdf.LARGEST, "an SRDF")
    found: dict[str, dict[str, float]] = {}
    for state in root.findall("group_state"):
        angles = found.setdefault(state.get("name") or "", {})
        for item in state.findall("joint"):
            try:
                angles[item.get("name") or ""] = float((item.get("value") or "").split()[0])
            except (ValueError, IndexError):
                continue  # a joint of several angles; none that moves here is one
    return found


def propose(
    robot: Geometry, known: Mapping[str, Mapping[str, float]],
    clear: Callable[[np.ndarray], float], margin: float,
) -> Stand:  # fmt: skip
    """The pose in which the robot stands.

    Args:
        robot: its anchor may be anything.
        known: poses that its files hold, by name: joint -> angle [rad].
        clear: least distance of its own parts at a pose, over pairs that are clear when the arms
            are held out [m].
        margin: what they are to keep [m].
    """
    for name in sorted(known, key=_rank):
        if _rank(name) == len(_NAMED):
            break
        angles = np.array([known[name].get(joint, 0.0) for joint in robot.joint_names])
        q = np.clip(angles, robot.lower, robot.upper)
        inside = np.abs(q - angles).max() < _OFF
        if inside and hanging(robot, q) >= HANGS and clear(q) >= margin:
            q = np.clip(np.round(q, 4), robot.lower, robot.upper)
            return Stand(q, f"'{name}' of its file", False)
    best: tuple[float, Stand] | None = None
    for away in _AWAY:
        q = _hung(robot, away)
        room = clear(q)
        how = "arms hanging" + (f", {np.degrees(away):.0f} deg outwards" if away else "")
        if best is None or room > best[0]:
            best = (room, Stand(q, how, True))
        if room >= margin:
            return Stand(q, how, True)
    assert best is not None
    return best[1]


def hanging(robot: Geometry, q: np.ndarray) -> float:
    """Mean cosine of the bones of all arms with straight down."""
    return float(np.mean([-bone[2] for bone in _bones(robot, q).values()]))


def _bones(robot: Geometry, q: np.ndarray) -> dict[str, np.ndarray]:
    """Unit vectors of upper arms and forearms at a pose, by what they are called."""
    at = {role: point[0] for role, point in sense.points(robot, q[None]).items()}
    found = {}
    for side in robot.arms:
        for tail, head in (("shoulder", "elbow"), ("elbow", "hand")):
            bone = at[f"{side}_{head}"] - at[f"{side}_{tail}"]
            found[f"{side}_{tail}"] = bone / max(float(np.linalg.norm(bone)), 1e-9)
    return found


def _hung(robot: Geometry, away: float) -> np.ndarray:
    """Waist at zero, arms as near to hanging as limits let, so far outwards [rad]."""
    zero = np.clip(np.zeros(robot.n_dof), robot.lower, robot.upper)
    trunk = robot.path_to(robot.points["neck"].joint)
    moving = [j for j in range(robot.n_dof) if j not in trunk]
    low, high = robot.lower.copy(), robot.upper.copy()
    low[trunk] = high[trunk] = zero[trunk]
    bare = chain.build(robot, np.empty((0, 2), np.int64), "midpoint")._replace(
        lower=low, upper=high
    )
    x = batch.skeletons(bare, zero[None])[0].reshape(len(BONES), 3).copy()
    for side, y in (("r", -1.0), ("l", 1.0)):
        if side in robot.arms:
            for bone in (f"{side}_shoulder_to_elbow", f"{side}_elbow_to_hand"):
                x[BONES.index(bone)] = 0.0, y * np.sin(away), -np.cos(away)
    starts = np.tile(zero, (1, 7, 1))
    rng = np.random.default_rng(0)
    least, most = np.maximum(low[moving], -1.5), np.minimum(high[moving], 1.5)
    starts[0, 1:, moving] = rng.uniform(least, most, (6, len(moving))).T
    best = batch.follow(bare, x.reshape(1, -1), starts, zero, _PULL, 0.0, True).q[0]
    q = zero.copy()
    low, high, best = low[moving], high[moving], best[moving]
    q[moving] = np.where(np.abs(best) < 2e-3, np.clip(0.0, low, high), np.round(best, 4))
    return np.clip(q, robot.lower, robot.upper)


def _rank(name: str) -> int:
    """How early a pose's name is asked; the last: it is none that a robot stands in."""
    words = name.lower()
    return next((k for k, word in enumerate(_NAMED) if word in words), len(_NAMED))


def keys(root: ElementTree.Element, width: Mapping[str, int]) -> dict[str, dict[str, float]]:
    """Poses that an MJCF holds (<key qpos>), by name: joint -> angle [rad].

    Args:
        root: the file's elements.
        width: numbers in qpos of each joint in the file's order.
    """
    found = {}
    for item in root.findall("keyframe/key"):
        try:
            values = [float(word) for word in (item.get("qpos") or "").split()]
        except ValueError:
            continue
        if len(values) != sum(width.values()):
            continue
        first = np.cumsum([0, *width.values()])
        found[item.get("name") or "home"] = {
            name: values[k] for (name, size), k in zip(width.items(), first, strict=False)
            if size == 1
        }  # fmt: skip
    return found
