"""holosoma-retargeting (OmniRetarget): whole motions by interaction meshes, on its own G1.

It wants a whole body's joints on a floor, so it is given a person of its own format whose trunk and
arms point along the same seven vectors as everybody's and whose legs stand straight. Of what it
makes, the joints that this benchmark's robot has are kept. It runs as its documentation has it
(robot_only), with the mujoco that it works with; the one that pip resolves freezes all joints. Time
is the whole motion's, evenly over its frames.
"""

import os
import sys
import time
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import person
from plain import Plain

from solvers import versions


def about() -> dict[str, str]:
    """Versions."""
    return versions("holosoma-retargeting", "mujoco", "cvxpy", "clarabel", "torch")


def whole(
    robot: Plain, dt: float, settings: dict, x: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A whole motion: poses (m, n) [rad], seconds, failures (m,), turns of the base (m, 3, 3).

    Raises:
        ValueError: it gives another number of frames, or has not the robot's joints.
    """
    found = find_spec("holosoma_retargeting")
    package = Path(found.submodule_search_locations[0])
    sys.path[:0] = [str(package), str(package / "src")]
    here = os.getcwd()
    os.chdir(package)  # it looks for its models from there
    try:
        import mujoco
        from holosoma_retargeting.config_types.retargeting import RetargetingConfig
        from holosoma_retargeting.examples import robot_retarget
        from scipy.spatial.transform import Rotation

        with TemporaryDirectory() as folder, redirect_stdout(sys.stderr):
            places = person.points(x)
            np.savez(
                Path(folder) / "motion.npz", global_joint_positions=places, height=person.HEIGHT
            )
            began = time.perf_counter()
            robot_retarget.main(
                RetargetingConfig(
                    task_type="robot_only", data_format="smplx", task_name="motion",
                    data_path=Path(folder), save_dir=Path(folder) / "made", robot="g1",
                )
            )  # fmt: skip
            took = time.perf_counter() - began
            with np.load(Path(folder) / "made/motion.npz") as made:
                qpos = made["qpos"]
        model = mujoco.MjModel.from_xml_path(str(package / "models/g1/g1_29dof.xml"))
        at = [int(model.joint(name).qposadr[0]) for name in robot.names]
    finally:
        os.chdir(here)
    if len(qpos) != len(x):
        raise ValueError(f"{len(qpos)} frames came of {len(x)}")
    base = Rotation.from_quat(qpos[:, 3:7], scalar_first=True).as_matrix()
    return qpos[:, at], np.full(len(x), took / len(x)), np.zeros(len(x), bool), base
