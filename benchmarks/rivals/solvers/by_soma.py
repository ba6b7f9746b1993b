"""soma-retargeter, as its unofficial fork eden-soma-retargeter on PyPI: whole motions, on its G1.

NVIDIA's tool solves on Newton and Warp, which run on a processor too, some six frames a second. It
wants rotations of its own skeleton, SOMA: those of the person of person.py, each turned on so that
trunk, shoulders and arms point along the same seven vectors as everybody's. Its G1 comes from a
clone of newton-physics/newton-assets, where the tool itself fetches it from. Its base floats and
its legs follow too; the joints that this benchmark's robot has are kept. As it ships: 24 iterations
a frame, fifteen frames before the first, smoothing and feet. No speed limits, no collisions.
"""

import sys
import time
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import person
from plain import Plain, shortest

from solvers import versions

MODELS = ("unitree_g1/mjcf/g1_29dof_rev_1_0.xml", "g1_description/g1_29dof_rev_1_0.xml")
TRUNK = ("Spine1", "Spine2", "Chest", "Neck1", "Neck2", "Head")
BONES = (
    ("Hips", "Neck1"), ("Neck1", "RightArm"), ("RightArm", "RightForeArm"),
    ("RightForeArm", "RightHand"), ("Neck1", "LeftArm"), ("LeftArm", "LeftForeArm"),
    ("LeftForeArm", "LeftHand"),
)  # fmt: skip
FACES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # y up, facing z -> ours
_tool = None


def about() -> dict[str, str]:
    """Versions."""
    return versions("eden-soma-retargeter", "newton", "warp-lang")


def whole(
    robot: Plain, dt: float, settings: dict, x: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A whole motion: poses (m, n) [rad], seconds, failures (m,), turns of the base (m, 3, 3).

    Raises:
        ValueError: it gives another number of frames, or has not the robot's joints.
        FileNotFoundError: there is no G1 in the clone.
    """
    global _tool
    import warp as wp
    from scipy.spatial.transform import Rotation

    with redirect_stdout(sys.stderr):
        if _tool is None:
            from soma_retargeter.retargeting import MotionRetargeter

            wp.set_device("cpu")
            _tool = MotionRetargeter(
                body_model="soma", device="cpu", robot_model_path=_model(), target_fps=1.0 / dt
            )
            _mend(_tool._ensure_pipeline(), wp)
        turns, hips, names = _followed(x)
        began = time.perf_counter()
        made = _tool.retarget_soma(turns, hips, source_fps=1.0 / dt, joint_names=names)
        took = time.perf_counter() - began
    q = made["dof_pos"][:, [made["joint_names"].index(name) for name in robot.names]]
    if len(q) != len(x):
        raise ValueError(f"{len(q)} frames came of {len(x)}")
    base = Rotation.from_quat(made["root_quat"], scalar_first=True).as_matrix()
    return q.astype(float), np.full(len(x), took / len(x)), np.zeros(len(x), bool), base


def _mend(pipeline: Any, wp: ModuleType) -> None:
    """Undo two things that differ on a processor, where arrays are shared or copied otherwise.

    It keeps views of one array, so that all frames would be the last one's; and the feet are
    solved about the pelvis as it stood at first, so that it would be put back there.
    """
    last, feet = pipeline.joint_limit_clamper, pipeline.feet_stabilizer
    clamp, setup = last.apply, feet.setup_num_envs

    def shared(count: int) -> None:
        setup(count)
        feet.joint_q = feet.model.joint_q.reshape(feet.joint_q.shape)

    last.apply = lambda q: wp.clone(clamp(q))
    feet.setup_num_envs = shared


def _model() -> str:
    """Its G1 in a clone that is on the path."""
    for folder in sys.path:
        for name in MODELS:
            if (file := Path(folder) / name).is_file():
                return str(file)
    raise FileNotFoundError(f"no {' and no '.join(MODELS)} in the clone")


def _rest() -> tuple[list[str], list[int], np.ndarray, np.ndarray]:
    """Of how it rests: names, parents, rotations (j, 3, 3) and places [m] (j, 3) as we see them."""
    from scipy.spatial.transform import Rotation
    from soma_retargeter.assets.bvh import load_bvh
    from soma_retargeter.retargeting.animation_io import (
        load_template_skeleton,
        template_bvh_path,
    )

    bones = load_template_skeleton()
    _, pose = load_bvh(str(template_bvh_path()), bones)
    local = np.array(pose.get_local_transforms(0), float)
    parents = [int(p) for p in bones.parent_indices]
    turn, at = np.empty((len(local), 3, 3)), np.empty((len(local), 3))
    for j, up in enumerate(parents):
        own = Rotation.from_quat(local[j, 3:]).as_matrix()
        turn[j] = FACES @ own if up < 0 else turn[up] @ own
        at[j] = FACES @ local[j, :3] if up < 0 else at[up] + turn[up] @ local[j, :3]
    return list(bones.joint_names), parents, turn, at


def _followed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Rotations (m, j, 3, 3) to the joint above, places of the hips [m] (m, 3), and joints."""
    names, parents, rest, at = _rest()
    place = dict(zip(names, at, strict=True))
    bones = np.array([place[b] - place[a] for a, b in BONES])
    bones /= np.linalg.norm(bones, axis=1, keepdims=True)
    still, turned = person.Turned().step(bones.ravel()), person.Turned()
    found = np.empty((len(x), len(names), 3, 3))
    for row, skeleton in zip(found, x, strict=True):
        to, u = turned.step(skeleton), skeleton.reshape(7, 3)
        chest = to.chest @ still.chest.T
        moved = dict.fromkeys(TRUNK, _along(bones[0], u[0], chest))
        for side, word in (("R", "Right"), ("L", "Left")):
            i = person.SIDES[side][0]
            upper, fore = to.upper[side] @ still.upper[side].T, to.fore[side] @ still.fore[side].T
            moved[f"{word}Shoulder"] = _along(bones[i], u[i], chest)
            moved[f"{word}Arm"] = _along(bones[i + 1], u[i + 1], upper)
            moved[f"{word}ForeArm"] = moved[f"{word}Hand"] = _along(bones[i + 2], u[i + 2], fore)
        full: list[np.ndarray] = []
        for j, (name, up) in enumerate(zip(names, parents, strict=True)):
            stays = np.eye(3) if up < 0 or _stands(name) else full[up]  # a finger goes with a hand
            full.append(moved.get(name, stays))
            here = full[j] @ rest[j]
            row[j] = here if up <= 0 else (full[up] @ rest[up]).T @ here
    return found[:, 1:], np.tile(place["Hips"], (len(x), 1)), names[1:]


def _stands(name: str) -> bool:
    return name == "Hips" or any(part in name for part in ("Leg", "Shin", "Foot", "Toe"))


def _along(bone: np.ndarray, to: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """A rotation, turned on the shortest way so that it brings a bone along a unit vector."""
    seen = turn @ bone
    return shortest(seen / np.linalg.norm(seen), to) @ turn
