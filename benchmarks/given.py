"""Joints that others move: what bounds and ranges cost, and streams among legs that walk.

    python benchmarks/given.py [MOTIONS] [--robot g1] [--picture docs/given/covered.png]

Without MOTIONS the first two tables. *Bounds*: by how much bodies are thicker at a rate if the
given joints may be so fast, and what share of the arm poses that are clear while the legs stand is
then lost. *Ranges*: the same for a balance controller's. MOTIONS is a folder of whole-body CSV
files in the layout of Unitree's LAFAN1 (root 7, joints in the URDF's order, 30 Hz): ours follow the
file's arms among its legs and wrists, whose next pose is known, or which are said to be as fast as
they are in that step, or at most 2 rad/s fast (the file is then played so slowly). `forced`: of the
pairs that ours can part.
"""

import time as clock
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from s3le.guard.guard import Guard
from s3le.kernels import batch
from s3le.robot import model
from s3le.robot.robot import Robot
from s3le.robot.wholebody import WholeBody, movable, whole_body, with_joints
from s3le.safety.folded import Folded
from s3le.show import camera, style

RATES, SPEEDS = (30.0, 100.0, 250.0, 500.0), (0.5, 1.0, 2.0, 5.0)  # [Hz], [rad/s]
POSES = 20_000
STANDING = {  # [rad], of the left leg
    "hip_pitch": (-0.6, 0.4), "hip_roll": (-0.1, 0.25), "hip_yaw": (-0.2, 0.2),
    "knee": (0.0, 0.8), "ankle_pitch": (-0.6, 0.3), "ankle_roll": (-0.2, 0.2),
}  # fmt: skip
WALK = {"left_hip_pitch": -0.75, "left_knee": 0.95, "right_hip_pitch": 0.35, "right_knee": 0.25,
        "left_ankle_pitch": -0.2, "right_ankle_pitch": -0.4}  # fmt: skip
COLOURS = {"ours": "#0072B2", "others": "#9aa5b1", "swept": "#E69F00"}


def main(
    motions: Annotated[Path | None, typer.Argument(help="folder of whole-body CSV files")] = None,
    robot: Annotated[str, typer.Option(help="name or robot file")] = "g1",
    picture: Annotated[Path | None, typer.Option(help="PNG to draw")] = None,
    every: Annotated[int, typer.Option(help="take each so manieth file")] = 1,
) -> None:
    """Print the tables."""
    plain = Robot.load(robot)
    legs = whole_body(plain, [name for name in movable(plain) if _leg(name)])
    ranged = standing(plain)
    bounds(plain, legs)
    ranges(plain, ranged)
    if picture:
        draw(plain, legs, ranged, picture)
    if motions:
        streams(plain, sorted(motions.glob("*.csv"))[::every])


def _leg(name: str) -> bool:
    return any(part in name for part in ("hip", "knee", "ankle"))


def standing(plain: Robot) -> Robot:
    """The robot with a balance controller's ranges."""
    text, found = plain.description, {}
    for name in movable(plain):
        for part, (low, high) in STANDING.items():
            if f"_{part}" in name:
                mirror = name.startswith("right") and ("roll" in part or "yaw" in part)
                found[name] = (-high, -low) if mirror else (low, high)
    made = model.from_description(replace(text, ranges=found))
    return Robot._settled(made, text.source, plain.margin, plain.neck)


def _clear(chain, q: np.ndarray) -> np.ndarray:
    return batch.clearances(chain, q) >= 0.002


def _poses(plain: Robot) -> np.ndarray:
    q = np.random.default_rng(0).uniform(plain.lower, plain.upper, (POSES, plain.n_dof))
    return q[_clear(plain.chain, q)]


def bounds(plain: Robot, legs: WholeBody) -> None:
    """What a bound on speed costs."""
    made, q, at = Folded(legs), _poses(plain), legs.robot.anchor[legs.others]
    names = [legs.robot.bodies[one].link for one in made._source]
    print(f"{plain.name}, legs given: thicker by [mm] (thigh, shin, foot); arm poses lost")
    print("| | " + " | ".join(f"{speed:g} rad/s" for speed in SPEEDS) + " |")
    print("|---|" + "---|" * len(SPEEDS))
    for rate in RATES:
        cells = []
        for speed in SPEEDS:
            made.stand(at, np.full(len(at), speed / rate))
            thick = (made.chain.body_radius - made._thin) * 1e3
            parts = [max(t for t, n in zip(thick, names, strict=True) if n == f"left_{part}_link")
                     for part in ("hip_yaw", "knee", "ankle_roll")]  # fmt: skip
            lost = 1.0 - _clear(made.chain, q).mean()
            cells.append(", ".join(f"{part:.0f}" for part in parts) + f"; {lost:.1%}")
        print(f"| {rate:g} Hz | " + " | ".join(cells) + " |")


def ranges(plain: Robot, ranged: Robot) -> None:
    """What ranges cost."""
    q = _poses(plain)
    kept = _clear(ranged.chain, q)
    names = tuple(ranged.description.ranges)
    body = whole_body(plain, names)
    low, high = np.array(list(ranged.description.ranges.values())).T
    rng, seen = np.random.default_rng(1), np.ones(len(q), bool)
    for _ in range(200):
        corner = rng.random((len(q), len(low))) < 0.5
        given = np.where(corner, np.where(rng.random(corner.shape) < 0.5, low, high),
                         rng.uniform(low, high, corner.shape))  # fmt: skip
        seen &= _clear(body.robot.chain, body.poses(q, given))
    print(
        f"ranges of {len(names)} joints: {len(ranged.bodies)} bodies, {len(ranged.watched)} pairs; "
        f"of arm poses clear while the legs stand {1.0 - kept.mean():.1%} are lost; "
        f"{1.0 - seen.mean():.1%} touch legs drawn from the ranges 200 times"
    )


def streams(plain: Robot, files: list[Path]) -> None:
    """Streams among real legs."""
    order = with_joints(plain, movable(plain)).joint_names
    its, held = Guard(plain, given="all"), Guard(plain)
    body = whole_body(plain, its.given)
    ours = [order.index(name) for name in plain.joint_names]
    theirs = [order.index(name) for name in its.given]
    coal = body.robot.certifier()
    print("| others | rate | steps | forced | not ours | gave way | moved: median, p95 [deg] | "
          "held legs: poses under 2 mm | ms median, p99 |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for said in ("known", "as fast as they are", "2 rad/s"):
        for rate in (30.0, 120.0):
            counts: Counter = Counter()
            off, took = [], []
            for file in files:
                q = np.loadtxt(file, delimiter=",")[:, 7:]
                times = np.arange(len(q)) / 30.0
                if said == "2 rad/s":  # played so slowly that it holds
                    fastest = np.abs(np.diff(q[:, theirs], axis=0)).max() * 30.0
                    times = times * max(fastest / 2.0, 1.0)
                    times, q = times[: len(q) // 4], q[: len(q) // 4]
                at = np.arange(0.0, times[-1], 1.0 / rate)
                q = np.stack([np.interp(at, times, column) for column in q.T], axis=1)
                wanted, given = q[:, ours], q[:, theirs]
                start = np.clip(wanted[0], plain.lower, plain.upper)
                its.start(start, given[0])
                for i in range(1, len(q)):
                    words: dict = {"given": given[i - 1]}
                    if said == "known":
                        words["given_next"] = given[i]
                    elif said == "2 rad/s":
                        words["given_speed"] = 2.0
                    else:
                        words["given_speed"] = np.abs(given[i] - given[i - 1]) * rate
                    began = clock.perf_counter()
                    step = its.step(wanted[i], 1.0 / rate, **words)
                    took.append(clock.perf_counter() - began)
                    counts["steps"] += 1
                    counts["not ours"] += "not ours" in step.reason
                    counts["forced"] += not step.certified and "not ours" not in step.reason
                    counts["gave way"] += step.reason.startswith("gave way")
                    off.append(np.degrees(np.abs(step.q - wanted[i])).max())
                if rate == 30.0 and said == "known" and _stand(held, start):
                    alone = np.array([held.step(row, 1.0 / rate).q for row in wanted[1:]])
                    whole = body.poses(alone, given[1:])
                    counts["held"] += int((coal.check(whole).clearance < plain.margin).sum())
                    counts["held steps"] += len(alone)
            moved = np.array(off)
            moved = moved[moved > 0.05]
            ms = np.quantile(took, [0.5, 0.99]) * 1e3
            share = f"{counts['held'] / counts['held steps']:.1%}" if counts["held steps"] else ""
            print(
                f"| {said} | {rate:g} Hz | {counts['steps']:,} | {counts['forced']} | "
                f"{counts['not ours']} | {counts['gave way']} | {np.median(moved):.1f}, "
                f"{np.quantile(moved, 0.95):.1f} | {share} | {ms[0]:.2f}, {ms[1]:.1f} |",
                flush=True,
            )


def _stand(guard: Guard, q: np.ndarray) -> bool:
    """Put a guard where a motion begins; False: it cannot stand there."""
    guard.start()
    for _ in range(600):
        guard.step(q, 1.0 / 30.0)
    return True


def draw(plain: Robot, legs: WholeBody, ranged: Robot, path: Path) -> None:
    """What is covered when: standing, walking with known legs, walking with bounded legs."""
    q = plain.anchor.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, angle in (("shoulder_pitch", 0.1), ("shoulder_roll", 0.35 * sign),
                            ("shoulder_yaw", 0.0), ("elbow", 0.7)):  # fmt: skip
            q[plain.joint_names.index(f"{side}_{part}_joint")] = angle
    given = np.array([WALK.get(name.removesuffix("_joint"), 0.0) for name in legs.given])
    made, panels = Folded(legs), []
    ends = batch.capsule_ends(ranged.chain, q[None])[0]
    kinds = ["swept" if "~" in body.name else _whose(body.link) for body in ranged.bodies]
    panels.append(("standing: anywhere in their ranges", ends, ranged.chain.body_radius, kinds))
    fast = np.full(len(given), 0.05)
    for title, within in (("next pose known", None), ("at most 5 rad/s, at 100 Hz", fast)):
        made.stand(given, within)
        links = [legs.robot.bodies[one].link for one in made._source]
        kinds = [_whose(link) if within is None or not _leg(link) else "swept" for link in links]
        ends = batch.capsule_ends(made.chain, q[None])[0]
        panels.append((f"walking: {title}", ends, made.chain.body_radius.copy(), kinds))
    view = camera.Camera(azimuth=60.0).rotation()
    boxes = [camera.extent(ends, radius, view) for _, ends, radius, _ in panels]
    low, high = np.array(boxes)[:, 2].min() - 0.05, np.array(boxes)[:, 3].max() + 0.05
    wide = max(box[1] - box[0] for box in boxes) + 0.1
    scale, tall = 330.0, high - low
    with style.sheet():
        figure = style.figure(3 * wide * scale / style.DPI, tall * scale / style.DPI + 0.5)
        for k, ((title, ends, radius, kinds), box) in enumerate(zip(panels, boxes, strict=True)):
            left = 0.5 * (box[0] + box[1]) - 0.5 * wide
            colours = np.array([_rgb(COLOURS[kind]) for kind in kinds])
            size = round(tall * scale), round(wide * scale)
            image = camera.render(ends, radius, colours, (left, high), scale, size, None, view)
            axes = figure.add_axes((k / 3, 0.0, 1 / 3, 1.0 - 0.4 / figure.get_size_inches()[1]))
            axes.imshow(image)
            axes.set_axis_off()
            axes.set_title(title, size=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=style.DPI)


def _whose(link: str) -> str:
    upper = ("torso", "waist", "shoulder", "elbow", "wrist", "hand", "head", "logo")
    return "ours" if any(part in link for part in upper) else "others"


def _rgb(colour: str) -> list[float]:
    return [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]


if __name__ == "__main__":
    typer.run(main)
