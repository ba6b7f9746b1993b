"""Stage `robot`: robot file and URDF -> data/robot/, the robot resolved once for all stages."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say
from s3le.robot import known
from s3le.robot.robot import Robot
from s3le.skeleton import NECKS

OUT = Path("data/robot")


@dataclass(frozen=True, kw_only=True)
class Params:
    """What settles the robot."""

    section: ClassVar[str] = "robot"
    robot: str = knob("robot file in data/robots or s3le/robots, without .yaml", shared=True)
    margin: float = knob("clearance every pose keeps [m]", at_least=0, at_most=0.1, shared=True)
    neck: str = knob("where the neck is", one_of=NECKS, shared=True)


def main() -> None:
    """Check the robot, decide which pairs of bodies are watched, write it all to one folder."""
    params = read(Params)
    made = Robot.adopt(known.named(params.robot), params.margin, params.neck)
    made.write(OUT)
    for reason, count in sorted(Counter(pair.reason for pair in made.pairs).items()):
        say(f"{count:4d} pairs of bodies: {reason}")
    for first, second, kind, reason in made.unwatched():
        if kind == "limb-trunk":
            say(f"     not watched, {reason}: {first} and {second}")


if __name__ == "__main__":
    launch(main, "robot")
