"""What a row of the comparison answers for every test frame, checked and scored."""

from pathlib import Path

import numpy as np

from s3le import artifact, index
from s3le.errors import TableError
from s3le.evaluation import score, summary
from s3le.kernels import batch
from s3le.kernels.batch import Progress
from s3le.machine import Machine
from s3le.methods import Entry
from s3le.robot.certificate import Report
from s3le.splits import test_rows

Columns = dict[str, np.ndarray]


def answer(
    machine: Machine,
    name: str,
    entry: Entry,
    frames: Columns,
    truth: Columns,
    pool: Columns | None,
    model: Path | None,
    metric: str | None,
    progress: Progress | None = None,
) -> tuple[Columns, dict]:
    """Retarget every test frame with one entry, check and score what comes out.

    Args:
        machine: the robot.
        name, entry: the row of the comparison.
        frames: columns of table skeletons.
        truth: columns of table ground_truth, one row for each test frame, in the same order.
        pool: columns of table index; None for an entry that decodes.
        model: the trained model's file; None for an entry without one.
        metric: index.LATENT_METRICS; None for an entry that decodes.
        progress: called with numbers of rows done, twice a row (answered, checked).

    Returns:
        Pair (columns of table retargeted, figures by split).

    Raises:
        TableError: truth and frames do not match row by row.
        CertificateError: a stored pose turns out not to be feasible.
    """
    rows = test_rows(frames)
    for column in ("clip", "frame"):
        if not np.array_equal(frames[column][rows], truth[column]):
            raise TableError("ground_truth and skeletons hold different frames; dvc repro truth")
    human = frames["x"][rows]
    z = human
    net = None
    if entry.model:
        net, _ = artifact.load_model(model, method=entry.model, robot_hash=machine.tag)
        z = artifact.encode_x(net, human)
    checker = machine.certifier()
    if pool is None:
        q = artifact.decode_q(net, z).astype(float)
        if progress:
            progress(len(q))
        found = np.full(len(q), -1, np.int32)
        report = checker.check(q, progress)
    else:
        found, _ = index.look_up(*comparable(pool, z, metric, net), progress)
        q = pool["q"][found]
        report = checker.require(q, machine.margin, progress)
    x = batch.skeletons(machine.chain, q)
    scored = score(x, truth["x"], human, machine.followed)
    split = frames["split"][rows]
    columns = {
        "method": np.full(len(rows), name),
        "split": split,
        "clip": frames["clip"][rows],
        "frame": frames["frame"][rows],
        "time": frames["time"][rows],
        "row": found.astype(np.int32),
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
        figures[part] = summary(
            frames["clip"][rows][at],
            type(scored)(*(values[at] for values in scored)),
            Report(*(values[at] for values in report)),
            machine.margin,
        )
        figures[part]["all"]["pool"] = len(pool["z"]) if pool is not None else 0
    return columns, figures


def comparable(
    pool: Columns, z: np.ndarray, metric: str, net: artifact.Model | None
) -> tuple[np.ndarray, np.ndarray, str]:
    """Stored vectors, queries, and which of index.METRICS they are to be compared by.

    "decoded" compares what latents decode to, P^X(z); "mahalanobis" their best linear guess at
    the skeleton (index.to_skeletons); both by L2.
    """
    stored = pool["z"]
    if metric == "decoded":
        stored, z, metric = artifact.decode_x(net, stored), artifact.decode_x(net, z), "l2"
    elif metric == "mahalanobis":
        onto = index.to_skeletons(stored, pool["x"])
        stored, z, metric = stored @ onto, z @ onto, "l2"
    return stored, np.asarray(z, np.float32), metric
