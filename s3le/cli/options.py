"""Options that several commands have, so that they are called and explained alike."""

from typing import Annotated

import typer

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
        help="Folder that the robot stage wrote, robot file, or name in data/robots.",
        show_default="the one that a file names, else data/robot, else coman",
    ),
]
RateOfFiles = Annotated[
    float | None,
    typer.Option(help="Rows per second of the files [Hz].", show_default="their own"),
]
Joints = Annotated[
    str | None,
    typer.Option(help="Names of the columns, for files that have none: NAME,NAME,... or a file."),
]
Degrees = Annotated[bool, typer.Option("--degrees", help="Angles of the files are in degrees.")]
