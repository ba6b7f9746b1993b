"""The command `s3le` and its subcommands; heavy imports happen inside them."""

import typer

from s3le.cli import audit, guard, render, retarget, robot, stream, video, view
from s3le.cli.shell import guarded

app = typer.Typer(
    name="s3le",
    help="Human motion in, humanoid motion out, every pose and every path between certified.",
    epilog="Each command explains itself: s3le audit --help",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("retarget", short_help="Motion files in, certified motions out.")(retarget.retarget)
app.command("video", short_help="Plain videos in, skeletons for retarget out.")(video.video)
app.command("audit", short_help="Check any trajectory, pose by pose and between.")(audit.audit)
app.command("guard", short_help="Joint motions in, the nearest certified ones out.")(guard.guard)
app.command("view", short_help="Look at motions in a browser.")(view.view)
app.command("render", short_help="Motions as a strip of pictures or a film.")(render.render)
app.command("stream", short_help="A live human in, a certified robot out.")(stream.stream)
app.add_typer(robot.app, name="robot", short_help="A robot file from a URDF, and its check.")


def run() -> None:
    """Entry point: a refusal is one line on stderr and exit status 2, not a traceback."""
    with guarded():
        app()
