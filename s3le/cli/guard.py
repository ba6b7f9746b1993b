"""`s3le guard`: joint motions in, the nearest certified motions out, in the layout they came in."""

import json
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from s3le.cli import options, shell
from s3le.errors import ParameterError

if TYPE_CHECKING:
    from s3le.guard.claim import Claim
    from s3le.guard.folder import Record
    from s3le.guard.layouts.episode import Layout
    from s3le.robot.robot import Files

_RUNS = 5  # runs of forced steps that are told of a file; all of them lie in its summary
_LOUD = 3  # so many files are told in detail, more only as a table


def guard(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Joint motions (.parquet, .csv, .npz, .npy, GMR's .pkl, .h5, a LeRobot folder), "
            "or folders of them.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results.", show_default="none, with --check"),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Name (s3le robot list), robot file, or folder that the robot stage wrote.",
            show_default="data/robot, else coman",
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit status 1 if anything is broken.")
    ] = False,
    speed_factor: Annotated[
        float, typer.Option(help="Share of the robot's joint speeds that may be used, 0 to 1.")
    ] = 1.0,
    acceleration: Annotated[
        list[str] | None,
        typer.Option(
            help="Limit of all joints [rad/s^2], or JOINT=LIMIT, several times; inf: none.",
            show_default="60",
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(help="Clearance that every pose keeps [m].", show_default="the robot's"),
    ] = None,
    straight: Annotated[
        bool,
        typer.Option(
            "--straight", help="Joints straight from row to row, without speeds or a way to rest."
        ),
    ] = False,
    jerk: options.Jerk = None,
    fps: options.RateOfRows = None,
    joints: options.Joints = None,
    degrees: options.Degrees = False,
    given: options.Given = None,
    change: Annotated[
        str | None,
        typer.Option(
            help="Joints beyond the robot file's that may be changed too: NAME,NAME,...",
            show_default="none",
        ),
    ] = None,
    column: Annotated[
        str | None,
        typer.Option(
            help="Which feature of a LeRobot folder holds the joints.", show_default="action"
        ),
    ] = None,
    jobs: options.Jobs = 0,
    ray_address: Annotated[
        str | None,
        typer.Option(
            help="Compute on a Ray cluster: host:port, auto (the one this machine is in), or "
            "local. Its machines must see the files under the same paths.",
            show_default="processes of this machine",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Bring joint motions to the nearest ones that are certified within the model.

    Whatever made them: poses are brought within the joint limits and clear of one another. What is
    between rows is a curve of continuous speed, on which clearances are proven, nothing is too fast
    and no acceleration too high, and from every row a way to rest is proven; CSV, Parquet and NPZ
    get the speeds (JOINT.vel, or v). --straight asks for straight joints from row to row instead.
    Names, order, rate, root, feet and every other column stay as they are, and a motion that holds
    already comes back to the bit. What is written is audited by an independent check first; a file
    for which no such motion is found is named, and the others are still written. Each result gets a
    summary (NAME.guard.json: what was broken and where, what was moved, the certificate), all
    together a table (guard.parquet). What an earlier run has finished, with the same numbers, is
    kept.

    In a motion of the whole body the robot file's joints alone are changed, and proven with all
    joints moving. Where legs and hands leave no certified way, steps are marked forced: listed in
    the summary, claimed of by nobody.

    \b
    s3le guard walk.csv --robot g1 --out out
    s3le guard retargeted/ --robot g1 --out out --jobs 8
    s3le guard dance.pkl --robot g1 --out out --speed-factor 0.8 --acceleration 40
    s3le guard dance.csv --robot g1 --out out --straight
    s3le guard walk.pkl --robot g1 --change left_wrist_roll_joint,right_wrist_roll_joint --out out
    s3le guard arms.npz --robot coman --fps 30 --joints names.txt --degrees --out out
    s3le guard retargeted/ --robot g1 --check
    s3le guard retargeted/ --robot g1 --out out --ray-address auto

    Exit status: 0 if everything holds, 1 if no motion was found for a file or steps of it are
    forced (with --check: if anything is broken), 2 if a file could not be read or written, or
    nothing could begin.
    """  # noqa: D301
    with shell.guarded():
        if check == (out is not None):
            raise ParameterError("give --out FOLDER, or --check to write nothing")
        from s3le.guard import folder, places, table
        from s3le.guard.claim import claim
        from s3le.guard.task import Cleaning, Reading
        from s3le.kernels.threads import processors
        from s3le.robot.wholebody import with_joints
        from s3le.tuples.engine import lock
        from s3le.tuples.engine.run import Where

        file = shell.robot(robot, margin)
        also = tuple(name.strip() for name in change.split(",")) if change else ()
        its, wanted = claim(
            with_joints(file, also) if also else file,
            margin,
            speed_factor,
            shell.by_joint(acceleration, "--acceleration", "RAD_S2"),
            straight,
            jerk or 0.0,
        )
        named = shell.names(joints)
        reading = Reading(
            fps, None if named is None else tuple(named), degrees, column, shell.given(given, its),
            straight,
        )  # fmt: skip
        pieces = places.pieces(shell.motions(files), out)
        held = its.to_bytes()

        def cleaning(sources: tuple[str, ...], hashes: tuple[str, ...]) -> Cleaning:
            return Cleaning(
                files=held, claim=wanted, reading=reading, check=check, sources=sources,
                hashes=hashes, change=also,
            )  # fmt: skip

        where = (
            Where(workers=min(jobs or processors(), len(pieces)))
            if ray_address is None
            else Where(executor="ray", ray_address=ray_address)
        )
        alone: AbstractContextManager[None] = nullcontext()
        if out is not None:
            alone = lock.held(out / ".guard.lock", str(out), kept="what it has finished is kept")
        many = len(pieces) > 1
        records: list[Record] = []
        with alone:
            _compile(held, wanted, also, check)
            with shell.bar(len(pieces), "all", "files", "") if many else nullcontext() as step:
                for record in folder.process(pieces, its, cleaning, where, partial(_bar, check)):
                    records.append(record)
                    if record.why:
                        shell.say(f"{record.status}: {record.why}", err=True)
                    for note in record.summary.get("notes", []):
                        shell.say(f"{record.piece.source}: note: {note}", err=True)
                    if step:
                        step(1)
            order = {piece: number for number, piece in enumerate(pieces)}
            records.sort(key=lambda record: order[record.piece])
            if out is not None:
                table.write(records, wanted.margin, its.tag, out / places.TABLE)
        if as_json:
            typer.echo(json.dumps(_tree(its.tag, records, check), indent=2, allow_nan=False))
        else:
            typer.echo("\n".join(_lines(records, check)))
    raise typer.Exit(_exit_status(records))


def _compile(held: "Files", wanted: "Claim", change: tuple[str, ...], check: bool) -> None:
    """Compile before workers do it side by side; says so, for it takes minutes."""
    from s3le.guard.task import opened
    from s3le.kernels import compiled
    from s3le.plan import whole

    if compiled.stored("segment.prove_rows" if check else whole.SLOWEST):
        return
    typer.echo("compiling kernels, once for this machine: some minutes", err=True)
    opened(held, wanted, change).warm_up(planning=not check)


def _bar(check: bool, layout: "Layout") -> AbstractContextManager[Any]:
    from s3le.guard.clean import looks, work

    count = looks if check else work
    return shell.bar(sum(count(len(one.time)) for one in layout.episodes), layout.path.name)


def _exit_status(records: "list[Record]") -> int:
    from s3le.guard.folder import UNREADABLE

    if any(record.status == UNREADABLE for record in records):
        return shell.UNREADABLE
    return shell.OK if all(record.good for record in records) else shell.BROKEN


def _lines(records: "list[Record]", check: bool) -> list[str]:
    """The table, where each file is one line, details of few files, and the sum in one line."""
    width = max(4, *(len(record.piece.name) for record in records))
    head = f"{'file':<{width}}  {'frames':>7}  "
    if not check:
        head += "touched  median    p95   most  "
    lines = [head + "broken before"]
    for record in records:
        lines.append(_line(record, width, check))
        if record.summary and (check or len(records) <= _LOUD):
            lines += _details(record.summary)
    return [*lines, "", _sum(records, check)]


def _line(record: "Record", width: int, check: bool) -> str:
    start = f"{record.piece.name:<{width}}  "
    said = record.summary
    if not said:
        return start + f"{'':>7}  {record.status}"
    start += f"{said['frames']:>7}  "
    if not check:
        moved = said["moved"]
        start += (
            f"{100 * moved['touched'] / moved['frames']:>5.1f} %  {moved['median_deg']:>6.2f} "
            f"{moved['p95_deg']:>6.2f} {moved['most_deg']:>6.2f}  "
        )
    return start + _broken(said) + (" (kept)" if record.kept else "")


def _broken(said: dict[str, Any]) -> str:
    from s3le.guard.table import broken

    found = [f"{count} {kind}" for kind, count in broken(said["before"]).items() if count]
    return ", ".join(found) or "nothing"


def _details(said: dict[str, Any]) -> list[str]:
    """The worst place of each kind that was broken, the joints that moved, what holds now."""
    from s3le.guard.table import broken

    several = said["episodes"] > 1
    lines = [
        f"    {kind}: {(one['episode'] + ', ') if several else ''}{one['says']}"
        for kind, one in (
            (kind, said["before"][kind]["worst"][0])
            for kind, count in broken(said["before"]).items()
            if count
        )
    ]
    if joints := said.get("moved", {}).get("joints"):
        farthest = [f"{one['joint']} {one['most_deg']:.2f} deg" for one in joints]
        lines.append(f"    moved most: {', '.join(farthest)}")
    if (told := said.get("jerk", {})).get("limit_rad_s3"):
        lines.append(f"    {shell.jerk(told)}")
    for name, one in said.get("given", {}).get("breaks", {}).items():
        if one["broken"]:
            lines.append(
                f"    given joints: {name} of {one['broken']} of {one['total']} rows do not hold, "
                "which is not counted"
            )
    for run in said.get("forced", {}).get("runs", [])[:_RUNS]:
        lines.append(f"    forced: {run['says']}")
    if "certificate" in said:
        poses, paths = said["certificate"]["poses"], said["certificate"]["paths"]
        proven = f", {paths['proven']} paths proven" if paths["proven"] else ""
        if paths["bound_m"] is not None:
            proven = f", paths proven to {paths['bound_m'] * 1e3:.3f} mm"
        lines.append(f"    now: poses keep {poses['least_clearance_m'] * 1e3:.3f} mm{proven}")
        if rows := said["certificate"].get("straight_rows"):
            lines.append(
                "    it has no place for speeds; straight rows are proven too"
                if rows["proven"]
                else "    it has no place for speeds, and of straight rows "
                f"{rows['steps_not_proven']} steps are not proven"
            )
    return lines


def _sum(records: "list[Record]", check: bool) -> str:
    from s3le.guard.folder import FORCED, REFUSED, UNREADABLE

    read = [record.summary for record in records if record.summary]
    frames = sum(said["frames"] for said in read)
    files = "1 file" if len(records) == 1 else f"{len(records)} files"
    words = [f"{files}, {frames} frames"]
    if check:
        words.append(f"{sum(not record.good for record in records)} broken or unreadable")
        return ", ".join(words)
    moved = _totals(records)
    words += [
        f"{100 * moved['touched'] / max(frames, 1):.1f} % touched",
        f"moved median {moved['median_deg']:.2f} / p95 {moved['p95_deg']:.2f} / most "
        f"{moved['most_deg']:.2f} deg",
        f"{moved['left_broken']} left broken",
    ]
    for status in (FORCED, REFUSED, UNREADABLE):
        if count := sum(record.status == status for record in records):
            words.append(f"{count} {status}")
    return ", ".join(words)


def _totals(records: "list[Record]") -> dict[str, Any]:
    from s3le.guard.moved import pooled
    from s3le.guard.table import broken

    read = [record.summary for record in records if record.summary]
    left = sum(sum(broken(said["after"]).values()) for said in read)
    return pooled([said["moved"] for said in read]) | {"left_broken": left}


def _tree(tag: str, records: "list[Record]", check: bool) -> dict[str, Any]:
    tree = {
        "robot": tag,
        "holds": all(record.good for record in records),
        "files": [
            {
                "file": record.piece.name, "status": record.status, "kept": record.kept,
                "why": record.why or None, **record.summary,
            }
            for record in records
        ],
    }  # fmt: skip
    return tree if check else tree | {"moved": _totals(records)}
