"""`s3le view`: motions in a browser, also over SSH."""

from pathlib import Path
from typing import Annotated

import typer

from s3le.cli import options, shell, shown
from s3le.errors import FilmError, ParameterError

DENSEST = 60.0  # [Hz] of the moments that the slider knows


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Motions: .parquet, .csv, .npz or .npy, side by side.", show_default=False
        ),
    ],
    human: options.Human = None,
    port: Annotated[int, typer.Option(help="Port, or the next that is free; 0: any.")] = 8080,
    host: Annotated[
        str,
        typer.Option(help="Address to serve on; 0.0.0.0 shows it to everybody on the network."),
    ] = "127.0.0.1",
    open_browser: Annotated[bool, typer.Option("--open", help="Open a browser here.")] = False,
    begin: options.Begin = None,
    end: options.End = None,
    robot: options.RobotOfFiles = None,
    meshes: Annotated[
        Path | None,
        typer.Option(help="URDF whose meshes are drawn.", show_default="the robot's own, if any"),
    ] = None,
    rate: options.RateOfFiles = None,
    joints: options.Joints = None,
    degrees: options.Degrees = False,
    layout: options.Layout = None,
    axes: options.Axes = None,
    pitch: options.Pitch = None,
    person: options.Person = None,
    confidence: options.Confidence = None,
    animation: options.Animation = None,
    names: options.Names = None,
) -> None:
    """Look at motions in a browser: human and robots, clearance, where they were slowed or held.

    Prints an address and serves it until Ctrl-C. Files are read as `s3le audit` reads them; the
    human is the clip that the first file says it was made from, or --human. On another machine:
    ssh -L 8080:localhost:8080 there, run it there, and open the address here.

    \b
    s3le view walk.parquet
    s3le view ours.parquet theirs.csv --human walk.bvh
    s3le view dance.npz --robot coman --from 10 --to 20 --port 9000
    s3le view walk.parquet --meshes ~/robots/g1/g1.urdf --open

    Exit status: 0 when it is ended, 2 if nothing could be shown.
    """  # noqa: D301
    import threading

    with shell.guarded():
        if not 0 <= port <= 65_535:
            raise ParameterError(f"--port must be from 0 to 65535, got {port}")
        if rate is not None and not rate > 0.0:
            raise ParameterError(f"--rate must be above 0 Hz, got {rate!r}")
        known = shell.how(layout, axes, pitch, person, confidence, animation, names)
        loaded = shown.load(files, human, robot, rate, joints, degrees, known)
        try:
            from s3le.show.viewer.page import Page
        except ModuleNotFoundError as error:
            raise FilmError(f"the viewer needs {error.name}: pip install 's3le[view]'") from None
        from s3le.show import motions

        times = motions.moments(loaded.motions, DENSEST, begin, end)
        with shell.bar(len(times) * len(loaded.motions), "measuring", "moments") as progress:
            page = Page(loaded.motions, loaded.human, times, host, port, progress, meshes)
        typer.echo(f"{page.address}  (Ctrl-C ends it)")
        if open_browser:
            import webbrowser

            webbrowser.open(page.address)
        stopped = threading.Event()
        try:
            page.run(stopped)
        except KeyboardInterrupt:
            typer.echo("", err=True)
        finally:
            page.stop()
