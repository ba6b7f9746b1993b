"""`s3le robot`: a robot file from a URDF, and what is to be known about one."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from s3le.cli import shell
from s3le.robot import known

if TYPE_CHECKING:
    from s3le.robot.robot import Robot

app = typer.Typer(
    help="Robot files: propose one from a URDF, check one.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("new", short_help="A robot file from a URDF.")
def new(
    urdf: Annotated[Path, typer.Argument(help="The robot's URDF.", show_default=False)],
    name: Annotated[
        str | None,
        typer.Option(help="Of the robot and its file.", show_default="the URDF's file name"),
    ] = None,
    srdf: Annotated[
        Path | None, typer.Option(help="Pairs of links that it disables are not watched.")
    ] = None,
    package_path: Annotated[
        list[Path] | None,
        typer.Option(help="Where package:// is looked for, besides ROS_PACKAGE_PATH; several."),
    ] = None,
    spheres: Annotated[
        Path | None,
        typer.Option(help="YAML, link -> [{center, radius}], instead of these links' geometry."),
    ] = None,
    capsules: Annotated[
        int, typer.Option(min=1, max=16, help="Most capsules that a mesh becomes.")
    ] = 4,
    collision_only: Annotated[
        bool,
        typer.Option(
            "--collision-only",
            help="Take collision shapes as they are, however far the drawing reaches beyond.",
        ),
    ] = False,
    allowance: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1.0,
            help="How far a link may be drawn beyond its collision shapes [m] before bodies are "
            "made around the drawing.",
            show_default="0.02",
        ),
    ] = None,
    finer: Annotated[
        bool,
        typer.Option(
            "--finer",
            help="Finer bodies for every pair of links that come near, not only where the robot "
            "could not stand or move; takes longer.",
        ),
    ] = False,
    hulls: Annotated[
        bool,
        typer.Option("--hulls", help="Keep the meshes' convex hulls, for an independent check."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of robot files.", show_default="data/robots if it is here, else ."
        ),
    ] = None,
    margin: Annotated[
        float, typer.Option(min=0.0, help="Clearance that the anchor keeps at least [m].")
    ] = known.MARGIN,
    picture: Annotated[
        Path | None,
        typer.Option(help="PNG that shows it.", show_default="NAME.png beside the robot file"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
) -> None:
    """Propose a robot file, say what is sure and what to look at, and draw it.

    Writes NAME.yaml, urdf/NAME.urdf (kinematics and bodies alone: no mesh is needed any more), with
    an SRDF urdf/NAME.srdf, with --hulls urdf/NAME.hulls.npz, and the picture. `s3le retarget
    --robot NAME.yaml` moves it at once. In a checkout, commit them all but the picture; then
    `dvc exp run -S robot=NAME` runs the pipeline with this robot.

    \b
    s3le robot new my.urdf
    s3le robot new g1.urdf --srdf g1.srdf --package-path ~/ros/src --hulls
    s3le robot new arm.urdf --name arm --capsules 8 --allowance 0.01
    """  # noqa: D301
    from s3le.onboard import propose, survey
    from s3le.safety.covered import ALLOWANCE

    with shell.guarded():
        out = out or (known.OWN if known.OWN.is_dir() else Path())
        made = propose.propose(
            urdf, name or urdf.stem, margin, known.NECK, package_path or (), srdf, spheres,
            capsules, collision_only, hulls, ALLOWANCE if allowance is None else allowance, finer,
        )  # fmt: skip
        png = picture or out / f"{made.name}.png"
        paths = propose.write(made, out, force, also=[png])
        robot = shell.robot(str(out / f"{made.name}.yaml"), margin)
        _draw(robot, png, [f"look: {line}" for line in made.look])
    for path in [*paths, png]:
        typer.echo(f"wrote {path}")
    for body in made.made:
        if body.capsules:
            typer.echo(
                f"body: {body.link}: {body.kind} -> {len(body.capsules)} capsules, "
                f"{body.grown:.2f} times the hull's volume, {body.adds * 1e3:.0f} mm beyond it"
            )
    for line in survey.stands(robot, survey.standing(robot)):
        typer.echo(f"look: {line}" if "forbid" in line else line)
    for line in made.sure:
        typer.echo(f"sure: {line}")
    for line in made.look:
        typer.echo(f"look: {line}")
    file = out / f"{made.name}.yaml"
    typer.echo(
        f"next: look at {png}; s3le robot check {file}; "
        f"s3le retarget CLIP --robot {file} --out motions"
    )


@app.command("list", short_help="The robots that are known here.")
def robots(
    by_name: Annotated[
        bool, typer.Option("--pairs", help="Name what is not covered of each.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """List the robots that come with S3LE and those in data/robots: what each is and who made it.

    For each: joints that move, bones that are followed, bodies, pairs of bodies that are watched,
    what no certificate speaks of (pairs that could meet but are not watched, links that are drawn
    beyond their bodies), who made it, under which licence.

    \b
    s3le robot list
    s3le robot list --pairs
    s3le robot list --json

    Exit status: 0, or 1 if one of them cannot be used.
    """  # noqa: D301
    from s3le.cli import listed

    told = listed.rows()
    typer.echo(json.dumps(told, indent=2) if as_json else "\n".join(listed.lines(told, by_name)))
    raise typer.Exit(shell.BROKEN if any("unusable" in row for row in told) else shell.OK)


@app.command("check", short_help="What there is to know about a robot file.")
def check(
    robot: Annotated[
        str,
        typer.Argument(
            help="Name (s3le robot list), robot file, or folder of stage robot.",
            show_default=False,
        ),
    ],
    margin: Annotated[
        float | None,
        typer.Option(help="Clearance of poses [m].", show_default="0.002, or the folder's"),
    ] = None,
    poses: Annotated[int, typer.Option(min=10, max=1_000_000, help="Random poses.")] = 2000,
    every: Annotated[bool, typer.Option("--all", help="List every pair.")] = False,
    picture: Annotated[Path | None, typer.Option(help="PNG to draw.")] = None,
) -> None:
    """Validate a robot file and report on it.

    Joints, reach, whether its bodies let it stand and which pairs forbid it, how far each link is
    drawn beyond its bodies, pairs and why they are watched or not, random poses, time of a check,
    the longest way to rest. The picture shows it at its anchor and as it stands.

    \b
    s3le robot check coman
    s3le robot check my.yaml --all --picture my.png

    Exit status: 0 if it can be used, 2 if not, with the reason in a line.
    """  # noqa: D301
    from s3le.onboard import survey

    with shell.guarded():
        its = shell.robot(robot, margin)
        found = survey.survey(its, poses)
        if picture:
            _draw(its, picture, [])
    typer.echo("\n".join([*survey.lines(its, found, every), *_hardest(its), _rest(its)]))


def _hardest(robot: "Robot") -> list[str]:
    """Limits of acceleration, and where they come from."""
    from s3le.plan.limits import limits

    by_limit: dict[str, list[str]] = {}
    for joint, limit in zip(robot.joints, limits(robot).acceleration.tolist(), strict=True):
        by = "by default" if joint.acceleration is None else "by the robot file"
        by_limit.setdefault(f"{limit:g} rad/s^2 {by}", []).append(joint.name)
    told = ", ".join(
        f"{said} ({'all joints' if len(names) == robot.n_dof else ', '.join(names)})"
        for said, names in by_limit.items()
    )
    return [f"acceleration: {told}"]


def _rest(robot: "Robot") -> str:
    """How long and how far the way to rest is at most (docs/curves.md)."""
    import numpy as np

    from s3le.plan.limits import limits
    from s3le.safety import curve

    most, step = limits(robot), 1.0 / 30.0
    v = np.where(np.isfinite(most.speed), most.speed, 0.0)
    path, far = np.empty((curve.ROWS, robot.n_dof)), np.zeros(robot.n_dof)
    takes = curve.stop(far, v, most.acceleration, step, path)
    curve.position(path, 1.0, far)
    i, j = int((v / most.acceleration).argmax()), int(far.argmax())
    return (
        f"way to rest: at most {takes:.3f} s ({robot.joint_names[i]}, from {v[i]:.3g} rad/s at "
        f"{most.acceleration[i]:.3g} rad/s^2) and {np.degrees(far[j]):.1f} deg "
        f"({robot.joint_names[j]}), braking in steps of 1/30 s"
    )


def _draw(robot: "Robot", path: Path, notes: list[str]) -> None:
    import numpy as np

    from s3le.kernels import batch
    from s3le.report import robot as picture
    from s3le.robot import pairs
    from s3le.skeleton import BONES

    it, chain = robot, robot.chain
    q = it.anchor[None]
    points = batch.points(chain, q)[0]
    kept = [BONES.index(name) for name in robot.vectors]
    tail, head = (points[ends[kept]].mean(axis=1) for ends in (chain.tail, chain.head))
    dropped = [(p.a, p.b) for p in robot.pairs if p.reason not in pairs.SURE]
    shown = picture.Shown(
        f"{it.name} at its anchor: {it.n_dof} joints, {len(it.bodies)} bodies, "
        f"{len(robot.watched)} pairs watched, {len(dropped)} not",
        batch.capsule_ends(chain, q)[0], chain.body_radius, pairs.body_kinds(it),
        np.stack([tail, head], axis=1), list(robot.vectors), dropped, notes, _standing(it),
    )  # fmt: skip
    picture.draw(path, shown)


def _standing(robot: "Robot"):
    """The robot in its stand pose, for the picture; None: it does not say how it stands."""
    from s3le.kernels import batch
    from s3le.onboard import survey
    from s3le.report import robot as picture
    from s3le.robot.hulls import HullCheck

    found = survey.standing(robot)
    if found is None or robot.stand is None:
        return None
    forbid = [(int(a), int(b)) for a, b in (robot.watched[row] for row, _, _ in found.forbid)]
    drawn = HullCheck(robot).placed(robot.stand) if robot.description.hulls else []
    turned = [corners @ robot.base_rotation.T for corners in drawn]
    return picture.Standing(batch.capsule_ends(robot.chain, robot.stand[None])[0], forbid, turned)
