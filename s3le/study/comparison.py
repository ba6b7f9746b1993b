"""What a row of the comparison answers for every test frame; all of it checked and scored."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from s3le.errors import ParameterError, TableError
from s3le.kernels import batch
from s3le.learn.methods import Entry
from s3le.retarget import exported
from s3le.retarget.stream import Retargeter
from s3le.retarget.table import stored_poses
from s3le.robot.certificate import Report
from s3le.robot.robot import Robot
from s3le.search import metrics
from s3le.store import documents, tables
from s3le.study.evaluation import between, score, summary
from s3le.study.followed import follow
from s3le.types import Columns, Progress

if TYPE_CHECKING:
    from s3le.learn import artifact


class Answered(NamedTuple):
    """What an entry returns for every test frame."""

    q: np.ndarray  # [rad], (n, n_dof)
    row: np.ndarray  # int (n,), of the index; -1: none
    mode: np.ndarray  # str (n,), see tables.retargeted
    proposed_by: str  # key of methods.PROPOSERS
    pool: int  # poses that it stores
    v: np.ndarray | None = None  # [rad/s], (n, n_dof); None: straight from frame to frame


def stored(
    robot: Robot,
    entry: Entry,
    human: np.ndarray,
    pool: Columns | None,
    model: Path | None,
    metric: str | None,
    progress: Progress | None = None,
) -> Answered:
    """Retarget every frame by itself: by the nearest stored pose, or by the decoder.

    Args:
        robot: the robot.
        entry: the row of the comparison.
        human: skeletons of the test frames, (n, 21).
        pool: columns of table index; None for an entry that decodes.
        model: the trained model's file; None for an entry without one.
        metric: index.LATENT_METRICS; None for an entry that decodes.
        progress: called with numbers of rows done.
    """
    z, net = human, None
    if entry.model:
        if model is None:
            raise ParameterError(f"'{entry.model}' wants the file of its model")
        from s3le.learn import artifact  # torch: two seconds that other rows need not wait

        net, _ = artifact.load_model(model, method=entry.model, robot_hash=robot.tag)
        z = artifact.encode_x(net, human)
    by, n = entry.model or "skeleton", len(human)
    if pool is None:
        if net is None:
            raise ParameterError("an entry without stored poses wants a model that decodes")
        q = artifact.decode_q(net, z).astype(float)
        if progress:
            progress(n)
        return Answered(q, np.full(n, -1), np.full(n, "decoded"), by, 0)
    if metric is None:
        raise ParameterError("an entry with stored poses wants a metric")
    found, _ = metrics.look_up(*comparable(pool, z, metric, net), progress)
    return Answered(pool["q"][found], found, np.full(n, "lookup"), by, len(pool["z"]))


def followed(
    robot: Robot,
    name: str,
    folder: Path,
    frames: Columns,
    progress: Progress | None = None,
) -> Answered:
    """Retarget every motion with what stage `export` wrote, as `s3le retarget` does.

    Args:
        robot: the robot.
        name: entry of the comparison, one that is online.
        folder: the exported retargeter.
        frames: columns of table skeletons, test frames only.
        progress: called with numbers of rows done.

    Raises:
        BundleError, CertificateError: see online.follow.
    """
    about = documents.read_json(folder / exported.ABOUT, "export")
    retargeter = Retargeter.load(folder)
    refine = name == "certified_refined"
    q, v, mode = follow(
        robot, retargeter, frames["clip"], frames["time"], frames["x"], refine, progress
    )
    poses, pool = folder / exported.POSES, 0
    if poses.exists():  # a decoder has none
        table = stored_poses(robot.n_dof, robot.margin)
        pool = len(tables.read(table, poses, robot.tag, ("row",))["row"])
    return Answered(q, np.full(len(q), -1), mode, about["method"], pool, v)


def judge(
    robot: Robot,
    name: str,
    entry: Entry,
    frames: Columns,
    truth: Columns,
    answered: Answered,
    progress: Progress | None = None,
) -> tuple[Columns, dict]:
    """Check and score what came out.

    Args:
        robot: the robot.
        name, entry: the row of the comparison.
        frames: columns of table skeletons, test frames only.
        truth: columns of table ground_truth, one row for each of them, in the same order.
        answered: what the entry returned for them.
        progress: called with numbers of rows done.

    Returns:
        Pair (columns of table retargeted, figures by split).

    Raises:
        TableError: truth and frames do not match row by row.
        CertificateError: a pose turns out not to be feasible, though not of an entry that decodes.
    """
    for column in ("clip", "frame"):
        if not np.array_equal(frames[column], truth[column]):
            raise TableError("ground_truth and skeletons hold different frames; dvc repro truth")
    q, checker = answered.q, robot.certifier()
    if entry.pool or entry.online:
        report = checker.require(q, robot.margin, progress)
    else:
        report = checker.check(q, progress)
    x = batch.skeletons(robot.chain, q)
    scored = score(x, truth["x"], frames["x"], robot.followed)
    split = frames["split"]
    columns = {
        "method": np.full(len(q), name),
        "split": split,
        "clip": frames["clip"],
        "frame": frames["frame"],
        "time": frames["time"],
        "row": answered.row.astype(np.int32),
        "mode": answered.mode,
        "to_truth": scored.to_truth,
        "to_human": scored.to_human,
        "q": q,
        "x": x,
        "clearance": report.clearance,
        "limit_margin": report.limit_margin,
    }
    figures = {}
    for part in dict.fromkeys(split.tolist()):
        at = split == part
        own = {column: frames[column][at] for column in ("clip", "frame", "time")}
        checked = Report(*(values[at] for values in report))
        figures[part] = summary(
            own["clip"],
            type(scored)(*(values[at] for values in scored)),
            checked,
            robot.margin,
            between(robot, own, q[at], checked, None if answered.v is None else answered.v[at]),
            answered.mode[at],
        )
        figures[part]["all"]["pool"] = answered.pool
        figures[part]["all"]["proposed_by"] = answered.proposed_by
    return columns, figures


def comparable(
    pool: Columns, z: np.ndarray, metric: str, net: "artifact.Model | None"
) -> tuple[np.ndarray, np.ndarray, str]:
    """Stored vectors, queries, and which of index.METRICS they are to be compared by.

    "decoded" compares what latents decode to, P^X(z); "mahalanobis" their best linear guess at
    the skeleton (index.to_skeletons); both by L2.
    """
    stored = pool["z"]
    if metric == "decoded":
        if net is None:
            raise ParameterError("metric 'decoded' wants a model that decodes")
        from s3le.learn import artifact

        stored, z, metric = artifact.decode_x(net, stored), artifact.decode_x(net, z), "l2"
    elif metric == "mahalanobis":
        onto = metrics.to_skeletons(stored, pool["x"])
        stored, z, metric = stored @ onto, z @ onto, "l2"
    return stored, np.asarray(z, np.float32), metric
