"""Stage `train@METHOD`: tuples and domain data -> data/model-METHOD.safetensors (Sec. V-B)."""

from dataclasses import asdict, fields, make_dataclass
from pathlib import Path

from pipeline.stage import knob, launch, read, steps_bar
from s3le.errors import ParameterError
from s3le.human.tables import MOCAP_DOMAIN
from s3le.learn import gather
from s3le.learn.settings import ALL, TRAIN, Training
from s3le.robot.robot import Robot
from s3le.store import documents, tables
from s3le.tuples.tables import kinematic_pairs, mocap_pairs, robot_poses

ROBOT = Path("data/robot")
DATA = Path("data")
CHECKPOINTS = Path("data/checkpoints")
CURVES = Path("reports/training")
CHECKPOINT_EVERY = 250  # steps; how often is no parameter, for it changes no result


def _section(name: str, doc: str) -> type:
    """The settings of a training that a section of params.yaml holds, as its parameters."""
    knobs = []
    for s in fields(Training):
        about = s.metadata
        if about and name in about["of"]:
            least, most = about["range"]
            shown = {"at_least": least, "at_most": most, "one_of": about["one_of"]}
            knobs.append((s.name, s.type, knob(about["doc"], **shown, shared=about["top"])))
    space = {"section": name, "__doc__": doc}
    return make_dataclass(name, knobs, frozen=True, kw_only=True, namespace=space)


Params = _section(TRAIN, "What all trainings share.")
METHODS = {method: _section(method, f"What {method} sets for itself.") for method in ALL}


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
