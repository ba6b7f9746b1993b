"""Stage `skeletons`: joint positions -> data/skeletons.parquet and data/mocap_domain.parquet."""

from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, say
from s3le import rng
from s3le.human import dataset
from s3le.human.tables import MOCAP_DOMAIN, MOCAP_POINTS, SKELETONS
from s3le.skeleton import NECKS, fixed_in, with_fixed
from s3le.store import documents, tables

POINTS = Path("data/mocap_points.parquet")
ROBOT_BONES = Path("data/robot/bones.json")
OUT = Path("data/skeletons.parquet")
OUT_DOMAIN = Path("data/mocap_domain.parquet")
COUNTS = Path("data/counts/skeletons.json")


@dataclass(frozen=True, kw_only=True)
class Params:
    """How frames become skeletons."""

    section: ClassVar[str] = "skeletons"
    seed: int = knob("root of every random stream", at_least=0, shared=True)
    neck: str = knob("where the neck is", one_of=NECKS, shared=True)
    rate: float = knob("frames per second [Hz]", at_least=1, at_most=1000)
    tilt_max: float = knob("largest tilt of the torso [deg]", at_least=0, at_most=180)
    domain_rows: int = knob("skeletons of the mocap domain", at_least=1, at_most=10_000_000)
    noise: float = knob("noise on joint positions [m]", at_least=0, at_most=1)


def main() -> None:
    """Resample, face forward, read the seven vectors; augment the training clips."""
    params = read(Params)
    points = tables.read(MOCAP_POINTS, POINTS)
    tilt = radians(params.tilt_max)
    frames, counts = dataset.at_rate(points, params.rate, params.neck, tilt)
    domain, kinds = dataset.training_domain(
        points,
        params.neck,
        tilt,
        params.domain_rows,
        params.noise,
        rng.stream(params.seed, Params.section),
    )
    fixed = fixed_in(documents.read_json(ROBOT_BONES, "robot"), ROBOT_BONES)
    frames = frames._replace(x=with_fixed(frames.x, fixed))
    domain["x"] = with_fixed(domain["x"], fixed)
    tables.write(frames._asdict(), SKELETONS, OUT)
    tables.write(domain, MOCAP_DOMAIN, OUT_DOMAIN)
    documents.write_json({"clips": counts, "domain": kinds}, COUNTS)
    for split, tally in counts.items():
        say(f"{split}: " + ", ".join(f"{name} {count}" for name, count in tally.items()))


if __name__ == "__main__":
    launch(main, "skeletons")
