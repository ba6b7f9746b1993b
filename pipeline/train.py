"""Stage `train@METHOD`: tuples and domain data -> data/model-METHOD.safetensors (Sec. V-B)."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.stage import knob, launch, read, steps_bar
from s3le.errors import ParameterError
from s3le.human.tables import MOCAP_DOMAIN
from s3le.learn import gather
from s3le.learn.gather import CHOICES, Training
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.tuples.tables import kinematic_pairs, mocap_pairs, robot_poses

ROBOT = Path("data/robot")
DATA = Path("data")
CHECKPOINTS = Path("data/checkpoints")
CURVES = Path("reports/training")
CHECKPOINT_EVERY = 250  # steps; how often is no parameter, for it changes no result


@dataclass(frozen=True, kw_only=True)
class Params:
    """What all trainings share."""

    section: ClassVar[str] = "train"
    beta: float = knob("weight of latent prior fitting [-]", at_least=0, shared=True)
    seed: int = knob("root of the trainings' own random streams", at_least=0)
    latent: int = knob("dimension of Z", at_least=1, at_most=4096)
    hidden: int = knob("units of a hidden layer", at_least=1, at_most=8192)
    layers: int = knob("hidden layers", at_least=1, at_most=16)
    first_gain: float = knob("of the first layers' weights", at_least=1e-3, at_most=100)
    learning_rate: float = knob("of encoders and decoders", at_least=1e-9, at_most=1)
    second_moment: float = knob("decay of Adam's squared gradients", at_least=0.5, at_most=0.9999)
    schedule: str = knob("of both learning rates", one_of=CHOICES["schedule"])
    warm_up: int = knob("steps of linear rise", at_least=0)
    weight_decay: float = knob("decoupled", at_least=0, at_most=1)
    precision: str = knob("of matrix products", one_of=CHOICES["precision"])
    history_every: int = knob("steps averaged into one point of a curve", at_least=1)


@dataclass(frozen=True, kw_only=True)
class _Own:
    """What every method sets for itself."""

    steps: int = knob("optimiser steps", at_least=1)
    batch_pairs: int = knob("mocap tuples a step; 0: none", at_least=0)
    batch_domain: int = knob("rows a step of each domain's own data", at_least=1)
    weight_recon_x: float = knob("weight of c in X", at_least=0)
    weight_recon_q: float = knob("weight of c in Y", at_least=0)
    consensus_kind: str = knob("form of the consensus", one_of=CHOICES["consensus_kind"])
    weight_consensus: float = knob("weight of the latent consensus", at_least=0)


@dataclass(frozen=True, kw_only=True)
class _Wasserstein(_Own):
    """What the two methods with Wasserstein autoencoders set."""

    prior: str = knob("latent prior", one_of=CHOICES["prior"])
    prior_rows: str = knob("latents held to it", one_of=CHOICES["prior_rows"])
    adversary_rate: float = knob("learning rate of the discriminators", at_least=1e-9, at_most=1)
    prior_fit: str = knob("how the prior is fitted", one_of=CHOICES["prior_fit"])
    reconstruct: str = knob("what x~ decodes to", one_of=CHOICES["reconstruct"])
    mixup: bool = knob("use x' among the pairs")
    weight_x_to_q: float = knob("weight of decoding x~ to q-bar; not in the paper", at_least=0)
    weight_q_to_x: float = knob("weight of decoding q-bar to x-bar; not in the paper", at_least=0)


@dataclass(frozen=True, kw_only=True)
class S3le(_Wasserstein):
    """What S3LE alone sets."""

    section: ClassVar[str] = "s3le"
    tau: float = knob("temperature of NT-Xent [-]", at_least=1e-6, shared=True)
    batch: int = knob("kinematic tuples a step; 0: none", at_least=0)
    weight_nt_xent: float = knob("weight of NT-Xent", at_least=0)


@dataclass(frozen=True, kw_only=True)
class Lwl2(_Wasserstein):
    """What LWL2 sets: no kinematic tuples, no contrast."""

    section: ClassVar[str] = "lwl2"


@dataclass(frozen=True, kw_only=True)
class Ale(_Own):
    """What ALE sets: two variational autoencoders with one latent space."""

    section: ClassVar[str] = "ale"


METHODS = {"s3le": S3le, "lwl2": Lwl2, "ale": Ale}


def main(method: str) -> None:
    """Train one method: s3le, lwl2 or ale."""
    if method not in METHODS:
        raise ParameterError(f"no training '{method}'; there are: {', '.join(METHODS)}")
    hyper = Training(
        **asdict(read(Params)) | asdict(read(METHODS[method])),
        checkpoint_every=CHECKPOINT_EVERY,
    )
    robot = Robot.read(ROBOT)
    n_dof, margin = robot.n_dof, robot.margin
    sampled = None
    if method == "s3le":
        table = kinematic_pairs(n_dof, margin)
        sampled = tables.read(table, DATA / "kinematic_pairs", robot.tag, gather.TUPLE)
    data = gather.gather(
        robot,
        tables.read(mocap_pairs(n_dof, margin), DATA / "mocap_pairs.parquet", robot.tag),
        tables.read(robot_poses(n_dof, margin), DATA / "robot_poses", robot.tag),
        tables.read(MOCAP_DOMAIN, DATA / "mocap_domain.parquet"),
        sampled,
    )
    out = DATA / f"model-{method}.safetensors"
    checkpoint = CHECKPOINTS / f"{method}.safetensors"
    with steps_bar(hyper.steps, f"training {method}") as on_step:
        trained = gather.learn(robot, method, data, hyper, out, checkpoint, on_step)
    documents.write_csv(trained.history, CURVES / f"{method}.csv")


if __name__ == "__main__":
    launch(main, "train")
