"""Pictures of the study's last CMU training: snapshots, latent spaces, training curves.

    python benchmarks/study/pictures.py [--clip 49_09] [--data data/study/clone]

The strip shows the motion in which both hands are raised highest, unless another is named; which
one it is stands in its title. Written to reports/study.
"""

from pathlib import Path
from typing import Annotated

import typer

from s3le.human.tables import SKELETONS
from s3le.learn import methods
from s3le.report import curves, spaces
from s3le.robot.robot import Robot
from s3le.show import strip
from s3le.store import documents, tables
from s3le.study import latents, snapshots
from s3le.study.tables import ground_truth, retargeted
from s3le.tuples.tables import robot_poses

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "reports/study"
TRAINED, SHOWN = ("s3le", "lwl2", "ale"), ("ale", "lwl2", "s3le")


def main(
    clip: Annotated[str, typer.Option(help="motion of the strip, or auto")] = "auto",
    moments: Annotated[int, typer.Option(help="moments in the strip")] = 9,
    folder: Annotated[Path, typer.Option("--data", help="clone that trained")] = ROOT
    / "data/study/clone",
) -> None:
    """Draw what the clone holds."""
    data, robot = folder / "data", Robot.read(folder / "data/robot")
    n_dof, margin = robot.n_dof, robot.margin
    frames = tables.read(SKELETONS, data / "skeletons.parquet")
    truth = tables.read(ground_truth(n_dof, margin), data / "ground_truth.parquet", robot.tag)
    answers = {
        name: tables.read(retargeted(n_dof), data / f"retargeted-{name}.parquet", robot.tag)
        for name in SHOWN
    }
    name, rows = snapshots.choose(frames, clip, moments)
    shown = snapshots.strip(
        robot, frames, rows, truth, answers, {name: methods.label(name) for name in SHOWN}
    )
    strip.draw(OUT / "strip.png", frames["time"][rows], shown, f"{robot.name}: CMU {name}")
    poses = tables.read(robot_poses(n_dof, margin), data / "robot_poses", robot.tag, ("q",))
    models = {name: data / f"model-{name}.safetensors" for name in TRAINED}
    spaces.draw(OUT / "latents.png", latents.spaces(robot, frames, truth, poses, models))
    reports = folder / "reports/training"
    histories = {name: documents.read_csv(reports / f"{name}.csv", "train") for name in TRAINED}
    curves.draw(OUT / "training.png", histories)
    print(f"strip of CMU {name}; pictures in {OUT}")


if __name__ == "__main__":
    typer.run(main)
