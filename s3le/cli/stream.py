"""`s3le stream`: a live human, or wanted joints, in; a certified robot out, line by line."""

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import radians
from pathlib import Path
from typing import Annotated

import typer

from s3le.cli import options, shell
from s3le.errors import ParameterError


def stream(
    robot: options.RobotToMove = None,
    model: options.Model = None,
    method: options.Method = None,
    rate: Annotated[
        float, typer.Option(help="Frames per second of lines without dt or t [Hz].")
    ] = 30.0,
    listen: Annotated[
        int | None,
        typer.Option(
            help="Port on 127.0.0.1 (0: any) instead of standard input; one client at a time."
        ),
    ] = None,
    tilt_max: Annotated[
        float, typer.Option(help="Refuse points whose torso leans farther [deg].")
    ] = 60.0,
    joints: Annotated[
        bool, typer.Option("--joints", help="Lines of joints alone: no poses are made for a human.")
    ] = False,
    given: Annotated[
        str | None,
        typer.Option(
            help="Joints that others move: NAME,NAME,...; or all that the robot has beside its "
            "own. Default: those that the robot file names."
        ),
    ] = None,
    given_speed: Annotated[
        float | None,
        typer.Option(help="How fast these may move where a line says nothing else [rad/s]."),
    ] = None,
) -> None:
    """Follow a stream of frames: JSON lines in, one certified pose out for each.

    In: {"x": [21 numbers], "dt": 0.033} or {"points": {"hip": [x, y, z], ...}, "t": 1.2}, metres,
    z up; or joints, {"q": [rad, ...] or {"joint": rad, ...}, "dt": 0.004}. Out: first a line that
    names the joints and the poses or the model, then {"t": s, "q": [rad], "mode": "...",
    "clearance": m}, of joints with "reason" and "certified", for each line in, or {"line": n,
    "error": "..."} where it could not be used; the stream goes on. The robot begins at its anchor.

    Where others move joints, lines hold "given" too, where these are [rad], in the order of the
    first line or by name; and "given_next", where they will be, or "given_speed", how fast they may
    move. A step for which they leave no certified way says so: "forced".

    \b
    camera | s3le stream --rate 60 > poses.jsonl
    leader | s3le stream --joints --robot g1 --rate 250
    s3le stream --listen 5555

    Exit status: 0 at the end of input, 2 if nothing could begin or the independent check refused
    a pose.
    """  # noqa: D301
    from s3le.guard import live

    with shell.guarded():
        if joints:
            begin = _of_joints(robot, model, method, rate, shell.names(given), given_speed)
        else:
            begin = _of_a_human(
                robot, model, method, rate, radians(tilt_max), shell.names(given), given_speed
            )
        if listen is not None:
            _listen(listen, begin)
            return

        def say(line: str) -> None:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

        live.serve(begin(), live.lines(sys.stdin.buffer), say)


def _of_a_human(
    robot: str | None,
    model: Path | None,
    method: str | None,
    rate: float,
    tilt: float,
    given: list[str] | None,
    speed: float | None,
) -> Callable:
    """What begins a stream of either kind."""
    from s3le.guard.guard import Guard
    from s3le.retarget.live import Live

    retargeter, about, line = shell.retargeter(model, method, robot, streams=True)
    typer.echo(line, err=True)

    def guard() -> Guard:
        factor = retargeter.settings.speed_factor
        return Guard(
            retargeter.robot, speed_factor=factor, given=given, given_speed=speed
        )  # fmt: skip

    return lambda: Live(retargeter, rate, tilt, about, guard, given, speed)


def _of_joints(
    robot: str | None,
    model: Path | None,
    method: str | None,
    rate: float,
    given: list[str] | None,
    speed: float | None,
) -> Callable:
    """What begins a stream of joints; kernels are compiled before the first line."""
    from s3le.guard.guard import Guard
    from s3le.guard.live import LiveJoints

    if model is not None or method is not None:
        raise ParameterError("--joints takes no --model and no --method: nobody is looked up")
    made = shell.robot(robot)
    typer.echo(f"robot {made.name} ({made.description.source}), wanted joints", err=True)
    guard = Guard(made, given=given, given_speed=speed)

    def begin() -> LiveJoints:
        guard.start()
        return LiveJoints(guard, rate)

    return begin


def _listen(port: int, begin: Callable) -> None:
    """Serve one client after the other on loopback, until interrupted."""
    import socket

    from s3le.guard import live

    with socket.create_server(("127.0.0.1", port)) as server:
        typer.echo(f"listening on 127.0.0.1:{server.getsockname()[1]}", err=True)
        while True:
            client, _ = server.accept()
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with client, client.makefile("rb") as source, suppress(ConnectionError, TimeoutError):
                say = partial(_send, client)  # a client that leaves makes room for the next
                live.serve(begin(), live.lines(source), say)


def _send(client, line: str) -> None:
    client.sendall(f"{line}\n".encode())
