"""From tables to a trained model: which rows each method may see (Sec. V-B)."""

from collections.abc import Callable
from pathlib import Path

from s3le.learn import artifact, training
from s3le.learn.batches import TrainingData, Tuples
from s3le.learn.settings import Training
from s3le.learn.training import Trained
from s3le.robot.robot import Robot
from s3le.types import Columns

TUPLE = ("x_relaxed", "x_feasible", "q_relaxed", "q_feasible", "x_mixed")  # columns that are used


def gather(
    robot: Robot,
    pairs: Columns,
    poses: Columns,
    domain: Columns,
    sampled: Columns | None,
) -> TrainingData:
    """Training data from the columns of mocap_pairs, robot_poses, mocap_domain, kinematic_pairs.

    Args:
        robot: the robot.
        pairs, poses, domain: see above.
        sampled: kinematic tuples; None for the baselines, which do not use them.
    """
    return TrainingData(
        pairs=_tuples(pairs),
        sampled=_tuples(sampled) if sampled is not None else None,
        robot_q=poses["q"],
        mocap_x=domain["x"],
        lower=robot.lower,
        upper=robot.upper,
    )


def learn(
    robot: Robot,
    method: str,
    data: TrainingData,
    hyper: Training,
    out: Path,
    checkpoint: Path,
    on_step: Callable[[int, int, dict[str, float]], None],
) -> Trained:
    """Train a method, store its model, and remove the checkpoint that it no longer needs.

    Raises:
        TrainingError: see training.train.
    """
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    trained = training.train(method, data, hyper, checkpoint=checkpoint, on_step=on_step)
    config = {
        "method": method,
        "robot": robot.name,
        "robot_hash": robot.tag,
        "joints": robot.joint_names,
        "training": vars(hyper),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    artifact.save_model(out, trained.model, config)
    checkpoint.unlink(missing_ok=True)
    return trained


def _tuples(columns: Columns) -> Tuples:
    return Tuples(
        columns["x_relaxed"],
        columns["x_feasible"],
        columns["q_relaxed"],
        columns["q_feasible"],
        columns.get("x_mixed"),
    )
