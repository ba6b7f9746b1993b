"""`s3le audit`: does a trajectory hold, whoever made it?"""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from s3le.cli import options, shell
from s3le.errors import S3leError

if TYPE_CHECKING:
    import numpy as np

    from s3le.motion.fit import Others
    from s3le.robot.robot import Robot
    from s3le.robot.wholebody import WholeBody
    from s3le.safety.audit import Check, Demands, Report


def audit(
    files: Annotated[
        list[Path],
        typer.Argument(
            help=".parquet, .csv, .npz, .npy, GMR's .pkl, .h5, or a LeRobot folder",
            show_default=False,
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            help="Name (s3le robot list), robot file, or folder that the robot stage wrote.",
            show_default="data/robot, else coman",
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            help="Clearance that every pose keeps [m].",
            show_default="the robot's; margin-between for rows of mode 'between'",
        ),
    ] = None,
    margin_between: Annotated[
        float | None,
        typer.Option(
            help="Clearance that the path between poses keeps [m].", show_default="margin / 4"
        ),
    ] = None,
    velocity: Annotated[
        list[str] | None,
        typer.Option(
            help="Limit of all joints [rad/s], or JOINT=LIMIT, several times; inf: none.",
            show_default="the URDF's",
        ),
    ] = None,
    acceleration: Annotated[
        list[str] | None,
        typer.Option(
            help="Limit of all joints [rad/s^2], or JOINT=LIMIT, several times.",
            show_default="not looked at",
        ),
    ] = None,
    straight: Annotated[
        bool,
        typer.Option(help="Joints move straight between rows, also where the file tells speeds."),
    ] = False,
    fps: options.RateOfRows = None,
    joints: options.Joints = None,
    degrees: options.Degrees = False,
    given: options.Given = None,
    budget: Annotated[
        int | None,
        typer.Option(help="Poses that the proof of one path may look at.", show_default="200"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Check trajectories: limits, velocities, clearance of every pose, a proof for every path.

    Each file gets a certificate, or the first counterexample: when, which bodies, how deep. What
    cannot be decided counts as broken. Pairs of bodies that are not watched are listed. In a motion
    of the whole body, where legs and hands move too, all pairs are looked at with all joints
    moving; limits and speeds are asked of the robot file's own joints alone.

    A file that tells speeds is a curve: between rows the joints move on the cubics that meet them.
    Limits, speeds and accelerations (the robot's, unless said) are held at every moment of it, and
    a motion to rest is proven from each row.

    \b
    s3le audit walk.parquet
    s3le audit dance.csv --robot coman --fps 30
    s3le audit gmr.pkl --margin 0.005 --velocity 9.4
    s3le audit out/*.parquet --json > audit.json

    Exit status: 0 if everything holds, 1 if something does not or could not be decided, 2 if a
    file could not be read.
    """  # noqa: D301
    from s3le.plan.limits import limits
    from s3le.safety import audit as library
    from s3le.safety import covered
    from s3le.safety.paths import BUDGET

    with shell.guarded():
        its = shell.robot(robot, margin)
        shell.warn_of(its)
        wanted = library.demands(
            its,
            margin,
            margin_between,
            shell.by_joint(velocity, "--velocity", "RAD_S"),
            BUDGET if budget is None else budget,
            shell.by_joint(acceleration, "--acceleration", "RAD_S2"),
        )
        named, moved = shell.names(joints), shell.given(given, its)
        bodies: dict[tuple[str, ...], WholeBody] = {}
        told: list[dict[str, Any]] = []
        status = shell.OK
        for path in shell.motions(files):
            try:
                for one in _motions(path, its, fps, named, degrees, moved):
                    body = _body(one.others, its, bodies)
                    asked = wanted
                    if straight:
                        one = one._replace(v=None)
                    elif one.v is not None and acceleration is None:
                        asked = wanted._replace(acceleration=limits(its).acceleration)
                    report, notes = _one(one, its, body, asked, every=margin is not None)
                    if not report.holds:
                        status = max(status, shell.BROKEN)
                    also = {"given_joints": list(body.given)} if body else {}
                    told.append({"file": one.name, "notes": notes, **also, **library.tree(report)})
                    if not as_json:
                        lines = _lines(one, its, body, asked, report, notes)
                        typer.echo("\n".join([*lines, ""]))
            except S3leError as refusal:
                shell.complain(refusal)
                told.append({"file": str(path), "unreadable": str(refusal)})
                status = shell.UNREADABLE
        if as_json:
            certificate = {
                "robot": its.name,
                "robot_hash": its.digest,
                "margin_m": wanted.margin,
                "margin_between_m": wanted.margin_between,
                "not_covered": _not_covered(its, bodies.values()),
                "by_design": library.by_design(its),
                "not_covered_links": covered.tree(its),
                "holds": status == shell.OK,
                "files": told,
            }
            typer.echo(json.dumps(certificate, indent=2, allow_nan=False))
        else:
            typer.echo("\n".join(_closing(its, bodies.values(), told)))
    raise typer.Exit(status)


def _not_covered(robot: "Robot", bodies: "Iterable[WholeBody]") -> list[dict[str, str]]:
    from s3le.safety import audit as library
    from s3le.safety import wholebody

    pairs = library.not_covered(robot)
    for body in bodies:
        pairs += [pair for pair in wholebody.not_covered(body) if pair not in pairs]
    return pairs


class _Motion(NamedTuple):
    """A motion to be audited, of a file or one of several in it."""

    name: str
    time: "np.ndarray"
    q: "np.ndarray"
    mode: "np.ndarray | None"
    notes: list[str]
    others: "Others | None"  # joints that others move
    v: "np.ndarray | None" = None  # [rad/s], where the file tells them


def _motions(
    path: Path,
    robot: "Robot",
    fps: float | None,
    joints: list[str] | None,
    degrees: bool,
    given: tuple[str, ...],
) -> list[_Motion]:
    """The motions of a file or a folder."""
    from s3le.guard.layouts import door
    from s3le.motion import files, text
    from s3le.motion.fit import fit

    kind = path.suffix.lower()
    # Who writes CSV without names (mjlab, Unitree) writes joints as MuJoCo numbers them.
    plain = kind == ".csv" and joints is None and path.is_file() and text.nameless(path)
    if path.is_dir() or plain or (kind in door.KNOWN and kind not in files.READ):
        layout = door.open_layout(
            path, robot, fps=fps, joints=joints, degrees=degrees, given=given
        )  # fmt: skip
        return [_Motion(e.name, e.time, e.q, e.mode, e.notes, e.others) for e in layout.episodes]
    one, notes, others = fit(files.read(path, fps, joints), robot, degrees, given)
    return [_Motion(str(path), one.time, one.q, one.mode, notes, others, one.v)]


def _body(
    others: "Others | None", robot: "Robot", made: "dict[tuple[str, ...], WholeBody]"
) -> "WholeBody | None":
    """The robot with the joints that others move; None: they move none."""
    from s3le.robot.wholebody import whole_body

    if others is None:
        return None
    if others.joints not in made:
        made[others.joints] = whole_body(robot, others.joints)
    return made[others.joints]


def _one(
    motion: _Motion, robot: "Robot", body: "WholeBody | None", wanted: "Demands", every: bool
) -> "tuple[Report, list[str]]":
    """Audit one motion; every: the margin of poses is asked of rows between two frames too."""
    import numpy as np

    from s3le.motion.trajectory import BETWEEN
    from s3le.safety import audit as library
    from s3le.safety import wholebody

    at_rows, notes = None, motion.notes
    if motion.mode is not None and not every:
        between = motion.mode == BETWEEN
        at_rows = np.where(between, wanted.margin_between, wanted.margin)
        if between.any():
            notes = [
                *notes,
                f"{between.sum()} rows lie between two frames by their mode and are held to "
                f"{wanted.margin_between * 1e3:g} mm, as the path is; --margin asks it of every "
                "row",
            ]
    with shell.bar(2 * len(motion.time) - 1, Path(motion.name).name) as progress:
        if body is None or motion.others is None:
            report = library.audit(
                robot, motion.time, motion.q, wanted, at_rows, progress=progress, v=motion.v
            )
        else:
            report = wholebody.look(
                body, motion.time, motion.q, motion.others.q, wanted, at_rows, progress
            ).report
    return report, notes


def _lines(
    motion: _Motion,
    robot: "Robot",
    body: "WholeBody | None",
    wanted: "Demands",
    report: "Report",
    notes: list[str],
) -> list[str]:
    from s3le.safety.audit import say

    way = "straight" if motion.v is None else "on the curve through positions and speeds"
    lines = [
        f"{motion.name}: {report.rows} poses, {report.seconds:.3f} s, robot {robot.name} "
        f"{robot.digest}, between rows {way}",
        *(f"  note: {note}" for note in notes),
    ]
    asked = {
        "limits": "joint ranges",
        "velocities": "joint speeds",
        "accelerations": "joint accelerations",
        "stops": "rows from which a way to rest is proven",
        "poses": f"poses at least {wanted.margin * 1e3:g} mm clear",
        "paths": f"paths at least {wanted.margin_between * 1e3:g} mm clear, proven",
    }
    for check in report.checks:
        good = check.total - check.broken
        lines.append(f"  {asked[check.name] + ':':<42} {good} of {check.total} hold" + _open(check))
        if check.broken:
            lines += [f"      {say(check.name, one)}" for one in check.worst]
        elif check.worst and check.name not in ("paths", "stops"):
            lines.append(f"      nearest: {say(check.name, check.worst[0])}")
    if body is not None:
        lines += _given(body, report)
    if report.holds:
        lines.append("  CERTIFIED")
    else:
        lines.append(f"  NOT CERTIFIED; first: {report.complaint}")
    return lines


def _given(body: "WholeBody", report: "Report") -> list[str]:
    """What others move, what they break, and what nobody here could mend."""
    from s3le.safety.audit import say

    lines = [f"  moved by others: {', '.join(body.given)}"]
    whose = {"limits": "their joint ranges", "velocities": "their joint speeds"}
    for check in report.given:
        if check.broken:
            lines.append(
                f"    {whose[check.name]} do not hold in {check.broken} of {check.total}, which is "
                f"not counted: {say(check.name, check.worst[0])}"
            )
    for check in report.apart:
        if check.broken:
            lines.append(
                f"    {check.broken} {check.name} among bodies that others alone move, not ours to "
                f"change: {say(check.name, check.worst[0])}"
            )
    return lines


def _open(check: "Check") -> str:
    return f", {check.undecided} not decided" if check.undecided else ""


_NUMBERS = re.compile(r", (seen to overlap by .+|[0-9.]+ mm (?:deep|apart))$")  # of pairs.told


def _closing(
    robot: "Robot", bodies: "Iterable[WholeBody]", told: list[dict[str, Any]]
) -> list[str]:
    """What no file's report repeats: the pairs that nothing is said about, and the count."""
    lines = []
    by_reason: dict[str, list[str]] = {}
    further = [pair for body in bodies for pair in body.unwatched()]
    for a, b, _, reason in dict.fromkeys([*robot.unwatched(), *further]):
        own = _NUMBERS.search(reason)  # each pair's own, after what it has in common with others
        why, numbers = (reason[: own.start()], f": {own[1]}") if own else (reason, "")
        by_reason.setdefault(why, []).append(f"{a} and {b}{numbers}")
    for reason, pairs in by_reason.items():
        lines.append(f"not covered, {len(pairs)} pairs ({reason}):")
        lines += [f"  {pair}" for pair in pairs]
    good = sum(one.get("holds", False) for one in told)
    unread = sum("unreadable" in one for one in told)
    tail = f", {unread} unreadable" if unread else ""
    return [*lines, f"{good} of {len(told)} files hold{tail}"]
