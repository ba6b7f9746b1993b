"""`s3le render`: motions as a strip of snapshots or a film, without a screen."""

from pathlib import Path
from typing import Annotated

import typer

from s3le.cli import options, shell, shown
from s3le.errors import FilmError, ParameterError

STRIP = ".png"
WIDEST = 7680  # [pixels], an 8K film
MOST_CELLS = 60
MOST_FPS = 240.0


def render(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Motions: .parquet, .csv, .npz or .npy, side by side.", show_default=False
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(help="strip.png, film.mp4 or film.gif; replaced.", show_default=False),
    ],
    human: options.Human = None,
    frames: Annotated[
        int | None, typer.Option(help="Moments of a strip, evenly spread.", show_default="8")
    ] = None,
    every: Annotated[
        float | None, typer.Option(help="Seconds between two moments of a strip.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Pictures per second of a film [Hz].")] = 30.0,
    begin: options.Begin = None,
    end: options.End = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="AZIMUTH[,ELEVATION] in degrees from the robot's front towards its left, or "
            "front, left, right, above.",
            show_default="22,14",
        ),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option(help="Width in pixels.", show_default="960; a strip 1880 without its labels"),
    ] = None,
    robot: options.RobotOfFiles = None,
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
    """Draw motions: a strip of snapshots (.png), or a film (.mp4, .gif); needs no screen, no GPU.

    The human stands above or beside the robots, all at one scale and seen by one camera. Several
    files are put side by side. A collision is outlined in red; below a film a line of time shows
    where the robot was slowed or held.

    \b
    s3le render walk.parquet --out strip.png
    s3le render walk.parquet --out walk.mp4
    s3le render ours.parquet theirs.csv --human walk.bvh --out both.mp4 --camera left
    s3le render walk.parquet --out part.gif --from 2 --to 5 --fps 15 --size 480
    s3le render walk.parquet --out steps.png --every 0.25 --to 3

    Exit status: 0 if it was drawn, 2 if not; then nothing was written.
    """  # noqa: D301
    with shell.guarded():
        strip = _check(out, frames, every, fps, size)
        angles = shown.camera(camera)
        known = shell.how(layout, axes, pitch, person, confidence, animation, names)
        loaded = shown.load(files, human, robot, rate, joints, degrees, known)
        if strip:
            _strip(loaded, out, frames, every, begin, end, angles, size)
        else:
            _film(loaded, out, fps, begin, end, angles, size)


def _check(
    out: Path, frames: int | None, every: float | None, fps: float, size: int | None
) -> bool:
    """Is it a strip? What cannot be drawn is refused before anything is read."""
    from s3le.show import movie

    kind = out.suffix.lower()
    if kind not in (STRIP, *movie.FORMATS):
        raise FilmError(f"--out {out}: wanted {', '.join((STRIP, *movie.FORMATS))}")
    if out.is_dir():
        raise FilmError(f"--out {out}: is a folder")
    if kind != STRIP and (frames is not None or every is not None):
        raise ParameterError("--frames and --every are for strips (.png); a film has --fps")
    if frames is not None and every is not None:
        raise ParameterError("--frames and --every: give one of them")
    if frames is not None and not 1 <= frames <= MOST_CELLS:
        raise ParameterError(f"--frames must be from 1 to {MOST_CELLS}, got {frames}")
    if every is not None and not every > 0.0:
        raise ParameterError(f"--every must be above 0 s, got {every!r}")
    if not 1.0 <= fps <= MOST_FPS:
        raise ParameterError(f"--fps must be from 1 to {MOST_FPS:g} Hz, got {fps!r}")
    if size is not None and not 200 <= size <= WIDEST:
        raise ParameterError(f"--size must be from 200 to {WIDEST} pixels, got {size}")
    return kind == STRIP


def _strip(loaded, out, frames, every, begin, end, angles, size) -> None:
    import numpy as np

    from s3le.show import camera, motions, rows, strip

    shown = loaded.motions
    first = min(one.trajectory.time[0] for one in shown) if begin is None else begin
    last = max(one.trajectory.time[-1] for one in shown) if end is None else end
    if every is not None:
        times = motions.moments(shown, 1.0 / every, begin, end, exact=True)
        if len(times) > MOST_CELLS:
            raise ParameterError(
                f"--every {every:g} makes {len(times)} snapshots, at most {MOST_CELLS} are drawn; "
                "take a longer step, or a part with --from and --to"
            )
    else:
        motions.moments(shown, 1.0, begin, end)  # refuses an empty part
        times = np.linspace(first, last, (frames or 8) if last > first else 1)
    shown_rows = [rows.human(loaded.human, times)] if loaded.human else []
    for number, one in enumerate(shown):
        told = rows.robot(one, times, number, len(shown) > 1)
        note = [f"{c * 1e3:.1f} mm" for c in told.clearance]
        shown_rows.append(told.row._replace(note=note))
    names = ", ".join(dict.fromkeys(one.robot.name for one in shown))
    labels = ", ".join(one.label for one in shown)
    how = {} if size is None else {"width": size}
    strip.draw(
        out, times, shown_rows, f"{names}: {labels}",
        camera=camera.Camera(*angles) if angles else camera.USUAL, **how,
    )  # fmt: skip


def _film(loaded, out, fps, begin, end, angles, size) -> None:
    from s3le.show import camera, film, motions, movie, pace, rows, style

    shown = loaded.motions
    times = motions.moments(shown, fps, begin, end, exact=True)
    shown_rows = [rows.human(loaded.human, times)] if loaded.human else []
    tracks, seen = [], set()
    with shell.bar(len(times) * (len(shown) + 1), out.name, "pictures") as progress:
        for number, one in enumerate(shown):
            told = rows.robot(one, times, number, len(shown) > 1, progress)
            shown_rows.append(told.row)
            spans = pace.spans(told.kind)
            seen |= {kind for _, _, kind in spans}
            tracks.append(film.Track([(a, b, kind.colour) for a, b, kind in spans]))
        legend = [(kind.label, kind.colour) for kind in pace.KINDS if kind in seen]
        with style.sheet():
            made = film.Film(
                times, shown_rows, tracks, legend,
                camera.Camera(*angles) if angles else camera.USUAL, size or 960, fine=2,
            )  # fmt: skip

            def pictures():
                for picture in made:
                    progress(1)
                    yield picture

            keep = (style.ALARM, *(kind.colour for kind in pace.KINDS))
            movie.write(out, pictures(), len(times), made.size, fps, keep)
