"""What an entry of the comparison answers: certified again, and scored against the right thing."""

import numpy as np
import pytest
from worlds import MARGIN, coman, relaxed

from s3le.errors import CertificateError, TableError
from s3le.kernels import batch
from s3le.learn.methods import ENTRIES
from s3le.search import metrics
from s3le.skeleton import cosine_distance
from s3le.study import comparison
from s3le.study.comparison import Answered

N = 6
LOOKED_UP = [name for name, entry in ENTRIES.items() if entry.pool and not entry.online]
ONLINE = [name for name, entry in ENTRIES.items() if entry.online]
DECODED = [name for name, entry in ENTRIES.items() if not entry.pool and not entry.online]


def feasible(seed):
    made = coman()
    return batch.project(made.chain, made.anchor, relaxed(made, N, seed), MARGIN).q


def situation():
    """Frames of two splits, their ground truth, and poses that are neither."""
    made = coman()
    human, best = (batch.skeletons(made.chain, feasible(seed)) for seed in (1, 2))
    frames = {
        "split": np.array(["test"] * 4 + ["demo"] * 2),
        "clip": np.array(["a"] * 4 + ["b"] * 2),
        "frame": np.arange(N),
        "time": np.arange(N) / 30.0,
        "x": human,
    }
    return frames, {"clip": frames["clip"], "frame": frames["frame"], "x": best}


def answer(q, mode="lookup"):
    return Answered(q, np.arange(N), np.full(N, mode), "skeleton", 99)


def judged(name, q):
    frames, truth = situation()
    return comparison.judge(coman(), name, ENTRIES[name], frames, truth, answer(q))


@pytest.mark.parametrize("name", ["skeleton_poses", *DECODED])
def test_to_truth_is_the_distance_to_the_ground_truth_and_to_human_that_to_the_human(name):
    frames, truth = situation()
    q = feasible(3)
    columns, figures = judged(name, q)
    x = batch.skeletons(coman().chain, q)
    to_truth, to_human = cosine_distance(x, truth["x"]), cosine_distance(x, frames["x"])
    assert np.allclose(columns["to_truth"], to_truth) and np.allclose(columns["to_human"], to_human)
    assert np.abs(to_truth - to_human).min() > 1e-3  # so that one can not stand for the other
    for split in ("test", "demo"):
        at = frames["split"] == split
        found = figures[split]["all"]
        assert found["to_truth"] == pytest.approx(to_truth[at].mean())
        assert found["to_human"] == pytest.approx(to_human[at].mean())
        assert found["frames"] == at.sum() and found["pool"] == 99
    assert (columns["x"] == x).all() and (columns["q"] == q).all()
    report = coman().certifier().check(q)
    assert (columns["clearance"] == report.clearance).all()
    assert (columns["limit_margin"] == report.limit_margin).all()


@pytest.mark.parametrize("name", [*LOOKED_UP, *ONLINE])
@pytest.mark.parametrize("what", ["collides", "is nearer than the margin", "is outside a limit"])
def test_what_was_looked_up_or_streamed_is_certified_again(name, what):
    q, made = feasible(3), coman()
    if what == "collides":
        q[4] = 0.0  # arms down: the hands are in the thighs
    elif what == "is outside a limit":
        q[4, 0] = made.upper[0] + 1e-9
    else:
        low, high = made.anchor, np.zeros(11)  # bisected to half the margin
        for _ in range(50):
            middle = (low + high) / 2
            clear = made.certifier().check(middle[None]).clearance[0] >= MARGIN / 2
            low, high = (middle, high) if clear else (low, middle)
        q[4] = low
    with pytest.raises(CertificateError, match="1 of 6 poses are not feasible; row 4"):
        judged(name, q)


@pytest.mark.parametrize("name", DECODED)
def test_what_a_decoder_answers_is_measured_and_counted(name):
    q = feasible(3)
    q[0], q[5, 0] = 0.0, np.nan
    columns, figures = judged(name, q)
    assert figures["test"]["all"]["collision_rate"] == 0.25
    assert figures["demo"]["all"]["collision_rate"] == 0.5  # NaN counts as colliding
    assert columns["clearance"][0] < 0.0 and np.isnan(columns["clearance"][5])


@pytest.mark.parametrize("column", ["clip", "frame"])
def test_a_truth_of_other_frames_is_refused(column):
    frames, truth = situation()
    truth[column] = truth[column][::-1]
    with pytest.raises(TableError, match="hold different frames; dvc repro truth"):
        comparison.judge(
            coman(), "skeleton_poses", ENTRIES["skeleton_poses"], frames, truth, answer(feasible(3))
        )


def test_a_look_up_answers_with_the_row_whose_stored_vector_is_nearest():
    frames, _ = situation()
    q = feasible(5)
    pool = {"q": q, "z": frames["x"][::-1].astype(np.float32), "x": frames["x"]}
    entry = ENTRIES["skeleton_poses"]
    found = comparison.stored(coman(), entry, frames["x"], pool, None, metrics.LATENT_METRICS[0])
    assert found.row.tolist() == list(range(N))[::-1] and (found.q == q[::-1]).all()
    assert set(found.mode) == {"lookup"} and found.pool == N
