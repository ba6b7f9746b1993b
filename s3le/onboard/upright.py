"""Which way is up, forward and left of a robot: from its shoulders, hip and joints' axes."""

import numpy as np


def up_of(raw: np.ndarray, axes: list[np.ndarray]) -> np.ndarray:
    """Upwards (3,), from the way hip to neck and the axes of joints (3,) that do not point left."""
    if np.linalg.norm(raw) < 0.1:
        return np.eye(3)[2]
    raw = raw / np.linalg.norm(raw)
    # Hips lie ahead of or behind shoulders; the base frame's or some joint's axis is upright.
    # Joints may be tilted, hips by 45 degrees, so the base's own axis goes before where it is near.
    near = _nearest_axis(raw, list(np.eye(3)), np.cos(np.radians(20)))
    if near is not raw:
        return near
    return _nearest_axis(raw, [*np.eye(3), *axes], np.cos(np.radians(35)))


def _nearest_axis(raw: np.ndarray, axes: list[np.ndarray], least: float) -> np.ndarray:
    """The direction that most axes near raw share; raw where none is near."""
    near = [a if a @ raw > 0 else -a for a in axes if abs(a @ raw) >= least]
    if not near:
        return raw
    votes = [sum(float(a @ b) > 0.9998 for b in near) for a in near]
    best = max(range(len(near)), key=lambda i: (votes[i], round(float(near[i] @ raw), 6)))
    return near[best]


def forward_of(up: np.ndarray) -> np.ndarray:
    """Of a robot with one arm: the base's x, or y where x is upright."""
    x = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    x = x - (x @ up) * up
    return x / np.linalg.norm(x)


def base_of(left: np.ndarray, up: np.ndarray, look: list[str]) -> np.ndarray:
    """Rows x forward, y left, z up; whole quarter turns where it is nearly one."""
    y = left - (left @ up) * up
    y = y / np.linalg.norm(y)
    base = np.stack([np.cross(y, up), y, up])
    whole = np.round(base)
    turn = np.degrees(np.arccos(np.clip((np.trace(base @ whole.T) - 1) / 2, -1, 1)))
    if abs(np.linalg.det(whole) - 1) < 1e-9 and turn < 5.0:
        return whole
    look.append("base: its axes are not the robot's; forward and up come from shoulders and hip")
    return base
