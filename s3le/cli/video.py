"""`s3le video`: plain videos in, skeletons out, which every other command reads as clips."""

import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from s3le.cli import options, shell
from s3le.errors import ParameterError, S3leError

if TYPE_CHECKING:
    from s3le.video.convert import Choices
    from s3le.video.process import Process

FILE = ".parquet"


def video(
    clips: Annotated[
        list[Path],
        typer.Argument(help="Videos: .mp4, .mov, .mkv, .webm, .avi, ...", show_default=False),
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="skeletons.parquet for one video, or a folder: NAME.parquet for each.",
            show_default=False,
        ),
    ],
    begin: options.Begin = None,
    end: options.End = None,
    pitch: Annotated[
        float | None,
        typer.Option(
            help="Angle by which the camera looks down [deg]; below 0: up.",
            show_default="from frames in which the person stands",
        ),
    ] = None,
    roll: Annotated[
        float, typer.Option(help="Angle by which uprights lean to the right in the image [deg].")
    ] = 0.0,
    visibility: Annotated[
        float, typer.Option(help="Joints that are less visible are not used, 0 to 1.")
    ] = 0.1,
    fill: Annotated[float, typer.Option(help="Longest hole that is filled [s].")] = 0.2,
    smooth: Annotated[
        float, typer.Option(help="Cutoff of the zero-phase filter [Hz]; 0: no filter.")
    ] = 6.0,
    rate: Annotated[
        float | None,
        typer.Option(
            help="Frames per second of the result [Hz].",
            show_default="the video's mean, at most 60",
        ),
    ] = None,
    environment: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the environment that MediaPipe is in.", show_default=".venv-video"
        ),
    ] = None,
) -> None:
    """Estimate the person of a video: ten points in time, z up, as a clip for `s3le retarget`.

    MediaPipe Pose runs in an environment of its own, which `make video` sets up once. Where nobody
    is seen, an arm is hidden, the scene is cut or the estimator takes another person, the file has
    a gap and the reason (column status); holes up to --fill are filled, never across a cut.

    \b
    s3le video clip.mp4 --out skeletons.parquet
    s3le retarget skeletons.parquet --out motions
    s3le video phone/*.mov --out clips --visibility 0.5 --smooth 4
    s3le video stairs.mp4 --out stairs.parquet --pitch 20 --from 3 --to 9.5

    Exit status: 0 if every video was written, 1 if one failed, 2 if nothing could begin.
    """  # noqa: D301
    with shell.guarded():
        from s3le.video import process
        from s3le.video.convert import Choices

        choices = Choices(
            pitch=pitch, roll=roll, visibility=visibility, fill=fill, smooth=smooth, rate=rate
        )
        choices.check()
        targets = _targets(clips, out)
        python = process.interpreter(environment)
        failed = 0
        for path, target in zip(clips, targets, strict=True):
            try:
                with process.Process(python) as estimator:  # afresh: it remembers the last person
                    about, took = _one(path, target, estimator, choices, begin, end)
            except (S3leError, OSError) as refusal:
                shell.complain(refusal)
                failed += 1
                continue
            for line in _lines(path, target, about, took):
                typer.echo(line)
        if failed:
            typer.echo(f"{failed} of {len(clips)} videos failed", err=True)
            raise typer.Exit(shell.BROKEN)


def _targets(clips: list[Path], out: Path) -> list[Path]:
    """Where each video's skeletons go."""
    if out.suffix.lower() == FILE and not out.is_dir():
        if len(clips) > 1:
            raise ParameterError(f"--out {out}: {len(clips)} videos need a folder")
        return [out]
    if out.suffix and not out.is_dir():
        raise ParameterError(f"--out {out}: wanted a name that ends in {FILE}, or a folder")
    names = [clip.stem for clip in clips]
    for name, count in Counter(names).items():
        if count > 1:
            raise ParameterError(f"{count} videos are called '{name}'; write them to two folders")
    return [out / f"{name}{FILE}" for name in names]


def _one(
    path: Path,
    target: Path,
    estimator: "Process",
    choices: "Choices",
    begin: float | None,
    end: float | None,
) -> tuple[dict[str, Any], float]:
    """Make one file; what it says of itself, and seconds taken for each frame."""
    from s3le.video import convert
    from s3le.video.decode import Video

    expected = Video(path).expected() if begin is None and end is None else None
    with shell.bar(expected, path.name, "frames", "") as progress:
        begun = time.perf_counter()
        looked = convert.look(path, estimator, progress, begin, end)
        took = (time.perf_counter() - begun) / len(looked.time)
    made = convert.skeletons(looked, choices, path)
    convert.write(made, target)
    return made.about, took


def _lines(path: Path, target: Path, about: dict[str, Any], took: float) -> list[str]:
    frames, usable = about["frames"], about["rows_by_status"]
    known = usable.get("seen", 0) + usable.get("filled", 0)
    breaks = [f"{about[n]} {n}" for n in ("cuts", "jumps", "flips")]
    line = (
        f"{path.name}: {frames} frames at {about['mean_fps']:.3g} Hz, a person in "
        f"{about['frames_with_person'] / frames:.0%}; {known} of {about['rows']} rows known, "
        f"{usable.get('filled', 0)} of them filled, {about['gaps']} gaps (longest "
        f"{about['longest_gap_s']:.2f} s), {', '.join(breaks)}; {1e3 * took:.0f} ms a frame "
        f"({1.0 / took:.0f} a second) -> {target}"
    )
    pitch = round(about["choices"]["pitch"], 1) + 0.0  # no "-0.0"
    notes = [f"camera looks down by {pitch:.1f} deg: {about['pitch_from']}"]
    if about["turned_deg"]:
        notes.append(f"turned by {about['turned_deg']} deg, as the file asks for")
    if about["longest_step_s"] > 1.5 * about["seconds"] / (frames - 1):
        low, high = (1.0 / about[f"{which}_step_s"] for which in ("longest", "shortest"))
        notes.append(f"frames come at {low:.1f} to {high:.1f} Hz; their own times are kept")
    for key in ("damaged_packets", "frames_out_of_order", "frames_without_time"):
        if about[key]:
            notes.append(f"{about[key]} {key.replace('_', ' ')}")
    if about["jumps"]:
        notes.append(
            "the estimator follows one person: where it jumps it may have taken another one; "
            "give the part with the person who is meant by --from and --to"
        )
    return [line, *(f"  {note}" for note in notes)]
