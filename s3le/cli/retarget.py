"""`s3le retarget`: clips in, one certified motion each out."""

import os
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from s3le.cli import options, shell
from s3le.errors import ParameterError, TrajectoryError

if TYPE_CHECKING:
    from s3le.human.skeletons import ClipFrames
    from s3le.retarget.clips import Record
    from s3le.retarget.others import Other
    from s3le.retarget.outputs import Shape
    from s3le.retarget.stream import Retargeter
    from s3le.robot.robot import Robot

_LONGEST = 1e6  # [s]


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
    jerk: options.Jerk = None,
    tilt_max: Annotated[
        float, typer.Option(help="Drop frames whose torso leans farther [deg].")
    ] = 60.0,
    others: Annotated[
        Path | None,
        typer.Option(
            help="Take legs, root and all joints that the robot file does not decide from this "
            "motion of another tool's (what s3le guard reads), and its rows.",
            show_default="they stand still",
        ),
    ] = None,
    offset: Annotated[
        float | None,
        typer.Option(
            help="When the clip begins after the first row of --others [s].", show_default="0"
        ),
    ] = None,
    others_fps: Annotated[
        float | None,
        typer.Option(help="Rows per second of --others [Hz].", show_default="the file's own times"),
    ] = None,
    joints: options.Joints = None,
    degrees: options.Degrees = False,
    given: options.Given = None,
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
    jobs: options.Jobs = 0,
    again: Annotated[
        bool, typer.Option("--again", help="Make every clip anew, also those that are finished.")
    ] = False,
) -> None:
    """Retarget motion files: one Parquet and one JSON summary per clip, all of it certified.

    Columns: time [s], one per joint as named in the URDF [rad], heading of the human [rad],
    clearance [m], mode. Every pose is checked by coal and every path between two poses is proven
    before anything is written; a clip that fails is named, and the others are still written. What
    keypoints leave open (which joint is which, up, tilt, unit, rate) is found in the data and said,
    or asked for. A clip of which most frames cannot be used fails too. Without --model the robot's
    poses are made when it is first asked for, and kept. All clips together get a table
    (retarget.parquet). What an earlier run has finished, of the same clip with the same options,
    is kept.

    With --others the arms are put on another tool's legs: rows, legs and root are that file's, to
    the bit, and all is proven with all joints moving. Where its joints leave the arms no certified
    way, steps are forced: listed in the summary, claimed of by nobody. --joints, --degrees and
    --given are of that file.

    \b
    s3le retarget walk.bvh --out out
    s3le retarget 14_05.amc 14_07.amc.gz --robot g1 --out out --csv --npz
    s3le retarget walk.bvh --robot my.yaml --out out
    s3le retarget walk.bvh --model data/retargeter --out out
    s3le retarget clips/ --out out --jobs 8
    s3le retarget clips/ --out out --rate 500 --lead-in 2
    s3le retarget walk.bvh --out out --full --for gmr --for mjlab --rate 30
    s3le retarget walk.bvh --robot g1 --others legs.pkl --offset 0.5 --for gmr --out out
    s3le retarget mediapipe.npz --out out --pitch 12
    s3le retarget joints.csv --out out --layout h36m17 --axes camera --fps 25
    s3le retarget odd.bvh --out out --axes z-up --names names.yaml
    s3le retarget mocap_output/ --out out --person 0
    s3le audit out/*.parquet

    Exit status: 0 if every clip was written, 1 if one failed or steps of it are forced, 2 if
    nothing could begin.
    """  # noqa: D301
    with shell.guarded():
        from s3le.human.chosen import chosen
        from s3le.kernels.threads import processors
        from s3le.retarget import clips as table
        from s3le.retarget import many, outputs
        from s3le.retarget.task import Asked, Lead, Retargeting
        from s3le.tuples.engine import lock

        known = shell.how(layout, axes, pitch, person, confidence, animation, names)
        paths = chosen(clips)
        its, words, line = shell.retargeter(model, method, robot)
        shell.warn_of(its.robot)
        if jerk is not None:
            its = its.gentler(jerk)  # refuses what is none
        shape = outputs.shape(
            its.robot,
            csv=csv,
            npz=npz,
            full=full,
            tools=tools or (),
            root_height=root_height,
        )
        other = None
        if others is not None:
            refused = {"--rate": rate, "--lead-in": lead_in or None, "--root-height": root_height}
            _refuse_beside_others(paths, refused)
            other = _other(
                others, out, offset, others_fps, joints, degrees, given, shape, its.robot
            )
        else:
            _refuse_without_others(
                {"--offset": offset, "--others-fps": others_fps, "--joints": joints,
                 "--degrees": degrees or None, "--given": given}
            )  # fmt: skip
        outputs.refuse_overlap(paths, out, shape, others)
        workers = min(jobs or processors(), len(paths))
        task = Retargeting(
            robot=its.robot.tag,
            lead=Lead.of(its.robot, model, method),
            asked=Asked(
                fps,
                tilt_max,
                known,
                accept_minority,
                rate,
                bool(shape.tools),
                lead_in,
                other,
                jerk,
            ),  # fmt: skip
            words=words,
            written=shape.about(),
        )
        typer.echo(line)
        with lock.held(out / ".retarget.lock", str(out), kept="what it has finished is kept"):
            if workers > 1:
                _compile(its)
            one = _bar if len(paths) == 1 else None
            found = many.process(
                paths, out, its, shape, task, workers=workers, again=again, bar=one
            )
            records = _told(found, paths)
            table.write(records, its.settings.between, its.robot.tag, out / outputs.TABLE)
        if len(paths) > 1:
            typer.echo(table.total(records))
        if failed := sum(not record.summary for record in records):
            typer.echo(f"{failed} of {len(paths)} clips failed", err=True)
        if failed or any(record.why for record in records):
            raise typer.Exit(shell.BROKEN)


def _refuse_beside_others(paths: list[Path], told: dict[str, Any]) -> None:
    """Refuse what --others decides already."""
    if len(paths) != 1:
        raise ParameterError(
            f"--others is the motion of one clip, and here are {len(paths)}; name the clip, and "
            "run once for each"
        )
    for option, value in told.items():
        if value is not None:
            raise ParameterError(
                f"{option} does not go with --others: rows and root are that file's own"
            )


def _refuse_without_others(told: dict[str, Any]) -> None:
    for option, value in told.items():
        if value is not None:
            raise ParameterError(f"{option} is of the motion of --others; give --others too")


def _other(
    path: Path,
    out: Path,
    offset: float | None,
    fps: float | None,
    joints: str | None,
    degrees: bool,
    given: str | None,
    shape: "Shape",
    robot: "Robot",
) -> "Other":
    """The motion of --others, once it could be read."""
    from s3le.guard.places import fingerprint
    from s3le.retarget.others import Other, read

    if offset is not None and not abs(offset) < _LONGEST:  # catches NaN
        raise ParameterError(f"--offset must be within {_LONGEST:g} s, got {offset!r}")
    named = shell.names(joints)
    try:
        held = fingerprint(path)
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror or error}") from None
    made = Other(
        path=str(path), shown=Path(os.path.relpath(path, out)).as_posix(), sha256=held,
        offset=offset or 0.0, fps=fps, joints=None if named is None else tuple(named),
        degrees=degrees, given=shell.given(given, robot), rooted=bool(shape.tools),
    )  # fmt: skip
    read(made, robot)  # refused before the work
    return made


def _told(found: "Iterable[Record]", paths: list[Path]) -> "list[Record]":
    """All records in the order of their clips; each is told once those before it are done."""
    waiting: dict[Path, Record] = {}
    told: list[Record] = []
    many = len(paths) > 1
    with shell.bar(len(paths), "all", "clips", "") if many else nullcontext() as step:
        for record in found:
            waiting[record.path] = record
            while len(told) < len(paths) and paths[len(told)] in waiting:
                told.append(waiting.pop(paths[len(told)]))
                _say(told[-1])
            if step:
                step(1)
    return told


def _say(record: "Record") -> None:
    for note in record.notes:
        shell.say(f"{record.path}: note: {note}", err=True)
    if record.why:
        shell.say(f"{record.status}: {record.why}", err=True)
    if record.summary:
        kept = " (kept)" if record.kept else ""
        shell.say(_line(record.path, record.summary) + kept)


def _bar(frames: "ClipFrames") -> AbstractContextManager[Any]:
    return shell.bar(len(frames.x), frames.name, "frames")


def _compile(its: "Retargeter") -> None:
    """Compile before workers do it side by side."""
    from s3le.kernels import compiled
    from s3le.plan import whole

    if not compiled.stored(whole.SLOWEST):
        its.warm_up_plan()


def _line(path: Path, summary: dict[str, Any]) -> str:
    rows, to_human = summary["rows"], summary["to_human"]
    jerk = summary["jerk"]["planned"]
    dropped, run = sum(summary["frames"]["dropped"].values()), summary.get("forced")
    said = "certified" if not run else "NOT certified, some steps are forced"
    return (
        f"{path.name}: {rows['written']} poses, {rows['seconds']:.2f} s, {said}; to the human "
        f"{to_human['mean']:.4f} (p95 {to_human['p95']:.4f}), clearance at least "
        f"{summary['clearance_m']['least'] * 1e3:.2f} mm, "
        f"{summary['milliseconds_per_frame']['p50']:.2f} ms a frame"
        + (f", {dropped} frames dropped" if dropped else "")
        + (f", {shell.jerk(jerk)}" if jerk["limit_rad_s3"] else "")
    )
