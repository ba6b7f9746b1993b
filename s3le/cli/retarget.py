"""`s3le retarget`: clips in, one certified motion each out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from s3le.cli import options, shell
from s3le.errors import S3leError

if TYPE_CHECKING:
    from s3le.retarget import outputs
    from s3le.retarget.stream import Retargeter


def retarget(
    clips: Annotated[
        list[Path],
        typer.Argument(
            help="Motion files (.amc, .bvh, DeepMimic .txt or .json; or with .gz), .parquet of "
            "s3le video, 3D keypoints (.npz, .npy, .csv, .trc, .json, .pkl, .pt, a folder of "
            "FrankMocap or OpenPose), .glb, .gltf or .vrma, or folders.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.", show_default=False)],
    robot: options.RobotToMove = None,
    model: options.Model = None,
    method: options.Method = None,
    csv: Annotated[bool, typer.Option("--csv", help="Also write CSV.")] = False,
    npz: Annotated[bool, typer.Option("--npz", help="Also write NPZ.")] = False,
    full: Annotated[
        bool,
        typer.Option("--full", help="Write every actuated joint of the URDF, held ones included."),
    ] = False,
    tools: Annotated[
        list[options.Tool] | None,
        typer.Option(
            "--for", help="Also write what this tool reads: a free base and all joints at one rate."
        ),
    ] = None,
    root_height: Annotated[
        float | None,
        typer.Option(
            help="Height of the base link in files --for a tool [m].",
            show_default="the robot stands on the ground",
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Rows per second, 30 to 1000 [Hz].", show_default="the clip's frames"),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(help="Frames per second of the clips [Hz].", show_default="the files' own"),
    ] = None,
    lead_in: Annotated[
        float,
        typer.Option(help="Move from the robot's anchor to the first frame in this time [s]."),
    ] = 0.0,
    tilt_max: Annotated[
        float, typer.Option(help="Drop frames whose torso leans farther [deg].")
    ] = 60.0,
    accept_minority: Annotated[
        bool,
        typer.Option(
            "--accept-minority", help="Also write clips of which most frames cannot be used."
        ),
    ] = False,
    layout: options.Layout = None,
    axes: options.Axes = None,
    pitch: options.Pitch = None,
    person: options.Person = None,
    confidence: options.Confidence = None,
    animation: options.Animation = None,
    names: options.Names = None,
) -> None:
    """Retarget motion files: one Parquet and one JSON summary per clip, all of it certified.

    Columns: time [s], one per joint as named in the URDF [rad], heading of the human [rad],
    clearance [m], mode. Every pose is checked by coal and every path between two poses is proven
    before anything is written; a clip that fails is named, and the others are still written. What
    keypoints leave open (which joint is which, up, tilt, unit, rate) is found in the data and said,
    or asked for. A clip of which most frames cannot be used fails too. Without --model the robot's
    poses are made when it is first asked for, and kept.

    \b
    s3le retarget walk.bvh --out out
    s3le retarget 14_05.amc 14_07.amc.gz --robot g1 --out out --csv --npz
    s3le retarget walk.bvh --robot my.yaml --out out
    s3le retarget walk.bvh --model data/retargeter --out out
    s3le retarget clips/ --out out --rate 500 --lead-in 2
    s3le retarget walk.bvh --out out --full --for gmr --for mjlab --rate 30
    s3le retarget mediapipe.npz --out out --pitch 12
    s3le retarget joints.csv --out out --layout h36m17 --axes camera --fps 25
    s3le retarget odd.bvh --out out --axes z-up --names names.yaml
    s3le retarget mocap_output/ --out out --person 0
    s3le audit out/*.parquet

    Exit status: 0 if every clip was written, 1 if one failed, 2 if nothing could begin.
    """  # noqa: D301
    with shell.guarded():
        from s3le.human.chosen import chosen
        from s3le.retarget import outputs

        known = shell.how(layout, axes, pitch, person, confidence, animation, names)
        read = {"fps": fps, "tilt_max": tilt_max, "how": known}
        paths = chosen(clips)
        retargeter, about, line = shell.retargeter(model, method, robot)
        shape = outputs.shape(
            retargeter.robot,
            csv=csv,
            npz=npz,
            full=full,
            tools=tools or (),
            root_height=root_height,
        )
        outputs.refuse_overlap(paths, out, shape)
        how = {
            "rate": rate,
            "even": bool(shape.tools),
            "lead_in": lead_in,
            "about": about,
        }
        typer.echo(line)
        failed = 0
        for path in paths:
            try:
                summary = _one(path, retargeter, out, shape, read, accept_minority, how)
            except (S3leError, OSError) as refusal:
                shell.complain(refusal)
                failed += 1
                continue
            typer.echo(_line(path, summary))
        if failed:
            typer.echo(f"{failed} of {len(paths)} clips failed", err=True)
            raise typer.Exit(shell.BROKEN)


def _one(
    path: Path,
    retargeter: "Retargeter",
    out: Path,
    shape: "outputs.Shape",
    read: dict[str, Any],
    minority: bool,
    how: dict[str, Any],
) -> dict[str, Any]:
    """Retarget one clip and write what came of it."""
    from s3le.human.origin import about_clip
    from s3le.human.skeletons import read_frames, refuse_minority
    from s3le.retarget import clip, outputs

    how = how | {"about": how["about"] | about_clip(path, out)}
    frames = read_frames(path, retargeter.robot.neck, **read)
    if not minority:
        refuse_minority(path, frames)
    for words in frames.reading.told if frames.reading else ():
        typer.echo(f"{path}: note: {words}", err=True)
    with shell.bar(len(frames.x), frames.name, "frames") as progress:
        made = clip.convert(retargeter, frames, **how, progress=progress)
    return outputs.write(made, retargeter.robot, out, shape).summary


def _line(path: Path, summary: dict[str, Any]) -> str:
    rows, to_human = summary["rows"], summary["to_human"]
    dropped = sum(summary["frames"]["dropped"].values())
    return (
        f"{path.name}: {rows['written']} poses, {rows['seconds']:.2f} s, certified; to the human "
        f"{to_human['mean']:.4f} (p95 {to_human['p95']:.4f}), clearance at least "
        f"{summary['clearance_m']['least'] * 1e3:.2f} mm, "
        f"{summary['milliseconds_per_frame']['p50']:.2f} ms a frame"
        + (f", {dropped} frames dropped" if dropped else "")
    )
