"""Stage dataset@NAME: a folder of motions -> certified motions of a robot as one table."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.stage import bar, knob, launch, read, say
from s3le.errors import S3leError
from s3le.guard import claim, collect, folder, places, table
from s3le.guard.task import Cleaning, Reading
from s3le.human.chosen import chosen
from s3le.human.skeletons import read_frames
from s3le.motion import files
from s3le.retarget import clip, stored
from s3le.robot.robot import Robot
from s3le.store import documents
from s3le.tuples.engine import run
from s3le.tuples.engine.vault import home

WANTED, GUARDED, LEROBOT = "dataset-wanted", "dataset-guarded", "dataset-lerobot"  # beside shards


@dataclass(frozen=True, kw_only=True)
class Params:
    """Which motions, of which robot, within which limits, and who computes."""

    section = "dataset"
    folder: str = knob("of the motions")
    holds: str = knob("what it holds", one_of=("clips", "motions"))
    rate: float = knob("rows a second [Hz]", at_least=30, at_most=1000)
    robot: str = knob("name of a robot")
    margin: float = knob("clearance of poses [m]", at_least=1e-6, at_most=0.1)
    speed_factor: float = knob("share of speeds", at_least=1e-3, at_most=1)
    acceleration: float = knob("limit [rad/s^2]", at_least=1e-3, at_most=1e6)
    lerobot: bool = knob("write LeRobot's folder too")
    executor: str = knob("who computes", one_of=run.EXECUTORS, shared=True)
    workers: int = knob("local processes; 0: all", at_least=0, at_most=10_000, shared=True)
    ray_address: str = knob("of a Ray cluster", shared=True)


def main(name: str) -> None:
    """Retarget clips, guard motions, put what holds into one table.

    Args:
        name: of the data set, in params.yaml's section dataset.
    """
    params = read(Params, of=name)
    out = Path("data/dataset") / name
    robot, wanted = claim.claim(
        Robot.load(params.robot), params.margin, params.speed_factor, params.acceleration
    )
    given = Path(params.folder)
    shelf = home(Path.cwd())
    refused = 0
    if params.holds == "clips":
        refused = _retarget(given, robot, params.rate, shelf / WANTED / name)
        given = shelf / WANTED / name
    pieces, reading = places.pieces([given], shelf / GUARDED / name), Reading()
    made = robot.to_bytes()

    def cleaning(sources: tuple[str, ...], hashes: tuple[str, ...]) -> Cleaning:
        return Cleaning(
            files=made, claim=wanted, reading=reading, check=False, sources=sources, hashes=hashes
        )

    where = run.Where(
        executor=params.executor, workers=params.workers, ray_address=params.ray_address
    )
    records = []
    with bar(len(pieces), "guarded", "files") as progress:
        for record in folder.process(pieces, robot, cleaning, where):
            records.append(record)
            progress(1)
            if record.why:
                say(f"{record.status}: {record.why}")
    records.sort(key=lambda record: record.piece.name)
    collect.write(records, reading, robot, out / "motions.parquet")
    if params.lerobot:
        given = shelf / LEROBOT / name
        collect.write_lerobot(records, reading, robot, cleaning, given, out / "lerobot")
    table.write(records, wanted.margin, robot.tag, out / "guard.parquet")
    documents.write_json(
        collect.metrics(records) | {"clips_refused": refused},
        Path("reports") / f"dataset-{name}.json",
    )


def _retarget(given: Path, robot: Robot, rate: float, to: Path) -> int:
    """Write what the robot is wanted to do, one file a clip; of clips that are gone none stays.

    Returns:
        How many clips cannot be used; what is wrong with each is said.
    """
    clips, retargeter, refused = chosen([given]), stored.retargeter_for(robot), 0
    for left in to.glob("*.parquet"):
        left.unlink()
    with bar(len(clips), "retargeted", "clips") as progress:
        for path in clips:
            try:
                frames = read_frames(path, robot.neck)
                made = clip.convert(retargeter, frames, rate=rate, even=True).motion
                files.write(made, to / f"{made.name}.parquet")
            except S3leError as refusal:
                say(f"clip refused: {refusal}")
                refused += 1
            progress(1)
    return refused


if __name__ == "__main__":
    launch(main, "dataset")
