"""`s3le stream`: a live human in, a certified robot out, line by line."""

import sys
from contextlib import suppress
from functools import partial
from math import radians
from typing import Annotated

import typer

from s3le.cli import options, shell


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
) -> None:
    """Follow a stream of frames: JSON lines in, one certified pose out for each.

    In: {"x": [21 numbers], "dt": 0.033} or {"points": {"hip": [x, y, z], ...}, "t": 1.2}, metres,
    z up. Out: first a line that names the joints and the poses or the model, then {"t": s, "q":
    [rad], "mode": "...", "clearance": m} for each line in, or {"line": n, "error": "..."} where it
    could not be used; the stream goes on. The robot begins at its anchor.

    \b
    camera | s3le stream --rate 60 > poses.jsonl
    s3le stream --listen 5555

    Exit status: 0 at the end of input, 2 if nothing could begin or the independent check refused
    a pose.
    """  # noqa: D301
    from s3le.retarget import live

    with shell.guarded():
        retargeter, about, line = shell.retargeter(model, method, robot, streams=True)
        typer.echo(line, err=True)

        def begin() -> live.Live:
            return live.Live(retargeter, rate, radians(tilt_max), about)

        if listen is not None:
            _listen(listen, begin)
            return

        def say(line: str) -> None:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

        live.serve(begin(), live.lines(sys.stdin.buffer), say)


def _listen(port: int, begin) -> None:
    """Serve one client after the other on loopback, until interrupted."""
    import socket

    from s3le.retarget import live

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
