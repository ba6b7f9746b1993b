"""GMR (general motion retargeting) from a user's clone of YanjieZe/GMR, on its own G1.

It follows a whole body's places and rotations in SMPL-X's frames with two tables of weights, a mink
program a pass and up to eleven passes a table. It is told the person of person.py: trunk and arms
along the same seven vectors as everybody's, the pelvis upright, the legs straight on the floor. Its
robot's base floats and its legs follow too; of what it makes, the joints that this benchmark's
robot has are kept, and how the base is turned is told beside them. It begins each motion with the
trunk and arms in the pose that the benchmark starts at. No speed limits, no collisions.

Its own module is loaded without its package's first lines, which want a viewer and a window; where
rich is not installed, which it only prints with, nothing is printed.
"""

import importlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable
from types import ModuleType

import numpy as np
import person
from plain import Goal, Plain

from solvers import versions

PACKAGE = "general_motion_retargeting"
SMPLX = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # its T-pose: left, up, ahead
NAMES = {  # its joints -> the person's
    "pelvis": "Pelvis", "spine3": "Spine3",
    **{f"{word}_{joint.lower()}": f"{side}_{joint}"
       for word, side in (("left", "L"), ("right", "R"))
       for joint in ("Hip", "Knee", "Foot", "Shoulder", "Elbow", "Wrist")},
}  # fmt: skip


def about() -> dict[str, str]:
    """Versions."""
    return versions("mink", "mujoco", "daqp", "qpsolvers", "scipy")


def make(robot: Plain, dt: float, settings: dict) -> Callable[[Goal, np.ndarray], np.ndarray]:
    """What solves a frame, and how the base is turned then."""
    import mujoco

    tool = _module("motion_retarget").GeneralMotionRetargeting(
        src_human="smplx", tgt_robot="unitree_g1", actual_human_height=person.HEIGHT
    )
    at = [int(tool.model.joint(name).qposadr[0]) for name in robot.names]
    turned = person.Turned()

    def solve(goal: Goal, q: np.ndarray) -> np.ndarray:
        full = tool.configuration.q.copy()
        full[at] = q
        tool.configuration.update(full)
        return tool.retarget(human(goal.skeleton, turned.step(goal.skeleton)))[at].copy()

    def base() -> np.ndarray:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, tool.configuration.q[3:7])
        return turn.reshape(3, 3)

    solve.base = base
    return solve


def human(x: np.ndarray, turns: person.Turns) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place [m] and rotation (a quaternion, its real part first) of each joint GMR asks for."""
    from scipy.spatial.transform import Rotation

    places = dict(zip(person.JOINTS, person.points(x[None])[0], strict=True))
    found = {}
    for name, joint in NAMES.items():
        turn = turns.of(joint) @ SMPLX
        found[name] = (places[joint], Rotation.from_matrix(turn).as_quat(scalar_first=True))
    return found


def _module(name: str) -> ModuleType:
    """A module of the clone, which is on the path; its package's own first lines are left out."""
    if PACKAGE not in sys.modules:
        package = ModuleType(PACKAGE)
        spec = importlib.machinery.PathFinder.find_spec(PACKAGE)
        if spec is None or spec.submodule_search_locations is None:
            raise ImportError(f"no {PACKAGE} in the clone")
        package.__path__ = list(spec.submodule_search_locations)
        sys.modules[PACKAGE] = package
        if importlib.util.find_spec("rich") is None:
            sys.modules["rich"] = ModuleType("rich")
            sys.modules["rich"].print = lambda *_: None
    return importlib.import_module(f"{PACKAGE}.{name}")
