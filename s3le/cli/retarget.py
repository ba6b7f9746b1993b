"""`s3le retarget`: clips in, one certified motion each out."""

from collections import Counter
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from s3le.cli import options, shell
from s3le.errors import ModelError, ParameterError, S3leError

if TYPE_CHECKING:
    from s3le.following import Follower
    from s3le.mocap.keypoints.how import How
    from s3le.trajectory.root import Root
    from s3le.trajectory.whole import Whole

MODEL = Path("data/retargeter")  # what the stage `export` writes
STARTS = 20  # of the optimisation to compare with


class Tool(StrEnum):
    """Tools whose own layout is written; see s3le/trajectory/layouts.py."""

    gmr = "gmr"
    mjlab = "mjlab"


def retarget(
    clips: Annotated[
        list[Path],
        typer.Argument(
            help="Motion files (.amc, .bvh, DeepMimic .txt or .json; or with .gz), .parquet of "
            "s3le video, 3D keypoints (.npz, .npy, .csv, .json, .pkl, a folder of FrankMocap or "
            "OpenPose), .glb or .gltf, or folders.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.", show_default=False)],
    robot: Annotated[
        str | None, typer.Option(help="Name of the robot that the model must be for.")
    ] = None,
    model: Annotated[Path, typer.Option(help="Folder of the exported retargeter.")] = MODEL,
    method: Annotated[
        str | None, typer.Option(help="Retrieval method.", show_default="the model's")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Also write CSV.")] = False,
    npz: Annotated[bool, typer.Option("--npz", help="Also write NPZ.")] = False,
    full: Annotated[
        bool,
        typer.Option("--full", help="Write every actuated joint of the URDF, held ones included."),
    ] = False,
    tools: Annotated[
        list[Tool] | None,
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
    look_ahead: Annotated[
        bool,
        typer.Option("--look-ahead", help="Give the model whole clips, not frame by frame."),
    ] = False,
    optimum: Annotated[
        bool,
        typer.Option("--optimum", help="Compare every frame with a constrained optimum; slow."),
    ] = False,
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
    names: options.Names = None,
) -> None:
    """Retarget motion files: one Parquet and one JSON summary per clip, all of it certified.

    Columns: time [s], one per joint as named in the URDF [rad], heading of the human [rad],
    clearance [m], mode. Every pose is checked by coal and every path between two poses is proven
    before anything is written; a clip that fails is named, and the others are still written. What
    keypoints leave open (which joint is which, up, tilt, unit, rate) is found in the data and said,
    or asked for. A clip of which most frames cannot be used fails too.

    \b
    s3le retarget walk.bvh --out out
    s3le retarget 14_05.amc 14_07.amc.gz --robot coman --out out --csv --npz
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
        known = shell.how(layout, axes, pitch, person, confidence, names)
        paths = _clips(clips)
        follower = shell.follower(model, method)
        own = follower.machine.robot.name
        if robot is not None and robot != own:
            raise ModelError(f"{model} is for robot '{own}', not '{robot}'")
        suffixes = [".parquet", *[".csv"] * csv, *[".npz"] * npz]
        shape = _shape(follower, full, tools or [], root_height)
        _refuse_overlap(paths, out, suffixes, shape.tools)
        how = {
            "rate": rate,
            "even": bool(shape.tools),
            "lead_in": lead_in,
            "look_ahead": look_ahead,
            "optimum": STARTS if optimum else 0,
            "about": {"model": str(model), "method": method},
        }
        failed = 0
        for path in paths:
            try:
                summary = _one(
                    path, follower, out, suffixes, shape, fps, tilt_max, known, accept_minority, how
                )
            except (S3leError, OSError) as refusal:
                shell.complain(refusal)
                failed += 1
                continue
            typer.echo(_line(path, summary))
        if failed:
            typer.echo(f"{failed} of {len(paths)} clips failed", err=True)
            raise typer.Exit(shell.BROKEN)


def _clips(given: list[Path]) -> list[Path]:
    """The files that are meant; each must have a name of its own, for its results take it."""
    from s3le.mocap.clip import clip_name
    from s3le.mocap.keypoints.folders import frames_of, is_frame
    from s3le.mocap.read import KEYPOINTS, READ, is_clip, suffix_of

    paths = []
    for path in given:
        inside = sorted(
            p for p in path.glob("*") if is_clip(p) or suffix_of(p) in KEYPOINTS or frames_of(p)
        )
        others = [p for p in inside if not is_frame(p)]
        frames = frames_of(path)
        if frames == path and others:
            raise ParameterError(
                f"{path}: holds frames of one clip and other clips, as {others[0].name}; part them"
            )
        if frames == path or (frames and others == [frames]):
            paths.append(path)
            continue
        if path.is_dir() and not inside:
            known = ", ".join(READ)
            raise ParameterError(f"{path}: is a folder with no motion files in it ({known})")
        paths += inside if path.is_dir() else [path]
    counts = Counter(clip_name(path) for path in paths)
    for name, count in counts.items():
        if count > 1:
            raise ParameterError(f"{count} clips are called '{name}'; write them to two folders")
    return paths


def _refuse_overlap(paths: list[Path], out: Path, suffixes: list[str], tools: list[Tool]) -> None:
    """Refuse clips whose files would be one another's, as those of `a` and `a.gmr`, or a clip."""
    from s3le.mocap.clip import clip_name
    from s3le.trajectory import layouts

    ends = [*suffixes, ".json", *(layouts.SUFFIX[tool] for tool in tools)]
    ends += [f"{end}.json" for end in ends if end.endswith(".csv")]
    writer: dict[str, Path] = {}
    given = {path.resolve(): path for path in paths}
    for path in paths:
        for name in (clip_name(path) + end for end in ends):
            if clip := given.get((out / name).resolve()):
                raise ParameterError(f"{clip} is a clip, and would be replaced by a result of that "
                                     "name; give another folder as --out")  # fmt: skip
            if (other := writer.setdefault(name, path)) is not path:
                raise ParameterError(f"{other} and {path} would both become {name}; write them "
                                     "to two folders")  # fmt: skip


class _Shape(NamedTuple):
    """Which joints and bases are written, and for whom."""

    full: bool
    tools: list[Tool]
    whole: "Whole | None"  # None: neither is asked for
    base: "Root | None"


def _shape(
    follower: "Follower", full: bool, tools: list[Tool], root_height: float | None
) -> _Shape:
    """What all clips' files have in common; refuses what no clip could be written with."""
    from s3le.trajectory import root, whole

    robot = follower.machine.robot
    if root_height is not None and not tools:
        raise ParameterError("--root-height is of the files that --for writes; give --for too")
    return _Shape(
        full,
        sorted(set(tools)),
        whole.joints(robot) if full or tools else None,
        root.find(robot, root_height) if tools else None,
    )


def _one(
    path: Path,
    follower: "Follower",
    out: Path,
    suffixes: list[str],
    shape: _Shape,
    fps: float | None,
    tilt_max: float,
    known: "How",
    minority: bool,
    how: dict[str, Any],
) -> dict[str, Any]:
    """Retarget one clip and write what came of it."""
    from s3le import clipframes, conversion, store
    from s3le.scene import motion
    from s3le.trajectory import files, layouts, whole

    frames = clipframes.read(path, follower.machine.neck, tilt_max, fps, how=known)
    if not minority:
        clipframes.refuse_minority(path, frames)
    how = how | {"about": how["about"] | motion.about_clip(path, out)}
    for words in frames.reading.told if frames.reading else ():
        typer.echo(f"{path}: note: {words}", err=True)
    with shell.bar(len(frames.x), frames.name, "frames") as progress:
        made = conversion.convert(follower, frames, **how, progress=progress)
    summary, written, complete = made.summary, made.trajectory, None
    if shape.whole is not None:
        complete = whole.complete(made.trajectory, follower.machine.robot, shape.whole)
        written = complete if shape.full else written
        summary = summary | {"whole": whole.tree(shape.whole)}
    for suffix in suffixes:
        files.write(written, out / f"{frames.name}{suffix}")
    for tool in shape.tools:
        to = out / f"{frames.name}{layouts.SUFFIX[tool]}"
        numbered = whole.numbered(complete, shape.whole)
        layouts.write(numbered, shape.base, summary["rate"], tool, to)
    store.write_json(summary, out / f"{frames.name}.json")
    return summary


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
