"""Options that several commands have, so that they are called and explained alike."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Tool(StrEnum):
    """Tools whose own layout is written; see s3le/motion/layouts.py."""

    gmr = "gmr"
    mjlab = "mjlab"


RobotToMove = Annotated[
    str | None,
    typer.Option(
        help="Name (s3le robot list), robot file, or folder of stage robot.",
        show_default="the model's; without one data/robot, else coman",
    ),
]
Model = Annotated[
    Path | None,
    typer.Option(
        help="Folder of a retargeter that the pipeline exported, e.g. data/retargeter.",
        show_default="poses that are made for the robot",
    ),
]
Method = Annotated[
    str | None,
    typer.Option(help="Refuse any other method of look-up.", show_default="whichever it is"),
]
Jerk = Annotated[
    float | None,
    typer.Option(
        help="Aim at no more jerk than this [rad/s^3]; it is told, and not certified.",
        show_default="any",
    ),
]
Human = Annotated[
    str | None,
    typer.Option(
        help="Clip of the human, or none.", show_default="the clip that the first file names"
    ),
]
Begin = Annotated[float | None, typer.Option("--from", help="Begin here [s].")]
End = Annotated[float | None, typer.Option("--to", help="End here [s].")]
RobotOfFiles = Annotated[
    str | None,
    typer.Option(
        help="Name (s3le robot list), robot file, or folder that the robot stage wrote.",
        show_default="the one that a file names, else data/robot, else coman",
    ),
]
RateOfFiles = Annotated[
    float | None,
    typer.Option(help="Rows per second of the files [Hz].", show_default="their own"),
]
RateOfRows = Annotated[
    float | None,
    typer.Option(help="Rows per second [Hz].", show_default="the file's times or rate"),
]
Joints = Annotated[
    str | None,
    typer.Option(help="Names of the columns, for files that have none: NAME,NAME,... or a file."),
]
Degrees = Annotated[bool, typer.Option("--degrees", help="Angles of the files are in degrees.")]
Given = Annotated[
    str | None,
    typer.Option(
        help="Joints that others move (legs that walk, hands that grasp): NAME,NAME,..., all that "
        "the file has, or none.",
        show_default="the robot file's, else those that do not stand still",
    ),
]
Jobs = Annotated[int, typer.Option(help="Processes; 0: one for every processor.", min=0)]
Layout = Annotated[
    str | None,
    typer.Option(
        help="Joint list of keypoints: smpl, mediapipe, body25, spin49, h36m17, coco17.",
        show_default="by number or names of the joints",
    ),
]
Axes = Annotated[
    str | None,
    typer.Option(
        help="Axes of the file: y-up, z-up, camera (x right, y down, z away), y-up-left (Unity), "
        "z-up-left (Unreal).",
        show_default="by the format, the rest pose and where trunks point",
    ),
]
Names = Annotated[
    Path | None,
    typer.Option(
        help="File that says which joint is which (YAML or JSON: r_elbow: RightForeArm, ...).",
        show_default="by the usual names",
    ),
]
Pitch = Annotated[
    float | None,
    typer.Option(
        help="How far the camera of keypoints looks down [deg].",
        show_default="by who stands on straight legs",
    ),
]
Person = Annotated[
    int | None, typer.Option(help="Which of several persons, by the file's numbers.")
]
Confidence = Annotated[
    float | None,
    typer.Option(
        help="Leave out frames in which a joint is less certain, 0 to 1.", show_default="0.1"
    ),
]
Animation = Annotated[
    str | None,
    typer.Option(
        help="Which animation of a glTF scene: its name, or its number from 0.",
        show_default="the only one",
    ),
]
