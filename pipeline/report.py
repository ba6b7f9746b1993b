"""Stage `report`: figures and tables -> reports/report.html, and its pictures beside it."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import PARAMS, knob, launch, read, say
from s3le.human.tables import SKELETONS
from s3le.learn import methods
from s3le.report import bars, curves, document, embed, maps, parameters, records, spaces
from s3le.robot.robot import Robot
from s3le.show import strip
from s3le.store import documents, tables
from s3le.study import latents, snapshots
from s3le.study.tables import SYNTHETIC, ground_truth, retargeted
from s3le.tuples.tables import robot_poses

ROBOT = Path("data/robot")
DATA = Path("data")
REPORTS = Path("reports")
FIGURES = REPORTS / "figures"
OUT = REPORTS / "report.html"
LATENCY = REPORTS / "latency.json"
VIDEO = REPORTS / "video"
TRAINED = ("s3le", "lwl2", "ale")
SHOWN = ("ale", "lwl2", "s3le", "certified_refined")


@dataclass(frozen=True, kw_only=True)
class Params:
    """What is shown."""

    section: ClassVar[str] = "report"
    strip_clip: str = knob("test clip of the snapshot strip, or auto")
    strip_frames: int = knob("moments in the snapshot strip", at_least=1, at_most=24)


def main() -> None:
    """Draw the pictures and write the page that reads the run to a stranger."""
    params = read(Params)
    robot = Robot.read(ROBOT)
    n_dof = robot.n_dof
    tree = documents.read_json(REPORTS / "run.json", "metrics")
    motions = documents.read_csv(REPORTS / "motions.csv", "metrics")
    histories = {
        name: documents.read_csv(REPORTS / "training" / f"{name}.csv", f"train@{name}")
        for name in TRAINED
    }
    frames = tables.read(SKELETONS, DATA / "skeletons.parquet")
    table = ground_truth(n_dof, robot.margin)
    truth = tables.read(table, DATA / "ground_truth.parquet", robot.tag)
    answers = {
        name: tables.read(retargeted(n_dof), DATA / f"retargeted-{name}.parquet", robot.tag)
        for name in SHOWN
    }
    labels = methods.labels(tree["splits"])
    bars.draw(FIGURES / "motions.svg", motions, labels, "Distance to the ground truth per motion")
    curves.draw(FIGURES / "training.svg", histories)
    clip, rows = snapshots.choose(frames, params.strip_clip, params.strip_frames)
    shown = snapshots.strip(robot, frames, rows, truth, answers, dict(labels))
    strip.draw(FIGURES / "strip.png", frames["time"][rows], shown, f"{robot.name}: {clip}")
    poses = tables.read(robot_poses(n_dof, robot.margin), DATA / "robot_poses", robot.tag, ("q",))
    models = {name: DATA / f"model-{name}.safetensors" for name in TRAINED}
    spaces.draw(FIGURES / "latents.svg", latents.spaces(robot, frames, truth, poses, models))
    points = tables.read(SYNTHETIC, DATA / "synthetic.parquet")
    maps.draw(FIGURES / "synthetic.png", points, tree["synthetic"])
    pictures = {
        "bars": "motions.svg",
        "strip": "strip.png",
        "spaces": "latents.svg",
        "curves": "training.svg",
        "maps": "synthetic.png",
    }
    text = document.page(
        tree,
        histories,
        {name: embed.read(FIGURES / file) for name, file in pictures.items()},
        motions=motions,
        unwatched=robot.unwatched(),
        knobs=parameters.read(PARAMS),
        latency=records.latency(LATENCY),
        robot_tag=robot.tag,
        grid=documents.read_csv(REPORTS / "grid.csv", "grid"),
        video=(records.figure(VIDEO / "figure.json"), embed.read(VIDEO / "figure.png")),
    )
    documents.write_text(text, OUT)
    size = len(text.encode()) / 1e6
    say(f"open {OUT}: one file of {size:.1f} MB, which needs no network")


if __name__ == "__main__":
    launch(main, "report")
