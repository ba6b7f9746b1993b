"""Stage `train@METHOD`: tuples and domain data -> data/model-METHOD.safetensors."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import bar, knob, launch, read
from s3le import learning, machine, store
from s3le.learning import Training
from s3le.tables.mocap_domain import MOCAP_DOMAIN
from s3le.tables.pairs import kinematic_pairs, mocap_pairs
from s3le.tables.poses import robot_poses

ROBOT = Path("data/robot")
DATA = Path("data")
REPORTS = Path("reports/training")


@dataclass(frozen=True, kw_only=True)
class Params:
    """What all trainings share."""

    section: ClassVar[str] = "train"
    beta: float = knob("weight of latent prior fitting [-]", at_least=0, shared=True)
    seed: int = knob("root of the trainings' random streams", at_least=0)


PARAMS = {"s3le": Params}


def main(method: str) -> None:
    """Train one method: s3le, lwl2 or ale."""
    raise NotImplementedError


if __name__ == "__main__":
    launch(main, "train")
