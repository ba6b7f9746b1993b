"""Hulls of a robot's own meshes, for a judge that no entrant was told of.

A robot that names hulls (`s3le robot new --hulls`) has its own. G1's meshes are not part of this
project; they come with holosoma-retargeting, where that is installed, and their hulls are packed
once. Links that this project's G1 does not have are left out.
"""

from pathlib import Path

import install
import numpy as np

from s3le.errors import RobotError
from s3le.onboard import hulls, reading
from s3le.robot.robot import Robot
from s3le.store import npz

ALIKE = {"left_rubber_hand_link": "left_rubber_hand", "right_rubber_hand_link": "right_rubber_hand"}
WHERE = "site-packages/holosoma_retargeting/models/g1/g1_29dof.xml"
MOST = 1 << 28  # [bytes]


def hulls_of(robot: Robot, folder: Path) -> Path | None:
    """The file of hulls of a robot; None: it has none here."""
    if robot.description.hulls:
        return robot.description.hulls
    found = sorted((install.FOLDER / "holosoma/lib").glob(f"*/{WHERE}"))
    if robot.name != "g1" or not found:
        return None
    target = folder / "hulls.npz"
    if not target.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        pack(found[0], robot, target)
    return target


def pack(model_file: Path, robot: Robot, target: Path) -> None:
    """Pack the hulls of a model's shapes, of links that the robot has too."""
    model, _ = robot.reduced()
    links = {frame.name for frame in model.frames}
    whole = target.with_suffix(".all.npz")
    whole.write_bytes(hulls.pack(reading.read(model_file)))
    kept = {}
    for name, corners in npz.read_npz(whole, RobotError, MOST).items():
        link, _, piece = name.rpartition("/")
        if (link := ALIKE.get(link, link)) in links:
            kept[f"{link}/{piece}"] = corners
    whole.unlink()
    part = target.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez_compressed(stream, **kept)
    part.replace(target)
