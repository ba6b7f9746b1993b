"""The skeleton feature x: seven unit vectors, one definition for human and robot (Sec. IV-A).

Frame: x forward, y left, z up. Ten points describe an upper body; seven directions between
them are all that the method ever sees, so body size and proportions do not matter.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from s3le.errors import ParameterError, RobotError

POINTS = (
    "hip",
    "r_pelvis",
    "l_pelvis",
    "neck",
    "r_shoulder",
    "r_elbow",
    "r_hand",
    "l_shoulder",
    "l_elbow",
    "l_hand",
)
BONES = (
    "hip_to_neck",
    "neck_to_r_shoulder",
    "r_shoulder_to_elbow",
    "r_elbow_to_hand",
    "neck_to_l_shoulder",
    "l_shoulder_to_elbow",
    "l_elbow_to_hand",
)
DIM = 3 * len(BONES)  # x lives in R^21
# What stands for the bones of an arm that a robot lacks, in its x and in what it sees of people.
ABSENT = {
    f"{name}{s}{rest}": way
    for s, y in (("r", -1.0), ("l", 1.0))
    for name, rest, way in (
        ("neck_to_", "_shoulder", (0.0, y, 0.0)),
        ("", "_shoulder_to_elbow", (0.0, 0.0, -1.0)),
        ("", "_elbow_to_hand", (0.0, 0.0, -1.0)),
    )
}

NECKS = ("midpoint", "joint")  # where the neck is: between the shoulders, or the file's own joint

_INDEX = {name: i for i, name in enumerate(POINTS)}
_TAIL = [
    _INDEX[p] for p in ("hip", "neck", "r_shoulder", "r_elbow", "neck", "l_shoulder", "l_elbow")
]
_HEAD = [
    _INDEX[p]
    for p in ("neck", "r_shoulder", "r_elbow", "r_hand", "l_shoulder", "l_elbow", "l_hand")
]
_MIRRORED_POINT = [0, 2, 1, 3, 7, 8, 9, 4, 5, 6]
_MIRRORED_BONE = [0, 4, 5, 6, 1, 2, 3]
_FLIP_Y = np.array([1.0, -1.0, 1.0])

SHORTEST_BONE = 1e-6  # [m] below this a bone has no direction


def bone_vectors(points: np.ndarray, neck: str = "midpoint") -> np.ndarray:
    """The seven bones of each frame, not normalised.

    Args:
        points: joint positions [m], shape (n, 10, 3), ordered as POINTS.
        neck: "midpoint" of the shoulders (the authors' choice, exists in every format),
            or "joint", the neck or thorax joint of the file.

    Returns:
        Bone vectors [m], shape (n, 7, 3), ordered as BONES.

    Raises:
        ParameterError: neck is not one of NECKS, or points has another shape.
    """
    points = np.asarray(points, float)
    if neck not in NECKS:
        raise ParameterError(f"neck must be one of {', '.join(NECKS)}, got {neck!r}")
    if points.ndim != 3 or points.shape[1:] != (len(POINTS), 3):
        raise ParameterError(f"points must have shape (n, {len(POINTS)}, 3), got {points.shape}")
    if neck == "midpoint":
        points = points.copy()
        shoulders = points[:, [_INDEX["r_shoulder"], _INDEX["l_shoulder"]]]
        points[:, _INDEX["neck"]] = shoulders.mean(axis=1)
    return points[:, _HEAD] - points[:, _TAIL]


def features(points: np.ndarray, neck: str = "midpoint") -> tuple[np.ndarray, np.ndarray]:
    """Skeleton features x of each frame: the bones' unit vectors (Sec. IV-A).

    Returns:
        Pair (x, ok): x of shape (n, 21); ok (n,) is False where a bone is shorter than
        SHORTEST_BONE or not finite, and x of that row is NaN.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        bones = bone_vectors(points, neck)
        length = np.linalg.norm(bones, axis=2, keepdims=True)  # (n, 7, 1)
        ok = np.all((length > SHORTEST_BONE) & np.isfinite(length), axis=(1, 2))  # NaN: no
        x = np.where(ok[:, None, None], bones / length, np.nan)
    return x.reshape(len(x), DIM), ok


def face_forward(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Yaw every frame about the vertical through its hip until the pelvis line lies along +y.

    Pelvic obliquity stays: only the horizontal part of (left - right pelvis) is aligned.

    Returns:
        Triple (points, heading, level): points as given but turned, shape (n, 10, 3);
        heading (n,) [rad], the yaw that was taken out; level (n,), the share of the pelvis
        line's length that is horizontal, in [0, 1] (small: heading is ill-defined; NaN: no line).
    """
    points = np.asarray(points, float)
    line = points[:, _INDEX["l_pelvis"]] - points[:, _INDEX["r_pelvis"]]  # (n, 3)
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.hypot(line[:, 0], line[:, 1]) / np.linalg.norm(line, axis=1)
    heading = np.arctan2(-line[:, 0], line[:, 1])  # zero where the line points along +y
    c, s = np.cos(heading), np.sin(heading)
    hip = points[:, :1]
    rel = points - hip
    turned = rel.copy()
    turned[..., 0] = c[:, None] * rel[..., 0] + s[:, None] * rel[..., 1]
    turned[..., 1] = -s[:, None] * rel[..., 0] + c[:, None] * rel[..., 1]
    return turned + hip, heading, level


def mirror_points(points: np.ndarray) -> np.ndarray:
    """Left-right mirror of joint positions, shape (n, 10, 3)."""
    return np.asarray(points)[:, _MIRRORED_POINT] * _FLIP_Y


def mirror(x: np.ndarray) -> np.ndarray:
    """Left-right mirror of skeleton features, shape (n, 21)."""
    x = np.asarray(x)
    return (x.reshape(len(x), len(BONES), 3)[:, _MIRRORED_BONE] * _FLIP_Y).reshape(len(x), DIM)


def fixed_in(tree: Mapping, where: object) -> dict[str, list[float]]:
    """What a robot's folder notes of bones that it cannot turn: bone -> unit vector.

    Raises:
        RobotError: it is damaged.
    """
    fixed = tree.get("fixed")
    if isinstance(fixed, dict) and all(
        bone in BONES and np.shape(way) == (3,) and abs(np.linalg.norm(way) - 1.0) < 1e-9
        for bone, way in fixed.items()
    ):
        return fixed
    raise RobotError(f"{where}: damaged; write it with: dvc repro robot")


def with_fixed(x: np.ndarray, fixed: Mapping[str, Sequence[float]]) -> np.ndarray:
    """Skeletons in which some bones are replaced, as a robot that cannot turn them sees people.

    Args:
        x: (..., 21).
        fixed: bone -> unit vector (3,); empty: x is returned as it is.
    """
    if not fixed:
        return x
    out = np.array(x, float)
    for bone, way in fixed.items():
        first = 3 * BONES.index(bone)
        out[..., first : first + 3] = way
    return out


def cosine_distance(a: np.ndarray, b: np.ndarray, bones: np.ndarray | None = None) -> np.ndarray:
    """Mean over the bones of 1 - cos(angle between a's and b's bone), in [0, 2].

    The paper's measure of accuracy (Sec. V-C). Vectors need not be normalised.

    Args:
        a, b: features, shapes broadcastable to (n, 21).
        bones: which of the seven count, bool (7,), at least one; None: all.

    Returns:
        Distance [-], shape (n,); NaN where an input is not finite or a bone has no length.
    """
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    a, b = (v.reshape(*v.shape[:-1], len(BONES), 3) for v in (a, b))
    with np.errstate(invalid="ignore", divide="ignore"):
        # Half the squared chord of the unit vectors: 1 - cos without its cancellation near 0.
        u = a / np.linalg.norm(a, axis=-1, keepdims=True)
        v = b / np.linalg.norm(b, axis=-1, keepdims=True)
        each = 0.5 * np.sum((u - v) ** 2, axis=-1)
        return each.mean(axis=-1) if bones is None else each[..., bones].mean(axis=-1)
